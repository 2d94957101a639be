"""A clock for what goes on moving in a standing body: a waving hand.

The phase is the network's only clock, and at rest its forecast stands still. In a style whose channel swings at rest, that
channel's phases are turned at the style's own rate in place of the forecast; every other channel stays the network's.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from runtime.arrays import Array
from runtime.motion.features import FPS, PHASE_OFFSETS, C
from runtime.spring import decay

# A fit that is linear in the words of the arms finds 1.33 to 3.3 at 1.0 to 1.9 turns a second for waving hands, and up to
# 1.25 at 0.93 in styles that nobody asked to wave.
LEAST_AMPLITUDE = 1.3
LEAST_RATE = 0.97  # turns a second, of the same fit
FULL_AMPLITUDE = 2.0  # of a waving hand in capture
RATES = (0.7, 2.0)  # turns a second
STANDING = 0.9  # of the gait's label
SET_IN = 0.25  # seconds, half-life, in which the clock takes over and leaves
LEAST_SHARE = 0.01
_SECONDS = np.arange(PHASE_OFFSETS[0], PHASE_OFFSETS[-1] + 1) / FPS
_PRESENT = int(-PHASE_OFFSETS[0])


@dataclass
class RestRhythm:
    """The clocks of N characters, from frame to frame."""

    share: Array = field(metadata={"shape": (C,)})  # (N, C) that each has taken over
    turns: Array = field(metadata={"shape": (C,)})  # (N, C) of the clocks

    @staticmethod
    def silent(count: int = 1) -> RestRhythm:
        """Nothing swings."""
        return RestRhythm(np.zeros((count, C)), np.zeros((count, C)))

    def apply(self, phase: Array, rest: Array, standing: Array) -> Array:
        """The windows `(N, 121, C, 2)` of this frame; `rest` `(N, C, 2)` are the styles' amplitudes and rates, `standing` `(N,)` 0 to 1."""
        swings = (
            (rest[..., 0] > LEAST_AMPLITUDE) & (rest[..., 1] > LEAST_RATE) & (standing[:, None] > STANDING)
        )
        if not swings.any() and not self.share.any():
            return phase
        full = FULL_AMPLITUDE / np.maximum(rest[..., 0], LEAST_AMPLITUDE)
        rate = np.clip(full * rest[..., 1], *RATES)
        now = phase[:, _PRESENT]
        begins = self.share == 0.0
        turns = np.where(begins, np.arctan2(now[..., 0], now[..., 1]) / (2 * np.pi), self.turns)
        self.turns = turns + rate / FPS
        share = self.share + (swings - self.share) * (1.0 - decay(SET_IN))
        self.share = np.where(swings | (share > LEAST_SHARE), share, 0.0)
        angle = 2 * np.pi * (self.turns[:, None] + rate[:, None] * _SECONDS[:, None])
        clock = FULL_AMPLITUDE * np.stack([np.sin(angle), np.cos(angle)], axis=-1)
        return np.asarray(phase + self.share[:, None, :, None] * (clock - phase))
