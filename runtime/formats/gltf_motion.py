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
    accessor_count,
    ancestors,
    nearest_of,
    node_world_matrices,
    open_gltf,
    read_accessor,
)
from runtime.errors import FileError
from runtime.formats.bvh import MAX_FRAMES, MAX_JOINT_FRAMES, MAX_JOINTS, MAX_VALUE, BvhMotion
from runtime.pose import MAX_FPS
from runtime.safe_read import printable, reason
from runtime.skeleton import Skeleton

RATES = (24.0, 25.0, 30.0, 48.0, 50.0, 60.0, 120.0)  # of which the nearest to the keys' is taken
USUAL_FPS = 30.0  # of an animation that does not tell
BLOCK = 1000  # frames that are sampled at a time
# nodes x frames, and keys, that any file may have; and more for each byte of it
MAX_UNBAKED, FOR_A_BYTE = 500_000, 0.5
MAX_NAME, MAX_BOUND = 200, 50_000
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


@dataclass(frozen=True)
class _Rig:
    """Joints as places among nodes, parents first, and what moves them."""

    joints: list[int]
    own_parents: list[int]  # of each joint the joint above it, or -1
    nodes: list[int]  # joints and what carries them
    parents: list[int]  # of every node
    rest: Array  # (all nodes, 4, 4)
    bind: Array  # (joints, 4, 4)
    channels: dict[tuple[int, str], _Channel]

    def local(self, times: Array) -> tuple[Array, Array]:
        """Local places `(T, joints, 3)` and rotations `(T, joints, 4)` at times.

        Each joint is seen from its bind pose, so that the hierarchy at rest turns nothing.
        """
        world = _world(self, times)
        shape = len(times), len(self.joints)
        places: Array = np.empty((*shape, 3))
        turns: Array = np.empty((*shape, 4))
        for j, node in enumerate(self.joints):
            places[:, j], turns[:, j] = world[node][..., :3, 3], _turns(world[node])
        turns = rotations.multiply(turns, rotations.inverse(_turns(self.bind)))
        local, positions = turns.astype(np.float32), places.astype(np.float32)
        for j, parent in enumerate(self.own_parents):
            if parent >= 0:
                back = rotations.inverse(turns[:, parent])
                local[:, j] = rotations.multiply(back, turns[:, j])
                positions[:, j] = rotations.rotate(back, places[:, j] - places[:, parent])
        return positions, rotations.normalize(local)


def _motion(file: GltfFile) -> BvhMotion:
    animations = file.gltf.animations or []
    if not animations:
        raise file.error("it has no animation.", "Choose a file with one, or open it as a character.")
    rig = _rig(file, _channels(file, animations[0]))
    times = _times(file, rig)
    with np.errstate(all="ignore"):  # what comes of it is checked
        blocks = [rig.local(times[first : first + BLOCK]) for first in range(0, len(times), BLOCK)]
    positions, local = (np.concatenate(parts) for parts in zip(*blocks, strict=True))
    offsets = rig.bind[:, :3, 3].copy()
    for j, parent in enumerate(rig.own_parents):
        if parent >= 0:
            offsets[j] -= rig.bind[parent, :3, 3]
    if not max(np.abs(positions).max(), np.abs(offsets).max()) <= MAX_VALUE or not np.isfinite(local).all():
        raise file.error(f"its animation moves joints further than {MAX_VALUE:.0e} away.", REMEDY)
    names = tuple(printable(file.gltf.nodes[j].name or f"node {j}")[:MAX_NAME] for j in rig.joints)
    several = len(animations) > 1
    name = printable(str(animations[0].name or "without a name"))[:60]
    note = f"{len(animations)} animations; the first one, {name}, is read." if several else ""
    skeleton = Skeleton(names, tuple(rig.own_parents), offsets.astype(np.float32))
    step = float(times[1] - times[0]) if len(times) > 1 else 1.0 / USUAL_FPS
    return BvhMotion(skeleton, positions, local, step, {}, note)


def _rig(file: GltfFile, channels: dict[tuple[int, str], _Channel]) -> _Rig:
    order, parents = ancestors(file)
    joints = _joints(file, order, parents, channels)
    rest = node_world_matrices(file, order, parents)
    nearest = nearest_of(order, parents, set(joints))
    above = [nearest[parents[j]] if parents[j] >= 0 else -1 for j in joints]
    own_parents = [joints.index(k) if k >= 0 else -1 for k in above]
    carrying = set(joints)
    for node in reversed(order):
        if node in carrying:
            carrying.add(parents[node])
    nodes = [node for node in order if node in carrying]
    return _Rig(joints, own_parents, nodes, parents, rest, _bind(file, rest, parents, joints), channels)


def _room(file: GltfFile) -> float:
    """How many keys, and nodes x frames, a file of this size may have."""
    return MAX_UNBAKED + FOR_A_BYTE * sum(map(len, file.buffers))


