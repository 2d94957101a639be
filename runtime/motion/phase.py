"""Phase over time: the ±1 s window of Eq. 1's vectors that the network reads and writes."""

from __future__ import annotations

import numpy as np

from runtime.arrays import Array
from runtime.motion.features import FUTURE_PHASE_OFFSETS, PHASE_OFFSETS

PRESENT = int(-PHASE_OFFSETS[0])  # index of the current frame in the dense window of 121 frames
_FRAMES = np.arange(FUTURE_PHASE_OFFSETS[-1] + 1)
# the shares (61, 7) of the samples in every frame
_BETWEEN = np.maximum(1.0 - np.abs(_FRAMES[:, None] - FUTURE_PHASE_OFFSETS) / FUTURE_PHASE_OFFSETS[1], 0.0)


def dense_future(samples: Array) -> Array:
    """Vectors of every frame `(..., 61, C, 2)` from the network's seven samples `(..., 7, C, 2)`.

    Interpolated in amplitude and angle: between samples that are a sixth of a second apart the chord would
    shorten the amplitude of a stepping rhythm by a fifth.
    """
    sine, cosine = samples[..., 0], samples[..., 1]
    amplitude = _BETWEEN @ np.sqrt(sine * sine + cosine * cosine)
    angle = _BETWEEN @ unwrapped(np.arctan2(sine, cosine))
    result = np.empty((*angle.shape, 2))
    np.multiply(amplitude, np.sin(angle), out=result[..., 0])
    np.multiply(amplitude, np.cos(angle), out=result[..., 1])
    return result


def unwrapped(angle: Array) -> Array:
    """Angles `(..., n, m)` without turns of 2 pi from one of the n to the next: `np.unwrap`, which costs five times as much."""
    steps = angle[..., 1:, :] - angle[..., :-1, :]
    result = angle.copy()
    result[..., 1:, :] -= 2.0 * np.pi * np.cumsum(np.round(steps / (2.0 * np.pi)), axis=-2)
    return result


def advance_phase(window: Array, samples: Array) -> Array:
    """The dense window `(..., 121, C, 2)` one frame on, with the network's forecast `(..., 7, C, 2)` of present and future."""
    moved = np.empty_like(window)
    moved[..., :PRESENT, :, :] = window[..., 1 : PRESENT + 1, :, :]
    moved[..., PRESENT:, :, :] = dense_future(samples)
    return moved


def at_rate(before: Array, window: Array, rate: Array) -> Array:
    """The window `(N, 121, C, 2)` that follows `before`, with its present and future turned back to `rate` `(N,)` of the frame's way."""
    if (rate == 1.0).all():
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
