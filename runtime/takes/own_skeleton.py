"""The original skeleton of a retargeted motion as points, to show beside it and to store."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from runtime.arrays import Array

MAX_POINTS = 1024  # joints and the ends of their bones
STEP_M = 0.0005  # resolution of a stored position
_REACH_M = 16.0  # range of a point from the middle, when stored


@dataclass(frozen=True, eq=False)
class OwnSkeleton:
    """The joint and bone-end positions `(T, K, 3)` float32 (metres) of the original skeleton of a retargeted clip, at its rate."""

    parents: tuple[int, ...]  # index of each point's parent, -1 without one
    points: Array

    def sample(self, frame: float) -> Array:
        """Return the points `(K, 3)` at a fractional frame, interpolated linearly."""
        frame = min(max(frame, 0.0), len(self.points) - 1.0)
        first = int(frame)
        after = self.points[min(first + 1, len(self.points) - 1)]
        return np.asarray(self.points[first] + (frame - first) * (after - self.points[first]), np.float64)

    def packed(self) -> tuple[Array, bytes]:
        """Return the median point `(T, 3)` float32 and the points relative to it as quantised temporal differences."""
        middle = np.median(self.points, axis=1, keepdims=True).astype(np.float32)
        about = np.clip(self.points - middle, -_REACH_M, _REACH_M)
        steps = np.round(about / STEP_M).astype(np.int16)
        return middle[:, 0], np.diff(steps, axis=0, prepend=np.zeros_like(steps[:1])).astype("<i2").tobytes()

    @staticmethod
    def unpacked(parents: tuple[int, ...], middle: Array, data: bytes) -> OwnSkeleton:
        """Return the skeleton that `packed` packed; ValueError if its parts do not fit each other."""
        frames, count = len(middle), len(parents)
        fits = 0 < count <= MAX_POINTS and len(data) == 2 * 3 * frames * count and frames > 0
        if not fits or any(not -1 <= parent < count for parent in parents) or not np.isfinite(middle).all():
            raise ValueError(f"a skeleton of {count} points")
        steps = np.cumsum(np.frombuffer(data, "<i2").reshape(frames, count, 3), axis=0, dtype=np.int64)
        about = np.clip(steps * STEP_M, -_REACH_M, _REACH_M)
        return OwnSkeleton(parents, (middle[:, None] + about).astype(np.float32))
