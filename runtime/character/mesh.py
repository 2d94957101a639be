"""Merges meshes, skins and nodes of a glTF file into one skinned mesh."""

import re
from collections import Counter
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime import rotations
from runtime.arrays import AnyArray
from runtime.character.joints import CONVENTIONS
from runtime.character.nodes import Nodes
from runtime.character.read import MAX_PRIMITIVES, Entry, GltfFile
from runtime.character.skinned_mesh import Surface
from runtime.character.textures import Textures, primitive_colors

MAX_BIND = 1e6  # of an inverse bind matrix: larger values would make rounding visible
# of all meshes; game characters have about 100,000 vertices
MAX_COUNTS = {"primitives": MAX_PRIMITIVES, "vertices": 1_000_000, "triangles": 2_000_000}
MAX_JOINTS = 1024
MAX_SKIN_JOINTS = 16 * MAX_JOINTS  # of all skins, which usually share joints
_SKINNED_AT_ONCE = 1 << 15  # vertices per batch, whose blended matrices take 400 bytes each


@dataclass(frozen=True)
class MeshData(Surface):
    """All skinned primitives of a file over one list of joints; `humanoid` holds the joints that a VRM names."""

    joint_nodes: tuple[int, ...]
    joint_parents: tuple[int, ...]  # -1 at roots
    inverse_bind: AnyArray  # (K, 4, 4) float32
    rest_world: AnyArray  # (K, 4, 4)
    humanoid: dict[str, int]

    def rest_positions(self) -> AnyArray:
        """Return vertices `(V, 3)` as shown by the file, skinned by the joints' rest transforms."""
        matrices = (self.rest_world @ self.inverse_bind)[:, :3]
        result = np.empty((len(self.positions), 3))
        for first in range(0, len(result), _SKINNED_AT_ONCE):
            rows = slice(first, first + _SKINNED_AT_ONCE)
            blended = np.einsum("vi,vijk->vjk", self.joint_weights[rows], matrices[self.joint_indices[rows]])
            result[rows] = np.einsum("vjk,vk->vj", blended[..., :3], self.positions[rows]) + blended[..., 3]
        return result


class _Palette:
    """The joints of all skins: one entry for each pair of node and inverse bind matrix."""

    def __init__(self, file: GltfFile) -> None:
        self.nodes: list[int] = []
        self.inverse_bind: list[AnyArray] = []
        self.first: dict[int, int] = {}  # entry of a node, the first one if there are several
        self._file = file
        self._index: dict[tuple[int, bytes], int] = {}
        self._slots: dict[int, NDArray[np.int64]] = {}
        self._read = 0

    def slots(self, skin: int) -> NDArray[np.int64]:
        """Return the palette entry of each joint of a skin."""
        if skin not in self._slots:
            joints, inverse = skin_joints(self._file, skin)
            self._read += len(joints)
            if self._read > MAX_SKIN_JOINTS:
                raise self._file.error(f"its skins have more than {MAX_SKIN_JOINTS} joints.")
            self._slots[skin] = np.array([self._add(j, m) for j, m in zip(joints, inverse, strict=False)])
        return self._slots[skin]

    def parents(self, nodes: Nodes, carriers: list[int]) -> tuple[int, ...]:
        """Return the palette entry of each joint's nearest ancestor joint, -1 at roots."""
        above = (carriers[nodes.parents[node]] if nodes.parents[node] >= 0 else -1 for node in self.nodes)
        return tuple(self.first[joint] if joint >= 0 else -1 for joint in above)

    def _add(self, node: int, inverse_bind: AnyArray) -> int:
        key = (node, np.round(inverse_bind, 5).astype(np.float32).tobytes())
        if key not in self._index:
            if len(self.nodes) == MAX_JOINTS:
                raise self._file.error(f"more than {MAX_JOINTS} joints are not supported.")
            self._index[key] = len(self.nodes)
            self.first.setdefault(node, len(self.nodes))
            self.nodes.append(node)
            self.inverse_bind.append(inverse_bind)
        return self._index[key]


def skin_joints(file: GltfFile, index: int) -> tuple[list[int], AnyArray]:
    """Return the nodes of skin `index` and their inverse bind matrices `(joints or more, 4, 4)`."""
    skins, nodes = file.gltf.skins, file.gltf.nodes
    if not 0 <= index < len(skins):
        raise file.error(f"skin {index} is missing.")
    joints = list(skins[index].joints or [])
    if not joints or not all(isinstance(j, int) and 0 <= j < len(nodes) for j in joints):
        raise file.error(f"skin {index} names joints that are not there.")
    return joints, _bind_matrices(file, index, len(joints))


