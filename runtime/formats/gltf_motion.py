"""The motion of a glTF, GLB, VRM, VRMA or FBX file: its animation sampled at an even rate, as a hierarchy at rest in its bind pose."""

from __future__ import annotations

import contextlib
from dataclasses import dataclass
from itertools import accumulate
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime import rotations
from runtime.arrays import Array
from runtime.character.mesh import vrm_bones
from runtime.character.read import (
    STRUCTURE_ERRORS,
    GltfFile,
    accessor_count,
    ancestors,
    local_matrices,
    nearest_of,
    node_world_matrices,
    open_gltf,
    read_accessor,
)
from runtime.checked import number_field
from runtime.errors import FileError
from runtime.formats.bvh import MAX_FRAMES, MAX_JOINT_FRAMES, MAX_JOINTS, MAX_VALUE, BvhMotion
from runtime.pose import MAX_FPS, VIDEO_RATES
from runtime.safe_read import parse_json, printable, reason
from runtime.skeleton import Skeleton

USUAL_FPS = 30.0  # of an animation that does not tell
RATES = (USUAL_FPS, 24.0, 25.0, 60.0, 48.0, 50.0, *VIDEO_RATES, 100.0, 240.0)  # in the order they are tried
LOWEST_FPS = 15.0  # that a motion is read at
ON_FRAME = 2e-4  # frames: how near to one a key lies that is on it; 29.97 and 30 differ by 1e-3
AT_KEY = 1e-5  # seconds: what is that little before a key is at it
BODY = 0.8  # share of the moved nodes that hang on the top of a body, cameras and props apart
NEAR = 0.3  # of a body's size: as near a bind pose lies to the pose at rest
# what Blender writes for it, and what it is
NTSC = {rate * 1.001: rate / 1.001 for rate in (24.0, 30.0, 60.0)}
CHUNK = 1024  # frames whose transforms are worked out at once
# nodes x frames, and keys, that any file may have; and more for each byte of it
MAX_UNBAKED, FOR_A_BYTE = 500_000, 0.5
MAX_NAME, MAX_SHOWN, MAX_BOUND = 200, 60, 50_000  # letters of a joint and of an animation, bind matrices
# nodes of animations that are looked at for a body, and what a channel counts
MAX_LOOKED_AT, CHANNEL = (50_000, 8)
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
        k = np.searchsorted(self.times, seconds + AT_KEY, side="right") - 1
        k = np.clip(k, 0, max(len(self.times) - 2, 0))
        after = np.minimum(k + 1, len(self.times) - 1)
        span = np.maximum(self.times[after] - self.times[k], 1e-9)
        t = np.clip((seconds - self.times[k]) / span, 0.0, 1.0)
        if self.kind == "STEP":
            return self.values[np.where(seconds + AT_KEY >= self.times[after], after, k)]
        if self.kind == "CUBICSPLINE":
            u, width = t[:, None], span[:, None]
            a, b = 2 * u**3 - 3 * u**2 + 1, u**3 - 2 * u**2 + u
            c, d = 3 * u**2 - 2 * u**3, u**3 - u**2
            v = self.values
            return np.asarray(a * v[k, 1] + b * width * v[k, 2] + c * v[after, 1] + d * width * v[after, 0])
        if self.values.shape[1] == 4:
            return rotations.slerp(self.values[k], self.values[after], t)
        return np.asarray(self.values[k] + t[:, None] * (self.values[after] - self.values[k]))


_Channels = dict[tuple[int, str], _Channel]


@dataclass(frozen=True)
class _Nodes:
    """The nodes of a file, parents first."""

    file: GltfFile
    order: list[int]
    parents: list[int]

    def children(self, node: int) -> list[int]:
        return self.file.gltf.nodes[node].children or []

    def with_ancestors(self, nodes: list[int]) -> list[int]:
        """Some nodes and all above them, parents first."""
        wanted = set(nodes)
        for node in reversed(self.order):
            if node in wanted:
                wanted.add(self.parents[node])
        return [node for node in self.order if node in wanted]


@dataclass(frozen=True)
class _Animation:
    """An animation, the joints of the body that it moves, how many of them it does, and what is told of the take."""

    name: str
    channels: _Channels
    joints: list[int]
    moved: int
    metadata: Any


