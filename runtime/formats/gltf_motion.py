"""Motion of a glTF, GLB, VRM, VRMA or FBX file: its animation resampled at a constant rate, relative to the bind pose."""

import contextlib
from collections import Counter
from dataclasses import dataclass
from itertools import accumulate
from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime import rotations
from runtime.arrays import Array
from runtime.character.bodies import Body, find_bodies
from runtime.character.glb_buffer import GENERATOR
from runtime.character.mesh import vrm_bones
from runtime.character.nodes import Nodes, local_matrices
from runtime.character.read import STRUCTURE_ERRORS, Entry, GltfFile, open_gltf
from runtime.character.rest_pose import bind_worlds
from runtime.checked import number_field
from runtime.errors import FileError
from runtime.formats.bvh import MAX_FRAMES, MAX_JOINT_FRAMES, MAX_JOINTS, MAX_VALUE, BvhMotion
from runtime.formats.gltf_keys import KEYS_REMEDY, PATHS, Channels, MovingNodes, read_channels, rotation_parts
from runtime.pose import MAX_FPS, VIDEO_RATES
from runtime.safe_read import parse_json, printable, reason
from runtime.skeleton import Skeleton

USUAL_FPS = 30.0  # of an animation without a rate
# in the order in which they are tried
USUAL_RATES = (USUAL_FPS, 24.0, 25.0, 60.0, 48.0, 50.0, *VIDEO_RATES, 100.0, 240.0)
# if keys lie on this fraction of a rate's frames, and there are at least this many, every frame counts as keyed
DENSE_FRACTION, MIN_DENSE_STEPS = (0.9, 4)
# minimum rate of keys in every frame: slower ones are keyframes, and cubics between them bend
MIN_FPS, MIN_CUBIC_FPS = (4.5, 15.0)
ON_FRAME_TOLERANCE = 2e-4  # distance in frames of a key from its frame; 29.97 and 30 differ by 1e-3
# rate that Blender writes, and the actual one
NTSC = {rate * 1.001: rate / 1.001 for rate in (24.0, 30.0, 60.0)}
CHUNK_FRAMES = 1024  # processed at once
# nodes x frames, and keys, allowed for any file; and added per byte
MAX_UNBAKED, KEYS_PER_BYTE_FACTOR = 500_000, 0.5
MAX_NAME, MAX_SHOWN, MAX_LISTED = 200, 60, 6  # letters of a joint and of an animation; bodies in a sentence
# nodes of animations searched for a body, and the cost of a channel
MAX_LOOKED_AT, CHANNEL_COST = (50_000, 8)


# per name, an animation and the body that it moves, by its keys; None if it moves none
_Listed = dict[str, tuple[Any, Body | None]]


@dataclass(frozen=True)
class _Animation:
    """An animation as read, with the number of moved joints of its body and the metadata of the take."""

    label: str
    channels: Channels
    body: Body | None
    moved: int
    metadata: Any

    @property
    def known(self) -> bool:
        """Return whether it animates a body recognised by names or hierarchy."""
        return self.body is not None and self.body.known and self.moved > 0

    def moves_half(self, most: int) -> bool:
        """Return whether it animates half of its body, or of `most` joints if fewer; without a body any motion is enough."""
        return bool(self.channels) and (self.body is None or self.moved >= self.body.half(most))


def contents(path: Path) -> tuple[bool, bool]:
    """Return whether a file has a skinned mesh, and whether it has a motion; FileError if it cannot be read.

    For a take exported by this program the mesh does not count: it only shows who moved.
    """
    file = open_gltf(path, motion=True)
    skinned = any(node.mesh is not None and node.skin is not None for node in file.gltf.nodes or [])
    try:
        moves = any(_moves(file, animation) for animation in file.gltf.animations or [])
    except STRUCTURE_ERRORS:
        moves = True  # reading it reports the error
    own = (file.gltf.asset or Entry()).generator == GENERATOR
    return skinned and not (moves and own), moves


def _moves(file: GltfFile, animation: Entry) -> bool:
    channels = [channel for channel in animation.channels or [] if channel.target.path in PATHS]
    return any(file.count(animation.samplers[channel.sampler].input) > 1 for channel in channels)


