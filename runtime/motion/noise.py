"""Noise for the diffusion of successive frames: standard normal at every time, and smooth over time."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

# Seconds of the waves that each number is a sum of. Noise that is fresh in every frame, or a random walk, makes the
# character tremble: a sampled pose follows its noise. These never come together again, and are slower than a step.
PERIODS_S = (1.7, 2.9, 5.3)


@lru_cache(maxsize=64)
def _waves(shape: tuple[int, ...], seed: int) -> NDArray[np.float32]:
    """Amplitudes `(6, numbers)` of the cosines and sines."""
    count = 2 * len(PERIODS_S)
    waves = np.random.default_rng(seed).standard_normal((count, int(np.prod(shape))), np.float32)
    return waves / np.float32(np.sqrt(len(PERIODS_S)))


def drifting_noise(shape: tuple[int, ...], seed: int, seconds: float) -> NDArray[np.float32]:
    """Numbers of `shape` at a time, each a sum of slow waves with random amplitudes: N(0, 1), the same for a seed."""
    angles = 2.0 * np.pi * seconds / np.array(PERIODS_S)
    weights = np.concatenate([np.cos(angles), np.sin(angles)]).astype(np.float32)
    return (weights @ _waves(shape, seed)).reshape(shape)
