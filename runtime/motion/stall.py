"""A stall: the root travels while the feet hardly move, because the phases that the network feeds itself stand still.

Advancing them, as a step would, lets the gait catch on again within some tenths of a second.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from runtime.arrays import Array
from runtime.feet.skating import SOLE_POINTS
from runtime.motion.features import FPS
from runtime.spring import decay

FEET = list(SOLE_POINTS)
STALLED_SHARE = 0.35  # of the requested speed; in a gait feet move against the root about as fast as the root
STALLED_SECONDS = 0.25  # longer than feet rest against the root in the slowest step
SMOOTHING = 0.1  # seconds, half-life of the feet's speed
CYCLES_PER_SECOND = 2.0  # of the phases while stalled


@dataclass
class Stall:
    """What is remembered of the feet of N characters."""

    feet: Array = field(metadata={"shape": (4, 3)})  # (N, 4, 3) relative to the root
    speed: Array = field(metadata={"shape": ()})  # (N,) of the feet, m/s, smoothed
    seconds: Array = field(metadata={"shape": ()})  # (N,) for which they have been slow

    @staticmethod
    def at_rest(joints: Array) -> Stall:
        """Of characters whose joints `(N, 31, 3)` do not move."""
        return Stall(joints[:, FEET], np.zeros(len(joints)), np.zeros(len(joints)))

    def update(self, joints: Array, requested: Array) -> NDArray[np.bool_]:
        """Which gaits stall `(N,)`, given joints `(N, 31, 3)` relative to the root and the `requested` speeds in m/s, 0 at rest."""
        feet = joints[:, FEET]
        moved = feet - self.feet
        speed = np.sqrt((moved * moved).sum(-1)).sum(-1) * (FPS / len(FEET))
        self.speed = self.speed + (speed - self.speed) * (1.0 - decay(SMOOTHING))
        self.feet = feet
        slow = (requested > 0.0) & (self.speed < STALLED_SHARE * requested)
        self.seconds = np.where(slow, self.seconds + 1.0 / FPS, 0.0)
        return np.asarray(self.seconds > STALLED_SECONDS)


def advance_by_cycles(phase: Array, cycles: float) -> Array:
    """Phase vectors `(..., 2)`, amplitude times sine and cosine, advanced by `cycles`."""
    angle = 2.0 * np.pi * cycles
    sine, cosine = np.sin(angle), np.cos(angle)
    s, c = phase[..., 0], phase[..., 1]
    return np.stack([s * cosine + c * sine, c * cosine - s * sine], axis=-1)
