"""Plays the animation of a GLB without the project's own reader, as another program would."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from pygltflib import GLTF2

_TYPES = {5121: np.uint8, 5123: np.uint16, 5125: np.uint32, 5126: np.float32}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}


@dataclass
class Played:
    """`times` `(T,)`, world matrices of all nodes `(T, nodes, 4, 4)`, and the document."""

    gltf: GLTF2
    times: np.ndarray
    worlds: np.ndarray

    def node(self, name: str) -> int:
        return [node.name for node in self.gltf.nodes].index(name)

    def joints(self, skin: int = 0) -> dict[str, np.ndarray]:
        """Return world matrices `(T, 4, 4)` of a skin's joints by name."""
        return {self.gltf.nodes[n].name: self.worlds[:, n] for n in self.gltf.skins[skin].joints}


def read_accessor(gltf: GLTF2, index: int) -> np.ndarray:
    accessor = gltf.accessors[index]
    start = (gltf.bufferViews[accessor.bufferView].byteOffset or 0) + (accessor.byteOffset or 0)
    width = _WIDTHS[accessor.type]
    kind = np.dtype(_TYPES[accessor.componentType])
    data = gltf.binary_blob()[start : start + accessor.count * width * kind.itemsize]
    return np.frombuffer(data, kind).reshape(accessor.count, width)


def play(path: Path) -> Played:
    gltf = GLTF2.load(str(path))
    (animation,) = gltf.animations
    times = read_accessor(gltf, animation.samplers[0].input)[:, 0]
    tracks = {(c.target.node, c.target.path): read_accessor(gltf, animation.samplers[c.sampler].output)
              for c in animation.channels}  # fmt: skip
    local = np.stack([_local(gltf, n, tracks, len(times)) for n in range(len(gltf.nodes))], 1)
    parents = [-1] * len(gltf.nodes)
    for n, node in enumerate(gltf.nodes):
        for child in node.children or []:
            parents[child] = n
    worlds = np.empty_like(local)
    done: set[int] = set()

    def place(n: int) -> None:
        if n in done:
            return
        if parents[n] >= 0:
            place(parents[n])
        worlds[:, n] = local[:, n] if parents[n] < 0 else worlds[:, parents[n]] @ local[:, n]
        done.add(n)

    for n in range(len(gltf.nodes)):
        place(n)
    return Played(gltf, times, worlds)


def _local(gltf: GLTF2, n: int, tracks: dict[tuple[int, str], np.ndarray], frames: int) -> np.ndarray:
    node = gltf.nodes[n]
    result = np.tile(np.eye(4), (frames, 1, 1))
    if node.matrix is not None:
        assert not any(key[0] == n for key in tracks), "an animated node has no matrix"
        return result @ np.array(node.matrix).reshape(4, 4).T
    q = tracks.get((n, "rotation"), np.array([node.rotation or (0, 0, 0, 1)])).astype(float)
    scale = tracks.get((n, "scale"), np.array([node.scale or (1, 1, 1)])).astype(float)
    x, y, z, w = q.T
    matrix = np.stack([
        np.stack([1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)], -1),
        np.stack([2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)], -1),
        np.stack([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)], -1)], -2)  # fmt: skip
    result[:, :3, :3] = matrix * scale[:, None, :]
    result[:, :3, 3] = tracks.get((n, "translation"), np.array([node.translation or (0, 0, 0)]))
    return result


def skinned(played: Played, frame: int) -> np.ndarray:
    """Return vertices `(V, 3)` of the first skinned mesh in a frame, by the skin's joints and inverse bind matrices."""
    gltf = played.gltf
    node = next(node for node in gltf.nodes if node.skin is not None)
    skin, primitive = gltf.skins[node.skin], gltf.meshes[node.mesh].primitives[0]
    binds = read_accessor(gltf, skin.inverseBindMatrices).reshape(-1, 4, 4).swapaxes(1, 2)
    moved = played.worlds[frame, skin.joints] @ binds
    at = read_accessor(gltf, primitive.attributes.POSITION).astype(float)
    joints = read_accessor(gltf, primitive.attributes.JOINTS_0)
    weights = read_accessor(gltf, primitive.attributes.WEIGHTS_0).astype(float)
    weights /= weights.sum(axis=1, keepdims=True)
    points = np.einsum("vjab,vb->vja", moved[joints], np.column_stack([at, np.ones(len(at))]))
    return np.einsum("vj,vja->va", weights, points)[:, :3]
