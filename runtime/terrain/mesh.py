"""Heights from meshes: only geometry is read, within limits on triangles and the cells they cover."""

import io
import re
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.arrays import Array
from runtime.errors import FileError
from runtime.safe_read import decode_text, read_bounded

MESH_SUFFIXES = (".obj", ".ply", ".stl", ".glb", ".gltf", ".off")
MAX_SIDE = 4096  # samples along one side
MAX_MESH_BYTES = 128 * 1024 * 1024
MAX_TRIANGLES = 500_000
MAX_VERTICES = 3 * MAX_TRIANGLES
MAX_COVERED_CELLS = 3 * MAX_SIDE * MAX_SIDE  # of the rectangles around all triangles
MAX_COORDINATE_M = 1e6
ROUNDING_FRACTION = 1e-6  # of a cell: tolerance of a mesh's end behind a sample
EDGE_TOLERANCE = 1e-9  # of cells and triangles: points on an edge are inside
STL_HEAD_BYTES, STL_TRIANGLE_BYTES = 84, 50
_SMALL = 64  # cells of a rectangle that is rasterised in a batch
_AT_ONCE = 1 << 15  # cells per batch, which keeps intermediate results in the processor's cache
_REMEDY = "Export the ground as one OBJ or PLY in metres, Y up."


def read_mesh(path: Path, cell_m: float) -> tuple[Array, tuple[float, float]]:
    """Return the mesh's highest surface sampled every `cell_m`, and x, z of the first sample; FileError says what is wrong."""
    try:
        with np.errstate(all="ignore"):
            vertices, faces = _geometry(path)
    except (FileError, MemoryError):
        raise
    except Exception as error:  # trimesh's readers raise arbitrary parser errors
        raise FileError(
            f"{path}: not a readable mesh: it has no faces, or it is damaged.", _REMEDY
        ) from error
    _check(path, vertices, faces)
    low, high = vertices[:, [0, 2]].min(0), vertices[:, [0, 2]].max(0)
    shape = np.ceil((high - low) / cell_m - ROUNDING_FRACTION).astype(int) + 1
    if shape.max() > MAX_SIDE or shape.min() < 2:
        size = f"{high[0] - low[0]:.2f} x {high[1] - low[1]:.2f} m"
        raise FileError(
            f"{path}: {size} at {cell_m} m a cell; expected 2 to {MAX_SIDE} cells a side.",
            "Change the cell size or the units (metres) of the mesh.",
        )
    centre = (low + high) / 2
    triangles = vertices[faces]
    triangles[..., [0, 2]] = (triangles[..., [0, 2]] - low) / cell_m
    grid = (int(shape[0]), int(shape[1]))
    covered = int(np.prod(_rectangles(triangles, grid)[1], axis=1).sum())
    if covered > MAX_COVERED_CELLS:
        raise FileError(
            f"{path}: its triangles lie over each other on {covered} cells; expected at most"
            f" {MAX_COVERED_CELLS}.",
            "Choose larger cells, or export the upper surface alone.",
        )
    origin = low - np.round(centre / cell_m) * cell_m
    return rasterise(triangles, grid), (float(origin[0]), float(origin[1]))


def _check(path: Path, vertices: Array, faces: NDArray[np.int64]) -> None:
    if not len(faces):
        raise FileError(f"{path}: this {path.suffix[1:].upper()} has no faces.", _REMEDY)
    sized = vertices.ndim == faces.ndim == 2 and vertices.shape[1] == faces.shape[1] == 3
    if not sized or not 1 <= len(faces) <= MAX_TRIANGLES or len(vertices) > MAX_VERTICES:
        raise FileError(
            f"{path}: {len(faces)} triangles of {len(vertices)} vertices; expected 1 to {MAX_TRIANGLES}"
            f" of at most {MAX_VERTICES}.",
            _REMEDY,
        )
    if faces.min() < 0 or faces.max() >= len(vertices):
        raise FileError(f"{path}: a triangle has a vertex that is not there.", _REMEDY)
    if not np.all(np.abs(vertices) <= MAX_COORDINATE_M):
        raise FileError(
            f"{path}: expected finite coordinates within {MAX_COORDINATE_M / 1000:.0f} km.", _REMEDY
        )


# --- files


