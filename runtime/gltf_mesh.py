"""Meshes, skins and nodes of a glTF file merged into one skinned mesh."""

from __future__ import annotations

import re
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from runtime import rotations
from runtime.errors import FileError
from runtime.gltf_joints import CONVENTIONS
from runtime.gltf_read import REMEDY, GltfFile, read_accessor

if TYPE_CHECKING:
    from pygltflib import Primitive

Array = NDArray[Any]

MAX_VERTICES = 4_000_000


@dataclass(frozen=True)
class MeshData:
    """All skinned primitives of a file over one list of joints; shapes as in `Character`."""

    positions: Array
    normals: Array
    colors: Array
    joint_indices: Array
    joint_weights: Array
    triangles: Array
    joint_nodes: tuple[int, ...] = ()
    joint_parents: tuple[int, ...] = ()
    inverse_bind: Array = field(default_factory=lambda: np.zeros((0, 4, 4), np.float32))
    rest_world: Array = field(default_factory=lambda: np.zeros((0, 4, 4)))
    humanoid: dict[str, int] = field(default_factory=dict)

    def rest_positions(self) -> Array:
        """Vertices `(V, 3)` as the file shows them, skinned by the joints' rest transforms."""
        matrices = (self.rest_world @ self.inverse_bind)[self.joint_indices, :3]
        blended = np.einsum("vi,vijk->vjk", self.joint_weights, matrices)
        return np.einsum("vjk,vk->vj", blended[..., :3], self.positions) + blended[..., 3]


def node_parents(file: GltfFile) -> list[int]:
    """Parent node of each node, -1 at roots; FileError on a cycle or a bad child index."""
    nodes = file.gltf.nodes or []
    parents = [-1] * len(nodes)
    for i, node in enumerate(nodes):
        for child in node.children or []:
            if not 0 <= child < len(nodes) or parents[child] >= 0 or child == i:
                raise FileError(f"{file.name}: the children of node {i} do not form a tree.", REMEDY)
            parents[child] = i
    for i in range(len(nodes)):
        steps, k = 0, i
        while k >= 0:
            k, steps = parents[k], steps + 1
            if steps > len(nodes):
                raise FileError(f"{file.name}: the node hierarchy has a cycle at node {i}.", REMEDY)
    return parents


def node_world_matrices(file: GltfFile) -> Array:
    """Rest transforms `(nodes, 4, 4)` in scene space, float64."""
    parents = node_parents(file)
    local = [_local_matrix(file, i) for i in range(len(parents))]
    world: dict[int, Array] = {}
    for i in range(len(parents)):
        path = []
        k = i
        while k >= 0 and k not in world:
            path.append(k)
            k = parents[k]
        for node in reversed(path):
            parent = parents[node]
            world[node] = local[node] if parent < 0 else world[parent] @ local[node]
    return np.stack([world[i] for i in range(len(parents))]) if parents else np.zeros((0, 4, 4))


def _local_matrix(file: GltfFile, i: int) -> Array:
    node = file.gltf.nodes[i]
    if node.matrix is not None:
        matrix = np.array(node.matrix, np.float64).reshape(4, 4).T
    else:
        x, y, z, w = np.array(node.rotation if node.rotation is not None else (0, 0, 0, 1), np.float64)
        matrix = np.eye(4)
        turn = rotations.to_matrix(rotations.normalize(np.array([w, x, y, z])))
        matrix[:3, :3] = turn * np.array(node.scale if node.scale is not None else (1, 1, 1), np.float64).reshape(3)
        matrix[:3, 3] = np.array(node.translation if node.translation is not None else (0, 0, 0), np.float64)
    if not np.all(np.isfinite(matrix)):
        raise FileError(f"{file.name}: the transform of node {i} is not finite.", REMEDY)
    return matrix


class _Palette:
    """The joints of all skins: one entry for each pair of node and inverse bind matrix."""

    def __init__(self) -> None:
        self.nodes: list[int] = []
        self.inverse_bind: list[Array] = []
        self._index: dict[tuple[int, bytes], int] = {}

    def add(self, node: int, inverse_bind: Array) -> int:
        key = (node, np.round(inverse_bind, 5).astype(np.float32).tobytes())
        if key not in self._index:
            self._index[key] = len(self.nodes)
            self.nodes.append(node)
            self.inverse_bind.append(inverse_bind)
        return self._index[key]


