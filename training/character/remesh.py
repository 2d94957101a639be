"""Parallel edge collapse, edge flips and cuts along lines: an even mesh that is fine only where it has to be.

All operations pick independent sets of edges, so that each pass is a handful of array operations.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from runtime.arrays import Array

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix

Indices = NDArray[np.int64]
Field = Callable[[Array], Array]


def edges_of(triangles: Indices) -> tuple[Indices, Indices]:
    """Undirected edges `(E, 2)` and how many triangles share each `(E,)`."""
    pairs = np.sort(
        np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]]), axis=1
    )
    return np.unique(pairs, axis=0, return_counts=True)


def _adjacency(edges: Indices, count: int) -> csr_matrix:
    from scipy.sparse import coo_matrix

    i, j = edges.T
    ones = np.ones(2 * len(edges), np.int32)
    return coo_matrix((ones, (np.r_[i, j], np.r_[j, i])), (count, count)).tocsr()


def face_normals(vertices: Array, triangles: Indices) -> Array:
    """Area-scaled normals `(F, 3)`."""
    a, b, c = (vertices[triangles[:, i]] for i in range(3))
    return np.cross(b - a, c - a)


def collapse(vertices: Array, triangles: Indices, target: Field, passes: int) -> tuple[Array, Indices]:
    """Merge edges shorter than 0.8 of the target length `target(points)`; the rim x = 0 stays on its plane."""
    for _ in range(passes):
        chosen = _short_edges(vertices, triangles, target)
        if not len(chosen):
            break
        vertices, triangles = _merge_edges(vertices, triangles, chosen)
    return vertices, triangles


def _short_edges(vertices: Array, triangles: Indices, target: Field) -> Indices:
    """An independent set of edges `(E, 2)` that may be merged, (kept, removed) vertex."""
    edges, shared = edges_of(triangles)
    adjacency = _adjacency(edges, len(vertices))
    rim = vertices[:, 0] == 0
    ratio = np.linalg.norm(vertices[edges[:, 0]] - vertices[edges[:, 1]], axis=1)
    ratio = ratio / target(vertices[edges].mean(axis=1))
    both = rim[edges].all(axis=1)
    allowed = (ratio < 0.8) & ~(both & (shared == 2))
    edges, ratio, shared = edges[allowed], ratio[allowed], shared[allowed]
    common = np.asarray(adjacency[edges[:, 0]].multiply(adjacency[edges[:, 1]]).sum(axis=1)).ravel()
    allowed = common == shared  # the link condition: merging must not pinch the surface
    edges, priority = edges[allowed], ratio[allowed].argsort(kind="stable").argsort().astype(float)
    nearest = np.full(len(vertices), np.inf)
    np.minimum.at(nearest, edges[:, 0], priority)
    np.minimum.at(nearest, edges[:, 1], priority)
    around = nearest.copy()
    rows = np.repeat(np.arange(len(vertices)), np.diff(adjacency.indptr))
    np.minimum.at(around, rows, nearest[adjacency.indices])
    chosen = edges[(priority <= around[edges[:, 0]]) & (priority <= around[edges[:, 1]])]
    swap = rim[chosen[:, 1]] & ~rim[chosen[:, 0]]
    chosen[swap] = chosen[swap][:, ::-1]
    return chosen


def _merge_edges(vertices: Array, triangles: Indices, chosen: Indices) -> tuple[Array, Indices]:
    rim = vertices[:, 0] == 0
    before = face_normals(vertices, triangles)
    owner = np.full(len(vertices), -1)
    owner[chosen.ravel()] = np.repeat(np.arange(len(chosen)), 2)
    keep = np.ones(len(chosen), bool)
    for _ in range(2):  # the second round leaves out what would have folded a triangle
        moved, image = vertices.copy(), np.arange(len(vertices))
        a, b = chosen[keep].T
        both = rim[a] == rim[b]
        moved[a] = np.where(both[:, None], 0.5 * (vertices[a] + vertices[b]), vertices[a])
        image[b] = a
        after = face_normals(moved, image[triangles])
        dead = np.any(image[triangles][:, [0, 1, 2]] == image[triangles][:, [1, 2, 0]], axis=1)
        cosine = np.sum(before * after, axis=1)
        cosine /= np.maximum(np.linalg.norm(before, axis=1) * np.linalg.norm(after, axis=1), 1e-20)
        culprits = owner[triangles[(cosine < 0.5) & ~dead]]
        keep[culprits[culprits >= 0]] = False
    a, b = chosen[keep].T
    moved, image = vertices.copy(), np.arange(len(vertices))
    both = rim[a] == rim[b]
    moved[a] = np.where(both[:, None], 0.5 * (vertices[a] + vertices[b]), vertices[a])
    image[b] = a
    triangles = image[triangles]
    triangles = triangles[np.all(triangles != triangles[:, [1, 2, 0]], axis=1)]
    return compact(moved, triangles)


def compact(vertices: Array, triangles: Indices) -> tuple[Array, Indices]:
    """Drop vertices that no triangle uses."""
    used, inverse = np.unique(triangles, return_inverse=True)
    return vertices[used], inverse.reshape(triangles.shape)


def flip(vertices: Array, triangles: Indices, passes: int = 6) -> Indices:
    """Flip edges whose opposite angles exceed half a turn together (towards a Delaunay triangulation)."""
    for _ in range(passes):
        face, i, j, k, other, m = _edge_pairs(triangles)
        angle = _angle(vertices, k, i, j) + _angle(vertices, m, i, j)
        normal = face_normals(vertices, triangles)
        first = np.cross(vertices[m] - vertices[k], vertices[j] - vertices[k])
        second = np.cross(vertices[i] - vertices[k], vertices[m] - vertices[k])
        mean = normal[face] + normal[other]
        flat = (np.sum(first * mean, 1) > 0) & (np.sum(second * mean, 1) > 0)
        known = _adjacency(edges_of(triangles)[0], len(vertices))
        new = np.asarray(known[k, m]).ravel() == 0
        want = np.flatnonzero((angle > np.pi + 0.02) & flat & new)
        want = want[np.argsort(-angle[want], kind="stable")]
        best = np.full(len(triangles), len(face))
        np.minimum.at(best, face[want], np.arange(len(want)))
        np.minimum.at(best, other[want], np.arange(len(want)))
        order = np.arange(len(want))
        chosen = want[(best[face[want]] == order) & (best[other[want]] == order)]
        ends = np.sort(np.stack([k[chosen], m[chosen]], axis=1), axis=1)
        chosen = chosen[np.unique(ends, axis=0, return_index=True)[1]]  # never the same new edge twice
        if not len(chosen):
            break
        triangles = triangles.copy()
        triangles[face[chosen]] = np.stack([k[chosen], m[chosen], j[chosen]], axis=1)
        triangles[other[chosen]] = np.stack([k[chosen], i[chosen], m[chosen]], axis=1)
    return triangles


def _edge_pairs(triangles: Indices) -> tuple[Indices, ...]:
    """Inner edges: face, its directed edge i to j and apex k; the other face and its apex m."""
    start = triangles.T.ravel()
    end, apex = triangles[:, [1, 2, 0]].T.ravel(), triangles[:, [2, 0, 1]].T.ravel()
    face = np.tile(np.arange(len(triangles)), 3)
    size = int(triangles.max()) + 1
    key, twin = start * size + end, end * size + start
    order = np.argsort(key)
    at = np.clip(np.searchsorted(key[order], twin), 0, len(key) - 1)
    match = order[at]
    inner = (key[match] == twin) & (start < end)
    return face[inner], start[inner], end[inner], apex[inner], face[match[inner]], apex[match[inner]]


def _angle(vertices: Array, apex: Indices, a: Indices, b: Indices) -> Array:
    u, v = vertices[a] - vertices[apex], vertices[b] - vertices[apex]
    return np.arctan2(np.linalg.norm(np.cross(u, v), axis=1), np.sum(u * v, axis=1))


def cut(
    vertices: Array, triangles: Indices, field: Field, outside: Field, fixed: NDArray[np.bool_]
) -> tuple[Array, Indices, NDArray[np.bool_]]:
    """Make the line `field = 0` run along edges where `outside` is negative.

    Vertices next to the line slide onto it, edges that cross it farther away are divided. `fixed` `(V,)` marks vertices
    on earlier lines, which stay; returned with this line added.
    """
    vertices, fixed = vertices.copy(), fixed.copy()
    value = field(vertices)
    on = np.abs(value) < 1e-6
    edges, _ = edges_of(triangles)
    i, j, t, _ = _crossings(vertices, edges, value, outside)
    rim = vertices[:, 0] == 0
    for near, far, share in ((i, j, t), (j, i, 1.0 - t)):
        snap = np.flatnonzero((share < 0.35) & ~fixed[near] & ~on[near] & (~rim[near] | rim[far]))
        at, first = np.unique(near[snap], return_index=True)
        chosen = snap[first]
        vertices[at] += share[chosen, None] * (vertices[far[chosen]] - vertices[at])
        on[at] = True
    value = np.where(on, 0.0, field(vertices))
    i, j, t, middle = _crossings(vertices, edges, value, outside)
    for _ in range(3):  # secant steps, since the field may be curved
        t = np.clip(t - 0.7 * field(middle) / (value[j] - value[i]), 0.02, 0.98)
        middle = vertices[i] + t[:, None] * (vertices[j] - vertices[i])
    split = {(a, b): len(vertices) + n for n, (a, b) in enumerate(zip(i.tolist(), j.tolist(), strict=True))}
    vertices = np.concatenate([vertices, middle])
    fixed = np.concatenate([fixed | on, np.ones(len(middle), bool)])
    return vertices, _divide(triangles, split), fixed


def _crossings(
    vertices: Array, edges: Indices, value: Array, outside: Field
) -> tuple[Indices, Indices, Array, Array]:
    """Edges (i, j) that cross the zero line, where along them, and the crossing points."""
    i, j = edges[value[edges[:, 0]] * value[edges[:, 1]] < 0].T
    t = value[i] / (value[i] - value[j])
    points = vertices[i] + t[:, None] * (vertices[j] - vertices[i])
    used = outside(points) < 0.004
    return i[used], j[used], t[used], points[used]


def _divide(triangles: Indices, split: dict[tuple[int, int], int]) -> Indices:
    """Replace triangles with one or two divided edges by two or three."""
    result: list[tuple[int, int, int]] = []
    for a, b, c in triangles.tolist():
        middles = [split.get((min(p, q), max(p, q))) for p, q in ((a, b), (b, c), (c, a))]
        count = sum(m is not None for m in middles)
        while count and (
            middles[0] is None or (count == 2 and middles[1] is None)
        ):  # turn until edge ab (and bc) is cut
            a, b, c, middles = b, c, a, [*middles[1:], middles[0]]
        m, n, _ = middles
        if count == 0:
            result.append((a, b, c))
        elif count == 1 and m is not None:
            result += [(a, m, c), (m, b, c)]
        elif count == 2 and m is not None and n is not None:
            result += [(m, b, n), (a, m, n), (a, n, c)]
        else:
            raise ValueError("a line crosses a triangle three times; refine the mesh there")
    return np.array(result, np.int64)
