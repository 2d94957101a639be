"""Phase over time: the ±1 s window of Eq. 1's vectors that the network reads and writes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from runtime.motion.features import FUTURE_PHASE_OFFSETS, PHASE_OFFSETS

Array = NDArray[np.floating]

PRESENT = int(-PHASE_OFFSETS[0])  # index of the current frame in the dense window of 121 frames


def dense_future(samples: Array) -> Array:
    """Vectors of every frame `(..., 61, C, 2)` from the network's seven samples `(..., 7, C, 2)`.

    Interpolated in amplitude and angle: between samples that are a sixth of a second apart the chord would
    shorten the amplitude of a stepping rhythm by a fifth.
    """
    amplitude = np.linalg.norm(samples, axis=-1)
    angle = np.unwrap(np.arctan2(samples[..., 0], samples[..., 1]), axis=-2)
    frames = np.arange(FUTURE_PHASE_OFFSETS[-1] + 1)
    position = frames / float(FUTURE_PHASE_OFFSETS[1])
    low = np.minimum(position.astype(int), samples.shape[-3] - 2)
    t = (position - low)[:, None]
    amplitude = (1 - t) * amplitude[..., low, :] + t * amplitude[..., low + 1, :]
    angle = (1 - t) * angle[..., low, :] + t * angle[..., low + 1, :]
    return np.stack([amplitude * np.sin(angle), amplitude * np.cos(angle)], axis=-1)


def advance_phase(window: Array, samples: Array) -> Array:
    """The dense window `(..., 121, C, 2)` one frame on, with the network's forecast `(..., 7, C, 2)` of present and future."""
    moved = np.concatenate([window[..., 1:, :, :], window[..., -1:, :, :]], axis=-3)
    moved[..., PRESENT:, :, :] = dense_future(samples)
    return moved
