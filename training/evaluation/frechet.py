"""Frechet motion distance: how far two sets of windows lie apart as Gaussians over features (FMD, Sec. IV-B)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.floating]

SEEDS = 10  # random halves and draws that are averaged
MAX_WINDOWS = 4000  # a side


def frechet_distance(a: Array, b: Array) -> float:
    """|mu_a - mu_b|^2 + tr(S_a + S_b - 2 (S_a S_b)^(1/2)) of feature rows `(N, d)` and `(M, d)`.

    It is biased upwards by 1/N and 1/M: compare only distances that were taken with equal numbers of rows.
    """
    a, b = np.asarray(a, np.float64), np.asarray(b, np.float64)
    if len(a) < 2 or len(b) < 2:
        return float("nan")
    covariance_a, covariance_b = np.atleast_2d(np.cov(a.T)), np.atleast_2d(np.cov(b.T))
    values, vectors = np.linalg.eigh(covariance_a)
    root = vectors * np.sqrt(np.clip(values, 0.0, None)) @ vectors.T
    cross = np.linalg.eigvalsh(root @ covariance_b @ root)  # the eigenvalues of S_a S_b
    trace = np.trace(covariance_a) + np.trace(covariance_b) - 2.0 * np.sqrt(np.clip(cross, 0.0, None)).sum()
    return float(np.square(a.mean(0) - b.mean(0)).sum() + max(trace, 0.0))


@dataclass(frozen=True)
class Projection:
    """Features to fewer principal components, measured once on captured windows."""

    mean: Array  # (d,)
    axes: Array  # (d, k), with the standardisation in it
    share: float  # of the variance that is left

    @staticmethod
    def fit(features: Array, components: int, standardise: bool) -> Projection:
        """Principal axes of rows `(N, d)`; `standardise` brings every feature to unit deviation first."""
        mean = features.mean(0)
        scale = features.std(0) if standardise else np.ones(features.shape[1])
        scale = np.where(scale > 1e-6, scale, np.inf)  # a feature that never changes tells nothing
        values, vectors = np.linalg.eigh(np.cov(((features - mean) / scale).T.astype(np.float64)))
        kept = vectors[:, ::-1][:, :components]
        share = float(values[::-1][:components].sum() / values.sum())
        return Projection(mean, kept / scale[:, None], share)

    def __call__(self, features: Array) -> Array:
        """Rows `(N, d)` to `(N, k)`."""
        return (features - self.mean) @ self.axes


@dataclass(frozen=True)
class Comparison:
    """Generated against captured windows, and captured against captured, at the same number of windows a side."""

    distance: float
    reference: float  # between two random halves of the capture
    windows: int  # a side

    @property
    def ratio(self) -> float:
        """Distance in units of the capture's own scatter."""
        return self.distance / self.reference if self.reference > 0 else float("nan")


def compare(
    generated: Array, captured: Array, units: Sequence[int] | NDArray[np.integer], seed: int = 0
) -> Comparison:
    """Compare rows `(N, k)` with rows `(M, k)`.

    `units` `(M,)` are 2 s in the first and 2 s + 1 in the second half of take s, and -1 in windows that reach over its
    middle, which are left out. Every draw gives one half of every take, at random, to one side and the other to the
    other: both sides hold the same mix of motions, and no frame twice. The reference is the distance between n windows of
    either side; the distance that of n generated windows to n captured ones. Both are means over `SEEDS` draws.
    """
    rng = np.random.default_rng(seed)
    unit = np.asarray(units)
    takes, half = unit // 2, unit % 2
    distances, references, sizes = [], [], []
    for _ in range(SEEDS):
        flip = rng.integers(0, 2, int(takes.max(initial=0)) + 1)
        first_side = half == flip[takes]
        sides = [np.flatnonzero((unit >= 0) & own) for own in (first_side, ~first_side)]
        n = min(*(len(side) for side in sides), len(generated), MAX_WINDOWS)
        if n < 2:
            return Comparison(float("nan"), float("nan"), 0)
        first, second = (captured[rng.permutation(side)[:n]] for side in sides)
        drawn = generated[rng.permutation(len(generated))[:n]]
        references.append(frechet_distance(first, second))
        distances.append(frechet_distance(drawn, captured[rng.permutation(np.concatenate(sides))[:n]]))
        sizes.append(n)
    return Comparison(float(np.mean(distances)), float(np.mean(references)), int(np.min(sizes)))