def contents(path: Path) -> tuple[bool, bool]:
    """Whether a file has a mesh with a skin, and whether it moves its nodes; FileError when it cannot be read."""
    file = open_gltf(path, motion=True)
    skinned = any(node.mesh is not None and node.skin is not None for node in file.gltf.nodes or [])
    try:
        moves = any(
            channel.target.path in _PATHS
            and accessor_count(file, animation.samplers[channel.sampler].input) > 1
            for animation in file.gltf.animations or []
            for channel in animation.channels or []
        )
    except STRUCTURE_ERRORS:
        moves = True  # reading it says what is wrong
    return skinned, moves


def read_gltf_motion(path: Path, animation: str = "") -> BvhMotion:
    """The animation of a name, or the first one that moves a body, in metres. FileError where there is none, or it is damaged."""
    file = open_gltf(path, motion=True)
    try:
        return _motion(file, animation)
    except FileError:
        raise
    except STRUCTURE_ERRORS as error:
        raise file.error(f"its animation is damaged ({reason(error)}).", REMEDY) from error


def _motion(file: GltfFile, wanted: str) -> BvhMotion:
    nodes = _Nodes(file, *ancestors(file))
    animations = _named(file)
    animation, note = _chosen(nodes, animations, wanted)
    joints = animation.joints
    needed = nodes.with_ancestors(joints)
    channels = {(node, path): keys for (node, path), keys in animation.channels.items() if node in needed}
    told = number_field(animation.metadata, "fps", 0.0)
    times, fps = _times(file, channels, len(needed), told)
    bind = _bind(nodes, joints)
    positions = np.empty((len(times), len(joints), 3), np.float32)
    local = np.empty((len(times), len(joints), 4), np.float32)
    motion = BvhMotion(
        _skeleton(nodes, joints, bind),
        positions,
        local,
        1.0 / fps,
        {},
        note,
        animation.metadata,
        tuple(animations),
    )
    moving = _Moving(needed, nodes.parents, local_matrices(file), channels)
    with np.errstate(all="ignore"):  # what comes of it is checked
        for first in range(0, len(times), CHUNK):
            rows = slice(first, first + CHUNK)
            world = moving.world(times[rows])
            _fill(motion, rows, np.stack([world[j] for j in joints], axis=1), bind)
    furthest = max(np.abs(positions).max(), np.abs(motion.skeleton.offsets).max())
    if not furthest <= MAX_VALUE or not np.isfinite(local).all():
        raise file.error(f"its animation moves joints further than {MAX_VALUE:.0e} away.", REMEDY)
    return motion


def _skeleton(nodes: _Nodes, joints: list[int], bind: Array) -> Skeleton:
    nearest = nearest_of(nodes.order, nodes.parents, set(joints))
    above = [nearest[nodes.parents[j]] if nodes.parents[j] >= 0 else -1 for j in joints]
    parents = tuple(joints.index(node) if node >= 0 else -1 for node in above)
    at_rest = bind[:, :3, 3]
    offsets = [at_rest[k] - (at_rest[p] if p >= 0 else 0.0) for k, p in enumerate(parents)]
    return Skeleton(_joint_names(nodes.file, joints), parents, np.array(offsets, np.float32))


def _joint_names(file: GltfFile, joints: list[int]) -> tuple[str, ...]:
    """Names of joints: of a VRM's bones as Unity has them, else those of the nodes."""
    bones = {node: bone[:1].upper() + bone[1:] for node, bone in vrm_bones(file).items()}
    named = (str(bones.get(j) or file.gltf.nodes[j].name or f"node {j}") for j in joints)
    return tuple(printable(name)[:MAX_NAME] for name in named)


def _fill(motion: BvhMotion, rows: slice, world: Array, bind: Array) -> None:
    """Write frames of world matrices `(T, J, 4, 4)`; each joint is seen from its bind pose, in which nothing turns."""
    places = world[..., :3, 3]
    turns = rotations.multiply(_turns(world), rotations.inverse(_turns(bind)))
    motion.local_rotations[rows], motion.positions[rows] = turns, places
    for j, parent in enumerate(motion.skeleton.parents):
        if parent >= 0:
            back = rotations.inverse(turns[:, parent])
            motion.local_rotations[rows, j] = rotations.normalize(rotations.multiply(back, turns[:, j]))
            motion.positions[rows, j] = rotations.rotate(back, places[:, j] - places[:, parent])


