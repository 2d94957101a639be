"""Limits the speed of the hands in a stop to that of the steady movement before it.

Where a walk ends, the network, body edits and swings bring the arms to rest at their own times, which together throw a hand
faster than any step did. Captured hands are at most 1.2 times as fast in a stop as before it (docs/results/moments.md).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from math import sqrt

import numpy as np

from runtime import rotations
from runtime.arrays import Array
from runtime.motion.features import DT
from runtime.scalar_math import MIN_DIVISOR, decay
from runtime.skeleton import SPORT_SKELETON

ARMS = np.array(
    [
        [SPORT_SKELETON.index(side + name) for name in ("Shoulder", "Arm", "ForeArm", "Hand")]
        for side in ("Left", "Right")
    ]
)
HANDS = ARMS[:, -1]
STOP_RATIO = 1.05  # speed limit in a stop, relative to the usual speed
USUAL_HALF_LIFE_S = 1.0  # in which the usual speed is forgotten
MIN_LIMIT_M_PER_S = 0.2
STOP_S = 2.5  # after the stick's release: later, hands are free
RELEASE_M_PER_S2 = 8.0  # growth of the limit when it ends
UNLIMITED_M_PER_S = 20.0
_FORGETS = decay(USUAL_HALF_LIFE_S)


@dataclass
class HandSpeed:
    """Usual speed of the hands of N characters and their present limit, all `(N,)`."""

    # m/s, relative to the hips
    usual: Array = field(default_factory=lambda: np.zeros(1), metadata={"shape": ()})
    limit: Array = field(default_factory=lambda: np.full(1, UNLIMITED_M_PER_S), metadata={"shape": ()})
    # s since the stick was released
    stopped: Array = field(default_factory=lambda: np.full(1, STOP_S), metadata={"shape": ()})
    # m, both hands relative to the hips; 0 before the first frame
    before: Array = field(default_factory=lambda: np.zeros((1, 2, 3)), metadata={"shape": (2, 3)})

    def apply(self, hips: Array, local: Array, positions: Array, last: Array, stops: Sequence[bool]) -> None:
        """Slow down arms of local rotations `(N, 31, 4)` in place; `stops` says which characters come to rest.

        `hips` is `(N, 3)`; `positions` `(N, 31, 3)` and `last` `(N, 31, 4)` are the poses shown in the last frame.
        """
        hands = positions[:, HANDS].astype(np.float64) - positions[:, :1]
        known = self.before.any((1, 2))
        speeds = np.sqrt(((hands - self.before) ** 2).sum(-1)).max(-1) / DT * known
        self.before = hands
        usual, limits, since = self.usual.tolist(), self.limit.tolist(), self.stopped.tolist()
        for i, (stop, speed) in enumerate(zip(stops, speeds.tolist(), strict=True)):
            since[i] = min(since[i] + DT, STOP_S) if stop else 0.0
            if not stop:
                usual[i] = max(usual[i] * _FORGETS, speed)
            if stop and since[i] < STOP_S:
                limits[i] = max(STOP_RATIO * usual[i], MIN_LIMIT_M_PER_S)
            else:
                limits[i] = min(limits[i] + RELEASE_M_PER_S2 * DT, UNLIMITED_M_PER_S)
            if limits[i] < UNLIMITED_M_PER_S:
                self._slow(i, hips[i], local, hands[i], last[i], limits[i])
        self.usual, self.limit, self.stopped = np.array(usual), np.array(limits), np.array(since)

    def _slow(self, i: int, hips: Array, local: Array, hands: Array, last: Array, limit: float) -> None:
        """Turn the arms of one character only so far that neither hand exceeds the limit (m/s)."""
        both = np.stack([local[i], local[i]])
        both[0, ARMS] = last[ARMS]  # where the hands get without the arms
        positions, _ = SPORT_SKELETON.forward_kinematics(np.stack([hips, hips]), both)
        start, end = positions[:, HANDS].astype(np.float64) - positions[:, :1] - hands
        for joints, a, b in zip(ARMS, start, end, strict=True):
            share = share_within(a, b - a, limit * DT)
            if share < 1.0:
                local[i, joints] = rotations.slerp(last[joints], local[i, joints], share)


def share_within(start: Array, way: Array, most: float) -> float:
    """Return the largest share, 0 to 1, of `way` after `start` that ends within `most` metres of 0, or the nearest to it."""
    if float((start + way) @ (start + way)) <= most * most:
        return 1.0
    size = max(float(way @ way), MIN_DIVISOR)
    middle = -float(start @ way) / size
    root = middle * middle - (float(start @ start) - most * most) / size
    return min(max(middle + sqrt(max(root, 0.0)), 0.0), 1.0)
