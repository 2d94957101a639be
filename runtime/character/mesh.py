"""Meshes, skins and nodes of a glTF file merged into one skinned mesh."""

from __future__ import annotations

import re
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from sport.runtime import rotations
from sport.runtime.character.color import primitive_colors
from sport.runtime.character.joints import CONVENTIONS
from sport.runtime.character.read import MAX_VALUE, REMEDY, GltfFile, read_accessor
from sport.runtime.errors import FileError

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
    def values(name: str, default: tuple[float, ...]) -> Array:
        given = getattr(node, name)
        array = np.array(default if given is None else given, np.float64)
        if array.shape != (len(default),) or not np.all(np.abs(array) < MAX_VALUE):
            raise FileError(
                f"{file.name}: the {name} of node {i} is not {len(default)} finite numbers.", REMEDY
            )
        return array

    node = file.gltf.nodes[i]
    if node.matrix is not None:
        return values("matrix", tuple(np.eye(4).ravel())).reshape(4, 4).T
    matrix = np.eye(4)
    turn = rotations.normalize(values("rotation", (0.0, 0.0, 0.0, 1.0))[[3, 0, 1, 2]])
    matrix[:3, :3] = rotations.to_matrix(turn) * values("scale", (1.0, 1.0, 1.0))
    matrix[:3, 3] = values("translation", (0.0, 0.0, 0.0))
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
        raise FileError(
            f"{file.name}: it has no skin.", "Export the character with its skeleton and skin weights."
        )
    world = node_world_matrices(file)
    palette = _Palette()
    parts: list[MeshData] = []
    for node in nodes:
        if node.mesh is not None and node.skin is not None:
            parts += _read_node(file, node.mesh, _skin_slots(file, node.skin, palette), None)
    if not parts:
        raise FileError(f"{file.name}: no mesh of triangles uses its skin.", REMEDY)
    for i, node in enumerate(nodes):
        if node.mesh is not None and node.skin is None:
            parts += _read_attachment(file, i, world, palette)
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


def _read_node(file: GltfFile, mesh: int, slots: NDArray[np.int64], rigid: Array | None) -> list[MeshData]:
    return [
        _read_primitive(file, primitive, slots, f"mesh {mesh} primitive {p}", rigid)
        for p, primitive in enumerate(file.gltf.meshes[mesh].primitives)
        if primitive.mode in (None, 4)
    ]


def _read_attachment(file: GltfFile, node: int, world: Array, palette: _Palette) -> list[MeshData]:
    """A mesh without skin that hangs on a joint (glasses, a sword): it moves rigidly with that joint."""
    parents = node_parents(file)
    joint = node
    while joint >= 0 and joint not in palette.nodes:
        joint = parents[joint]
    if joint < 0:
        return []  # scenery that does not belong to the character
    slot = palette.nodes.index(joint)
    to_bind = np.linalg.inv(world[joint] @ palette.inverse_bind[slot]) @ world[node]
    return _read_node(file, file.gltf.nodes[node].mesh, np.array([slot]), to_bind)


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
            raise FileError(
                f"{file.name}: skin {index} has {len(joints)} joints but {len(values)} bind matrices.", REMEDY
            )
        inverse = values.reshape(-1, 4, 4).transpose(0, 2, 1)
    return np.array([palette.add(j, m) for j, m in zip(joints, inverse, strict=False)])