def _chosen(nodes: _Nodes, animations: dict[str, Any], wanted: str) -> tuple[_Animation, str]:
    """The animation of a name, else the first one that moves a body, with what to say of the others. FileError."""
    wanted = printable(wanted)[:MAX_SHOWN]
    chosen = {wanted: animations.get(wanted)} if wanted else animations
    if None in chosen.values():
        names = ", ".join(list(animations)[:40])
        raise nodes.file.error(f"no animation {wanted!r}.", f"It has {names}.")
    # a camera, and the empty takes of some programs, come first too
    read = _as_far_as_needed(nodes, chosen)
    most = max(animation.moved for animation in read)
    first = next((a for a in read if a.channels and a.moved >= most / 2), None)
    if first is None:
        raise nodes.file.error("its animation moves no node.", REMEDY)
    return first, f"{len(chosen)} animations; {first.name} is read." if len(chosen) > 1 else ""


def _as_far_as_needed(nodes: _Nodes, animations: dict[str, Any]) -> list[_Animation]:
    """Animations up to the first one of which half as many joints move as any later one has keys for. FileError."""
    targets = [{channel.target.node for channel in a.channels or []} for a in animations.values()]
    later = [*accumulate(map(len, targets[:0:-1]), max, initial=0)][::-1]
    read: list[_Animation] = []
    keys = looked_at = moved = 0
    for (name, animation), most in zip(animations.items(), later, strict=True):
        keys += _key_count(nodes.file, animation)
        if keys > _room(nodes.file):
            raise nodes.file.error("more keys than a file of its size has.", REMEDY)
        read.append(_animation(nodes, name, animation))
        looked_at += len(nodes.parents) + CHANNEL * (1 + len(animation.channels or []))
        moved = max(moved, read[-1].moved)
        if looked_at > MAX_LOOKED_AT or read[-1].moved >= max(most, moved) / 2 > 0:
            break
    return read


def _named(file: GltfFile) -> dict[str, Any]:
    """The animations by their names, those that have the same one with their number. FileError where there is none."""
    animations: dict[str, Any] = {}
    for k, animation in enumerate(file.gltf.animations or []):
        name = printable(str(animation.name or f"animation {k + 1}"))[:MAX_SHOWN]
        animations[f"{name} ({k + 1})" if name in animations else name] = animation
    if not animations:
        raise file.error("it has no animation.", "Choose a file with one, or open it as a character.")
    return animations


def _key_count(file: GltfFile, animation: Any) -> int:
    """Times and values of all channels; a sampler counts for each that has it."""
    used = [animation.samplers[channel.sampler] for channel in animation.channels or []]
    return sum(accessor_count(file, key) for sampler in used for key in (sampler.input, sampler.output))


def _room(file: GltfFile) -> float:
    """How many keys, and nodes x frames, a file of this size may have."""
    return MAX_UNBAKED + FOR_A_BYTE * sum(map(len, file.buffers))


def _animation(nodes: _Nodes, name: str, animation: Any) -> _Animation:
    channels, told = _channels(nodes.file, animation), _metadata(nodes.file, animation)
    if not channels:
        return _Animation(name, channels, [], 0, told)
    joints = _joints(nodes, {node for node, _ in channels})
    changed = {node for (node, _), channel in channels.items() if np.ptp(channel.values, axis=0).max() > 1e-6}
    return _Animation(name, channels, joints, len(changed.intersection(joints)), told)


def _metadata(file: GltfFile, animation: Any) -> dict[str, Any]:
    """What a file of ours tells of the take that an animation is, {} for any other; an FBX has it of one take, as text."""
    gltf = file.gltf
    for holder in (animation, *((gltf.scenes or [])[:1] if len(gltf.animations) == 1 else ())):
        extras = holder.get("extras")
        value = extras.get("sport") if isinstance(extras, dict) else None
        with contextlib.suppress(ValueError):
            value = parse_json(value) if isinstance(value, str) else value
        if isinstance(value, dict):
            return value
    return {}


def _channels(file: GltfFile, animation: Any) -> _Channels:
    """Keys by node and property."""
    nodes = range(len(file.gltf.nodes or []))
    return {
        (channel.target.node, channel.target.path): _keys(
            file, animation.samplers[channel.sampler], channel.target.path
        )
        for channel in animation.channels or []
        if channel.target.path in _PATHS and channel.target.node in nodes
    }


