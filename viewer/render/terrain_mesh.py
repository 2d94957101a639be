"""Level-of-detail triangles of a height map: tiles whose step is chosen by their error in pixels.

A window of the terrain is one regular grid of vertices plus a distant ring that extends the edge heights,
as `Terrain.height` does. A tile has 16 x 16 cells; at levels (lx, lz) it uses every 2 ** lx-th row and every
2 ** lz-th column, so that a flight of stairs costs a few long triangles. Where a finer tile meets a coarser one its
edge vertices snap to the coarser's, so no cracks open. Only numpy here, no OpenGL.
"""

import math
from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import product

import numpy as np
from numpy.typing import NDArray

from runtime.arrays import Array
from runtime.terrain.height_map import Terrain

Indices = NDArray[np.uint32]
Levels = NDArray[np.int64]

TILE = 16  # cells per side
LEVELS = 5  # steps of 1, 2, 4, 8, 16 cells
MAX_CELLS = 1024  # per side of the window
WINDOW_M = 64.0  # minimum extent of the window, if the terrain is as large
HAZE_M = 25.0
APRON_M = 150.0  # distance of the ring, beyond all fog
# heights over the local mean, metres, at the scale of edges and of hollows: each with its full value and its weight
RELIEF = ((0.07, 0.05, 0.30), (0.60, 0.10, 0.45))


@dataclass(frozen=True)
class TerrainWindow:
    """The drawn part of a terrain as a grid with a border ring; indices [0] and [-1] are the ring."""

    heights: Array  # (nx + 2, nz + 2) float32
    cell_m: float
    origin: tuple[float, float]  # x, z of heights[1, 1]
    whole: bool  # False: the terrain extends beyond the window

    @property
    def tiles(self) -> tuple[int, int]:
        return (self.heights.shape[0] - 3) // TILE, (self.heights.shape[1] - 3) // TILE

    @property
    def centre(self) -> Array:
        """Return x and z of the centre, `(2,)`."""
        return np.array(self.origin) + 0.5 * self.cell_m * TILE * np.array(self.tiles)

    @cached_property
    def slopes(self) -> NDArray[np.float16]:
        """Return the slope (metres per metre) along x and along z at each vertex, `(nx + 2, nz + 2, 2)`."""
        return np.stack(tuple(np.gradient(self.heights, self.cell_m)), -1).astype(np.float16)

    @cached_property
    def relief(self) -> NDArray[np.float16]:
        """Return how much lighter (edges, crests) or darker (hollows) than level ground each vertex is, `(nx + 2, nz + 2)`."""
        h = self.heights
        relief = np.zeros(h.shape, np.float32)
        for size, full, weight in RELIEF:
            apart = (h - _mean_around(h, max(round(size / self.cell_m), 1))) / full
            relief += weight * np.clip(apart, -1.0, 1.0)
        return relief.astype(np.float16)

    @cached_property
    def height_range(self) -> tuple[Array, Array]:
        """Return the lowest and highest height of each tile, both `(tiles x, tiles z)`."""
        blocks = _tile_blocks(self.heights[1:-1, 1:-1])
        return blocks.min((1, 3)), blocks.max((1, 3))

    @cached_property
    def errors(self) -> Array:
        """Return the largest height error (metres) per axis, level and tile, `(2, LEVELS, tiles x, tiles z)`, increasing by level.

        The errors of both axes add up at most, since interpolation along one does not increase the other's.
        """
        h = self.heights[1:-1, 1:-1]
        errors = np.zeros((2, LEVELS, *self.tiles), np.float32)
        for axis in (0, 1):
            for level in range(1, LEVELS):
                difference = _skip_error(h if axis == 0 else h.T, 2**level)
                worst = _tile_blocks(difference if axis == 0 else difference.T).max((1, 3))
                errors[axis, level] = np.maximum(errors[axis, level - 1], worst)
        return errors


def _mean_around(grid: Array, radius: int) -> Array:
    """Return the mean over the square of `2 * radius + 1` cells about each point; edges carry on."""
    for axis in (0, 1):
        pad = [(0, 0), (0, 0)]
        pad[axis] = (radius + 1, radius)
        total = np.cumsum(np.pad(grid, pad, mode="edge"), axis=axis, dtype=np.float64)
        count = grid.shape[axis]
        lower, upper = (np.take(total, at + np.arange(count), axis=axis) for at in (0, 2 * radius + 1))
        grid = ((upper - lower) / (2 * radius + 1)).astype(np.float32)
    return grid


