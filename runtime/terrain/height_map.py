"""The ground as a height map, which gives heights and normals to model, IK, camera and renderer."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from math import inf

import numpy as np

from runtime.arrays import Array
from runtime.errors import TerrainError

LAST_CELL_WIDTH = 1.000001  # from the number of grid points to the last position inside the cells


@dataclass(frozen=True)
class Terrain:
    """A regular grid of heights in metres; outside it, heights continue from the nearest edge. TerrainError if invalid.

    `heights[i, j]` lies at x = origin_x + i * cell, z = origin_z + j * cell.
    """

    name: str
    heights: Array  # (nx, nz) float32
    cell_m: float
    origin: tuple[float, float]  # x, z of heights[0, 0], metres
    note: str = ""  # how it was read, for the user
    unit_m: float = 1.0  # metres per unit of its lengths: see `seen_by`

    def __post_init__(self) -> None:
        heights = self.heights
        if not isinstance(heights, np.ndarray) or heights.ndim != 2 or min(heights.shape) < 2:
            raise TerrainError(
                f"Terrain {self.name!r}: heights {np.shape(heights)}; expected (nx, nz) of at least 2 x 2.",
                "Give a larger array.",
            )
        if not max(-float(heights.min()), float(heights.max())) < math.inf:
            raise TerrainError(f"Terrain {self.name!r}: heights that are not finite.", "Replace them.")
        if not 0.0 < self.cell_m < math.inf or not all(abs(at) < math.inf for at in self.origin):
            raise TerrainError(
                f"Terrain {self.name!r}: cells of {self.cell_m} m from {self.origin}; expected finite numbers.",
                "Give metres above 0.",
            )

    @staticmethod
    def flat(name: str = "flat", size_m: float = 40.0, cell_m: float = 1.0) -> Terrain:
        """Return level ground: a square centred on the origin."""
        n = round(size_m / cell_m) + 1
        return Terrain(name, np.zeros((n, n), np.float32), cell_m, (-size_m / 2, -size_m / 2))

    def seen_by(self, size: float) -> Terrain:
        """Return the ground in the units of a body `size` times as large as ours, for which one unit is `size` metres.

        The simulation and the view then work in these units. Ground in these units already is returned unchanged.
        """
        if size == self.unit_m:
            return self
        by = self.unit_m / size
        x, z = self.origin
        heights = (self.heights * np.float32(by)).astype(np.float32)
        return replace(self, heights=heights, cell_m=self.cell_m * by, origin=(x * by, z * by), unit_m=size)

    @property
    def extent(self) -> tuple[float, float, float, float]:
        """(min x, min z, max x, max z) in metres."""
        nx, nz = self.heights.shape
        x, z = self.origin
        return x, z, x + (nx - 1) * self.cell_m, z + (nz - 1) * self.cell_m

    @cached_property
    def steepest(self) -> float:
        """An upper bound of the slope anywhere, rise over run."""
        rises = (float(np.abs(np.diff(self.heights, axis=axis)).max()) for axis in (0, 1))
        return math.hypot(*rises) / self.cell_m

    def height(self, x: Array | float, z: Array | float) -> Array:
        """Return the bilinear height (metres) at x, z (any equal shapes)."""
        nx, nz = self.heights.shape
        if self.steepest == 0.0 and np.isfinite(place := np.add(x, z)).all():
            return np.full(place.shape, self.heights[0, 0], np.float32)
        # float64: in float32 the upper clip bound would round up onto the edge
        u = (np.asarray(x, np.float64) - self.origin[0]) / self.cell_m
        v = (np.asarray(z, np.float64) - self.origin[1]) / self.cell_m
        u, v = (
            np.minimum(np.maximum(u, 0.0), nx - LAST_CELL_WIDTH),
            np.minimum(np.maximum(v, 0.0), nz - LAST_CELL_WIDTH),
        )
        i, j = u.astype(np.int64), v.astype(np.int64)
        fu, fv = u - i, v - j
        h = self.heights
        try:
            low = h[i, j] * (1 - fu) + h[i + 1, j] * fu
        except IndexError as error:  # NaN: clipping keeps it
            raise TerrainError(
                f"Terrain {self.name!r}: a place that is not finite.", "Give metres."
            ) from error
        high = h[i, j + 1] * (1 - fu) + h[i + 1, j + 1] * fu
        return np.asarray(low * (1 - fv) + high * fv, np.float32)

    def normal(self, x: Array | float, z: Array | float, reach_m: float = 0.05) -> Array:
        """Return unit upward normals `(..., 3)` from central differences over ± `reach_m`."""
        x, z = np.asarray(x), np.asarray(z)
        dx = (self.height(x + reach_m, z) - self.height(x - reach_m, z)) / (2 * reach_m)
        dz = (self.height(x, z + reach_m) - self.height(x, z - reach_m)) / (2 * reach_m)
        n = np.stack([-dx, np.ones_like(dx), -dz], axis=-1)
        return n / np.linalg.norm(n, axis=-1, keepdims=True)


class PointHeights:
    """Fast heights of single points of a terrain; heights outside `lowest` to `highest` (metres) are clamped."""

    def __init__(self, terrain: Terrain, lowest: float = -inf, highest: float = inf) -> None:
        self.steepest = terrain.steepest
        if self.steepest == 0.0:
            level = min(max(float(terrain.heights[0, 0]), lowest), highest)
            self.height: Callable[[float, float], float] = lambda x, z: level
            return
        item, cells = terrain.heights.item, 1.0 / terrain.cell_m
        (x0, z0), (nx, nz) = terrain.origin, terrain.heights.shape
        last_u, last_v = nx - LAST_CELL_WIDTH, nz - LAST_CELL_WIDTH

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

        # bilinear height in metres at x, z, as `Terrain.height`; a closure, as it is called about thirty times per frame
        self.height = height
