"""Frechet motion distance (FMD, Sec. IV-B): distance between two sets of windows as Gaussians over features."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.arrays import Array

SEEDS = 10  # random halves and draws to average
MAX_WINDOWS = 4000  # per side


def frechet_distance(a: Array, b: Array) -> float:
    """Return |mu_a - mu_b|^2 + tr(S_a + S_b - 2 (S_a S_b)^(1/2)) of feature rows `(N, d)` and `(M, d)`.

    It is biased upwards by 1/N and 1/M: compare only distances with equal numbers of rows.
    """
    a, b = np.asarray(a, np.float64), np.asarray(b, np.float64)
    if len(a) < 2 or len(b) < 2:
        return float("nan")
    of_a, of_b = np.atleast_2d(np.cov(a.T)), np.atleast_2d(np.cov(b.T))
    values, vectors = np.linalg.eigh(of_a)
    root = vectors * np.sqrt(np.clip(values, 0.0, None)) @ vectors.T
    cross = np.linalg.eigvalsh(root @ of_b @ root)  # the eigenvalues of S_a S_b
    trace = np.trace(of_a) + np.trace(of_b) - 2.0 * np.sqrt(np.clip(cross, 0.0, None)).sum()
    return float(np.square(a.mean(0) - b.mean(0)).sum() + max(trace, 0.0))


@dataclass(frozen=True)
class Projection:
    """Projection of features to principal components of captured windows."""

    mean: Array  # (d,)
    axes: Array  # (d, k), including the standardisation

    @staticmethod
    def fit(features: Array, components: int, standardise: bool) -> Projection:
        """Compute principal axes of rows `(N, d)`; `standardise` scales every feature to unit deviation first."""
        mean = features.mean(0)
        scale = features.std(0) if standardise else np.ones(features.shape[1])
        scale = np.where(scale > 1e-6, scale, np.inf)  # a constant feature has no information
        _, vectors = np.linalg.eigh(np.cov(((features - mean) / scale).T.astype(np.float64)))
        kept = vectors[:, ::-1][:, :components]
        return Projection(mean, kept / scale[:, None])

    def __call__(self, features: Array) -> Array:
        """Project rows `(N, d)` to `(N, k)`."""
        return (features - self.mean) @ self.axes


# `distance` between generated and captured windows, `reference` between halves of the capture, their `ratio`, and the
# number of `windows` per side
Distances = dict[str, Any]


def compare(
    generated: Array, captured: Array, units: Sequence[int] | NDArray[np.integer], seed: int = 0
) -> Distances:
    """Compare rows `(N, k)` with rows `(M, k)`; results are means over `SEEDS` random splits of the capture into two halves.

    Every take is cut in the middle, into halves of the same performance. The entry `takes` is the same with whole takes
    on either side, so the reference is the distance between performances of the same style.

    `units` `(M,)` are 2 s in the first and 2 s + 1 in the second half of take s, and -1 - s in windows across its middle,
    which are excluded when takes are cut. Takes 2 p and 2 p + 1 are similar (neighbours in speed), and one of them goes to
    each side, so that both sides have the same mix of gaits. No frame is on both sides. The reference is the distance
    between n windows of each side; the distance that between n generated and n captured windows of both sides.
    """
    rng = np.random.default_rng(seed)
    unit = np.asarray(units)
    take = np.where(unit >= 0, unit // 2, -1 - unit)
    count = int(take.max(initial=0)) + 1
    by_take, by_half = [], []
    for _ in range(SEEDS):
        coin = rng.integers(0, 2, count // 2 + 1)
        first_side = take % 2 == coin[take // 2]
        by_take.append(_draw(generated, captured, first_side, ~first_side, rng))
        whole, flip = unit >= 0, rng.integers(0, 2, count)
        first_side = unit % 2 == flip[take]
        by_half.append(_draw(generated, captured, whole & first_side, whole & ~first_side, rng))
    return {**_mean(by_half), "takes": _mean(by_take)}


def _draw(
    generated: Array,
    captured: Array,
    first: NDArray[np.bool_],
    second: NDArray[np.bool_],
    rng: np.random.Generator,
) -> tuple[float, float, int] | None:
    """Return distance, reference and windows per side of one split, limited by the smaller side; None for fewer than two."""
    sides = np.flatnonzero(first), np.flatnonzero(second)
    n = min(*(len(side) for side in sides), len(generated), MAX_WINDOWS)
    if n < 2:
        return None
    own, other = (captured[rng.permutation(side)[:n]] for side in sides)
    both = captured[rng.permutation(np.concatenate(sides))[:n]]
    drawn = generated[rng.permutation(len(generated))[:n]]
    return frechet_distance(drawn, both), frechet_distance(own, other), n


def _mean(cuts: Sequence[tuple[float, float, int] | None]) -> Distances:
    """Return the means over the valid splits."""
    found = [cut for cut in cuts if cut is not None] or [(float("nan"), float("nan"), 0)]
    distance, reference, _ = np.mean(found, axis=0).tolist()
    ratio = distance / reference if reference > 0 else float("nan")
    windows = min(count for *_, count in found)
    return {"distance": distance, "reference": reference, "windows": windows, "ratio": ratio}