def _keys(file: GltfFile, sampler: Any, path: str) -> _Channel:
    times = read_accessor(file, sampler.input, "the times of a key").astype(float)[:, 0]
    values = read_accessor(file, sampler.output, f"a key's {path}").astype(float)
    kind = sampler.interpolation or "LINEAR"
    if path == "rotation":
        values = values[:, [3, 0, 1, 2]]
    if kind == "CUBICSPLINE":
        values = values.reshape(len(times), 3, _PATHS[path])
        if path == "rotation":  # Blender writes both signs of a turn, between which a cubic turns astray
            values = values * np.cumprod(np.sign(_dots(values[:, 1]) + 1e-12))[:, None, None]
    if len(values) != len(times) or values.shape[-1] != _PATHS[path] or not (np.diff(times) >= 0.0).all():
        raise file.error("keys of an animation that do not fit its times.", REMEDY)
    return _Channel(times, values, kind)


def _dots(quaternions: Array) -> Array:
    """Of each quaternion `(K,)` with the one before; one for the first."""
    return np.concatenate([[1.0], (quaternions[1:] * quaternions[:-1]).sum(-1)])


def _joints(nodes: _Nodes, moved: set[int]) -> list[int]:
    """Nodes that are joints, parents first: all below the top of the largest skin, or without one of what is moved.

    Those are more than a skin names, which many programs write without joints that hold no vertex; what has a mesh, a
    camera or a light at the end of a branch is none.
    """
    skins = [set(skin.joints) for skin in nodes.file.gltf.skins or []]
    bones = max(skins, key=len) if skins else moved
    kept = _below(nodes, _top(nodes, bones, len(bones) * (1.0 if skins else BODY)), bones)
    if not 1 <= len(kept) <= MAX_JOINTS:
        raise nodes.file.error(f"{len(kept)} joints; expected at most {MAX_JOINTS}.", REMEDY)
    return [node for node in nodes.order if node in kept]


def _below(nodes: _Nodes, top: int, bones: set[int]) -> set[int]:
    """A node and what hangs on it, but for ends of branches that show or light something."""
    inside, kept = nearest_of(nodes.order, nodes.parents, {top}), set[int]()
    for node in reversed(nodes.order):
        entry = nodes.file.gltf.nodes[node]
        bare = (
            entry.mesh is None
            and entry.camera is None
            and not (entry.extensions or {}).get("KHR_lights_punctual")
        )
        if inside[node] == top and (bare or node in bones or not kept.isdisjoint(nodes.children(node))):
            kept.add(node)
    return kept


def _top(nodes: _Nodes, bones: set[int], most: float) -> int:
    """The lowest node that is a bone, or above so many of them."""
    below = [int(node in bones) for node in range(len(nodes.parents))]
    for node in reversed(nodes.order):
        if nodes.parents[node] >= 0:
            below[nodes.parents[node]] += below[node]
    top = max((node for node in nodes.order if nodes.parents[node] < 0), key=lambda node: below[node])
    while top not in bones:
        deeper = [child for child in nodes.children(top) if below[child] >= most]
        if not deeper:
            break
        top = deeper[0]
    return top


def _times(file: GltfFile, channels: _Channels, nodes: int, told: float) -> tuple[NDArray[np.float64], float]:
    """Even times from the first key to the last one, and their rate: the one that is `told` or a usual one with all keys on its frames, else the keys'."""
    keys = np.unique(np.concatenate([channel.times for channel in channels.values()]))
    first, keys = keys[0], keys - keys[0]
    near = ON_FRAME * (1.0 + keys[-1] / 60.0)  # times have 24 bits
    rates = (*([told] if 0.0 < told <= MAX_FPS else []), *RATES, *NTSC)
    usual = (fps for fps in rates if np.abs(keys * fps - np.round(keys * fps)).max() < near)
    steps = np.concatenate([np.diff(channel.times) for channel in channels.values()])
    rate = 1.0 / max(float(np.median(steps)), 1e-6) if len(steps) else USUAL_FPS
    fps = next(usual, rate if LOWEST_FPS <= rate <= MAX_FPS else USUAL_FPS)
    count = int(np.floor(keys[-1] * fps + 1e-3)) + 1
    if count > MAX_FRAMES or count * nodes > min(MAX_JOINT_FRAMES, _room(file)):
        raise file.error(f"an animation of {count} frames.", "Split the clip, or export it baked.")
    return np.asarray(first + np.arange(count) / fps), NTSC.get(fps, fps)