def _geometry(path: Path) -> tuple[Array, NDArray[np.int64]]:
    """Return vertices `(V, 3)` and triangles `(F, 3)` as in the file, unchecked."""
    kind = path.suffix.lower()
    if kind in (".glb", ".gltf"):
        return _gltf_geometry(path)
    data = read_bounded(path, MAX_MESH_BYTES, _REMEDY)
    if kind == ".obj":
        return _obj_geometry(decode_text(data), path)
    return _trimesh_geometry(path, kind, data)


def _trimesh_geometry(path: Path, kind: str, data: bytes) -> tuple[Array, NDArray[np.int64]]:
    import trimesh

    binary = kind == ".ply" or (
        kind == ".stl"
        and len(data) == STL_HEAD_BYTES + STL_TRIANGLE_BYTES * int.from_bytes(data[80:84], "little")
    )
    if kind == ".ply":
        end = data.find(b"end_header")
        head = data[: max(end, 0)]
        counts = re.findall(rb"^\s*element\s+\S+\s+(\d+)", head, re.MULTILINE)
        if end < 0 or sum(int(count[:12]) for count in counts) > MAX_VERTICES + MAX_TRIANGLES:
            raise FileError(
                f"{path}: not a readable mesh (a header without end or with too many elements).", _REMEDY
            )
        binary = b"format ascii" not in head
    if not binary:
        text = decode_text(data)
        if kind == ".stl" and text.lower().count("vertex") > MAX_VERTICES:
            raise FileError(f"{path}: more than {MAX_TRIANGLES} triangles.", _REMEDY)
        data = text.encode("utf-8", "replace")
    mesh: Any = trimesh.load(
        io.BytesIO(data), file_type=kind[1:], force="mesh", process=False, skip_materials=True
    )
    return np.asarray(mesh.vertices, np.float64), np.asarray(mesh.faces, np.int64)


def _obj_geometry(text: str, path: Path) -> tuple[Array, NDArray[np.int64]]:
    """Read the lines `v` and `f` of an OBJ; polygons become fans, and everything else (materials, normals) is skipped."""
    vertices: list[list[str]] = []
    faces: list[tuple[int, int, int]] = []
    for line in text.replace("\\\n", " ").replace("\\\r\n", " ").splitlines():
        kind, *words = line.split(None, MAX_TRIANGLES) or [""]
        if kind == "v":
            vertices.append(words[:3])
        elif kind == "f":
            faces += _fan(words, len(vertices))
        if len(faces) > MAX_TRIANGLES:
            raise FileError(f"{path}: more than {MAX_TRIANGLES} triangles.", _REMEDY)
        if len(vertices) > MAX_VERTICES:
            raise FileError(f"{path}: more than {MAX_VERTICES} vertices.", _REMEDY)
    return np.array(vertices, np.float64).reshape(len(vertices), -1), np.array(faces, np.int64).reshape(-1, 3)


def _fan(words: list[str], vertices: int) -> list[tuple[int, int, int]]:
    """Return the triangles of an OBJ polygon, whose negative indices count back from the last of the `vertices`."""
    numbers = [int(word.partition("/")[0]) for word in words]
    corners = [k - 1 if k > 0 else vertices + k for k in numbers]
    return [(corners[0], b, c) for b, c in pairwise(corners[1:])]


def _gltf_geometry(path: Path) -> tuple[Array, NDArray[np.int64]]:
    """Return all triangles of a glTF, transformed by its nodes; materials and textures are ignored."""
    from runtime.character.nodes import Nodes
    from runtime.character.read import open_gltf

    file = open_gltf(path)
    world = Nodes(file).rest
    vertices, faces, count = [np.zeros((0, 3))], [np.zeros((0, 3), np.int64)], 0
    for matrix, mesh, primitive in _gltf_primitives(path, file, world):
        what = f"mesh {mesh}"
        points = file.values(primitive.attributes.POSITION, f"POSITION of {what}")
        indices = np.arange(len(points))
        if primitive.indices is not None:
            indices = file.values(primitive.indices, f"indices of {what}").ravel().astype(np.int64)
        if len(indices) % 3 or indices.min() < 0 or indices.max() >= len(points) or points.shape[1] != 3:
            raise FileError(f"{path}: the indices of {what} do not fit its {len(points)} vertices.", _REMEDY)
        vertices.append(points @ matrix[:3, :3].T + matrix[:3, 3])
        faces.append(indices.reshape(-1, 3) + count)
        count += len(points)
    return np.concatenate(vertices), np.concatenate(faces)