def read_gltf_motion(path: Path, animation: str = "") -> BvhMotion:
    """Read the named animation, or the first that moves a body, in metres; the result's `animations` lists all names.

    An animation of several bodies is listed once per body: "walk" for the first one, "walk / NPC" for another. Raises
    FileError if there is none or it is damaged.
    """
    file = open_gltf(path, motion=True)
    try:
        return _motion(file, animation)
    except FileError:
        raise
    except STRUCTURE_ERRORS as error:
        raise file.error(f"its animation is damaged ({reason(error)}).", KEYS_REMEDY) from error


def _motion(file: GltfFile, wanted: str) -> BvhMotion:
    nodes = Nodes(file)
    animations = _named(file)
    bodies = find_bodies(nodes, {node for entry in animations.values() for node in _targets(nodes, entry)})
    listed = _listed(nodes, animations, bodies)
    animation = _chosen(nodes, listed, wanted)
    joints = list(animation.body.joints) if animation.body else []
    needed = nodes.with_ancestors(joints)
    channels = {(node, path): keys for (node, path), keys in animation.channels.items() if node in needed}
    if not channels:
        raise file.error("its animation moves no node of a body.", KEYS_REMEDY)
    if len(joints) > MAX_JOINTS:
        raise file.error(f"{len(joints)} joints; expected at most {MAX_JOINTS}.", KEYS_REMEDY)
    times, fps = _times(file, channels, len(needed), number_field(animation.metadata, "fps", 0.0))
    bind = bind_worlds(nodes, joints)
    positions = np.empty((len(times), len(joints), 3), np.float32)
    local = np.empty((len(times), len(joints), 4), np.float32)
    note = _note(animation, listed, bodies, wanted)
    skeleton, told = _skeleton(nodes, joints, bind), animation.metadata
    motion = BvhMotion(skeleton, positions, local, 1.0 / fps, {}, note, told, tuple(listed))
    moving = MovingNodes(needed, nodes.parents, local_matrices(file), channels)
    with np.errstate(all="ignore"):  # the results are checked
        _fill(motion, moving, times, joints, np.linalg.inv(bind[:, :3, :3]))
    furthest = max(np.abs(positions).max(), np.abs(skeleton.offsets).max())
    if not furthest <= MAX_VALUE or not np.isfinite(local).all():
        raise file.error(f"its animation moves joints further than {MAX_VALUE:.0e} away.", KEYS_REMEDY)
    return motion


def _skeleton(nodes: Nodes, joints: list[int], bind: Array) -> Skeleton:
    nearest = nodes.nearest(set(joints))
    above = [nearest[nodes.parents[j]] if nodes.parents[j] >= 0 else -1 for j in joints]
    parents = tuple(joints.index(node) if node >= 0 else -1 for node in above)
    at_rest = bind[:, :3, 3]
    offsets = [at_rest[k] - (at_rest[p] if p >= 0 else 0.0) for k, p in enumerate(parents)]
    # a VRM's bones by Unity's names
    bones = {node: bone[:1].upper() + bone[1:] for node, bone in vrm_bones(nodes.file).items()}
    names = tuple(printable(str(bones.get(j) or nodes.name(j)))[:MAX_NAME] for j in joints)
    return Skeleton(names, parents, np.array(offsets, np.float32))


def _fill(motion: BvhMotion, moving: MovingNodes, times: Array, joints: list[int], unbind: Array) -> None:
    """Write the frames of a motion, with joints relative to the bind pose, where all rotations are zero.

    `unbind` `(J, 3, 3)` undoes the bind pose, including scale, mirroring and shear of the nodes above.
    """
    for first in range(0, len(times), CHUNK_FRAMES):
        rows = slice(first, first + CHUNK_FRAMES)
        made = moving.world(times[rows])
        world = np.stack([made[joint] for joint in joints], axis=1)  # (T, J, 4, 4)
        places = world[..., :3, 3]
        turns = rotations.normalize(rotations.from_matrix(rotation_parts(world[..., :3, :3] @ unbind)))
        motion.local_rotations[rows], motion.positions[rows] = turns, places
        for j, parent in enumerate(motion.skeleton.parents):
            if parent >= 0:
                back = rotations.inverse(turns[:, parent])
                motion.local_rotations[rows, j] = rotations.normalize(rotations.multiply(back, turns[:, j]))
                motion.positions[rows, j] = rotations.rotate(back, places[:, j] - places[:, parent])