def read_meshes(file: GltfFile) -> MeshData:
    """Merge every skinned primitive of the file; FileError when there is none or it is damaged."""
    nodes = file.gltf.nodes or []
    if not file.gltf.skins:
        raise FileError(f"{file.name}: it has no skin.", "Export the character with its skeleton and skin weights.")
    world = node_world_matrices(file)
    palette = _Palette()
    parts: list[MeshData] = []
    for node in nodes:
        if node.mesh is None or node.skin is None:
            continue
        slots = _skin_slots(file, node.skin, palette)
        for p, primitive in enumerate(file.gltf.meshes[node.mesh].primitives):
            if primitive.mode in (None, 4):
                parts.append(_read_primitive(file, primitive, slots, f"mesh {node.mesh} primitive {p}"))
    if not parts:
        raise FileError(f"{file.name}: no mesh of triangles uses its skin.", REMEDY)
    merged = _merge(file, parts)
    parents = _joint_parents(file, palette.nodes)
    return replace(
        merged,
        joint_nodes=tuple(palette.nodes),
        joint_parents=parents,
        inverse_bind=np.stack(palette.inverse_bind).astype(np.float32),
        rest_world=world[palette.nodes],
        humanoid=_vrm_humanoid(file, palette.nodes),
    )


def _skin_slots(file: GltfFile, index: int, palette: _Palette) -> NDArray[np.int64]:
    """Palette entry of each joint of skin `index`."""
    skin = file.gltf.skins[index]
    joints = list(skin.joints or [])
    if not joints or not all(0 <= j < len(file.gltf.nodes) for j in joints):
        raise FileError(f"{file.name}: skin {index} names joints that are not there.", REMEDY)
    if skin.inverseBindMatrices is None:
        inverse = np.repeat(np.eye(4)[None], len(joints), axis=0)
    else:
        values = read_accessor(file, skin.inverseBindMatrices, f"inverse bind matrices of skin {index}")
        if values.shape[1] != 16 or len(values) < len(joints):
            raise FileError(f"{file.name}: skin {index} has {len(joints)} joints but {len(values)} bind matrices.", REMEDY)
        inverse = values.reshape(-1, 4, 4).transpose(0, 2, 1)
    return np.array([palette.add(j, m) for j, m in zip(joints, inverse, strict=False)])


def _read_primitive(file: GltfFile, primitive: Primitive, slots: NDArray[np.int64], what: str) -> MeshData:
    attributes = primitive.attributes
    positions = _vectors(file, attributes.POSITION, f"POSITION of {what}", 3)
    if primitive.indices is None:
        indices = np.arange(len(positions))
    else:
        indices = read_accessor(file, primitive.indices, f"indices of {what}").ravel().astype(np.int64)
    if len(indices) % 3 or indices.min() < 0 or indices.max() >= len(positions):
        raise FileError(f"{file.name}: the indices of {what} do not fit its {len(positions)} vertices.", REMEDY)
    triangles = indices.reshape(-1, 3)
    if attributes.NORMAL is None:
        normals = vertex_normals(positions, triangles)
    else:
        normals = _matching(file, attributes.NORMAL, f"NORMAL of {what}", (3,), len(positions))
    joints, weights = _influences(file, attributes, slots, what, len(positions))
    return MeshData(positions, rotations.normalize(normals).astype(np.float32),
                    _colors(file, primitive, what, len(positions)), joints, weights, triangles.astype(np.uint32))


def _vectors(file: GltfFile, index: int | None, what: str, width: int) -> Array:
    values = read_accessor(file, index, what)
    if values.shape[1] != width:
        raise FileError(f"{file.name}: {what} has {values.shape[1]} components; expected {width}.", REMEDY)
    return values.astype(np.float32)


def _matching(file: GltfFile, index: int | None, what: str, widths: tuple[int, ...], count: int) -> Array:
    values = read_accessor(file, index, what)
    if len(values) != count or values.shape[1] not in widths:
        raise FileError(f"{file.name}: {what} is {values.shape[0]} x {values.shape[1]}; expected {count} rows.", REMEDY)
    return values


def vertex_normals(positions: Array, triangles: Array) -> Array:
    """Area-weighted vertex normals `(V, 3)`."""
    a, b, c = (positions[triangles[:, i]].astype(np.float64) for i in range(3))
    face = np.cross(b - a, c - a)
    normals = np.stack(
        [np.bincount(triangles.T.ravel(), np.tile(face[:, i], 3), len(positions)) for i in range(3)], axis=1
    )
    return rotations.normalize(normals)