def _gltf_primitives(path: Path, file: Any, world: Array) -> Iterator[tuple[Array, int, Any]]:
    """Yield world matrix, mesh index and primitive of everything made of triangles, within the limits."""
    from runtime.character.read import MAX_PRIMITIVES

    primitives = vertices = triangles = 0
    for node, matrix in zip(file.gltf.nodes or [], world, strict=True):
        if node.mesh is None:
            continue
        for primitive in file.gltf.meshes[node.mesh].primitives:
            if primitive.mode not in (None, 4):
                continue
            count = file.count(primitive.attributes.POSITION)
            primitives, vertices = primitives + 1, vertices + count
            triangles += (file.count(primitive.indices) or count) // 3
            if primitives > MAX_PRIMITIVES or vertices > MAX_VERTICES or triangles > MAX_TRIANGLES:
                raise FileError(
                    f"{path}: more than {MAX_TRIANGLES} triangles or {MAX_PRIMITIVES} meshes.", _REMEDY
                )
            yield matrix, node.mesh, primitive


# --- heights


def _rectangles(triangles: Array, shape: tuple[int, int]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """First grid point `(n, 2)` and size `(n, 2)` of the rectangle of grid points under each triangle."""
    xz = triangles[..., [0, 2]]
    first = np.maximum(np.ceil(xz.min(1) - EDGE_TOLERANCE).astype(np.int64), 0)
    last = np.minimum(np.floor(xz.max(1) + EDGE_TOLERANCE).astype(np.int64), np.array(shape) - 1)
    return first, np.maximum(last - first + 1, 0)


def rasterise(triangles: Array, shape: tuple[int, int]) -> Array:
    """Return the highest y of triangles `(n, 3, 3)` at each grid point (x, z in cells) of `shape`; gaps take the lowest y."""
    heights = np.full(shape, -np.inf)
    first, size = _rectangles(triangles, shape)
    cells = np.prod(size, axis=1)
    xz = triangles[..., [0, 2]]
    edge1, edge2 = xz[:, 1] - xz[:, 0], xz[:, 2] - xz[:, 0]
    area = edge1[:, 0] * edge2[:, 1] - edge1[:, 1] * edge2[:, 0]
    cells[np.abs(area) <= 1e-12] = 0  # small ones may lie between grid points, vertical ones have no top
    small = np.flatnonzero((cells > 0) & (cells <= _SMALL))
    for some in np.array_split(small, len(small) * _SMALL // _AT_ONCE + 1):
        of = np.repeat(some, cells[some])
        number = np.arange(len(of)) - np.repeat(np.cumsum(cells[some]) - cells[some], cells[some])
        i, j = first[of, 0] + number // size[of, 1], first[of, 1] + number % size[of, 1]
        np.maximum.at(heights, (i, j), _surface(triangles, area, of, i, j))
    for k in np.flatnonzero(cells > _SMALL):
        rows = max(1, _AT_ONCE // int(size[k, 1]))
        j = np.arange(first[k, 1], first[k, 1] + size[k, 1])[None, :]
        for i0 in range(int(first[k, 0]), int(first[k, 0] + size[k, 0]), rows):
            i = np.arange(i0, min(i0 + rows, first[k, 0] + size[k, 0]))[:, None]
            block = heights[i0 : i0 + len(i), j[0, 0] : j[0, -1] + 1]
            np.maximum(block, _surface(triangles, area, k, i, j), out=block)
    heights[np.isneginf(heights)] = triangles[..., 1].min()
    return heights


def _surface(triangles: Array, area: Array, k: Any, i: Array, j: Array) -> Array:
    """Height of triangle(s) `k` over the grid points i, j; minus infinity outside them."""
    a, edge1, edge2 = triangles[k, 0], triangles[k, 1] - triangles[k, 0], triangles[k, 2] - triangles[k, 0]
    dx, dz = i - a[..., 0], j - a[..., 2]
    u = (dx * edge2[..., 2] - dz * edge2[..., 0]) / area[k]
    v = (dz * edge1[..., 0] - dx * edge1[..., 2]) / area[k]
    inside = (u >= -EDGE_TOLERANCE) & (v >= -EDGE_TOLERANCE) & (u + v <= 1 + EDGE_TOLERANCE)
    return np.where(inside, a[..., 1] + u * edge1[..., 1] + v * edge2[..., 1], -np.inf)