def _bind_matrices(file: GltfFile, skin: int, joints: int) -> AnyArray:
    matrices = file.gltf.skins[skin].inverseBindMatrices
    if matrices is None:
        return np.broadcast_to(np.eye(4), (joints, 4, 4))
    if file.count(matrices) > 2 * MAX_JOINTS:
        raise file.error(f"skin {skin} has more than {2 * MAX_JOINTS} bind matrices.")
    values = file.values(matrices, f"inverse bind matrices of skin {skin}")
    if values.shape[1] != 16 or len(values) < joints:
        raise file.error(f"skin {skin} has {joints} joints but {len(values)} bind matrices.")
    if np.abs(values).max(initial=0.0) > MAX_BIND:
        raise file.error(f"skin {skin} has bind matrices with values over {MAX_BIND:,.0f}.")
    return values.reshape(-1, 4, 4).transpose(0, 2, 1)


class _Reader:
    """Reads the primitives of a file, up to the limits of a character."""

    def __init__(self, file: GltfFile) -> None:
        self._file = file
        self._textures = Textures(file)
        self._counts = Counter[str]()

    def read(self, mesh: int, slots: NDArray[np.int64], rigid: AnyArray | None) -> list[Surface]:
        """Return the triangle surfaces of a mesh skinned to the joints `slots`; for `rigid` see `_surface`."""
        meshes = self._file.gltf.meshes or []
        if not 0 <= mesh < len(meshes):
            raise self._file.error(f"mesh {mesh} is missing.")
        parts = []
        for p, primitive in enumerate(meshes[mesh].primitives):
            if primitive.mode in (None, 4):
                what = f"mesh {mesh} primitive {p}"
                self._count(primitive, what)
                parts.append(self._surface(primitive, slots, what, rigid))
        return parts

    def _surface(
        self, primitive: Entry, slots: NDArray[np.int64], what: str, rigid: AnyArray | None
    ) -> Surface:
        """Read one primitive; `rigid` `(4, 4)` transforms a mesh without weights to the bind space of its only joint."""
        file, attributes = self._file, primitive.attributes
        count = file.count(attributes.POSITION)
        positions = _matching(file, attributes.POSITION, f"POSITION of {what}", 3, count).astype(np.float32)
        if primitive.indices is None:
            indices = np.arange(len(positions))
        else:
            indices = file.values(primitive.indices, f"indices of {what}").ravel().astype(np.int64)
        if len(indices) % 3 or indices.min() < 0 or indices.max() >= len(positions):
            raise file.error(f"the indices of {what} do not fit its {len(positions)} vertices.")
        triangles = indices.reshape(-1, 3)
        if attributes.NORMAL is None:
            normals = vertex_normals(positions, triangles)
        else:
            normals = _matching(file, attributes.NORMAL, f"NORMAL of {what}", 3, count)
        if rigid is None:
            joints, weights = _influences(file, attributes, slots, what, len(positions))
        else:
            joints = np.tile(np.array([slots[0], 0, 0, 0], np.uint16), (len(positions), 1))
            weights = np.tile(np.array([1, 0, 0, 0], np.float32), (len(positions), 1))
            positions = (positions @ rigid[:3, :3].T + rigid[:3, 3]).astype(np.float32)
            normals = normals @ np.linalg.inv(rigid[:3, :3])
        unit = rotations.normalize(normals.astype(np.float64)).astype(np.float32)
        colors = primitive_colors(file, self._textures, primitive, what, len(positions))
        return Surface(positions, unit, colors, joints, weights, triangles.astype(np.uint32))

    def _count(self, primitive: Entry, what: str) -> None:
        vertices = self._file.count(primitive.attributes.POSITION)
        triangles = (self._file.count(primitive.indices) or vertices) // 3
        self._counts.update(primitives=1, vertices=vertices, triangles=triangles)
        for name, most in MAX_COUNTS.items():
            if self._counts[name] > most:
                problem = f"more than {most} {name} up to the POSITION of {what}."
                raise self._file.error(problem, "Reduce the mesh.")


def read_meshes(file: GltfFile) -> MeshData:
    """Merge every skinned primitive of the file; FileError when there is none or it is damaged."""
    if not file.gltf.skins:
        raise file.error("it has no skin.", "Export the character with its skeleton and skin weights.")
    nodes = Nodes(file)
    world = nodes.rest
    palette, reader = _Palette(file), _Reader(file)
    parts: list[Surface] = []
    meshes = {i: node for i, node in enumerate(file.gltf.nodes) if node.mesh is not None}
    for node in meshes.values():
        if node.skin is not None:
            parts += reader.read(node.mesh, palette.slots(node.skin), None)
    if not parts:
        raise file.error("no mesh of triangles uses its skin.")
    carriers = nodes.nearest(palette.first)
    for i, node in meshes.items():
        if node.skin is None and carriers[i] >= 0:  # glasses, a sword: it moves rigidly with that joint
            slot = palette.first[carriers[i]]
            to_bind = np.linalg.inv(world[carriers[i]] @ palette.inverse_bind[slot]) @ world[i]
            parts += reader.read(node.mesh, np.array([slot]), to_bind)
    return MeshData(
        **_merged(parts),
        joint_nodes=tuple(palette.nodes),
        joint_parents=palette.parents(nodes, carriers),
        inverse_bind=np.stack(palette.inverse_bind).astype(np.float32),
        rest_world=world[palette.nodes],
        humanoid=_vrm_humanoid(file, palette.nodes),
    )


