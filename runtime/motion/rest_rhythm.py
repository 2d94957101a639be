"""A clock for what goes on moving in a standing body: a waving hand.

The phase is the network's only clock, and at rest its forecast stands still. In a style whose channel swings at rest, that
channel's phases are turned at the style's own rate in place of the forecast; every other channel stays the network's.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from runtime.motion.features import FPS, PHASE_OFFSETS
from runtime.motion.trajectory import decay

Array = NDArray[np.floating]

# A fit that is linear in the words finds a third to all of what capture has: 0.6 to 2.3 for a waving hand, up to 0.45 else.
LEAST_AMPLITUDE = 0.6
LEAST_RATE = 0.3  # turns a second, of the same fit: resting legs have a high amplitude and do not turn
FULL_AMPLITUDE = 2.0  # of a waving hand in capture
RATES = (0.7, 2.0)  # turns a second
STANDING = 0.9  # of the gait's label
SET_IN = 0.25  # seconds, half-life, in which the clock takes over and leaves
_SECONDS = np.arange(PHASE_OFFSETS[0], PHASE_OFFSETS[-1] + 1) / FPS
_PRESENT = int(-PHASE_OFFSETS[0])


class RestRhythm:
    """The clock of one character, from frame to frame."""

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Nothing swings."""
        self._share: Array | None = None
        self._turns: Array | None = None

    def apply(self, phase: Array, rest: Array, standing: float) -> Array:
        """The window `(121, C, 2)` of this frame; `rest` `(C, 2)` are the style's amplitudes and rates, `standing` 0 to 1."""
        swings = (rest[:, 0] > LEAST_AMPLITUDE) & (rest[:, 1] > LEAST_RATE) & (standing > STANDING)
        full = FULL_AMPLITUDE / np.maximum(rest[:, 0], LEAST_AMPLITUDE)
        rate = np.clip(full * rest[:, 1], *RATES)
        if self._share is None or self._turns is None:
            if not swings.any():
                return phase
            self._share = np.zeros(len(rest))
            now = phase[_PRESENT]
            self._turns = np.arctan2(now[:, 0], now[:, 1]) / (2 * np.pi)
        self._share = self._share + (swings - self._share) * (1.0 - decay(SET_IN))
        self._turns = self._turns + rate / FPS
        angle = 2 * np.pi * (self._turns + rate * _SECONDS[:, None])
        clock = FULL_AMPLITUDE * np.stack([np.sin(angle), np.cos(angle)], axis=-1)
        if not swings.any() and self._share.max() < 0.01:
            self.reset()
            return phase
        return phase + self._share[:, None] * (clock - phase)
