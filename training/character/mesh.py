"""From the implicit body to a triangle mesh of its left half, and from the half to the whole."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.arrays import Array
from training.character import remesh
from training.character.body import Body

Triangles = NDArray[np.int64]


def _axis(*stops: tuple[float, float]) -> Array:
    """Grid coordinates through `(coordinate, spacing up to the next stop)` stops."""
    parts = [
        np.linspace(a, b, max(2, round((b - a) / step) + 1))[:-1] for (a, step), (b, _) in pairwise(stops)
    ]
    return np.concatenate([*parts, [stops[-1][0]]])


def extract(body: Body) -> tuple[Array, Triangles]:
    """Marching cubes over x >= 0 on a grid that is finer at the hand and the face: vertices `(V, 3)`, triangles."""
    from skimage.measure import marching_cubes

    xs = _axis((0.0, 0.006), (0.66, 0.003), (0.87, 0))
    ys = _axis((-0.02, 0.004), (0.08, 0.007), (1.20, 0.0028), (1.34, 0.006), (1.72, 0))
    zs = _axis((-0.14, 0.007), (-0.090, 0.0028), (0.055, 0.006), (0.26, 0))
    grid = np.stack(np.meshgrid(xs, ys, zs, indexing="ij"), axis=-1).reshape(-1, 3)
    values = np.concatenate([body.distance(chunk) for chunk in np.array_split(grid, 24)])
    vertices, triangles, _, _ = marching_cubes(values.reshape(len(xs), len(ys), len(zs)), 0.0)
    columns = [np.interp(vertices[:, i], np.arange(len(a)), a) for i, a in enumerate((xs, ys, zs))]
    return _weld(np.stack(columns, axis=1), triangles.astype(np.int64))


def edge_length(points: Array) -> Array:
    """Target edge length `(N,)` in metres at surface points of the half body."""
    x, y, _ = points.T
    size = np.full(len(points), 0.0125)
    size = np.where(x > 0.63, 0.0042, size)
    size = np.where(y > 1.46, 0.0078, size)
    return np.where(y < 0.12, 0.0088, size)


def half_mesh(body: Body) -> tuple[Array, Triangles]:
    """Even mesh of the half body, on its surface, with edges of about `edge_length`."""
    vertices, triangles = extract(body)
    vertices = relax(body, vertices, triangles, 2)
    for _ in range(6):
        vertices, triangles = remesh.collapse(vertices, triangles, edge_length, 8)
        triangles = remesh.flip(vertices, triangles)
        vertices = relax(body, vertices, triangles, 2)
    return vertices, triangles


def _weld(vertices: Array, triangles: Triangles, tolerance: float = 1e-5) -> tuple[Array, Triangles]:
    keys = np.round(vertices / tolerance).astype(np.int64)
    _, first, inverse = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    triangles = inverse.reshape(-1)[triangles]
    distinct = (
        (triangles[:, 0] != triangles[:, 1])
        & (triangles[:, 1] != triangles[:, 2])
        & (triangles[:, 2] != triangles[:, 0])
    )
    return vertices[first], triangles[distinct]


def neighbour_mean(triangles: Triangles, count: int) -> Any:
    """Sparse row-stochastic matrix `(count, count)` that averages over the one-ring."""
    from scipy.sparse import coo_matrix, diags

    rows = triangles[:, [0, 1, 1, 2, 2, 0]].ravel()
    columns = triangles[:, [1, 0, 2, 1, 0, 2]].ravel()
    matrix = coo_matrix((np.ones(len(rows)), (rows, columns)), (count, count)).tocsr()
    matrix.data[:] = 1.0
    return diags(1.0 / np.maximum(np.asarray(matrix.sum(axis=1)).ravel(), 1)) @ matrix


def laplacian(vertices: Array, triangles: Triangles) -> tuple[Any, Array]:
    """Cotangent stiffness matrix `(V, V)` and lumped vertex areas `(V,)`."""
    from scipy.sparse import coo_matrix, diags

    count = len(vertices)
    rows, columns, values = [], [], []
    mass = np.zeros(count)
    for k in range(3):
        i, j, apex = triangles[:, k], triangles[:, (k + 1) % 3], triangles[:, (k + 2) % 3]
        u, v = vertices[i] - vertices[apex], vertices[j] - vertices[apex]
        area = np.maximum(np.linalg.norm(np.cross(u, v), axis=1), 1e-12)
        rows += [i, j]
        columns += [j, i]
        values += [np.maximum(0.5 * np.sum(u * v, axis=1) / area, 0.0)] * 2
        np.add.at(mass, apex, area / 6.0)
    weight = coo_matrix(
        (np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))), (count, count)
    )
    return diags(np.asarray(weight.sum(axis=1)).ravel()) - weight.tocsr(), mass


def relax(body: Body, vertices: Array, triangles: Triangles, rounds: int) -> Array:
    """Even out triangle shapes: slide vertices along the surface towards their neighbours' mean."""
    mean = neighbour_mean(triangles, len(vertices))
    middle = vertices[:, 0] < 1e-7
    for _ in range(rounds):
        normals = body.gradient(vertices)
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        move = mean @ vertices - vertices
        move -= np.sum(move * normals, axis=1, keepdims=True) * normals
        move[middle, 0] = 0.0
        vertices = body.project(vertices + 0.5 * move, 1)
    return body.project(vertices, 3)


def mirror_index(vertices: Array) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """For each vertex of the whole mesh: the half-mesh vertex it comes from, and whether it is mirrored (0 or 1)."""
    side = np.flatnonzero(vertices[:, 0] > 1e-7)
    source = np.concatenate([np.arange(len(vertices)), side])
    return source, np.repeat([0, 1], [len(vertices), len(side)])


def mirror_triangles(vertices: Array, triangles: Triangles) -> Triangles:
    """Triangles of the whole mesh whose vertices are ordered as in `mirror_index`."""
    side = np.flatnonzero(vertices[:, 0] > 1e-7)
    image = np.arange(len(vertices))
    image[side] = len(vertices) + np.arange(len(side))
    return np.concatenate([triangles, image[triangles][:, ::-1]])
