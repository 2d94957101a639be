"""Phase over time: the ±1 s window of Eq. 1's vectors that the network reads and writes.

The phase is the network's only clock, and its forecast stops at rest. In a style with a gesture at rest (a waving
hand) the channel of that gesture advances at the style's own rate; every other channel stays the network's.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from runtime.arrays import Array
from runtime.motion.features import FPS, PHASE_OFFSETS, SAMPLE_STEP, C
from runtime.scalar_math import decay

PRESENT = int(-PHASE_OFFSETS[0])  # index of the current frame in the dense window of 121 frames
# forecast of each coming frame: only the samples' frames are read
_NEAREST = np.arange(PRESENT + 1) // SAMPLE_STEP


def advance_phase(window: Array, samples: Array) -> Array:
    """Return the window `(N, 121, C, 2)` one frame later, with the network's forecast `(N, 7, C, 2)` of present and future."""
    return np.concatenate([window[:, 1 : PRESENT + 1], samples.take(_NEAREST, 1)], 1)


def at_rate(before: Array, window: Array, rate: Array) -> Array:
    """Return the phase window `(N, 121, C, 2)` slowed: its present and future advance only by the fraction `rate` `(N,)`."""
    if all(each == 1.0 for each in rate.tolist()):
        return window
    old, new = before[:, PRESENT], window[:, PRESENT]
    turn = np.arctan2(new[..., 0], new[..., 1]) - np.arctan2(old[..., 0], old[..., 1])
    turn = (turn + np.pi) % (2.0 * np.pi) - np.pi
    angle = ((rate[:, None] - 1.0) * turn)[:, None]
    sine, cosine = np.sin(angle), np.cos(angle)
    s, c = window[:, PRESENT:, :, 0], window[:, PRESENT:, :, 1]
    result = window.copy()
    result[:, PRESENT:, :, 0], result[:, PRESENT:, :, 1] = s * cosine + c * sine, c * cosine - s * sine
    return result


# A fit that is linear in the arm descriptions finds amplitudes of 1.33 to 3.3 at 1.0 to 1.9 turns a second for waving hands,
# and up to 1.25 at 0.93 in styles that do not wave.
MIN_GESTURE_AMPLITUDE = 1.3
MIN_GESTURE_RATE_HZ = 0.97  # from the same fit
FULL_GESTURE_AMPLITUDE = 2.0  # of a waving hand in capture
RATE_RANGE_HZ = (0.7, 2.0)  # turns a second
STANDING_LABEL_FRACTION = 0.9  # of the gait's label
CLOCK_HALF_LIFE_S = 0.25  # in which the clock fades in and out
MIN_CLOCK_WEIGHT = 0.01
_SECONDS = np.arange(PHASE_OFFSETS[0], PHASE_OFFSETS[-1] + 1) / FPS
_PRESENT = int(-PHASE_OFFSETS[0])


@dataclass
class RestRhythm:
    """Gesture phases of N standing characters, carried from frame to frame."""

    fraction: Array = field(metadata={"shape": (C,)})  # (N, C) weight of each channel's clock
    turns: Array = field(metadata={"shape": (C,)})  # (N, C) position of the clocks, in turns

    @staticmethod
    def silent(count: int = 1) -> RestRhythm:
        """Return the state without gestures."""
        return RestRhythm(np.zeros((count, C)), np.zeros((count, C)))

    def apply(self, phase: Array, styles: Sequence[Array], standing: Array) -> Array:
        """Return the phase windows `(N, 121, C, 2)` of this frame with the styles' gestures at rest.

        `styles` are amplitudes and rates `(C, 2)` at rest, `standing` `(N,)` is 0 to 1.
        """
        if max(standing.tolist()) <= STANDING_LABEL_FRACTION and not np.count_nonzero(self.fraction):
            return phase
        rest = np.stack(styles)
        swings = (
            (rest[..., 0] > MIN_GESTURE_AMPLITUDE)
            & (rest[..., 1] > MIN_GESTURE_RATE_HZ)
            & (standing[:, None] > STANDING_LABEL_FRACTION)
        )
        if not swings.any() and not np.count_nonzero(self.fraction):
            return phase
        full = FULL_GESTURE_AMPLITUDE / np.maximum(rest[..., 0], MIN_GESTURE_AMPLITUDE)
        rate = np.clip(full * rest[..., 1], *RATE_RANGE_HZ)
        now = phase[:, _PRESENT]
        begins = self.fraction == 0.0
        turns = np.where(begins, np.arctan2(now[..., 0], now[..., 1]) / (2 * np.pi), self.turns)
        self.turns = turns + rate / FPS
        fraction = self.fraction + (swings - self.fraction) * (1.0 - decay(CLOCK_HALF_LIFE_S))
        self.fraction = np.where(swings | (fraction > MIN_CLOCK_WEIGHT), fraction, 0.0)
        angle = 2 * np.pi * (self.turns[:, None] + rate[:, None] * _SECONDS[:, None])
        clock = FULL_GESTURE_AMPLITUDE * np.stack([np.sin(angle), np.cos(angle)], axis=-1)
        return np.asarray(phase + self.fraction[:, None, :, None] * (clock - phase))
