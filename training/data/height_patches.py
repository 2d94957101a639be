"""Ground under a clip: height patches that agree with its footsteps."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from runtime.arrays import Array
from runtime.safe_read import open_npz
from runtime.terrain.height_map import Terrain

CELL_M = 0.15
FLAT_MARGIN_M = 1.5
RELIEF_MARGIN_M = 2.5


@dataclass(frozen=True)
class Patches:
    """K grounds on one grid: `heights` `(K, n, m)` metres, [0, 0] at `origin` (x, z), `cell` metres apart."""

    heights: Array
    origin: tuple[float, float]
    cell: float

    def terrain(self, k: int = 0) -> Terrain:
        """Patch `k` as a terrain to ask heights of."""
        return Terrain("patch", self.heights[k].astype(np.float32), self.cell, self.origin)

    def mirrored(self) -> Patches:
        """The same ground reflected through the plane X = 0."""
        width = (self.heights.shape[1] - 1) * self.cell
        return Patches(self.heights[:, ::-1].copy(), (-(self.origin[0] + width), self.origin[1]), self.cell)


def grid_under(
    positions: Array, margin: float, cell: float = CELL_M
) -> tuple[tuple[float, float], tuple[int, int]]:
    """Origin and size of a grid that covers joint positions `(T, J, 3)` and `margin` metres around."""
    low = positions[..., [0, 2]].reshape(-1, 2).min(0) - margin
    high = positions[..., [0, 2]].reshape(-1, 2).max(0) + margin
    n, m = (int(v) for v in np.ceil((high - low) / cell) + 1)
    return (float(low[0]), float(low[1])), (n, m)


def load_rollout_terrain(path: Path) -> tuple[Array, float]:
    """Heights `(n, m)` and cell, both in metres, of a height map of the rollouts."""
    with open_npz(path, "Unpack the archive again.") as data:
        return np.asarray(data["height_cm"], np.float64) * 0.01, float(data["cell_cm"]) * 0.01


def wrapped_height(heights: Array, cell: float, x: Array, z: Array) -> Array:
    """Bilinear height at x, z of a map centred on the origin that repeats at its edges."""
    n, m = heights.shape
    u, v = np.asarray(x) / cell + n / 2, np.asarray(z) / cell + m / 2
    i, j = np.floor(u).astype(np.int64), np.floor(v).astype(np.int64)
    fu, fv = u - i, v - j
    i, j = i % n, j % m
    i1, j1 = (i + 1) % n, (j + 1) % m
    low = heights[i, j] * (1 - fu) + heights[i1, j] * fu
    return low * (1 - fv) + (heights[i, j1] * (1 - fu) + heights[i1, j1] * fu) * fv


def crop_rollout(heights: Array, cell: float, positions: Array, out_cell: float = 0.1) -> Patches:
    """The part of a wrapping height map that lies around a clip."""
    origin, (n, m) = grid_under(positions, RELIEF_MARGIN_M, out_cell)
    x = origin[0] + np.arange(n)[:, None] * out_cell
    z = origin[1] + np.arange(m)[None, :] * out_cell
    x, z = np.broadcast_arrays(x, z)
    return Patches(wrapped_height(heights, cell, x, z)[None], origin, out_cell)
