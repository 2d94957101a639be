"""How much of the root's speed the feet carry.

A network that is asked to go on at a speed moves its root at that speed, even where its legs take shorter steps: planted
feet then slide, and hands, hips and shoulders swing as little as such steps need. What a planted foot goes back at, seen
from the root, is the speed of the steps; the regulator holds that to the request, and the strides become long enough.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from runtime.feet.skating import SOLE_POINTS
from runtime.motion.features import FPS
from runtime.motion.trajectory import decay

Array = NDArray[np.floating]

POINTS = list(SOLE_POINTS)  # left heel, left toe, right heel, right toe, as contacts
LEAST_CONTACT = 0.25  # sum of squared contacts: less is a flight, which says nothing
RANGE = (0.5, 1.5)  # of the share
SMOOTHING = 0.3  # seconds, half-life: about a step
SLOWEST = 0.3  # m/s: slower, feet may well rest


class Stride:
    """The speed of the planted feet over that of the root, from frame to frame."""

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget the steps so far."""
        self._feet: Array | None = None
        self.share = 1.0

    def update(self, joints: Array, contacts: Array, speed: float) -> float:
        """The share, given joints `(31, 3)` relative to the root, contacts `(4,)` and the root's smoothed speed in m/s."""
        feet = joints[POINTS][:, [0, 2]]
        before, self._feet = self._feet, feet
        if before is None or speed < SLOWEST:
            self.share += (1.0 - self.share) * (1.0 - decay(SMOOTHING))
            return self.share
        weights = np.square(np.clip(contacts, 0.0, 1.0))
        total = float(weights.sum())
        if total > LEAST_CONTACT:
            back = float(np.linalg.norm(weights @ (feet - before))) * FPS / total
            share = min(max(back / speed, RANGE[0]), RANGE[1])
            self.share += (share - self.share) * (1.0 - decay(SMOOTHING))
        return self.share
