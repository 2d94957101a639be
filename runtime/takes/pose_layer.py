"""The pose layer of a take: keyframed joint rotations, and offsets of hips and feet, added to the motion below.

Every joint has its own curve through the keys that have a value for it, so that a head turned at 2 s and a hand raised
at 8 s are independent. A curve eases in before its first key and out after its last one. Legs are solved by IK:
when the hips move, the feet stay planted.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from functools import cached_property

import numpy as np

from runtime import rotations
from runtime.arrays import Array
from runtime.errors import UsageError
from runtime.feet.ik import LEG_FEET, solve_legs, two_bone
from runtime.skeleton import MIRROR_JOINTS, SPORT_SKELETON, J
from runtime.takes.clip import Clip
from runtime.takes.pinned import LEG_M

HIPS = 0
MOVED = (HIPS, *LEG_FEET.tolist())  # joints with offsets; every joint can be rotated
HANDS = {20: (18, 19), 27: (25, 26)}  # hand: upper arm and forearm
ELBOWS = {19: (18, 20), 26: (25, 27)}  # forearm: upper arm and hand
KNEES = {3: (2, 4), 8: (7, 9)}  # shin: thigh and foot
DEFAULT_EASE_S, MAX_EASE_S, MAX_TIME_S = 0.3, 60.0, 36_000.0
MAX_KEYS = 1000
CHUNK_FRAMES = 2048  # processed together, which limits memory
APART_S = 1e-6  # minimum distance of two keys: a curve between nearer ones would overflow
MAX_TURN_RAD, MAX_MOVE_M = 7.0, 10.0  # radians, metres
REMEDY = "Undo, or delete the key and set it again."


class Curve(StrEnum):
    """The kind of an animation curve."""

    TURN = "turn"  # of a joint
    MOVE = "move"  # of hips or a foot
    CAMERA = "camera"  # not part of a pose


POSE_CURVES = (Curve.TURN, Curve.MOVE)


class Tangent(StrEnum):
    """How a curve passes through a key."""

    SMOOTH = "smooth"  # without overshoot: flat at extrema
    FLAT = "flat"
    LINEAR = "linear"  # straight to the next key
    STEP = "step"  # constant until the next key


@dataclass(frozen=True)
class JointValue:
    """A rotation vector (radians, in the joint's own frame) or an offset (metres: left, up, ahead of the hips) of a joint."""

    joint: int
    x: float
    y: float
    z: float

    @property
    def vector(self) -> Array:
        """The vector `(3,)`."""
        return np.array([self.x, self.y, self.z])


def _fit(values: Sequence[JointValue], joints: Collection[int], limit: float) -> bool:
    """Whether the values belong to these joints, one per joint, within a limit."""
    named = {value.joint for value in values}
    largest = np.abs([value.vector for value in values]).max(initial=0.0)
    return named <= set(joints) and len(named) == len(values) and bool(largest <= limit)


@dataclass(frozen=True)
class PoseKey:
    """A key of the pose layer: rotations and offsets added to the motion at a time; UsageError for values out of range."""

    seconds: float
    turns: tuple[JointValue, ...] = ()
    moves: tuple[JointValue, ...] = ()
    tangent: Tangent = Tangent.SMOOTH

    def __post_init__(self) -> None:
        turns = _fit(self.turns, range(J), MAX_TURN_RAD)
        if not (turns and _fit(self.moves, MOVED, MAX_MOVE_M) and 0.0 <= self.seconds <= MAX_TIME_S):
            raise UsageError(f"A pose key at {self.seconds:g} s with invalid values.", REMEDY)

    def __bool__(self) -> bool:
        return bool(self.turns or self.moves)

    def values(self, curve: Curve) -> tuple[JointValue, ...]:
        """Return the rotations or the offsets of the key."""
        return self.turns if curve is Curve.TURN else self.moves

    def value(self, curve: Curve, joint: int) -> Array:
        """Return the rotation vector or offset `(3,)` of a joint; zeros if it has none."""
        return next((value.vector for value in self.values(curve) if value.joint == joint), np.zeros(3))

    def with_value(self, curve: Curve, joint: int, vector: Array) -> PoseKey:
        """Return the key with a new rotation or offset of a joint."""
        x, y, z = (float(v) for v in vector)
        values = [*self.without(joint, (curve,)).values(curve), JointValue(joint, x, y, z)]
        return self._with(curve, sorted(values, key=lambda value: value.joint))

    def without(self, joint: int, curves: Sequence[Curve] = POSE_CURVES) -> PoseKey:
        """Return the key without the values of a joint."""
        key = self
        for curve in curves:
            key = key._with(curve, [value for value in key.values(curve) if value.joint != joint])
        return key

    def _with(self, curve: Curve, values: list[JointValue]) -> PoseKey:
        kept = tuple(values)
        return replace(self, turns=kept) if curve is Curve.TURN else replace(self, moves=kept)


Point = tuple[PoseKey, Array]  # of a joint's curve: the key, and its value (3,)


@dataclass(frozen=True)
class PoseLayer:
    """The pose layer of a take: keys in order of time. `keeps`: the last key of a joint holds to the end of the take."""

    keys: tuple[PoseKey, ...] = ()
    ease_in: float = DEFAULT_EASE_S  # seconds
    ease_out: float = DEFAULT_EASE_S
    keeps: bool = False

    def __post_init__(self) -> None:
        if not (0.0 <= self.ease_in <= MAX_EASE_S and 0.0 <= self.ease_out <= MAX_EASE_S):
            problem = f"A pose layer that eases in {self.ease_in:g} and {self.ease_out:g} s."
            raise UsageError(problem, f"Choose 0 to {MAX_EASE_S:g} s.")
        if any(not after.seconds - key.seconds >= APART_S for key, after in itertools.pairwise(self.keys)):
            raise UsageError("Pose keys at the same time or out of order.", REMEDY)

    def __bool__(self) -> bool:
        return bool(self.keys)

    def with_key(self, key: PoseKey, fps: float) -> PoseLayer:
        """Return the layer with a key added, replacing one at the same frame; UsageError for more than MAX_KEYS."""
        kept = [k for k in self.keys if round(k.seconds * fps) != round(key.seconds * fps)]
        if len(kept) >= MAX_KEYS:
            raise UsageError(f"A pose layer of {MAX_KEYS} keys is full.", "Delete keys first.")
        return replace(self, keys=tuple(sorted([*kept, key], key=lambda k: k.seconds)))

    def key_at(self, frame: int, fps: float) -> PoseKey | None:
        """Return the key at a frame, or None."""
        return next((key for key in self.keys if round(key.seconds * fps) == frame), None)

    def joints(self, curve: Curve) -> list[int]:
        """Return the joints with a curve of this kind."""
        return sorted(self._points[curve])

    def values(self, curve: Curve, joint: int, seconds: Array) -> Array:
        """Return the curve of a joint at times `(T,)`: rotation vectors (radians) or offsets (metres), `(T, 3)`."""
        return self._between(self._points[curve].get(joint, []), seconds)

    @cached_property
    def _points(self) -> dict[Curve, dict[int, list[Point]]]:
        """Return the points of every curve, by joint."""
        found: dict[Curve, dict[int, list[Point]]] = {curve: {} for curve in POSE_CURVES}
        for key, curve in itertools.product(self.keys, POSE_CURVES):
            for value in key.values(curve):
                found[curve].setdefault(value.joint, []).append((key, value.vector))
        return found

    def between(self, seconds: float) -> PoseKey:
        """Return the layer's interpolated values at a time, as a key."""
        key = PoseKey(seconds)
        for curve in POSE_CURVES:
            for joint in self.joints(curve):
                key = key.with_value(curve, joint, self.values(curve, joint, np.array([seconds]))[0])
        return key

    def edited(self, frame: int, fps: float, change: Callable[[PoseKey], PoseKey]) -> PoseLayer:
        """Return the layer with a key at a frame, made by `change` from the interpolated values there. Raises UsageError."""
        key = self.key_at(frame, fps) or PoseKey(frame / fps)
        shown = self.between(key.seconds)
        made = change(shown)
        for curve in POSE_CURVES:
            for value in made.values(curve):
                if value not in shown.values(curve):
                    key = key.with_value(curve, value.joint, value.vector)
        return self.with_key(key, fps)

    def without_key(self, key: PoseKey) -> PoseLayer:
        """Return the layer without a key."""
        return replace(self, keys=tuple(one for one in self.keys if one is not key))

    def _between(self, points: list[Point], seconds: Array) -> Array:
        if not points:
            return np.zeros((len(seconds), 3))
        times = [key.seconds for key, _ in points]
        values = [value for _, value in points]
        tangents = [key.tangent for key, _ in points]
        ends = [(times[0] - max(self.ease_in, 1e-6), 0)]
        if not self.keeps:
            ends.append((times[-1] + max(self.ease_out, 1e-6), len(times) + 1))
        for time, place in ends:
            times.insert(place, time)
            values.insert(place, np.zeros(3))
            tangents.insert(place, Tangent.FLAT)
        if self.keeps and tangents[-1] is Tangent.SMOOTH:
            tangents[-1] = Tangent.FLAT
        return _hermite(np.array(times), np.array(values), tangents, seconds)


NO_LAYER = PoseLayer()


def _hermite(times: Array, values: Array, tangents: Sequence[Tangent], at: Array) -> Array:
    """Cubic interpolation of values `(K, 3)` at times `(T,)`; constant before the first and after the last."""
    rises = np.diff(values, axis=0) / np.diff(times)[:, None]
    slopes = np.zeros_like(values)
    before, after = rises[:-1], rises[1:]
    # Fritsch and Butland 1984: the harmonic mean of both slopes does not overshoot
    same = before * after > 0.0
    mean = 2.0 * before * after / np.where(same, before + after, 1.0)
    slopes[1:-1] = np.where(same, mean, 0.0)
    slopes[[tangent is not Tangent.SMOOTH for tangent in tangents]] = 0.0
    k = np.clip(np.searchsorted(times, at, side="right") - 1, 0, len(times) - 2)
    span = np.diff(times)[k][:, None]
    t = np.clip((at - times[k])[:, None] / span, 0.0, 1.0)
    straight = values[k] + t * (values[k + 1] - values[k])
    a, b = 2 * t**3 - 3 * t**2 + 1, t**3 - 2 * t**2 + t
    c, d = 3 * t**2 - 2 * t**3, t**3 - t**2
    smooth = a * values[k] + b * span * slopes[k] + c * values[k + 1] + d * span * slopes[k + 1]
    kinds = np.array([list(Tangent).index(tangent) for tangent in tangents])[k][:, None]
    linear, step = (list(Tangent).index(kind) for kind in (Tangent.LINEAR, Tangent.STEP))
    stays = np.where(t < 1.0, values[k], values[k + 1])
    return np.where(kinds == linear, straight, np.where(kinds == step, stays, smooth))


def layered(clip: Clip, layer: PoseLayer, begin_s: float = 0.0) -> Clip:
    """Return the clip with a layer added; `begin_s` is the clip's start in the take. Frames without values are bit-identical."""
    seconds = begin_s + np.arange(len(clip)) / clip.fps
    turns, moves = (
        {joint: layer.values(curve, joint, seconds) for joint in layer.joints(curve)} for curve in POSE_CURVES
    )
    changed = np.zeros(len(clip), bool)
    for curve in (*turns.values(), *moves.values()):
        changed |= (curve != 0.0).any(-1)
    if not changed.any():
        return clip
    hips, local = clip.hips_positions.copy(), clip.local_rotations.copy()
    frames = np.flatnonzero(changed)
    for first in range(0, len(frames), CHUNK_FRAMES):
        part = frames[first : first + CHUNK_FRAMES]
        own = ({joint: curve[part] for joint, curve in curves.items()} for curves in (turns, moves))
        hips[part], local[part] = added(hips[part].astype(float), local[part].astype(float), *own)
    return clip.posed(hips, local)


def added(hips: Array, local: Array, turns: dict[int, Array], moves: dict[int, Array]) -> tuple[Array, Array]:
    """Return hips `(T, 3)` and local rotations `(T, 31, 4)` with rotations and offsets `(T, 3)` of joints added.

    Leg rotations determine the feet and the knees' planes; then the hips move, and the legs reach the feet.
    """
    heading = rotations.from_yaw(rotations.yaw_of(local[:, HIPS]))
    made = local.copy()
    for joint, vectors in turns.items():
        if joint != HIPS:
            made[:, joint] = rotations.multiply(local[:, joint], rotations.from_rotation_vector(vectors))
    if HIPS not in turns and not moves:
        return hips, rotations.normalize(made)
    positions, world = SPORT_SKELETON.forward_kinematics(hips, made)
    targets = positions[:, LEG_FEET].copy()
    for side, foot in enumerate(LEG_FEET.tolist()):
        if foot in moves:
            targets[:, side] += rotations.rotate(heading, moves[foot])
    if HIPS in moves:
        hips = hips + rotations.rotate(heading, moves[HIPS])
    if HIPS in turns:
        made[:, HIPS] = rotations.multiply(local[:, HIPS], rotations.from_rotation_vector(turns[HIPS]))
    return hips, solve_legs(hips, rotations.normalize(made), targets, world[:, LEG_FEET])


# --- keys from a gizmo; `positions` (31, 3) and `world` (31, 4) are of the shown pose


def turned(key: PoseKey, joint: int, world: Array, turn: Array) -> PoseKey:
    """Return the key with a joint rotated further by a world-space quaternion `(4,)`."""
    own = rotations.multiply(rotations.multiply(rotations.inverse(world[joint]), turn), world[joint])
    total = rotations.multiply(rotations.from_rotation_vector(key.value(Curve.TURN, joint)), own)
    return key.with_value(Curve.TURN, joint, rotations.to_rotation_vector(total))


def posed_by(joint: int) -> tuple[int, ...]:
    """Return the joints whose values `turned` and `dragged` change when this joint is edited, itself first."""
    if joint in MOVED:
        return (joint,)
    limb = HANDS.get(joint) or (ELBOWS.get(joint) or KNEES.get(joint) or (SPORT_SKELETON.parents[joint],))[:1]
    return (joint, *limb)


def dragged(key: PoseKey, joint: int, positions: Array, world: Array, by: Array) -> PoseKey:
    """Return the key with a joint dragged by a world-space vector `(3,)` in metres.

    Hips and feet are offset. A hand takes its arm along, an elbow or knee swings about the axis of its limb, and any
    other joint swings about its parent.
    """
    if joint in MOVED:
        if joint != HIPS:
            by = _within_reach(positions[joint - 2], positions[joint] + by) - positions[joint]
        heading = rotations.inverse(rotations.from_yaw(rotations.yaw_of(world[HIPS])))
        return key.with_value(Curve.MOVE, joint, key.value(Curve.MOVE, joint) + rotations.rotate(heading, by))
    goal = positions[joint] + by
    if joint in HANDS:
        upper, fore = HANDS[joint]
        first, second = two_bone(positions[upper], positions[fore], positions[joint], goal)
        key = turned(key, upper, world, first)
        # the forearm has already been rotated by its parent
        return turned(key, fore, world, rotations.multiply(rotations.inverse(first), second))
    if joint in ELBOWS or joint in KNEES:
        start, end = ELBOWS.get(joint) or KNEES[joint]
        return turned(key, start, world, _swing(positions[start], positions[end], positions[joint], goal))
    parent = SPORT_SKELETON.parents[joint]
    now, wanted = positions[joint] - positions[parent], goal - positions[parent]
    if np.linalg.norm(now) < 1e-4:
        return key
    turn = rotations.between(rotations.normalize(now), rotations.normalize(wanted))
    return turned(key, parent, world, turn)


def _within_reach(hip: Array, goal: Array) -> Array:
    """Return an ankle's goal, limited to the leg's length from its hip."""
    away = goal - hip
    return np.asarray(hip + away * min(1.0, 0.999 * LEG_M / max(float(np.linalg.norm(away)), 1e-6)))


def _swing(start: Array, end: Array, joint: Array, goal: Array) -> Array:
    """Return the rotation about the line from `start` to `end` that brings a joint nearest to `goal`."""
    axis = rotations.normalize(end - start)
    now, wanted = (point - start - np.dot(point - start, axis) * axis for point in (joint, goal))
    angle = np.arctan2(np.dot(np.cross(now, wanted), axis), np.dot(now, wanted))
    return rotations.from_axis_angle(axis, np.asarray(angle))


def pose_as_key(hips: Array, local: Array, below: Clip, frame: int) -> PoseKey:
    """Return a key that turns a frame below the layer into a pose, hips `(3,)` and local rotations `(31, 4)`.

    Place and heading of the body are kept.
    """
    base_hips, base = below.hips_positions[frame].astype(float), below.local_rotations[frame].astype(float)
    wanted = np.array(local, float)
    about = rotations.from_yaw(rotations.yaw_of(base[HIPS]) - rotations.yaw_of(wanted[HIPS]))
    wanted[HIPS] = rotations.multiply(about, wanted[HIPS])
    turns = rotations.to_rotation_vector(rotations.multiply(rotations.inverse(base), wanted))
    key = PoseKey(frame / below.fps)
    for joint in range(J):
        key = key.with_value(Curve.TURN, joint, turns[joint])
    place = np.array([base_hips[0], hips[1], base_hips[2]])
    goals = SPORT_SKELETON.forward_kinematics(place, wanted)[0][LEG_FEET]
    legs_alone = base.copy()
    legs_alone[1:] = wanted[1:]
    feet = SPORT_SKELETON.forward_kinematics(base_hips, legs_alone)[0][LEG_FEET]
    heading = rotations.inverse(rotations.from_yaw(rotations.yaw_of(base[HIPS])))
    key = key.with_value(Curve.MOVE, HIPS, rotations.rotate(heading, place - base_hips))
    for side, foot in enumerate(LEG_FEET.tolist()):
        key = key.with_value(Curve.MOVE, foot, rotations.rotate(heading, goals[side] - feet[side]))
    return key


def mirrored_pose(local: Array) -> Array:
    """Return the mirrored pose, local rotations `(31, 4)`, with the same heading."""
    yaw = rotations.yaw_of(local[HIPS])
    made = local[MIRROR_JOINTS] * np.array([1.0, 1.0, -1.0, -1.0])
    made[HIPS] = rotations.multiply(rotations.from_yaw(2.0 * yaw), made[HIPS])
    return np.asarray(made)