def _colors(file: GltfFile, primitive: Primitive, what: str, count: int) -> Array:
    materials = file.gltf.materials or []
    factor = np.ones(3, np.float32)
    if primitive.material is not None:
        if not 0 <= primitive.material < len(materials):
            raise FileError(f"{file.name}: the material of {what} is missing.", REMEDY)
        surface = materials[primitive.material].pbrMetallicRoughness
        if surface is not None and surface.baseColorFactor is not None:
            factor = np.array(surface.baseColorFactor, np.float32)[:3]
    if primitive.attributes.COLOR_0 is None:
        return np.tile(factor, (count, 1))
    color = _matching(file, primitive.attributes.COLOR_0, f"COLOR_0 of {what}", (3, 4), count)
    return np.clip(color[:, :3] * factor, 0.0, 1.0).astype(np.float32)


def _influences(file: GltfFile, attributes: Any, slots: NDArray[np.int64], what: str, count: int) -> tuple[Array, Array]:
    joints, weights = [], []
    for channel in ("0", "1"):  # up to eight influences; the four strongest are kept
        j = getattr(attributes, f"JOINTS_{channel}", None)
        w = getattr(attributes, f"WEIGHTS_{channel}", None)
        if channel == "0" or (j is not None and w is not None):
            joints.append(_matching(file, j, f"JOINTS_{channel} of {what}", (4,), count).astype(np.int64))
            weights.append(_matching(file, w, f"WEIGHTS_{channel} of {what}", (4,), count).astype(np.float64))
    all_joints, all_weights = np.concatenate(joints, axis=1), np.concatenate(weights, axis=1)
    used = all_weights > 0
    if all_joints.min() < 0 or np.any(all_joints[used] >= len(slots)):
        raise FileError(
            f"{file.name}: {what} uses joint {int(all_joints[used].max())}; its skin has {len(slots)} joints.", REMEDY
        )
    if all_weights.min() < 0 or not np.all(used.any(axis=1)):
        raise FileError(f"{file.name}: {what} has negative weights or vertices without a joint.", "Normalise the weights.")
    best = np.argsort(-all_weights, axis=1, kind="stable")[:, :4]
    kept = np.take_along_axis(all_weights, best, axis=1)
    index = np.take_along_axis(np.where(used, all_joints, 0), best, axis=1)
    return slots[index].astype(np.uint16), (kept / kept.sum(axis=1, keepdims=True)).astype(np.float32)


def _merge(file: GltfFile, parts: list[MeshData]) -> MeshData:
    if sum(len(p.positions) for p in parts) > MAX_VERTICES:
        raise FileError(f"{file.name}: more than {MAX_VERTICES} vertices.", "Reduce the mesh.")
    base = np.cumsum([0] + [len(p.positions) for p in parts[:-1]])
    triangles = [p.triangles + np.uint32(b) for p, b in zip(parts, base, strict=True)]
    names = ("positions", "normals", "colors", "joint_indices", "joint_weights")
    merged = {name: np.concatenate([getattr(p, name) for p in parts]) for name in names}
    return MeshData(**merged, triangles=np.concatenate(triangles))


def _joint_parents(file: GltfFile, joint_nodes: list[int]) -> tuple[int, ...]:
    """Nearest ancestor that is itself a joint, as an index into `joint_nodes`."""
    parents = node_parents(file)
    first = {}
    for i, node in enumerate(joint_nodes):
        first.setdefault(node, i)
    result = []
    for node in joint_nodes:
        k = parents[node]
        while k >= 0 and k not in first:
            k = parents[k]
        result.append(first[k] if k >= 0 else -1)
    return tuple(result)


def _vrm_humanoid(file: GltfFile, joint_nodes: list[int]) -> dict[str, int]:
    """SPORT joint -> joint index from a VRM 0 or 1 humanoid description; empty when the file has none."""
    extensions = file.gltf.extensions or {}
    bones: dict[str, int] = {}
    for description in (extensions.get("VRM"), extensions.get("VRMC_vrm")):
        listed = (description or {}).get("humanoid", {}).get("humanBones", {})
        pairs = listed.items() if isinstance(listed, dict) else ((bone["bone"], bone) for bone in listed)
        bones |= {re.sub(r"[^a-z0-9]", "", name.lower()): int(bone["node"]) for name, bone in pairs}
    return {
        joint: joint_nodes.index(bones[simple])
        for joint, simple in CONVENTIONS["VRM"].items()
        if bones.get(simple) in joint_nodes
    }