def _named(file: GltfFile) -> dict[str, Any]:
    """Return the animations by name, with a number for duplicate names. FileError if there are none."""
    animations: dict[str, Any] = {}
    for k, animation in enumerate(file.gltf.animations or []):
        name = printable(str(animation.name or f"animation {k + 1}"))[:MAX_SHOWN]
        animations[f"{name} ({k + 1})" if name in animations else name] = animation
    if not animations:
        raise file.error("it has no animation.", "Choose a file with one, or open it as a character.")
    return animations


def _targets(nodes: Nodes, entry: Any) -> set[int]:
    """Return the nodes for which an animation has keys."""
    every = range(len(nodes.parents))
    found = (channel.target for channel in entry.channels or [])
    return {target.node for target in found if target.path in PATHS and target.node in every}


def _listed(nodes: Nodes, animations: dict[str, Any], bodies: list[Body]) -> _Listed:
    """List the choices: each animation with the first body that it moves, and once more for each further body."""
    inside = {joint: k for k, body in enumerate(bodies) for joint in body.joints}
    above = [(body, set(nodes.with_ancestors(body.joints[:1]))) for body in bodies]
    listed: _Listed = {}
    for name, entry in animations.items():
        targets = _targets(nodes, entry)
        moved = (
            _most_moved_first(bodies, inside, targets)
            or [b for b, k in above if not targets.isdisjoint(k)][:1]
        )
        listed[name] = entry, next(iter(moved), None)
        for body in filter(attrgetter("known"), moved[1:]):
            listed[f"{name} / {printable(body.name)[:MAX_SHOWN]}"] = entry, body
    return listed


def _most_moved_first(bodies: list[Body], inside: dict[int, int], targets: set[int]) -> list[Body]:
    """Return the bodies that contain targets (`inside`): recognised ones first, and those with half of their joints moved."""
    hits = Counter(inside[node] for node in targets if node in inside)
    most = max(hits.values(), default=0)
    order = sorted(hits, key=lambda k: (not bodies[k].known, hits[k] < bodies[k].half(most), k))
    return [bodies[k] for k in order]


def _chosen(nodes: Nodes, listed: _Listed, wanted: str) -> _Animation:
    """Return the animation of a name, else the first one that moves a body. FileError."""
    if wanted:
        wanted = printable(wanted)[: 2 * MAX_SHOWN]
        if wanted not in listed:
            raise nodes.file.error(f"no animation {wanted!r}.", f"It has {', '.join(list(listed)[:40])}.")
        listed = {wanted: listed[wanted]}
    # cameras and the empty takes of some programs may come first
    read = _as_far_as_needed(nodes, listed)
    read = [animation for animation in read if animation.known] or read
    most = max(animation.moved for animation in read)
    first = next((animation for animation in read if animation.moves_half(most)), None)
    if first is None:
        raise nodes.file.error("its animation moves no node.", KEYS_REMEDY)
    return first


def _note(animation: _Animation, listed: _Listed, bodies: list[Body], wanted: str) -> str:
    """Return a sentence that says what was read and what else the file has; "" if that is all."""
    others = [printable(b.name)[:MAX_SHOWN] for b in bodies if b.known and b is not animation.body]
    texts = []
    if len(listed) > 1 and not wanted:
        more = [label for label in listed if label != animation.label][:MAX_LISTED]
        texts.append(f"{len(listed)} animations; {animation.label} is read, not {', '.join(more)}.")
    if others and animation.body:
        name = printable(animation.body.name)[:MAX_SHOWN]
        texts.append(f"{1 + len(others)} bodies; {name} is read, not {', '.join(others[:MAX_LISTED])}.")
    return " ".join(texts)


