"""Triangles of a height map, fewer where it is plain or far: tiles whose step is chosen by their error in pixels.

A window of the terrain is one regular grid of vertices plus a ring far outside that carries the edge heights on,
as `Terrain.height` does. A tile has 16 x 16 cells; at level l it uses every 2 ** l-th vertex. Where a finer tile
meets a coarser one its edge vertices snap to the coarser's, so no cracks open. Only numpy here, no OpenGL.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray

from runtime.terrain import Terrain

Array = NDArray[np.floating]
Indices = NDArray[np.uint32]

TILE = 16  # cells per side
LEVELS = 5  # steps of 1, 2, 4, 8, 16 cells
MAX_CELLS = 1024  # per side of the window
WINDOW_M = 64.0  # what the window covers at least, where the terrain is as large
APRON_M = 150.0  # how far the ring lies outside, beyond all fog


@dataclass(frozen=True)
class TerrainWindow:
    """A part of a terrain as a grid with a ring around it; index [0] and [-1] are the ring."""

    heights: Array  # (nx + 2, nz + 2) float32
    cell_m: float
    origin: tuple[float, float]  # x, z of heights[1, 1]
    whole: bool  # False: the terrain goes on outside the window

    @property
    def tiles(self) -> tuple[int, int]:
        """Number of tiles along x and z."""
        return (self.heights.shape[0] - 3) // TILE, (self.heights.shape[1] - 3) // TILE

    @property
    def centre(self) -> Array:
        """x and z of the middle, `(2,)`."""
        return np.array(self.origin) + 0.5 * self.cell_m * TILE * np.array(self.tiles)

    @cached_property
    def slopes(self) -> NDArray[np.float16]:
        """Rise per metre along x and along z at each vertex, `(nx + 2, nz + 2, 2)`."""
        return np.stack(np.gradient(self.heights, self.cell_m), -1).astype(np.float16)

    @cached_property
    def height_range(self) -> tuple[Array, Array]:
        """Lowest and highest vertex of each tile, both `(tiles x, tiles z)`."""
        blocks = _tile_blocks(self.heights[1:-1, 1:-1])
        return blocks.min((1, 3)), blocks.max((1, 3))

    @cached_property
    def errors(self) -> Array:
        """Largest height error in metres of each tile at each level, `(LEVELS, tiles x, tiles z)`, rising by level."""
        h = self.heights[1:-1, 1:-1]
        errors = np.zeros((LEVELS, *self.tiles), np.float32)
        for level in range(1, LEVELS):
            step = 2**level
            coarse = np.repeat(h[::step], step, 0)[: len(h)]
            ahead = np.vstack([np.repeat(h[step::step], step, 0), h[-1:]])
            share = ((np.arange(len(h)) % step) / step)[:, None].astype(np.float32)
            rows = coarse + (ahead - coarse) * share
            coarse = np.repeat(rows[:, ::step], step, 1)[:, : h.shape[1]]
            ahead = np.hstack([np.repeat(rows[:, step::step], step, 1), rows[:, -1:]])
            share = ((np.arange(h.shape[1]) % step) / step)[None].astype(np.float32)
            difference = np.abs(h - coarse - (ahead - coarse) * share)
            errors[level] = np.maximum(errors[level - 1], _tile_blocks(difference).max((1, 3)))
        return errors


def _tile_blocks(grid: Array) -> Array:
    """View `(tiles x, 17, tiles z, 17)` of a grid: each tile with its own edges."""
    shape = ((grid.shape[0] - 1) // TILE, TILE + 1, (grid.shape[1] - 1) // TILE, TILE + 1)
    sx, sz = grid.strides
    return np.lib.stride_tricks.as_strided(grid, shape, (sx * TILE, sx, sz * TILE, sz), writeable=False)


def cut_window(terrain: Terrain, centre: Array) -> TerrainWindow:
    """The part of `terrain` about `centre` (x, z) that is drawn; all of it when it is small."""
    min_x, min_z, max_x, max_z = terrain.extent
    spans = (max_x - min_x, max_z - min_z)
    cell = max(terrain.cell_m, min(max(spans), WINDOW_M) / MAX_CELLS)
    starts, counts, whole = [], [], True
    for low, span, middle in zip((min_x, min_z), spans, centre, strict=True):
        cells = max(math.ceil(span / cell - 1e-6), 1)
        count = min(math.ceil(cells / TILE) * TILE, MAX_CELLS)
        first = 0
        if count < cells:  # in whole tiles, so that the mesh does not swim when the window moves
            whole = False
            first = round(((middle - low) / cell - count / 2) / TILE) * TILE
            first = min(max(first, 0), math.ceil((cells - count) / TILE) * TILE)
        starts.append(low + first * cell)
        counts.append(count)
    x = starts[0] + cell * np.clip(np.arange(-1, counts[0] + 2), 0, counts[0])
    z = starts[1] + cell * np.clip(np.arange(-1, counts[1] + 2), 0, counts[1])
    heights = terrain.height(*np.meshgrid(x, z, indexing="ij"))
    return TerrainWindow(heights, cell, (float(starts[0]), float(starts[1])), whole)


@lru_cache(maxsize=512)
def _tile_pattern(level: int, edges: tuple[int, int, int, int], row: int) -> Indices:
    """Vertex offsets of one tile's triangles; `edges` are the levels on -x, +x, -z, +z, `row` vertices per grid row."""
    k = np.arange(0, TILE + 1, 2**level)
    i, j = (a.copy() for a in np.meshgrid(k, k, indexing="ij"))
    snapped = [k // 2**edge * 2**edge for edge in edges]
    j[0], j[-1], i[:, 0], i[:, -1] = snapped
    v = i * row + j
    a, b, c, d = v[:-1, :-1], v[:-1, 1:], v[1:, 1:], v[1:, :-1]
    triangles = np.stack([a, b, c, a, c, d], -1).reshape(-1, 3)
    proper = (triangles != np.roll(triangles, 1, axis=1)).all(1)
    return triangles[proper].ravel().astype(np.uint32)


@lru_cache(maxsize=128)
def _apron_pattern(level: int, side: int, row: int) -> Indices:
    """Vertex offsets, from a border tile's first vertex, of the strip between its outer side and the ring."""
    k = np.arange(0, TILE + 1, 2**level)
    along, out, start = ((1, -row, 0), (1, row, TILE * row), (row, -1, 0), (row, 1, TILE))[side]
    near = start + k * along
    far = near + out
    quads = np.stack([near[:-1], far[:-1], far[1:], near[:-1], far[1:], near[1:]], -1)
    return quads.ravel().astype(np.int64).astype(np.uint32)  # wraps below zero; the sum with the tile's base is right


class TerrainMesh:
    """Chooses the triangles of one window for a view."""

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

    def levels(self, eye: Array, radians_per_pixel: float, max_triangles: int, pixels: float = 1.0) -> NDArray[np.int64]:
        """Level of each tile, such that its error stays under `pixels` seen from `eye`, within the triangle budget."""
        nearest = np.clip(eye, self._low, self._high)
        distance = np.linalg.norm(nearest - eye, axis=-1)
        while True:
            allowed = np.maximum(distance, 0.5) * radians_per_pixel * pixels
            levels = np.sum(self.window.errors[1:] <= allowed, axis=0)
            if 2 * np.sum((TILE >> levels) ** 2) <= max_triangles or pixels > 1e3:
                return levels
            pixels *= 1.5

    def visible(self, view_projection: Array, reach: float = 0.0) -> NDArray[np.bool_]:
        """Tiles that touch the view frustum; `reach` metres are added around each."""
        planes = np.concatenate([view_projection[3] + view_projection[:3], view_projection[3] - view_projection[:3]])
        normal = planes[:, None, None, :3]
        corner = np.where(normal > 0, self._high + reach, self._low - reach)
        return np.all(np.sum(normal * corner, -1) + planes[:, None, None, 3] >= 0, axis=0)

    def touching(self, low: Array, high: Array) -> NDArray[np.bool_]:
        """Tiles that overlap the rectangle from `low` to `high` (x, z)."""
        return np.all((self._low[..., ::2] <= high) & (self._high[..., ::2] >= low), axis=-1)

    def indices(self, levels: NDArray[np.int64], chosen: NDArray[np.bool_]) -> Indices:
        """Vertex indices of the triangles of the `chosen` tiles."""
        padded = np.pad(levels, 1, mode="edge")
        around = [padded[:-2, 1:-1], padded[2:, 1:-1], padded[1:-1, :-2], padded[1:-1, 2:]]
        keys = levels.copy()
        for neighbour in around:
            keys = keys * LEVELS + np.maximum(neighbour, levels)
        keys, base = keys[chosen], self._base[chosen]
        parts = []
        for key in np.unique(keys):
            digits = [int(key) // LEVELS**power % LEVELS for power in range(4, -1, -1)]
            pattern = _tile_pattern(digits[0], (digits[1], digits[2], digits[3], digits[4]), self._row)
            parts.append((base[keys == key][:, None] + pattern).ravel())
        return np.concatenate(parts) if parts else np.zeros(0, np.uint32)

    def apron_indices(self, levels: NDArray[np.int64]) -> Indices:
        """Vertex indices of the strips and corners that carry the edge heights on to the ring."""
        sides = (np.s_[0, :], np.s_[-1, :], np.s_[:, 0], np.s_[:, -1])
        parts = []
        for side, border in enumerate(sides):
            side_levels, base = levels[border], self._base[border]
            for level in np.unique(side_levels):
                pattern = _apron_pattern(int(level), side, self._row)
                parts.append((base[side_levels == level][:, None] + pattern).ravel())
        last_i, last_j = (n - 1 for n in self.window.heights.shape)
        for i, ring_i in ((1, 0), (last_i - 1, last_i)):
            for j, ring_j in ((1, 0), (last_j - 1, last_j)):
                a, b = i * self._row + j, ring_i * self._row + j
                c, d = ring_i * self._row + ring_j, i * self._row + ring_j
                parts.append(np.array([a, b, c, a, c, d], np.uint32))
        return np.concatenate(parts)
