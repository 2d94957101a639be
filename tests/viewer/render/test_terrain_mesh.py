"""Terrain triangles: without cracks at any levels of detail, within the error asked for, around the focus."""

from collections import Counter

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from runtime.terrain.height_map import Terrain
from tests.helpers.render_scene import hills, stairs
from viewer.render.terrain_mesh import LEVELS, MAX_CELLS, TILE, TerrainMesh, cut_window

RADIANS_PER_PIXEL = 0.001


def edges_of(triangles: np.ndarray) -> Counter[tuple[int, int]]:
    pairs = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    return Counter(map(tuple, np.sort(pairs, axis=1).tolist()))


def grid_places(mesh: TerrainMesh) -> np.ndarray:
    """Row and column `(vertices, 2)`, the ring as far out as one cell."""
    shape = mesh.window.heights.shape
    return np.stack(np.meshgrid(*map(np.arange, shape), indexing="ij"), -1).reshape(-1, 2).astype(float)


@settings(max_examples=12)
@given(st.integers(0, 2**32 - 1), st.booleans())
def test_any_levels_give_one_surface_without_cracks(seed: int, with_apron: bool) -> None:
    rng = np.random.default_rng(seed)
    size = TILE * np.array([3, 4])
    terrain = Terrain("noise", rng.random((size[0] + 1, size[1] + 1)).astype(np.float32), 0.1, (0.0, 0.0))
    mesh = TerrainMesh(cut_window(terrain, np.zeros(2)))
    levels = rng.integers(0, LEVELS, (2, 3, 4))
    indices = mesh.indices(levels, np.ones((3, 4), bool))
    if with_apron:
        indices = np.concatenate([indices, mesh.apron_indices(levels)])
    triangles = indices.reshape(-1, 3).astype(np.int64)

    places = grid_places(mesh)
    a, b, c = (places[triangles[:, k]] for k in range(3))
    area = 0.5 * np.cross(b - a, c - a)
    expected = np.prod(size + 2) if with_apron else np.prod(size)
    assert np.sum(np.abs(area)) == pytest.approx(expected), "covers the window once"

    top = np.array(mesh.window.heights.shape) - 1
    low, high = (0, top) if with_apron else (1, top - 1)
    for (first, second), count in edges_of(triangles).items():
        ends = places[[first, second]]
        outline = np.any((ends == low).all(0) | (ends == high).all(0))
        assert count == (1 if outline else 2), "an edge inside belongs to exactly two triangles"


def triangle_height_error(mesh: TerrainMesh, indices: np.ndarray, terrain: Terrain) -> float:
    heights = mesh.window.heights.ravel()
    places = grid_places(mesh)
    triangles = indices.reshape(-1, 3).astype(np.int64)
    weights = np.random.default_rng(0).dirichlet(np.ones(3), len(triangles))
    spot = np.einsum("tk,tkc->tc", weights, places[triangles])
    shown = np.einsum("tk,tk->t", weights, heights[triangles])
    x, z = (np.array(mesh.window.origin) + (spot - 1) * mesh.window.cell_m).T
    return float(np.max(np.abs(shown - terrain.height(x, z))))


@pytest.mark.parametrize("terrain", [hills(), stairs()], ids=["hills", "stairs"])
def test_error_stays_near_a_pixel(terrain: Terrain) -> None:
    mesh = TerrainMesh(cut_window(terrain, np.zeros(2)))
    everywhere = np.ones(mesh.window.tiles, bool)
    levels = mesh.levels(np.array([0.0, 6.0, 0.0]), RADIANS_PER_PIXEL, everywhere, 10**9)
    assert levels.max() > 0, "something was saved"
    farthest = np.linalg.norm(np.array(terrain.extent[2:])) + 6.0
    hazed = farthest * (1 + (farthest / 25.0) ** 2)
    cell_diagonal_error = 0.02  # a height map is bilinear inside a cell, triangles are not
    error = triangle_height_error(mesh, mesh.indices(levels, everywhere), terrain)
    assert error < hazed * RADIANS_PER_PIXEL + cell_diagonal_error


def test_stairs_cost_little_although_every_step_is_exact() -> None:
    mesh = TerrainMesh(cut_window(stairs(), np.zeros(2)))
    everywhere = np.ones(mesh.window.tiles, bool)
    levels = mesh.levels(np.array([0.0, 2.0, 0.0]), 1e-6, everywhere, 10**9)
    indices = mesh.indices(levels, everywhere)
    assert triangle_height_error(mesh, indices, stairs()) < 1e-3
    assert len(indices) // 3 < 0.15 * 2 * 200**2


def test_triangle_budget_is_kept() -> None:
    mesh = TerrainMesh(cut_window(hills(cell_m=0.1), np.zeros(2)))
    everywhere = np.ones(mesh.window.tiles, bool)
    levels = mesh.levels(np.array([0.0, 1.0, 0.0]), 1e-5, everywhere, 5000)
    assert len(mesh.indices(levels, everywhere)) // 3 <= 5000


def test_window_of_a_large_terrain_follows_the_focus_in_whole_tiles() -> None:
    n = MAX_CELLS + 1000
    terrain = Terrain("large", np.zeros((n + 1, n + 1), np.float32), 0.1, (0.0, 0.0))
    for focus in (np.array([60.0, 70.0]), np.array([99.0, 101.3])):
        window = cut_window(terrain, focus)
        assert not window.whole
        assert window.tiles == (MAX_CELLS // TILE, MAX_CELLS // TILE)
        np.testing.assert_allclose(window.centre, focus, atol=TILE * 0.1)
        steps = (np.array(window.origin) / (TILE * 0.1)).round(6)
        np.testing.assert_allclose(steps, steps.round(), atol=1e-4)
    assert cut_window(terrain, np.array([-500.0, -500.0])).origin == (0.0, 0.0)


def test_invisible_tiles_are_those_behind_the_camera() -> None:
    from viewer.render.camera import OrbitCamera

    mesh = TerrainMesh(cut_window(hills(), np.zeros(2)))
    camera = OrbitCamera((0.0, 1.0, 0.0), yaw=0.0, pitch=0.1, distance=3.0)
    visible = mesh.visible(camera.projection_matrix(1.5) @ camera.view_matrix())
    z = mesh.window.origin[1] + (np.arange(mesh.window.tiles[1]) + 0.5) * TILE * mesh.window.cell_m
    assert visible.any()
    assert not visible[:, z < -8.0].any()
    assert visible[:, z > 4.0].any()