def _as_far_as_needed(nodes: Nodes, listed: _Listed) -> list[_Animation]:
    """Read animations up to the first that moves half of its body, or half as much as any later one has keys for. FileError."""
    targets = [len(_targets(nodes, entry)) if body else 0 for entry, body in listed.values()]
    later = [*accumulate(targets[:0:-1], max, initial=0)][::-1]
    read: list[_Animation] = []
    keys = looked_at = moved = 0
    for (label, (entry, body)), most in zip(listed.items(), later, strict=True):
        keys += _key_count(nodes.file, entry)
        if keys > _room(nodes.file):
            raise nodes.file.error("more keys than a file of its size can hold.", KEYS_REMEDY)
        read.append(_animation(nodes, label, entry, body))
        looked_at += len(nodes.parents) + CHANNEL_COST * (1 + len(entry.channels or []))
        moved = max(moved, read[-1].moved)
        enough = body.half(max(most, moved)) if body else np.inf
        if looked_at > MAX_LOOKED_AT or read[-1].moved >= enough > 0:
            break
    return read


def _key_count(file: GltfFile, animation: Entry) -> int:
    used = [
        animation.samplers[channel.sampler] for channel in animation.channels or []
    ]  # it may occur several times
    return sum(file.count(key) for each in used for key in (each.input, each.output))


def _room(file: GltfFile) -> float:
    """Return the most keys, and nodes x frames, that a file of this size may have."""
    return MAX_UNBAKED + KEYS_PER_BYTE_FACTOR * sum(map(len, file.buffers))


def _animation(nodes: Nodes, label: str, entry: Any, body: Body | None) -> _Animation:
    channels, told = read_channels(nodes.file, entry), _metadata(nodes.file, entry)
    changed = {node for (node, _), channel in channels.items() if np.ptp(channel.values, axis=0).max() > 1e-6}
    return _Animation(label, channels, body, len(changed.intersection(body.joints if body else ())), told)


def _metadata(file: GltfFile, animation: Any) -> dict[str, Any]:
    """Return the metadata that our exports store with an animation, {} for other files; an FBX stores it as text."""
    gltf = file.gltf
    for holder in (animation, *((gltf.scenes or [])[:1] if len(gltf.animations) == 1 else ())):
        extras = holder.get("extras")
        value = extras.get("sport") if isinstance(extras, dict) else None
        with contextlib.suppress(ValueError):
            value = parse_json(value) if isinstance(value, str) else value
        if isinstance(value, dict):
            return value
    return {}


def _times(file: GltfFile, channels: Channels, nodes: int, told: float) -> tuple[NDArray[np.float64], float]:
    """Return evenly spaced times from the first to the last key, and their rate (`_rates`)."""
    keys = np.unique(np.concatenate([channel.times for channel in channels.values()]))
    first, keys = keys[0], keys - keys[0]
    near = ON_FRAME_TOLERANCE * (1.0 + keys[-1] / 60.0)  # times have 24 bits
    cubic = any(channel.kind == "CUBICSPLINE" for channel in channels.values())
    rates = _rates(keys, told, MIN_CUBIC_FPS if cubic else MIN_FPS)
    fps = next((fps for fps in rates if np.abs(keys * fps - np.round(keys * fps)).max() < near), rates[-1])
    count = int(np.floor(keys[-1] * fps + 1e-3)) + 1
    if count > MAX_FRAMES or count * nodes > min(MAX_JOINT_FRAMES, _room(file)):
        raise file.error(f"an animation of {count} frames.", "Split the clip, or export it baked.")
    return np.asarray(first + np.arange(count) / fps), NTSC.get(fps, fps)


def _rates(keys: Array, told: float, least: float) -> list[float]:
    """Return candidate rates for key times `(K,)`: the first with all keys on its frames is used, else the last.

    In order: the stated rate; that of keys in nearly every frame, as a common or whole number; common rates; that
    of the keys, if that is at least `least`.
    """
    steps = np.diff(keys)
    rate = 1.0 / max(float(np.median(steps)), 1e-6) if len(steps) else USUAL_FPS
    usual, likely = (*USUAL_RATES, *NTSC), least <= rate <= MAX_FPS
    rates = [told] if 0.0 < told <= MAX_FPS else []
    if len(steps) >= MIN_DENSE_STEPS and likely:
        nearest = (*(fps for fps in usual if abs(fps - rate) < 2e-3 * fps), float(round(rate)))
        rates += [fps for fps in nearest if len(steps) > DENSE_FRACTION * keys[-1] * fps]
    return [*rates, *usual, rate if likely else USUAL_FPS]