def _channels(file: GltfFile, animation: Any) -> dict[tuple[int, str], _Channel]:
    """Keys by node and property."""
    found: dict[tuple[int, str], _Channel] = {}
    keys, nodes = 0, range(len(file.gltf.nodes or []))
    for channel in animation.channels:
        node, path = channel.target.node, channel.target.path
        if path not in _PATHS or not isinstance(node, int) or node not in nodes:
            continue
        sampler = animation.samplers[channel.sampler]
        keys += accessor_count(file, sampler.input) + accessor_count(file, sampler.output)
        if keys > _room(file):
            raise file.error("more keys than a file of its size has.", REMEDY)
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


def _times(file: GltfFile, rig: _Rig) -> NDArray[np.float64]:
    """Even times from the first key to the last one, at the usual rate that is nearest to the keys'."""
    channels = rig.channels.values()
    first = min(channel.times[0] for channel in channels)
    last = max(channel.times[-1] for channel in channels)
    steps = np.concatenate([np.diff(channel.times) for channel in channels])
    rate = 1.0 / float(np.median(steps)) if len(steps) else USUAL_FPS
    near = min(RATES, key=lambda usual: abs(np.log(usual / rate)))
    exact = len(steps) and abs(near / rate - 1.0) > 0.005 and near / 2 < rate <= MAX_FPS
    fps = rate if exact else near
    count = int(np.floor((last - first) * fps + 1e-3)) + 1
    if count > MAX_FRAMES or count * len(rig.nodes) > min(MAX_JOINT_FRAMES, _room(file)):
        raise file.error(f"an animation of {count} frames.", "Split the clip, or export it baked.")
    return np.asarray(first + np.arange(count) / fps)


def _world(rig: _Rig, times: Array) -> dict[int, Array]:
    """World matrices `(T, 4, 4)` of nodes that are moved, and of what they carry; `(4, 4)` of others."""
    moved = {node for node, _ in rig.channels}
    world: dict[int, Array] = {}
    for node in rig.nodes:
        parent = rig.parents[node]
        above = world[parent] if parent >= 0 else np.eye(4)
        resting = np.linalg.inv(rig.rest[parent]) @ rig.rest[node] if parent >= 0 else rig.rest[node]
        local = resting
        if node in moved:
            local = np.broadcast_to(resting, (len(times), 4, 4)).copy()
            turn, size = _parts(resting)
            turns, sizes = (
                rig.channels[node, path].at(times) if (node, path) in rig.channels else still
                for path, still in (("rotation", turn), ("scale", size))
            )
            matrix = rotations.to_matrix(rotations.normalize(turns))
            local[:, :3, :3] = matrix * np.asarray(sizes)[..., None, :]
            if (node, "translation") in rig.channels:
                local[:, :3, 3] = rig.channels[node, "translation"].at(times)
        world[node] = above @ local
    return world


def _parts(matrix: Array) -> tuple[Array, Array]:
    """The turn and the scale of a node's transform."""
    size = np.linalg.norm(matrix[:3, :3], axis=0)
    return rotations.from_matrix(matrix[:3, :3] / np.maximum(size, 1e-12)), size


def _turns(matrices: Array) -> Array:
    """The rotations `(..., 4)` of transforms `(..., 4, 4)` that may scale."""
    size = np.linalg.norm(matrices[..., :3, :3], axis=-2, keepdims=True)
    return rotations.normalize(rotations.from_matrix(matrices[..., :3, :3] / np.maximum(size, 1e-12)))


def _bind(file: GltfFile, rest: Array, parents: list[int], joints: list[int]) -> Array:
    """Transforms `(joints, 4, 4)` in the world at rest: the bind pose where a skin tells it, else the nodes as they are.

    A skin tells it in the space of its mesh, which lies in the world as the node above the joints does, or not at all
    moved; where the joints then are nowhere near their nodes, as the uppermost one does.
    """
    rest, known, count = rest.copy(), dict[int, Array](), 0
    for skin in sorted(file.gltf.skins or [], key=lambda skin: len(skin.joints)):
        if skin.inverseBindMatrices is None:
            continue
        count += max(len(skin.joints), accessor_count(file, skin.inverseBindMatrices))
        if count > MAX_BOUND:
            raise file.error(f"more than {MAX_BOUND} bind matrices.", REMEDY)
        inverse = read_accessor(file, skin.inverseBindMatrices, "the bind pose").astype(float)
        matrices = inverse.reshape(-1, 4, 4).transpose(0, 2, 1)[: len(skin.joints)]
        usable = np.flatnonzero(np.abs(np.linalg.det(matrices)) > 1e-15)
        joints_of = [skin.joints[k] for k in usable]
        known.update(zip(joints_of, np.linalg.inv(matrices[usable]), strict=True))
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
