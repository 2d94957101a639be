"""Terrain heights for single points in plain floats: the per-frame twin of `Terrain.height`."""

from __future__ import annotations

from collections.abc import Callable
from math import inf

from runtime.terrain.height_map import Terrain


class PointHeights:
    """Heights of one terrain, without the overhead of arrays, none under `lowest` or over `highest` (metres)."""

    def __init__(self, terrain: Terrain, lowest: float = -inf, highest: float = inf) -> None:
        self.steepest = terrain.steepest
        item, cells = terrain.heights.item, 1.0 / terrain.cell_m
        (x0, z0), (nx, nz) = terrain.origin, terrain.heights.shape
        last_u, last_v = nx - 1.000001, nz - 1.000001

        def height(x: float, z: float) -> float:
            u, v = (x - x0) * cells, (z - z0) * cells
            u = 0.0 if u < 0.0 else last_u if u > last_u else u
            v = 0.0 if v < 0.0 else last_v if v > last_v else v
            i, j = int(u), int(v)
            u, v = u - i, v - j
            low = item(i, j) * (1.0 - u) + item(i + 1, j) * u
            high = item(i, j + 1) * (1.0 - u) + item(i + 1, j + 1) * u
            here = low * (1.0 - v) + high * v
            return lowest if here < lowest else highest if here > highest else here

        # bilinear height in metres at x, z, as `Terrain.height`; a closure, as it is called some thirty times in a frame
        self.height: Callable[[float, float], float] = height
