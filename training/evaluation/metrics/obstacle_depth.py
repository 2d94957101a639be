"""How deep joints and limbs are in the ground: metres to its nearest surface, so that a wall's face counts like its top."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from runtime.terrain.height_map import Terrain

Array = NDArray[np.floating]

# limbs as capsules: the joints at both ends, and the radius in metres
CAPSULES: dict[str, tuple[tuple[int, int, float], ...]] = {
    "thighs": ((2, 3, 0.06), (7, 8, 0.06)),
    "shins": ((3, 4, 0.045), (8, 9, 0.045)),
    "hands": ((20, 22, 0.03), (27, 29, 0.03)),
}
DIRECTIONS, STEP_M, FARTHEST_M = 16, 0.01, 0.8
STATIONS = (0.0, 0.25, 0.5, 0.75, 1.0)  # along a capsule
AROUND = 8  # points of its surface at each


def depth_inside(points: Array, terrain: Terrain) -> Array:
    """Depth in metres of `(..., 3)` points under the nearest surface, 0 outside; at most `FARTHEST_M`."""
    flat = np.asarray(points, np.float64).reshape(-1, 3)
    down = terrain.height(flat[:, 0], flat[:, 2]) - flat[:, 1]
    inside = np.flatnonzero(down > 0.0)
    depth = np.zeros(len(flat))
    if len(inside):
        depth[inside] = _to_surface(flat[inside], down[inside], terrain)
    return depth.reshape(np.shape(points)[:-1])


def _to_surface(points: Array, down: Array, terrain: Terrain) -> Array:
    """Least way out of the ground of points inside it: up, sideways, or up and sideways."""
    angle = 2.0 * np.pi * np.arange(DIRECTIONS) / DIRECTIONS
    compass = np.stack([np.cos(angle), np.sin(angle)], -1)
    nearest = np.minimum(down, FARTHEST_M).astype(np.float64)
    for radius in np.arange(STEP_M, FARTHEST_M, STEP_M):
        left = np.flatnonzero(nearest > radius)
        if not len(left):
            break
        xz = points[left, None][..., [0, 2]] + radius * compass
        up = np.maximum(terrain.height(xz[..., 0], xz[..., 1]) - points[left, 1:2], 0.0).min(1)
        nearest[left] = np.minimum(nearest[left], np.hypot(radius, up))
    return nearest


def capsule_points(positions: Array, first: int, last: int, radius: float) -> Array:
    """Points `(T, 40, 3)` on the surface of the capsule between two joints of world positions `(T, 31, 3)`."""
    a, b = (positions[:, j].astype(np.float64) for j in (first, last))
    axis = b - a
    axis /= np.maximum(np.linalg.norm(axis, axis=-1, keepdims=True), 1e-9)
    helper = np.where(np.abs(axis[:, 1:2]) < 0.9, [[0.0, 1.0, 0.0]], [[1.0, 0.0, 0.0]])
    u = np.cross(axis, helper)
    u /= np.linalg.norm(u, axis=-1, keepdims=True)
    v = np.cross(axis, u)
    angle = 2.0 * np.pi * np.arange(AROUND) / AROUND
    ring = np.cos(angle)[:, None] * u[:, None] + np.sin(angle)[:, None] * v[:, None]
    at = a[:, None] + np.array(STATIONS)[:, None] * (b - a)[:, None]
    return (at[:, :, None] + radius * ring[:, None]).reshape(len(positions), -1, 3)


def limb_depths(positions: Array, terrain: Terrain) -> dict[str, Array]:
    """Depth `(T,)` in metres of the deepest point of each kind of limb of `CAPSULES`."""
    return {
        name: np.max(
            [depth_inside(capsule_points(positions, *ends), terrain).max(1) for ends in pairs], axis=0
        )
        for name, pairs in CAPSULES.items()
    }
