"""The root of a take: a point on the ground under the character that moves smoothly, and where it faces."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from runtime import rotations
from runtime.arrays import Array
from runtime.feet.skating import SOLE_HEIGHTS, SOLE_POINTS
from runtime.motion import features
from runtime.takes.clip import Clip
from runtime.terrain.height_map import Terrain

SMOOTHING_S = 0.3  # deviation of the Gaussian: steps and sway stay in the hips, turns in the root


@dataclass(frozen=True)
class RootTrack:
    """The root in each frame: `positions` `(T, 3)` metres on the ground, `yaw` `(T,)` radians without jumps."""

    positions: Array
    yaw: Array

    def cut(self, first: int, last: int) -> RootTrack:
        """Return the root in the frames `first` to `last`."""
        return RootTrack(self.positions[first : last + 1], self.yaw[first : last + 1])

    def moved(self, placement: Placement) -> RootTrack:
        """Return the root put elsewhere."""
        return RootTrack(placement.points(self.positions), self.yaw + placement.yaw)


@dataclass(frozen=True)
class Placement:
    """A turn about +Y by `yaw`, then a shift by `offset` `(3,)`: how a take, and its ground, are put elsewhere."""

    yaw: float = 0.0
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)

    @property
    def identity(self) -> bool:
        """Return whether it leaves everything in its place."""
        return self == Placement()

    def points(self, points: Array) -> Array:
        """Return points `(..., 3)` in their new place, float64."""
        turned = rotations.rotate(rotations.from_yaw(self.yaw), np.asarray(points, np.float64))
        return turned + np.array(self.offset)

    def matrix(self) -> Array:
        """Return the transform `(4, 4)` of points."""
        result = np.eye(4)
        result[:3, :3] = rotations.to_matrix(rotations.from_yaw(self.yaw))
        result[:3, 3] = self.offset
        return result

    def inverse(self) -> Placement:
        """Return the placement that undoes this one."""
        turned = rotations.rotate(rotations.from_yaw(-self.yaw), np.array(self.offset))
        x, y, z = (0.0 - float(v) for v in turned)
        return Placement(-self.yaw, (x, y, z))

    def clip(self, clip: Clip) -> Clip:
        """Return a clip put elsewhere."""
        local = np.array(clip.local_rotations, np.float64)
        local[:, 0] = rotations.multiply(rotations.from_yaw(self.yaw), local[:, 0])
        return clip.posed(self.points(clip.hips_positions), local)


def root_track(clip: Clip, terrain: Terrain | None = None) -> RootTrack:
    """Find the root of a clip: hips and heading, smoothed, on the `terrain`, or on the level of its lowest sole without one."""
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
    """Smooth values `(T, n)` by a Gaussian of a deviation in frames; the ends go on as they came, so that they are met."""
    reach = min(round(3.0 * deviation), len(values) - 1)
    if reach < 1:
        return np.array(values, np.float64)
    before = 2.0 * values[0] - values[reach:0:-1]
    after = 2.0 * values[-1] - values[-2 : -reach - 2 : -1]
    padded = np.concatenate([before, values, after])
    kernel = np.exp(-0.5 * (np.arange(-reach, reach + 1) / deviation) ** 2)
    kernel /= kernel.sum()
    return np.column_stack([np.convolve(column, kernel, "valid") for column in padded.T])
