"""Where the character was and is asked to go: ±1 s of root path, facing and gait, blended from stick and network."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sport.runtime.motion import features
from sport.runtime.motion.features import FPS, GAITS, TRAJECTORY_OFFSETS

Array = NDArray[np.floating]

PRESENT = 60  # index of the current frame in the dense ±60 frame window
LENGTH = 2 * PRESENT + 1

# How strongly the stick overrules the network along the coming second: 1 - (1 - t)^bias at time t of it.
POSITION_BIAS = 8.0
DIRECTION_BIAS = 3.0
VELOCITY_HALF_LIFE = 0.09  # seconds in which the asked velocity covers half of a change of the stick
FACING_HALF_LIFE = 0.09
GAIT_HALF_LIFE = 0.10


def decay(half_life: float, dt: float = 1.0 / FPS) -> float:
    """Fraction of a difference that is left after `dt` seconds."""
    return float(0.5 ** (dt / half_life))


def wrap_angle(angle: Array | float) -> Array:
    """Angles in radians brought to -pi..pi."""
    return (np.asarray(angle) + np.pi) % (2 * np.pi) - np.pi


class Trajectory:
    """Dense window of 121 frames: `xz` `(121, 2)`, unwrapped `yaw` `(121,)`, `gait` `(121, 6)`."""

    def __init__(self, x: float = 0.0, z: float = 0.0, yaw: float = 0.0) -> None:
        self.xz = np.tile(np.array([x, z]), (LENGTH, 1))
        self.yaw = np.full(LENGTH, float(yaw))
        self.gait = np.zeros((LENGTH, GAITS))
        self.gait[:, 0] = 1.0
        self.velocity = np.zeros(2)  # smoothed wish, m/s
        self.wished_yaw = float(yaw)

    @property
    def samples(self) -> NDArray[np.integer]:
        """Indices of the network's 12 samples."""
        return TRAJECTORY_OFFSETS + PRESENT

    @property
    def directions(self) -> Array:
        """Unit facing directions `(121, 2)`."""
        return np.stack([np.sin(self.yaw), np.cos(self.yaw)], axis=-1)

    def steer(self, velocity: Array, facing_yaw: float | None, gait: Array) -> None:
        """Blend the wish (m/s, radians, one-hot) into the coming second."""
        self.velocity += (velocity - self.velocity) * (1 - decay(VELOCITY_HALF_LIFE))
        if facing_yaw is not None:
            turn = wrap_angle(facing_yaw - self.wished_yaw)
            self.wished_yaw += float(turn) * (1 - decay(FACING_HALF_LIFE))
        t = np.arange(1, LENGTH - PRESENT) / (LENGTH - PRESENT - 1)
        along = (1 - (1 - t) ** POSITION_BIAS)[:, None]
        increments = np.diff(self.xz[PRESENT:], axis=0)
        increments += (self.velocity / FPS - increments) * along
        self.xz[PRESENT + 1 :] = self.xz[PRESENT] + np.cumsum(increments, axis=0)
        around = 1 - (1 - t) ** DIRECTION_BIAS
        self.yaw[PRESENT + 1 :] += wrap_angle(self.wished_yaw - self.yaw[PRESENT + 1 :]) * around
        present = self.gait[PRESENT]
        self.gait[PRESENT:] = present + (gait - present) * (1 - decay(GAIT_HALF_LIFE))

    def advance(self, displacement: Array, turn: float, positions: Array, directions: Array) -> None:
        """Move on by one frame: displacement `(2,)` metres and turn in radians, in world space.

        `positions`, `directions` `(6, 2)` are the network's coming samples (0, 10 ... 50 frames on), in world space.
        """
        for array in (self.xz, self.yaw, self.gait):
            array[:PRESENT] = array[1 : PRESENT + 1]
        self.xz[PRESENT] = self.xz[PRESENT] + displacement
        self.yaw[PRESENT] = self.yaw[PRESENT] + turn
        at = features.FUTURE_OFFSETS.astype(float)
        frames = np.arange(1, LENGTH - PRESENT)
        for axis in range(2):
            shifted = positions[:, axis] - positions[0, axis]
            path = np.interp(frames, at, shifted)
            slope = (shifted[-1] - shifted[-2]) / (at[-1] - at[-2])
            beyond = np.maximum(frames - at[-1], 0.0)
            self.xz[PRESENT + 1 :, axis] = self.xz[PRESENT, axis] + path + slope * beyond
        angle = np.arctan2(directions[:, 0], directions[:, 1])
        relative = wrap_angle(angle - self.yaw[PRESENT])
        self.yaw[PRESENT + 1 :] = self.yaw[PRESENT] + np.interp(frames, at, np.unwrap(relative))
