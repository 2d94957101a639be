"""Noise for the diffusion of successive frames: standard normal at every time, and smooth over time."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

# Seconds of the waves that each number is a sum of. Noise that is fresh in every frame, or a random walk, makes the
# character tremble: a sampled pose follows its noise. These never come together again, and are slower than a step.
PERIODS_S = (1.7, 2.9, 5.3)


class DriftingNoise:
    """Numbers of `shape`, each a sum of slow waves with random amplitudes: N(0, 1), deterministic for a seed."""

    def __init__(self, shape: tuple[int, ...], seed: int) -> None:
        count = 2 * len(PERIODS_S)
        waves = np.random.default_rng(seed).standard_normal((count, int(np.prod(shape))), np.float32)
        self._waves = waves / np.float32(np.sqrt(len(PERIODS_S)))
        self._shape = shape
        self._frame = 0

    def step(self, dt: float) -> NDArray[np.float32]:
        """The next frame's noise, `dt` seconds after the last."""
        angles = 2.0 * np.pi * self._frame * dt / np.array(PERIODS_S)
        self._frame += 1
        weights = np.concatenate([np.cos(angles), np.sin(angles)]).astype(np.float32)
        return (weights @ self._waves).reshape(self._shape)
