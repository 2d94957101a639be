"""What one simulated frame shows, records and hands on: an immutable pose of the SPORT skeleton."""

from __future__ import annotations

from dataclasses import dataclass

from runtime.arrays import Array

FPS = 60  # frames a second, of the network and of every clip
DT = 1.0 / FPS  # seconds of a frame


@dataclass(frozen=True)
class Pose:
    """One frame in world space (metres, Y up), after foot lock and leg IK.

    `positions` and `world_rotations` are forward kinematics of `hips_position` and `local_rotations`.
    """

    hips_position: Array  # (3,)
    local_rotations: Array  # (31, 4) relative to the parent joint
    positions: Array  # (31, 3)
    world_rotations: Array  # (31, 4)
    contacts: Array  # (4,) 0..1: left heel, left toe, right heel, right toe
    root_position: Array  # (3,) hips projected to the ground
    root_yaw: float  # radians about +Y; 0 faces +Z
