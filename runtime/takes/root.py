"""The root of a take: a smoothly moving point on the ground under the character, and its facing."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from runtime import rotations
from runtime.arrays import Array
from runtime.feet.skating import SOLE_HEIGHTS, SOLE_POINTS
from runtime.motion import features
from runtime.takes.clip import Clip
from runtime.terrain.height_map import Terrain

SMOOTHING_S = 0.3  # standard deviation of the Gaussian: steps and sway stay in the hips, turns in the root


@dataclass(frozen=True)
class RootTrack:
    """Root positions `(T, 3)` on the ground (metres) and `yaw` `(T,)` in radians without jumps, per frame."""

    positions: Array
    yaw: Array

    def cut(self, first: int, last: int) -> RootTrack:
        """Return the root of frames `first` to `last`."""
        return RootTrack(self.positions[first : last + 1], self.yaw[first : last + 1])

    def moved(self, placement: Placement) -> RootTrack:
        """Return the root transformed by a placement."""
        return RootTrack(placement.points(self.positions), self.yaw + placement.yaw)


@dataclass(frozen=True)
class Placement:
    """A rotation about +Y by `yaw` (radians), then a translation by `offset` `(3,)`, which moves a take and its ground."""

    yaw: float = 0.0
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)

    @property
    def identity(self) -> bool:
        """Whether it changes nothing."""
        return self == Placement()

    def points(self, points: Array) -> Array:
        """Return points `(..., 3)` transformed, float64."""
        turned = rotations.rotate(rotations.from_yaw(self.yaw), np.asarray(points, np.float64))
        return turned + np.array(self.offset)

    def matrix(self) -> Array:
        """Return the transform as a matrix `(4, 4)`."""
        result = np.eye(4)
        result[:3, :3] = rotations.to_matrix(rotations.from_yaw(self.yaw))
        result[:3, 3] = self.offset
        return result

    def inverse(self) -> Placement:
        """Return the inverse transform."""
        turned = rotations.rotate(rotations.from_yaw(-self.yaw), np.array(self.offset))
        x, y, z = (0.0 - float(v) for v in turned)
        return Placement(-self.yaw, (x, y, z))

    def clip(self, clip: Clip) -> Clip:
        """Return a clip transformed."""
        local = np.array(clip.local_rotations, np.float64)
        local[:, 0] = rotations.multiply(rotations.from_yaw(self.yaw), local[:, 0])
        return clip.posed(self.points(clip.hips_positions), local)


def root_track(clip: Clip, terrain: Terrain | None = None) -> RootTrack:
    """Return the root of a clip: smoothed hips and heading on the `terrain`, or else at the height of its lowest sole."""
    positions, _ = clip.world()
    hips = np.asarray(clip.hips_positions, np.float64)
    heading = np.unwrap(features.facing_yaw(positions).astype(np.float64))
    deviation = SMOOTHING_S * clip.fps
    track = smooth(np.column_stack([hips[:, [0, 2]], heading]), deviation)
    x, z, yaw = track.T
    if terrain is None:
        soles = positions[:, list(SOLE_POINTS), 1] - np.array(SOLE_HEIGHTS)
        ground = np.full(len(x), float(soles.min()))
    else:
        ground = smooth(terrain.height(x, z)[:, None].astype(np.float64), deviation)[:, 0]
    return RootTrack(np.column_stack([x, ground, z]), yaw)


def smooth(values: Array, deviation: float) -> Array:
    """Return values `(T, n)` smoothed by a Gaussian (standard deviation in frames); the first and last values are kept."""
    reach = min(round(3.0 * deviation), len(values) - 1)
    if reach < 1:
        return np.array(values, np.float64)
    before = 2.0 * values[0] - values[reach:0:-1]
    after = 2.0 * values[-1] - values[-2 : -reach - 2 : -1]
    padded = np.concatenate([before, values, after])
    kernel = np.exp(-0.5 * (np.arange(-reach, reach + 1) / deviation) ** 2)
    kernel /= kernel.sum()
    return np.column_stack([np.convolve(column, kernel, "valid") for column in padded.T])
