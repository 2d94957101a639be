"""The pose of one simulated frame: an immutable pose of the SPORT skeleton."""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from runtime.arrays import Array

FPS = 60  # frames per second, of the network and of every clip
DT = 1.0 / FPS  # seconds of a frame
MAX_FPS = 1000.0  # of a clip from a file, or of an export
VIDEO_RATES = (24000 / 1001, 24.0, 25.0, 30000 / 1001, 30.0, 48.0, 50.0, 60000 / 1001, 60.0, 120.0)


def video_rate(fps: float) -> float:
    """Return the exact video rate or integer for a rounded rate (29.97 is 30000 / 1001), else the rate to a thousandth."""
    if not isfinite(fps):
        return fps
    nearest = min((*VIDEO_RATES, max(round(fps), 1)), key=lambda rate: abs(fps - rate))
    return float(nearest) if abs(fps - nearest) < 2e-4 * nearest else float(round(fps, 3))


@dataclass(frozen=True)
class Pose:
    """A pose in world space (metres, Y up), after foot lock and leg IK.

    `positions` and `world_rotations` are forward kinematics of `hips_position` and `local_rotations`.
    """

    hips_position: Array  # (3,)
    local_rotations: Array  # (31, 4) relative to the parent joint
    positions: Array  # (31, 3)
    world_rotations: Array  # (31, 4)
    contacts: Array  # (4,) 0..1: left heel, left toe, right heel, right toe
    root_position: Array  # (3,) hips projected to the ground
    root_yaw: float  # radians about +Y; 0 faces +Z