class _Moving:
    """Nodes, parents first, with what moves them."""

    def __init__(self, nodes: list[int], parents: list[int], resting: Array, channels: _Channels) -> None:
        self.nodes, self.parents, self.resting, self.channels = nodes, parents, resting, channels

    def world(self, seconds: Array) -> dict[int, Array]:
        """World matrices `(T, 4, 4)` of each node at times."""
        made: dict[int, Array] = {}
        for node in self.nodes:
            local = self._local(node, seconds)
            made[node] = local if self.parents[node] < 0 else made[self.parents[node]] @ local
        return made

    def _local(self, node: int, seconds: Array) -> Array:
        resting = self.resting[node]
        local = np.tile(resting, (len(seconds), 1, 1))
        moved = {
            path: self.channels[node, path].at(seconds) for path in _PATHS if (node, path) in self.channels
        }
        if "rotation" in moved or "scale" in moved:
            turn, size = rotations.from_matrix(_proper(resting)), np.linalg.norm(resting[:3, :3], axis=0)
            size = size * np.sign(np.linalg.det(resting[:3, :3]))
            matrix = rotations.to_matrix(rotations.normalize(moved.get("rotation", turn)))
            local[:, :3, :3] = matrix * np.asarray(moved.get("scale", size))[..., None, :]
        if "translation" in moved:
            local[:, :3, 3] = moved["translation"]
        return local


def _proper(matrices: Array) -> Array:
    """The rotations `(..., 3, 3)` of transforms `(..., 4, 4)` that may scale or mirror."""
    matrix = matrices[..., :3, :3]
    size = np.linalg.norm(matrix, axis=-2, keepdims=True)
    flat = size.min(axis=(-2, -1), keepdims=True) < 1e-9  # scaled away, as hidden parts are
    turn = np.where(flat, np.eye(3), matrix / np.maximum(size, 1e-12))
    return np.asarray(turn * np.where(np.linalg.det(turn) < 0.0, -1.0, 1.0)[..., None, None])


def _turns(matrices: Array) -> Array:
    """The rotations `(..., 4)` of transforms `(..., 4, 4)`."""
    return rotations.normalize(rotations.from_matrix(_proper(matrices)))


def _bind(nodes: _Nodes, joints: list[int]) -> Array:
    """Transforms `(joints, 4, 4)` in the world at rest: the bind pose where a skin tells it, else the nodes as they are.

    A skin tells it in the space of its mesh, which lies in the world as the node above the joints does, or not at all
    moved; where the joints then are nowhere near their nodes, as the uppermost one does. What no skin tells lies to the
    joint above it, or below, as at rest.
    """
    rest = node_world_matrices(nodes.file, nodes.order, nodes.parents)
    known = _bound(nodes.file)
    told = [joint for joint in joints if joint in known]
    if not told:
        return rest[joints]
    at = rest[told]
    placed = _placed(np.array([known[joint] for joint in told]), at, rest, nodes.parents[told[0]])
    # from where a node rests to where it was bound
    moved = dict(zip(told, placed @ np.linalg.inv(at), strict=True))
    for node in nodes.with_ancestors(told)[::-1]:
        moved.setdefault(nodes.parents[node], moved[node])
    for node in nodes.order:
        moved.setdefault(node, moved[nodes.parents[node]])
    return np.array([moved[joint] @ rest[joint] for joint in joints])


def _bound(file: GltfFile) -> dict[int, Array]:
    """The bind pose of joints in the space of their mesh, by the largest skin that has them."""
    known, count = dict[int, Array](), 0
    for skin in sorted(file.gltf.skins or [], key=lambda skin: len(skin.joints)):
        if skin.inverseBindMatrices is None:
            continue
        count += max(len(skin.joints), accessor_count(file, skin.inverseBindMatrices))
        if count > MAX_BOUND:
            raise file.error(f"more than {MAX_BOUND} bind matrices.", REMEDY)
        inverse = read_accessor(file, skin.inverseBindMatrices, "the bind pose").astype(float)
        matrices = inverse.reshape(-1, 4, 4).transpose(0, 2, 1)[: len(skin.joints)]
        usable = np.flatnonzero(np.abs(np.linalg.det(matrices)) > 1e-15)
        joints = [skin.joints[k] for k in usable]
        known.update(zip(joints, np.linalg.inv(matrices[usable]), strict=True))
    return known


def _placed(bind: Array, at: Array, rest: Array, top: int) -> Array:
    """A bind pose `(K, 4, 4)` in the world, where its joints rest `at` and hang on the node `top`."""
    size = float(np.linalg.norm(np.ptp(at[:, :3, 3], axis=0)))
    for space in (rest[top] if top >= 0 else np.eye(4), np.eye(4)):
        placed = space @ bind
        if np.linalg.norm(placed[:, :3, 3] - at[:, :3, 3], axis=-1).mean() < NEAR * size:
            return placed
    return at[0] @ np.linalg.inv(bind[0]) @ bind
