"""A clock for what goes on moving in a standing body: a waving hand.

The phase is the network's only clock, and at rest its forecast stands still. In a style whose channel swings at rest, that
channel's phases are turned at the style's own rate in place of the forecast; every other channel stays the network's.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sport.runtime.motion.features import FPS, PHASE_OFFSETS
from sport.runtime.motion.trajectory import decay

Array = NDArray[np.floating]

LEAST_AMPLITUDE = 1.3  # of a channel that swings at rest: a plain body has up to 0.9, a waving hand 2
LEAST_RATE = 0.5  # turns a second
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
        amplitude, rate = rest[:, 0], rest[:, 1]
        swings = (amplitude > LEAST_AMPLITUDE) & (rate > LEAST_RATE) & (standing > 0.9)
        if self._share is None or self._turns is None:
            if not swings.any():
                return phase
            self._share = np.zeros(len(rest))
            now = phase[_PRESENT]
            self._turns = np.arctan2(now[:, 0], now[:, 1]) / (2 * np.pi)
        self._share = self._share + (swings - self._share) * (1.0 - decay(SET_IN))
        self._turns = self._turns + rate / FPS
        angle = 2 * np.pi * (self._turns + rate * _SECONDS[:, None])
        clock = amplitude[:, None] * np.stack([np.sin(angle), np.cos(angle)], axis=-1)
        if not swings.any() and self._share.max() < 0.01:
            self.reset()
            return phase
        return phase + self._share[:, None] * (clock - phase)
