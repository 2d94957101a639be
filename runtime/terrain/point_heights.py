"""Terrain heights for single points in plain floats: the per-frame twin of `Terrain.height`."""

from __future__ import annotations

from math import inf

from runtime.terrain.height_map import Terrain


class PointHeights:
    """Heights of one terrain, without the overhead of arrays, none under `lowest` or over `highest` (metres)."""

    def __init__(self, terrain: Terrain, lowest: float = -inf, highest: float = inf) -> None:
        self._item = terrain.heights.item
        self._nx, self._nz = terrain.heights.shape
        self._x, self._z = terrain.origin
        self._cells = 1.0 / terrain.cell_m
        self._lowest, self._highest = lowest, highest

    def height(self, x: float, z: float) -> float:
        """Bilinear height in metres, as `Terrain.height`."""
        u = min(max((x - self._x) * self._cells, 0.0), self._nx - 1.000001)
        v = min(max((z - self._z) * self._cells, 0.0), self._nz - 1.000001)
        i, j = int(u), int(v)
        u, v, item = u - i, v - j, self._item
        low = item(i, j) * (1.0 - u) + item(i + 1, j) * u
        high = item(i, j + 1) * (1.0 - u) + item(i + 1, j + 1) * u
        return min(max(low * (1.0 - v) + high * v, self._lowest), self._highest)
