"""The motion of a glTF, GLB, VRM or FBX file: its animation sampled at an even rate, as a hierarchy at rest in its bind pose."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime import rotations
from runtime.arrays import Array
from runtime.character.read import (
    STRUCTURE_ERRORS,
    GltfFile,
    ancestors,
    nearest_of,
    node_world_matrices,
    open_gltf,
    read_accessor,
)
from runtime.errors import FileError
from runtime.formats.bvh import MAX_FRAMES, MAX_JOINT_FRAMES, MAX_JOINTS, BvhMotion
from runtime.pose import MAX_FPS
from runtime.safe_read import printable, reason
from runtime.skeleton import Skeleton

RATES = (24.0, 25.0, 30.0, 48.0, 50.0, 60.0, 120.0)  # of which the nearest to the keys' is taken
USUAL_FPS = 30.0  # of an animation that does not tell
NEAR = 0.3  # of a body's size: as near a bind pose lies to the pose at rest
REMEDY = "Export it again with its animation baked, or as BVH."
_PATHS = {"translation": 3, "rotation": 4, "scale": 3}


@dataclass(frozen=True)
class _Channel:
    """Keys of one property of a node; a cubic has in-tangent, value and out-tangent of each."""

    times: Array  # (K,) seconds
    values: Array  # (K, width), or (K, 3, width)
    kind: str

    def at(self, seconds: Array) -> Array:
        """Values `(T, width)` at times, as the specification interpolates them; those of the ends beyond them."""
        k = np.clip(np.searchsorted(self.times, seconds, side="right") - 1, 0, max(len(self.times) - 2, 0))
        after = np.minimum(k + 1, len(self.times) - 1)
        span = np.maximum(self.times[after] - self.times[k], 1e-9)
        t = np.clip((seconds - self.times[k]) / span, 0.0, 1.0)
        if self.kind == "STEP":
            return self.values[np.where(t >= 1.0, after, k)]
        if self.kind == "CUBICSPLINE":
            u, width = t[:, None], span[:, None]
            a, b = 2 * u**3 - 3 * u**2 + 1, u**3 - 2 * u**2 + u
            c, d = 3 * u**2 - 2 * u**3, u**3 - u**2
            v = self.values
            return np.asarray(a * v[k, 1] + b * width * v[k, 2] + c * v[after, 1] + d * width * v[after, 0])
        if self.values.shape[1] == 4:
            return rotations.slerp(self.values[k], self.values[after], t)
        return np.asarray(self.values[k] + t[:, None] * (self.values[after] - self.values[k]))


def contents(path: Path) -> tuple[bool, bool]:
    """Whether a file has a mesh with a skin, and whether it moves its nodes; FileError when it cannot be read."""
    gltf = open_gltf(path, motion=True).gltf
    skinned = any(node.mesh is not None and node.skin is not None for node in gltf.nodes or [])
    return skinned, any(animation.channels for animation in gltf.animations or [])


def read_gltf_motion(path: Path) -> BvhMotion:
    """The first animation of a file, in metres. FileError where it has none, or is damaged."""
    file = open_gltf(path, motion=True)
    try:
        return _motion(file)
    except FileError:
        raise
    except STRUCTURE_ERRORS as error:
        raise file.error(f"its animation is damaged ({reason(error)}).", REMEDY) from error


def _motion(file: GltfFile) -> BvhMotion:
    animations = file.gltf.animations or []
    if not animations:
        raise file.error("it has no animation.", "Choose a file with one, or open it as a character.")
    channels = _channels(file, animations[0])
    order, parents = ancestors(file)
    joints = _joints(file, order, parents, channels)
    times = _times(file, channels, len(joints))
    world = _world(file, order, parents, channels, times)
    # each joint is seen from its bind pose, so that the hierarchy at rest turns nothing
    bind = _bind(file, order, parents, joints)
    nearest = nearest_of(order, parents, set(joints))
    above = [nearest[parents[j]] if parents[j] >= 0 else -1 for j in joints]
    own_parents = tuple(joints.index(k) if k >= 0 else -1 for k in above)
    moving = world[:, joints]
    places, turns = moving[..., :3, 3], _turns(moving)
    turns = rotations.multiply(turns, rotations.inverse(_turns(bind)))
    at_rest = bind[:, :3, 3]
    local, positions = turns.copy(), places.copy()
    offsets = at_rest.copy()
    for j, parent in enumerate(own_parents):
        if parent >= 0:
            back = rotations.inverse(turns[:, parent])
            local[:, j] = rotations.multiply(back, turns[:, j])
            positions[:, j] = rotations.rotate(back, places[:, j] - places[:, parent])
            offsets[j] = at_rest[j] - at_rest[parent]
    names = tuple(str(file.gltf.nodes[j].name or f"node {j}") for j in joints)
    several = len(animations) > 1
    name = printable(str(animations[0].name or "without a name"))[:60]
    note = f"{len(animations)} animations; the first one, {name}, is read." if several else ""
    skeleton = Skeleton(names, own_parents, offsets.astype(np.float32))
    step = float(times[1] - times[0]) if len(times) > 1 else 1.0 / USUAL_FPS
    return BvhMotion(
        skeleton, positions.astype(np.float32), rotations.normalize(local).astype(np.float32), step, {}, note
    )


def _channels(file: GltfFile, animation: Any) -> dict[tuple[int, str], _Channel]:
    """Keys by node and property."""
    found: dict[tuple[int, str], _Channel] = {}
    for channel in animation.channels:
        node, path = channel.target.node, channel.target.path
        if path not in _PATHS or not isinstance(node, int):
            continue
        sampler = animation.samplers[channel.sampler]
        times = read_accessor(file, sampler.input, "the times of a key").astype(float)[:, 0]
        values = read_accessor(file, sampler.output, f"a key's {path}").astype(float)
        kind = sampler.interpolation or "LINEAR"
        if path == "rotation":
            values = values[:, [3, 0, 1, 2]]
        if kind == "CUBICSPLINE":
            values = values.reshape(len(times), 3, _PATHS[path])
        if len(values) != len(times) or values.shape[-1] != _PATHS[path] or not (np.diff(times) > 0.0).all():
            raise file.error("keys of an animation that do not fit its times.", REMEDY)
        found[node, path] = _Channel(times, values, kind)
    if not found:
        raise file.error("its animation moves no node.", REMEDY)
    return found


def _joints(
    file: GltfFile, order: list[int], parents: list[int], channels: dict[tuple[int, str], _Channel]
) -> list[int]:
    """Nodes that are joints, parents first: those of the largest skin, or without one all that are moved and those between."""
    skins = [set(skin.joints) for skin in file.gltf.skins or []]
    wanted = max(skins, key=len) if skins else {node for node, _ in channels}
    if not skins:
        top = next(node for node in order if node in wanted)
        inside = nearest_of(order, parents, {top})
        children = {parents[node] for node in order}
        wanted = {node for node in order if inside[node] == top and (node in wanted or node in children)}
    joints = [node for node in order if node in wanted]
    if not 1 <= len(joints) <= MAX_JOINTS:
        raise file.error(f"{len(joints)} joints; expected at most {MAX_JOINTS}.", REMEDY)
    return joints


def _times(file: GltfFile, channels: dict[tuple[int, str], _Channel], joints: int) -> NDArray[np.float64]:
    """Even times from the first key to the last one, at the usual rate that is nearest to the keys'."""
    first = min(channel.times[0] for channel in channels.values())
    last = max(channel.times[-1] for channel in channels.values())
    steps = np.concatenate([np.diff(channel.times) for channel in channels.values()])
    rate = 1.0 / float(np.median(steps)) if len(steps) else USUAL_FPS
    near = min(RATES, key=lambda usual: abs(np.log(usual / rate)))
    exact = len(steps) and abs(near / rate - 1.0) > 0.005 and near / 2 < rate <= MAX_FPS
    fps = rate if exact else near
    count = int(np.floor((last - first) * fps + 1e-3)) + 1
    if count > MAX_FRAMES or count * joints > MAX_JOINT_FRAMES:
        raise file.error(f"an animation of {count} frames.", "Split the clip.")
    return np.asarray(first + np.arange(count) / fps)


