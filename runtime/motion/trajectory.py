"""Where the character was and is requested to go: ±1 s of root path, facing and gait, blended from stick and network."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from runtime.motion import features
from runtime.motion.features import FPS, GAITS, TRAJECTORY_OFFSETS
from runtime.terrain.height_map import Terrain

Array = NDArray[np.floating]

PRESENT = 60  # index of the current frame in the dense ±60 frame window
LENGTH = 2 * PRESENT + 1

# How strongly the stick overrules the network along the coming second: 1 - (1 - t)^bias at time t of it.
POSITION_BIAS = 8.0
DIRECTION_BIAS = 3.0
VELOCITY_HALF_LIFE = 0.09  # seconds in which the requested velocity covers half of a change of the stick
FACING_HALF_LIFE = 0.09
GAIT_HALF_LIFE = 0.10

_AT = features.FUTURE_OFFSETS.astype(float)  # the network's coming samples,
_FRAMES = np.arange(1, LENGTH - PRESENT)  # the coming frames,
_BEFORE = np.minimum(_FRAMES // features.SAMPLE_STEP, len(_AT) - 2)  # the sample before each,
_BEYOND = _AT[-1] <= _FRAMES  # and those after the last sample
_TIME = _FRAMES / (LENGTH - PRESENT - 1)
_ALONG = (1 - (1 - _TIME) ** POSITION_BIAS)[:, None]
_AROUND = 1 - (1 - _TIME) ** DIRECTION_BIAS


def decay(half_life: float, dt: float = 1.0 / FPS) -> float:
    """Fraction of a difference that is left after `dt` seconds."""
    return float(0.5 ** (dt / half_life))


def wrap_angle(angle: Array | float) -> Array:
    """Angles in radians brought to -pi..pi."""
    return (np.asarray(angle) + np.pi) % (2 * np.pi) - np.pi


@dataclass(frozen=True)
class TrajectoryView:
    """What the viewer draws: the 12 samples in world space."""

    positions: Array  # (12, 3)
    directions: Array  # (12, 2)


class Trajectory:
    """Dense window of 121 frames: `xz` `(121, 2)`, unwrapped `yaw` `(121,)`, `gait` `(121, 6)`."""

    def __init__(self, x: float = 0.0, z: float = 0.0, yaw: float = 0.0) -> None:
        self.xz = np.tile(np.array([x, z]), (LENGTH, 1))
        self.yaw = np.full(LENGTH, float(yaw))
        self.gait = np.zeros((LENGTH, GAITS))
        self.gait[:, 0] = 1.0
        self.velocity = np.zeros(2)  # smoothed request, m/s
        self.requested_yaw = float(yaw)

    @property
    def here(self) -> Array:
        """XZ of the root in this frame."""
        result: Array = self.xz[PRESENT]
        return result

    @property
    def samples(self) -> NDArray[np.integer]:
        """Indices of the network's 12 samples."""
        return TRAJECTORY_OFFSETS + PRESENT

    def view(self, terrain: Terrain) -> TrajectoryView:
        """The 12 samples, laid on the terrain."""
        xz = self.xz[self.samples]
        height = terrain.height(xz[:, 0], xz[:, 1])
        return TrajectoryView(np.stack([xz[:, 0], height, xz[:, 1]], -1), self.directions[self.samples])

    @property
    def directions(self) -> Array:
        """Unit facing directions `(121, 2)`."""
        return np.stack([np.sin(self.yaw), np.cos(self.yaw)], axis=-1)

    def steer(self, velocity: Array, facing_yaw: float | None, gait: Array) -> None:
        """Blend the requested velocity (m/s), facing (radians) and gait (one-hot) into the coming second."""
        self.aim(velocity, facing_yaw)
        bend(self.xz, self.yaw, self.gait, self.velocity, self.requested_yaw, gait)

    def aim(self, velocity: Array, facing_yaw: float | None) -> None:
        """Smooth the requested velocity (m/s) and facing (radians; None keeps it)."""
        self.velocity += (velocity - self.velocity) * (1 - decay(VELOCITY_HALF_LIFE))
        if facing_yaw is not None:
            turn = wrap_angle(facing_yaw - self.requested_yaw)
            self.requested_yaw += float(turn) * (1 - decay(FACING_HALF_LIFE))

    def advance(self, displacement: Array, turn: float, positions: Array, directions: Array) -> None:
        """Move on by one frame: see `advance`."""
        advance(self.xz, self.yaw, self.gait, displacement, turn, positions, directions)


def bend(
    xz: Array, yaw: Array, gaits: Array, velocity: Array, requested_yaw: Array | float, gait: Array
) -> None:
    """Blend smoothed velocity `(..., 2)`, facing `(...)` and the one-hot gait `(..., 6)` into the coming second, in place.

    The windows are `(..., 121, 2)`, `(..., 121)` and `(..., 121, 6)`: those of one character or of many.
    """
    increments = np.diff(xz[..., PRESENT:, :], axis=-2)
    increments += (velocity[..., None, :] / FPS - increments) * _ALONG
    xz[..., PRESENT + 1 :, :] = xz[..., PRESENT, None, :] + np.cumsum(increments, axis=-2)
    ahead = yaw[..., PRESENT + 1 :]
    ahead += wrap_angle(np.asarray(requested_yaw)[..., None] - ahead) * _AROUND
    present = gaits[..., PRESENT, :]
    gaits[..., PRESENT:, :] = (present + (gait - present) * (1 - decay(GAIT_HALF_LIFE)))[..., None, :]


def advance(
    xz: Array,
    yaw: Array,
    gaits: Array,
    displacement: Array,
    turn: Array | float,
    positions: Array,
    directions: Array,
) -> None:
    """Move the windows of `bend` on by one frame, in place: displacement `(..., 2)` metres and turn `(...)` radians.

    `positions`, `directions` `(..., 6, 2)` are the network's coming samples (0, 10 ... 50 frames on); all in world space.
    """
    for array in (xz, gaits):
        array[..., :PRESENT, :] = array[..., 1 : PRESENT + 1, :]
    yaw[..., :PRESENT] = yaw[..., 1 : PRESENT + 1]
    xz[..., PRESENT, :] += displacement
    yaw[..., PRESENT] += turn
    for axis in range(2):
        shifted = positions[..., axis] - positions[..., :1, axis]
        slope = (shifted[..., -1:] - shifted[..., -2:-1]) / (_AT[-1] - _AT[-2])
        beyond = np.maximum(_FRAMES - _AT[-1], 0.0)
        xz[..., PRESENT + 1 :, axis] = xz[..., PRESENT, None, axis] + _every_frame(shifted) + slope * beyond
    angle = np.arctan2(directions[..., 0], directions[..., 1])
    relative = wrap_angle(angle - yaw[..., PRESENT, None])
    yaw[..., PRESENT + 1 :] = yaw[..., PRESENT, None] + _every_frame(np.unwrap(relative))


def _every_frame(values: Array) -> Array:
    """Values `(..., 60)` of the coming frames from the six samples `(..., 6)`: `np.interp`, bit by bit, along many rows."""
    slopes = np.diff(values) / np.diff(_AT)
    return np.where(
        _BEYOND, values[..., -1:], slopes[..., _BEFORE] * (_FRAMES - _AT[_BEFORE]) + values[..., _BEFORE]
    )