def _merged(parts: list[Surface]) -> dict[str, AnyArray]:
    """Return the fields of all surfaces merged into one."""
    base = np.cumsum([0] + [len(part.positions) for part in parts[:-1]])
    parts = [replace(p, triangles=p.triangles + np.uint32(b)) for p, b in zip(parts, base, strict=True)]
    return {field.name: np.concatenate([getattr(p, field.name) for p in parts]) for field in fields(Surface)}


def _matching(file: GltfFile, index: Any, what: str, width: int, count: int) -> AnyArray:
    """Return the values `(count, width)` of an accessor; FileError for another shape."""
    values = file.values(index, what)
    if values.shape != (count, width):
        raise file.error(f"{what} is {values.shape[0]} x {values.shape[1]}; expected {count} x {width}.")
    return values


def vertex_normals(positions: AnyArray, triangles: AnyArray) -> AnyArray:
    """Return area-weighted vertex normals `(V, 3)`."""
    a, b, c = (positions[triangles[:, i]].astype(np.float64) for i in range(3))
    face = np.cross(b - a, c - a)
    normals: AnyArray = np.stack(
        [np.bincount(triangles.T.ravel(), np.tile(face[:, i], 3), len(positions)) for i in range(3)], axis=1
    )
    return rotations.normalize(normals)


def _influences(
    file: GltfFile, attributes: Any, slots: NDArray[np.int64], what: str, count: int
) -> tuple[AnyArray, AnyArray]:
    joints, weights = [], []
    for channel in ("0", "1"):  # up to eight influences; the four strongest are kept
        j = getattr(attributes, f"JOINTS_{channel}", None)
        w = getattr(attributes, f"WEIGHTS_{channel}", None)
        if channel == "0" or (j is not None and w is not None):
            joints.append(_matching(file, j, f"JOINTS_{channel} of {what}", 4, count).astype(np.int64))
            weights.append(_matching(file, w, f"WEIGHTS_{channel} of {what}", 4, count).astype(np.float64))
    all_joints, all_weights = np.concatenate(joints, axis=1), np.concatenate(weights, axis=1)
    used = all_weights > 0
    if all_joints.min() < 0 or np.any(all_joints[used] >= len(slots)):
        highest = int(all_joints[used].max())
        raise file.error(f"{what} uses joint {highest}; its skin has {len(slots)} joints.")
    if all_weights.min() < 0 or not np.all(used.any(axis=1)):
        problem = f"{what} has negative weights or vertices without a joint."
        raise file.error(problem, "Normalise the weights.")
    best = np.argsort(-all_weights, axis=1, kind="stable")[:, :4]
    kept = np.take_along_axis(all_weights, best, axis=1)
    index = np.take_along_axis(np.where(used, all_joints, 0), best, axis=1)
    return slots[index].astype(np.uint16), (kept / kept.sum(axis=1, keepdims=True)).astype(np.float32)


def _vrm_humanoid(file: GltfFile, joint_nodes: list[int]) -> dict[str, int]:
    """Return SPORT joint -> joint index from a VRM 0 or 1 humanoid description; empty if there is none."""
    bones = {re.sub(r"[^a-z0-9]", "", name.lower()): node for node, name in vrm_bones(file).items()}
    return {
        joint: joint_nodes.index(bones[simple])
        for joint, simple in CONVENTIONS["VRM"].items()
        if bones.get(simple) in joint_nodes
    }


def vrm_bones(file: GltfFile) -> dict[int, str]:
    """Return the humanoid bone name of each node that a VRM or VRM animation names."""
    extensions, bones = file.gltf.extensions or {}, dict[int, str]()
    for name in ("VRM", "VRMC_vrm", "VRMC_vrm_animation"):
        listed = (extensions.get(name) or {}).get("humanoid", {}).get("humanBones", {})
        pairs = listed.items() if isinstance(listed, dict) else ((bone["bone"], bone) for bone in listed)
        bones |= {int(bone["node"]): str(name) for name, bone in pairs}
    return bones
