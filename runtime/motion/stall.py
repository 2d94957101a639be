"""A stall: the root travels while the feet hardly move, because the phases that the network feeds itself stand still.

Advancing them, as a step would, lets the gait catch on again within some tenths of a second.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from runtime.feet.skating import SOLE_POINTS
from runtime.motion.features import FPS
from runtime.motion.trajectory import decay

Array = NDArray[np.floating]

FEET = list(SOLE_POINTS)
STALLED_SHARE = 0.35  # of the requested speed; in a gait feet move against the root about as fast as the root
STALLED_SECONDS = 0.25  # longer than feet rest against the root in the slowest step
SMOOTHING = 0.1  # seconds, half-life of the feet's speed
CYCLES_PER_SECOND = 2.0  # of the phases while stalled


class Stall:
    """Notices a stall from frame to frame."""

    def __init__(self) -> None:
        self._feet: Array | None = None
        self._speed = 0.0
        self._seconds = 0.0

    def reset(self) -> None:
        """Forget the motion so far."""
        self._feet, self._seconds = None, 0.0

    def update(self, joints: Array, requested: float) -> bool:
        """Whether the gait stalls, given joints `(31, 3)` relative to the root and the speed `requested` in m/s, 0 at rest."""
        feet = joints[FEET]
        if self._feet is None:
            self._speed = requested
        else:
            speed = float(np.linalg.norm(feet - self._feet, axis=-1).mean()) * FPS
            self._speed += (speed - self._speed) * (1.0 - decay(SMOOTHING))
        self._feet = feet
        slow = requested > 0.0 and self._speed < STALLED_SHARE * requested
        self._seconds = self._seconds + 1.0 / FPS if slow else 0.0
        return self._seconds > STALLED_SECONDS


def advance_by_cycles(phase: Array, cycles: float) -> Array:
    """Phase vectors `(..., 2)`, amplitude times sine and cosine, advanced by `cycles`."""
    angle = 2.0 * np.pi * cycles
    sine, cosine = np.sin(angle), np.cos(angle)
    s, c = phase[..., 0], phase[..., 1]
    return np.stack([s * cosine + c * sine, c * cosine - s * sine], axis=-1)