def _read_primitive(
    file: GltfFile, primitive: Primitive, slots: NDArray[np.int64], what: str, rigid: Array | None
) -> MeshData:
    """One primitive; `rigid` `(4, 4)` carries a mesh without weights to the bind space of its only joint."""
    attributes = primitive.attributes
    positions = _vectors(file, attributes.POSITION, f"POSITION of {what}", 3)
    if primitive.indices is None:
        indices = np.arange(len(positions))
    else:
        indices = read_accessor(file, primitive.indices, f"indices of {what}").ravel().astype(np.int64)
    if len(indices) % 3 or indices.min() < 0 or indices.max() >= len(positions):
        raise FileError(
            f"{file.name}: the indices of {what} do not fit its {len(positions)} vertices.", REMEDY
        )
    triangles = indices.reshape(-1, 3)
    if attributes.NORMAL is None:
        normals = vertex_normals(positions, triangles)
    else:
        normals = _matching(file, attributes.NORMAL, f"NORMAL of {what}", (3,), len(positions))
    if rigid is None:
        joints, weights = _influences(file, attributes, slots, what, len(positions))
    else:
        joints = np.tile(np.array([slots[0], 0, 0, 0], np.uint16), (len(positions), 1))
        weights = np.tile(np.array([1, 0, 0, 0], np.float32), (len(positions), 1))
        positions = (positions @ rigid[:3, :3].T + rigid[:3, 3]).astype(np.float32)
        normals = normals @ np.linalg.inv(rigid[:3, :3])
    unit = rotations.normalize(normals.astype(np.float64)).astype(np.float32)
    return MeshData(
        positions,
        unit,
        primitive_colors(file, primitive, what, len(positions)),
        joints,
        weights,
        triangles.astype(np.uint32),
    )


def _vectors(file: GltfFile, index: int | None, what: str, width: int) -> Array:
    values = read_accessor(file, index, what)
    if values.shape[1] != width:
        raise FileError(f"{file.name}: {what} has {values.shape[1]} components; expected {width}.", REMEDY)
    return values.astype(np.float32)


def _matching(file: GltfFile, index: int | None, what: str, widths: tuple[int, ...], count: int) -> Array:
    values = read_accessor(file, index, what)
    if len(values) != count or values.shape[1] not in widths:
        raise FileError(
            f"{file.name}: {what} is {values.shape[0]} x {values.shape[1]}; expected {count} rows.", REMEDY
        )
    return values


def vertex_normals(positions: Array, triangles: Array) -> Array:
    """Area-weighted vertex normals `(V, 3)`."""
    a, b, c = (positions[triangles[:, i]].astype(np.float64) for i in range(3))
    face = np.cross(b - a, c - a)
    normals: Array = np.stack(
        [np.bincount(triangles.T.ravel(), np.tile(face[:, i], 3), len(positions)) for i in range(3)], axis=1
    )
    return rotations.normalize(normals)


def _influences(
    file: GltfFile, attributes: Any, slots: NDArray[np.int64], what: str, count: int
) -> tuple[Array, Array]:
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
            f"{file.name}: {what} uses joint {int(all_joints[used].max())}; its skin has {len(slots)} joints.",
            REMEDY,
        )
    if all_weights.min() < 0 or not np.all(used.any(axis=1)):
        raise FileError(
            f"{file.name}: {what} has negative weights or vertices without a joint.", "Normalise the weights."
        )
    best = np.argsort(-all_weights, axis=1, kind="stable")[:, :4]
    kept = np.take_along_axis(all_weights, best, axis=1)
    index = np.take_along_axis(np.where(used, all_joints, 0), best, axis=1)
    return slots[index].astype(np.uint16), (kept / kept.sum(axis=1, keepdims=True)).astype(np.float32)


def _merge(file: GltfFile, parts: list[MeshData]) -> MeshData:
    if sum(len(p.positions) for p in parts) > MAX_VERTICES:
        raise FileError(f"{file.name}: more than {MAX_VERTICES} vertices.", "Reduce the mesh.")
    base = np.cumsum([0] + [len(p.positions) for p in parts[:-1]])
    triangles = [p.triangles + np.uint32(b) for p, b in zip(parts, base, strict=True)]

    def join(name: str) -> Array:
        return np.concatenate([getattr(p, name) for p in parts])

    return MeshData(
        join("positions"), join("normals"), join("colors"), join("joint_indices"), join("joint_weights"),
        np.concatenate(triangles),
    )  # fmt: skip


def _joint_parents(file: GltfFile, joint_nodes: list[int]) -> tuple[int, ...]:
    """Nearest ancestor that is itself a joint, as an index into `joint_nodes`."""
    parents = node_parents(file)
    first: dict[int, int] = {}
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