def _world(
    file: GltfFile,
    order: list[int],
    parents: list[int],
    channels: dict[tuple[int, str], _Channel],
    times: Array,
) -> Array:
    """World matrices `(T, nodes, 4, 4)` of moved nodes and of what they carry; others rest."""
    rest = node_world_matrices(file, order, parents)
    moved = {node for node, _ in channels}
    world = np.broadcast_to(rest, (len(times), *rest.shape)).copy()
    for node in order:
        parent = parents[node]
        above = world[:, parent] if parent >= 0 else np.eye(4)
        resting = np.linalg.inv(rest[parent]) @ rest[node] if parent >= 0 else rest[node]
        local = resting
        if node in moved:
            local = np.broadcast_to(resting, (len(times), 4, 4)).copy()
            turn, size = _parts(resting)
            turns, sizes = (
                channels[node, path].at(times) if (node, path) in channels else still
                for path, still in (("rotation", turn), ("scale", size))
            )
            matrix = rotations.to_matrix(rotations.normalize(turns))
            local[:, :3, :3] = matrix * np.asarray(sizes)[..., None, :]
            if (node, "translation") in channels:
                local[:, :3, 3] = channels[node, "translation"].at(times)
        world[:, node] = above @ local
    return world


def _parts(matrix: Array) -> tuple[Array, Array]:
    """The turn and the scale of a node's transform."""
    size = np.linalg.norm(matrix[:3, :3], axis=0)
    return rotations.from_matrix(matrix[:3, :3] / np.maximum(size, 1e-12)), size