def _skip_error(grid: Array, step: int) -> Array:
    """Return the error at each point `(n, m)` when only every `step`-th row is kept and the others are interpolated."""
    kept = grid[::step]
    fraction = (np.arange(step, dtype=np.float32) / step)[:, None]
    between = kept[:-1, None] + (kept[1:] - kept[:-1])[:, None] * fraction
    lost = np.zeros_like(grid)
    lost[:-1] = np.abs(grid[:-1] - between.reshape(-1, grid.shape[1]))
    return lost


def _tile_blocks(grid: Array) -> Array:
    """Return a view `(tiles x, 17, tiles z, 17)` of a grid: each tile with its own edges."""
    shape = ((grid.shape[0] - 1) // TILE, TILE + 1, (grid.shape[1] - 1) // TILE, TILE + 1)
    sx, sz = grid.strides
    return np.lib.stride_tricks.as_strided(grid, shape, (sx * TILE, sx, sz * TILE, sz), writeable=False)


def cut_window(terrain: Terrain, centre: Array) -> TerrainWindow:
    """Return the part of `terrain` around `centre` (x, z) to draw; all of it if it is small."""
    min_x, min_z, max_x, max_z = terrain.extent
    spans = (max_x - min_x, max_z - min_z)
    cell = max(terrain.cell_m, min(max(spans), WINDOW_M) / MAX_CELLS)
    starts, counts, whole = [], [], True
    for low, span, middle in zip((min_x, min_z), spans, centre, strict=True):
        cells = max(math.ceil(span / cell - 1e-6), 1)
        count = min(math.ceil(cells / TILE) * TILE, MAX_CELLS)
        first = 0
        if count < cells:  # in whole tiles, so that the mesh is stable when the window moves
            whole = False
            first = round(((middle - low) / cell - count / 2) / TILE) * TILE
            first = min(max(first, 0), math.ceil((cells - count) / TILE) * TILE)
        starts.append(low + first * cell)
        counts.append(count)
    x = starts[0] + cell * np.clip(np.arange(-1, counts[0] + 2), 0, counts[0])
    z = starts[1] + cell * np.clip(np.arange(-1, counts[1] + 2), 0, counts[1])
    heights = terrain.height(*np.meshgrid(x, z, indexing="ij"))
    return TerrainWindow(heights, cell, (float(starts[0]), float(starts[1])), whole)


@lru_cache(maxsize=2048)
def _tile_pattern(levels: tuple[int, ...], row: int) -> Indices:
    """Return the vertex offsets of one tile's triangles.

    `levels` are its own along x and z, then those of its edges: along z at -x and +x, along x at -z and +z;
    `row` is the number of vertices in a row of the grid.
    """
    along_x, along_z = (np.arange(0, TILE + 1, 2**level) for level in levels[:2])
    i, j = (a.copy() for a in np.meshgrid(along_x, along_z, indexing="ij"))
    for edge, k, level in (
        (j[0], along_z, 2),
        (j[-1], along_z, 3),
        (i[:, 0], along_x, 4),
        (i[:, -1], along_x, 5),
    ):
        edge[:] = k // 2 ** levels[level] * 2 ** levels[level]
    v = i * row + j
    a, b, c, d = v[:-1, :-1], v[:-1, 1:], v[1:, 1:], v[1:, :-1]
    triangles = np.stack([a, b, c, a, c, d], -1).reshape(-1, 3)
    proper = (triangles != np.roll(triangles, 1, axis=1)).all(1)
    return triangles[proper].ravel().astype(np.uint32)


@lru_cache(maxsize=128)
def _apron_pattern(level: int, side: int, row: int) -> Indices:
    """Return the vertex offsets, from a border tile's first vertex, of the strip between its outer side and the ring."""
    k = np.arange(0, TILE + 1, 2**level)
    along, out, start = ((1, -row, 0), (1, row, TILE * row), (row, -1, 0), (row, 1, TILE))[side]
    near = start + k * along
    far = near + out
    quads = np.stack([near[:-1], far[:-1], far[1:], near[:-1], far[1:], near[1:]], -1)
    # wraps below zero; the sum with the tile's base is right
    return quads.ravel().astype(np.int64).astype(np.uint32)


class TerrainMesh:
    """Level-of-detail triangles of a terrain window."""

    def __init__(self, window: TerrainWindow) -> None:
        self.window = window
        nx, nz = window.tiles
        self._row = window.heights.shape[1]
        i, j = np.meshgrid(np.arange(nx), np.arange(nz), indexing="ij")
        self._base = ((1 + TILE * i) * self._row + 1 + TILE * j).astype(np.uint32)
        size = TILE * window.cell_m
        low, high = window.height_range
        x, z = window.origin[0] + size * i, window.origin[1] + size * j
        self._low = np.stack([x, low, z], -1)  # (tiles x, tiles z, 3) metres
        self._high = np.stack([x + size, high, z + size], -1)

    def levels(
        self, eye: Array, radians_per_pixel: float, chosen: NDArray[np.bool_], max_triangles: int
    ) -> Levels:
        """Return the detail levels `(2, tiles x, tiles z)` along x and z that keep errors under a pixel, seen from `eye`.

        The limit grows to a few pixels if the `chosen` tiles would exceed `max_triangles`.
        """
        nearest = np.clip(eye, self._low, self._high)
        distance = np.maximum(np.linalg.norm(nearest - eye, axis=-1), 0.5)
        distance *= 1.0 + (distance / HAZE_M) ** 2  # distant tiles in the fog may be coarser
        pixels = 1.0
        while True:
            allowed = distance * radians_per_pixel * pixels
            levels = np.sum(self.window.errors[:, 1:] <= 0.5 * allowed, axis=1)
            if 2 * np.sum((TILE >> levels).prod(0), where=chosen) <= max_triangles or pixels > 1e3:
                return levels
            pixels *= 1.4

    def visible(self, view_projection: Array) -> NDArray[np.bool_]:
        planes = np.concatenate(
            [view_projection[3] + view_projection[:3], view_projection[3] - view_projection[:3]]
        )
        normal = planes[:, None, None, :3]
        corner = np.where(normal > 0, self._high, self._low)
        return np.all(np.sum(normal * corner, -1) + planes[:, None, None, 3] >= 0, axis=0)

    def touching(self, low: Array, high: Array) -> NDArray[np.bool_]:
        """Return which tiles overlap the rectangle from `low` to `high` (x, z)."""
        return np.all((self._low[..., ::2] <= high) & (self._high[..., ::2] >= low), axis=-1)

    def corners(self, low: Array, high: Array, chosen: NDArray[np.bool_]) -> Array:
        """Return the corners `(8, 3)` of a box over the rectangle from `low` to `high` (x, z), with the heights of the `chosen` tiles."""
        bottom = np.min(self._low[..., 1], where=chosen, initial=np.inf)
        top = np.max(self._high[..., 1], where=chosen, initial=-np.inf)
        sides = (low[0], high[0]), (bottom, top), (low[1], high[1])
        return np.array(list(product(*sides)))

    def indices(self, levels: Levels, chosen: NDArray[np.bool_]) -> Indices:
        """Return the vertex indices that make up the triangles of the `chosen` tiles."""
        x, z = levels
        wide_x, wide_z = np.pad(x, 1, mode="edge"), np.pad(z, 1, mode="edge")
        digits = [x, z, wide_z[:-2, 1:-1], wide_z[2:, 1:-1], wide_x[1:-1, :-2], wide_x[1:-1, 2:]]
        digits = [x, z, *(np.maximum(d, own) for d, own in zip(digits[2:], (z, z, x, x), strict=True))]
        table = np.stack(digits, -1)[chosen]
        keys, base = table @ LEVELS ** np.arange(6), self._base[chosen]
        order = np.argsort(keys, kind="stable")
        starts = np.flatnonzero(np.diff(keys[order], prepend=-1))
        parts = []
        for group in np.split(order, starts[1:]) if len(order) else []:
            pattern = _tile_pattern(tuple(table[group[0]].tolist()), self._row)
            parts.append((base[group][:, None] + pattern).ravel())
        return np.concatenate(parts) if parts else np.zeros(0, np.uint32)

    def apron_indices(self, levels: Levels) -> Indices:
        """Return the triangle indices of the border, which extends the edge heights to the ring."""
        sides = (np.s_[0, :], np.s_[-1, :], np.s_[:, 0], np.s_[:, -1])
        parts = []
        for side, border in enumerate(sides):
            side_levels, base = levels[1 if side < 2 else 0][border], self._base[border]
            for level in set(side_levels.tolist()):
                pattern = _apron_pattern(level, side, self._row)
                parts.append((base[side_levels == level][:, None] + pattern).ravel())
        last_i, last_j = (n - 1 for n in self.window.heights.shape)
        for i, ring_i in ((1, 0), (last_i - 1, last_i)):
            for j, ring_j in ((1, 0), (last_j - 1, last_j)):
                a, b = i * self._row + j, ring_i * self._row + j
                c, d = ring_i * self._row + ring_j, i * self._row + ring_j
                parts.append(np.array([a, b, c, a, c, d], np.uint32))
        return np.concatenate(parts)