def _turns(matrices: Array) -> Array:
    """The rotations `(..., 4)` of transforms `(..., 4, 4)` that may scale."""
    size = np.linalg.norm(matrices[..., :3, :3], axis=-2, keepdims=True)
    return rotations.normalize(rotations.from_matrix(matrices[..., :3, :3] / np.maximum(size, 1e-12)))


def _bind(file: GltfFile, order: list[int], parents: list[int], joints: list[int]) -> Array:
    """Transforms `(joints, 4, 4)` in the world at rest: the bind pose where a skin tells it, else the nodes as they are.

    A skin tells it in the space of its mesh, which lies in the world as the node above the joints does, or not at all
    moved; where the joints then are nowhere near their nodes, as the uppermost one does.
    """
    rest = node_world_matrices(file, order, parents)
    known: dict[int, Array] = {}
    for skin in sorted(file.gltf.skins or [], key=lambda skin: len(skin.joints)):
        if skin.inverseBindMatrices is None:
            continue
        inverse = read_accessor(file, skin.inverseBindMatrices, "the bind pose").astype(float)
        for joint, matrix in zip(skin.joints, inverse.reshape(-1, 4, 4).transpose(0, 2, 1), strict=False):
            if abs(np.linalg.det(matrix)) > 1e-15:
                known[joint] = np.linalg.inv(matrix)
    told = [joint for joint in joints if joint in known]
    if not told:
        return rest[joints]
    bind, nodes, top = np.array([known[joint] for joint in told]), rest[told], parents[told[0]]
    size = float(np.linalg.norm(np.ptp(nodes[:, :3, 3], axis=0)))
    for space in (rest[top] if top >= 0 else np.eye(4), np.eye(4), nodes[0] @ np.linalg.inv(bind[0])):
        placed = space @ bind
        if np.linalg.norm(placed[:, :3, 3] - nodes[:, :3, 3], axis=-1).mean() < NEAR * size:
            break
    rest[told] = placed
    return rest[joints]
