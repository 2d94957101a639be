"""Applies pins to poses: two-bone IK of arms and legs, a leaning spine, a turning head, held poses.

The network's motion continues underneath: frames without a pin stay bit-identical.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from runtime import rotations
from runtime.arrays import Array
from runtime.easing import smoothstep
from runtime.feet.ik import LEG_FEET, LEG_TOES, solve_legs, two_bone
from runtime.skeleton import ANKLE_HEIGHT, PART_JOINTS, REST_HIPS_HEIGHT, SPORT_SKELETON
from runtime.takes.clip import Clip
from runtime.takes.pins import Pin, Pinned

ARMS = {Pinned.LEFT_HAND: (18, 19, 20), Pinned.RIGHT_HAND: (25, 26, 27)}  # upper arm, forearm, hand
FEET = (Pinned.LEFT_FOOT, Pinned.RIGHT_FOOT)
CHUNK_FRAMES = 2048  # processed together, which limits memory
ARM_M = float(np.linalg.norm(SPORT_SKELETON.offsets[[19, 20]], axis=1).sum())
LEG_M = float(np.linalg.norm(SPORT_SKELETON.offsets[[3, 4]], axis=1).sum())
CHEST, HEAD = 13, 16
SPINE = ((11, 1 / 3), (12, 1 / 3), (13, 1 / 3))  # joints that lean together, with their fractions
ORDER = (Pinned.POSE, Pinned.LEFT_FOOT, Pinned.RIGHT_FOOT, Pinned.LOOK, Pinned.LEFT_HAND, Pinned.RIGHT_HAND)
NECK = ((14, 0.3), (15, 0.3), (16, 0.4))  # joints that turn to look, with their fractions
# of its length: from the first on, an arm extends with falling speed
EASY_ARM_FRACTION, MAX_ARM_FRACTION = 0.94, 0.995
# of its length, and limit of the hips' lowering for a leg out of reach
EASY_LEG_FRACTION, MAX_DROP_M = 0.985, 0.2
MAX_LEAN_RAD = np.radians(60.0)  # of the spine, to bring a hand nearer
RELEASE_ARM_LENGTHS = (1.9, 2.6)  # where a hand begins to let go, and has let go
RELEASE_LEG_LENGTHS = (1.02, 1.3)  # in leg lengths from the hip, likewise
RELEASE_LOOK_RAD = np.radians((90.0, 150.0))  # where the head begins to let go, and has let go
MAX_TURN_RAD = np.radians(75.0)  # of the head
POLE_M = 0.03  # an elbow closer to the shoulder-hand line bends down and back
UPPER_BODY = tuple(j for part in ("torso", "left_arm", "right_arm", "head") for j in PART_JOINTS[part] if j)
World = tuple[Array, Array]  # positions (T, 31, 3) and rotations (T, 31, 4) of joints
_FORWARD = np.array([0.0, 0.0, 1.0])


@dataclass
class _Frames:
    """Some frames while they are bent: hips `(T, 3)`, local rotations `(T, 31, 4)`, contacts `(T, 4)`."""

    hips: Array
    local: Array
    contacts: Array

    def part(self, part: slice) -> _Frames:
        """Return a copy of some frames, for editing."""
        return _Frames(self.hips[part].astype(float), self.local[part].astype(float), self.contacts[part])

    def world(self) -> World:
        """Return world positions and rotations of the joints."""
        return SPORT_SKELETON.forward_kinematics(self.hips, self.local)


def pinned(
    clip: Clip, pins: Sequence[Pin], begin_s: float = 0.0, pose_at: Callable[[float], Array] | None = None
) -> Clip:
    """Return the clip with pins applied: poses first, then feet, looks and hands.

    The clip may be part of a take, beginning at `begin_s`; `pose_at` gives the take's local rotations at a time.
    """
    made = _Frames(*(array.copy() for array in clip.arrays))
    seconds = begin_s + np.arange(len(clip)) / clip.fps
    for pin in sorted(pins, key=lambda pin: ORDER.index(pin.what)):
        weights = pin.weights(seconds)
        held = np.flatnonzero(weights > 0.0)
        if len(held) == 0:
            continue
        parts = [
            slice(first, min(first + CHUNK_FRAMES, int(held[-1]) + 1))
            for first in range(int(held[0]), int(held[-1]) + 1, CHUNK_FRAMES)
        ]
        flat = _foot_heading(made, pin, parts, weights) if pin.what in FEET and len(parts) > 1 else None
        for part in parts:
            frames = made.part(part)
            if pin.what is Pinned.POSE:
                at = min(round(pin.of * clip.fps), len(clip) - 1)
                pose = clip.local_rotations[at] if pose_at is None else pose_at(pin.of)
                _hold_pose(frames, pose, weights[part])
            else:
                _bend(frames, pin, weights[part], flat)
            made.hips[part] = frames.hips
            made.local[part] = frames.local
            made.contacts[part] = frames.contacts
    return clip.posed(made.hips, made.local, made.contacts)


def bent_pose(
    hips: Array, local: Array, contacts: Array, pins: Sequence[tuple[Pin, float]]
) -> tuple[Array, Array, Array]:
    """Return a pose bent to pins with weights: hips `(3,)`, local rotations `(31, 4)`, contacts `(4,)`. Pose pins are ignored."""
    frames = _Frames(np.asarray(hips, float)[None], np.asarray(local, float)[None], np.array(contacts)[None])
    for pin, weight in sorted(pins, key=lambda entry: ORDER.index(entry[0].what)):
        if pin.what is not Pinned.POSE and weight > 0.0:
            _bend(frames, pin, np.array([weight]))
    return frames.hips[0].astype(np.float32), frames.local[0].astype(np.float32), frames.contacts[0]


def farthest(clip: Clip, pin: Pin) -> float:
    """Return the largest distance (metres) of a hand or foot from its pin while it holds; 0 for other pins."""
    first, last = (min(max(round(at * clip.fps), 0), len(clip) - 1) for at in (pin.start, pin.end))
    if pin.what in (Pinned.POSE, Pinned.LOOK):
        return 0.0
    frames = _Frames(*(array[first : last + 1] for array in clip.arrays))
    positions, world = frames.world()
    goals = _goals(pin, frames, positions, world)
    return float(np.linalg.norm(positions[:, _joint(pin.what)] - goals, axis=1).max())


def point_of(what: Pinned, positions: Array, world: Array) -> Array:
    """Return the point `(3,)` at which a new pin holds this pose, `(31, 3)` and `(31, 4)`; for a look, two metres ahead of the eyes."""
    if what is Pinned.LOOK:
        return np.asarray(positions[HEAD] + 2.0 * rotations.rotate(world[HEAD], _FORWARD))
    joint = np.array(positions[_joint(what)], float)
    return joint - (0.0, ANKLE_HEIGHT, 0.0) if what in FEET else joint


def in_world(pin: Pin, hips: Array, hips_rotation: Array) -> tuple[Array, ...]:
    """Return the world position of a pin's point, and of its rail's end if any, `(..., 3)` each."""
    points = [np.array(point, float) for point in (pin.point, pin.rail) if point is not None]
    if pin.along:
        turn = rotations.from_yaw(rotations.yaw_of(hips_rotation))
        below = hips - np.array([0.0, REST_HIPS_HEIGHT, 0.0])
        points = [below + rotations.rotate(turn, point) for point in points]
    return tuple(points)


def along_with(point: Array, hips: Array, hips_rotation: Array) -> Array:
    """Return a world point `(3,)` relative to the character: left, up from its ground, ahead."""
    offset = np.asarray(point) - hips
    back = rotations.inverse(rotations.from_yaw(rotations.yaw_of(hips_rotation)))
    return np.asarray(rotations.rotate(back, offset) + np.array([0.0, REST_HIPS_HEIGHT, 0.0]))


def _bend(frames: _Frames, pin: Pin, weights: Array, flat: Array | None = None) -> None:
    """Bend frames to a pin; `flat` `(4,)` is the heading of a pinned foot, if it also depends on other frames."""
    seen = frames.world()
    goals = _goals(pin, frames, *seen)
    if pin.what is Pinned.LOOK:
        _look(frames, seen, goals, weights)
    elif pin.what in ARMS:
        _reach(frames, seen, goals, weights, pin.what)
    else:
        _step_on(frames, seen, goals, weights, FEET.index(pin.what), flat)


def _goals(pin: Pin, frames: _Frames, positions: Array, world: Array) -> Array:
    """Return the target positions of the pinned joint `(T, 3)`."""
    place, *rail = in_world(pin, frames.hips, world[:, 0])
    points = np.broadcast_to(place, (len(positions), 3))
    for end in rail:
        near = positions[:, ARMS[pin.what][0] if pin.what in ARMS else _joint(pin.what)]
        along = end - points
        fraction = np.sum((near - points) * along, -1) / np.maximum(np.sum(along * along, -1), 1e-9)
        points = points + np.clip(fraction, 0.0, 1.0)[:, None] * along
    sole = pin.what in FEET
    return np.asarray(points + np.array([0.0, ANKLE_HEIGHT if sole else 0.0, 0.0]))


def _joint(what: Pinned) -> int:
    if what in ARMS:
        return ARMS[what][2]
    return HEAD if what is Pinned.LOOK else int(LEG_FEET[int(what is Pinned.RIGHT_FOOT)])


def _hold_pose(frames: _Frames, pose: Array, weights: Array) -> None:
    """Hold arms, spine and head as in another frame; the legs walk on."""
    joints = list(UPPER_BODY)
    frames.local[:, joints] = rotations.slerp(
        frames.local[:, joints], pose[None, joints].astype(float), weights[:, None]
    )


def _look(frames: _Frames, seen: World, goals: Array, weights: Array) -> None:
    positions, world = seen
    facing = rotations.rotate(world[:, HEAD], _FORWARD)
    wanted = rotations.normalize(goals - positions[:, HEAD])
    chest = rotations.rotate(world[:, CHEST], _FORWARD)
    off = np.arccos(np.clip(np.sum(chest * wanted, -1), -1.0, 1.0))
    weights = weights * _falls(off, *RELEASE_LOOK_RAD)
    turn = rotations.to_rotation_vector(rotations.between(facing, wanted))
    angle = np.linalg.norm(turn, axis=-1, keepdims=True)
    turn = turn * weights[:, None] * np.minimum(1.0, MAX_TURN_RAD / np.maximum(angle, 1e-9))
    _turn(frames, world, NECK, turn)


def _reach(frames: _Frames, seen: World, goals: Array, weights: Array, what: Pinned) -> None:
    """Move a hand to its goal; the spine leans if the arm is too short, and the hand releases a goal far out of reach."""
    (positions, world), (shoulder, elbow, hand) = seen, ARMS[what]
    distance = np.linalg.norm(goals - positions[:, shoulder], axis=-1)
    weights = weights * _falls(distance / ARM_M, *RELEASE_ARM_LENGTHS)
    own = np.linalg.norm(positions[:, hand] - positions[:, shoulder], axis=-1)
    for _ in range(3):
        lack = distance - np.maximum(own, EASY_ARM_FRACTION * ARM_M)
        lack = weights * _smooth_positive(lack - 0.005, 0.01)
        base = positions[:, SPINE[0][0]]
        arm, aim = positions[:, shoulder] - base, rotations.normalize(goals - base)
        span = np.maximum(np.linalg.norm(arm, axis=-1), 1e-6)
        axis = rotations.normalize(np.cross(arm, aim))
        room = np.arccos(np.clip(np.sum(arm * aim, -1) / span, -1.0, 1.0))
        angle = np.minimum(np.minimum(lack / span, room), MAX_LEAN_RAD)
        _turn(frames, world, SPINE, axis * angle[:, None])
        positions, world = frames.world()
        distance = np.linalg.norm(goals - positions[:, shoulder], axis=-1)
    now = positions[:, hand]
    arm, aim = now - positions[:, shoulder], goals - positions[:, shoulder]
    target = positions[:, shoulder] + _between_reaches(arm, aim, _soft_arm(distance, arm), weights)
    pole = _elbow_pole(positions, world, shoulder, elbow, hand)
    first, second = two_bone(positions[:, shoulder], positions[:, elbow], now, target, pole)
    upper, fore = rotations.multiply(first, world[:, shoulder]), rotations.multiply(second, world[:, elbow])
    parent = SPORT_SKELETON.parents[shoulder]
    held = weights[:, None] > 0.0
    frames.local[:, shoulder] = np.where(held, _relative(world[:, parent], upper), frames.local[:, shoulder])
    frames.local[:, elbow] = np.where(held, _relative(upper, fore), frames.local[:, elbow])


def _between_reaches(now: Array, goal: Array, length: Array, weights: Array) -> Array:
    """Return positions on an arc around the shoulder `(T, 3)` from `now` to `goal`, `length` away, not through the body."""
    turn = rotations.between(rotations.normalize(now), rotations.normalize(goal))
    way = rotations.slerp(np.broadcast_to(rotations.identity(), turn.shape), turn, weights)
    span = np.linalg.norm(now, axis=-1)
    far = span + weights * (length - span)
    return np.asarray(rotations.rotate(way, rotations.normalize(now)) * far[:, None])


def _elbow_pole(positions: Array, world: Array, shoulder: int, elbow: int, hand: int) -> Array:
    """Return the elbow's direction: its own, or down and back if the arm is nearly straight."""
    axis = rotations.normalize(positions[:, hand] - positions[:, shoulder])
    bend = positions[:, elbow] - positions[:, shoulder]
    bend = bend - np.sum(bend * axis, -1, keepdims=True) * axis
    out = np.linalg.norm(bend, axis=-1, keepdims=True)
    easy = rotations.rotate(world[:, CHEST], np.array([0.0, -0.6, -0.8]))
    return rotations.normalize(bend + np.maximum(POLE_M - out, 0.0) * easy)


def _foot_heading(made: _Frames, pin: Pin, parts: Sequence[slice], weights: Array) -> Array:
    """Return the heading `(4,)` of a pinned foot in the middle of the frames in which it is held."""
    side = FEET.index(pin.what)
    bearing, headings = [], []
    for part in parts:
        frames = made.part(part)
        positions, world = frames.world()
        bearing.append(_bearing(positions, _goals(pin, frames, positions, world), weights[part], side))
        headings.append(rotations.yaw_of(world[:, LEG_FEET[side]]))
    return _heading(np.concatenate(headings), np.concatenate(bearing))


def _bearing(positions: Array, goals: Array, weights: Array, side: int) -> Array:
    """Return weights `(T,)` of a foot on its mark, which it releases if the leg cannot reach it."""
    return weights * _falls(
        np.linalg.norm(goals - positions[:, 2 + 5 * side], axis=-1) / LEG_M, *RELEASE_LEG_LENGTHS
    )


def _heading(yaws: Array, weights: Array) -> Array:
    most = np.flatnonzero(weights >= weights.max() - 1e-9)
    middle = int(most[len(most) // 2])
    return np.asarray(rotations.from_yaw(yaws[middle : middle + 1]))[0]


def _step_on(
    frames: _Frames, seen: World, goals: Array, weights: Array, side: int, flat: Array | None
) -> None:
    """Plant a foot flat on its mark."""
    positions, world = seen
    hip, ankle = positions[:, 2 + 5 * side], positions[:, LEG_FEET[side]]
    weights = _bearing(positions, goals, weights, side)
    frames.hips[:, 1] -= weights * drop_to(hip, goals)
    targets = positions[:, LEG_FEET].astype(float)
    targets[:, side] = ankle + weights[:, None] * (goals - ankle)
    feet = world[:, LEG_FEET].astype(float)
    heading = _heading(rotations.yaw_of(feet[:, side]), weights) if flat is None else flat
    flat = np.broadcast_to(heading, feet[:, side].shape)
    feet[:, side] = rotations.slerp(feet[:, side], flat, weights)
    solved = solve_legs(frames.hips, frames.local, targets, feet)
    toe = LEG_TOES[side]
    held = weights[:, None, None] > 0.0
    frames.local[:] = np.where(held, solved, frames.local)
    straight = np.broadcast_to(rotations.identity(), frames.local[:, toe].shape)
    frames.local[:, toe] = rotations.slerp(frames.local[:, toe], straight, weights)
    chances = frames.contacts[:, 2 * side : 2 * side + 2]
    frames.contacts[:, 2 * side : 2 * side + 2] = np.where(weights[:, None] > 0.99, 1.0, chances)


def drop_to(hip: Array, ankle: Array) -> Array:
    """Return how far (metres, `(T,)`, at most `MAX_DROP_M`) the hips sink so that a leg from `hip` to `ankle` `(T, 3)` stays bent."""
    across = np.sum((ankle - hip)[:, [0, 2]] ** 2, axis=-1)
    high = np.sqrt(np.maximum((EASY_LEG_FRACTION * LEG_M) ** 2 - across, (0.5 * LEG_M) ** 2))
    drop = np.asarray(_smooth_positive(hip[:, 1] - ankle[:, 1] - high, 0.005))
    return np.minimum(drop, MAX_DROP_M)


def _smooth_positive(value: Array, width: float) -> Array:
    """The positive part, smoothed at zero."""
    return 0.5 * (value + np.sqrt(value * value + width * width))


def _soft_arm(distance: Array, now: Array) -> Array:
    """Return how far an arm extended to `now` `(T, 3)` reaches towards a goal: near straight it extends with falling speed."""
    easy, room = EASY_ARM_FRACTION * ARM_M, (MAX_ARM_FRACTION - EASY_ARM_FRACTION) * ARM_M
    over = np.maximum(distance - easy, 0.0)
    soft = np.where(over > 0.0, easy + room * (1.0 - np.exp(-over / room)), distance)
    return np.maximum(soft, np.minimum(distance, np.linalg.norm(now, axis=-1)))


def _turn(frames: _Frames, world: Array, chain: Sequence[tuple[int, float]], turn: Array) -> None:
    """Rotate the joints of a chain by their fractions of world rotation vectors `(T, 3)`, each with its descendants."""
    angle, axis = np.linalg.norm(turn, axis=-1), rotations.normalize(turn)
    turned, total = world[:, SPORT_SKELETON.parents[chain[0][0]]], 0.0
    for joint, fraction in chain:
        total += fraction
        now = rotations.multiply(rotations.from_axis_angle(axis, total * angle), world[:, joint])
        made = _relative(turned, now)
        frames.local[:, joint] = np.where(angle[:, None] > 0.0, made, frames.local[:, joint])
        turned = now


def _falls(value: Array, begins: float, ends: float) -> Array:
    """1 up to `begins`, easing to 0 at `ends`."""
    return 1.0 - smoothstep((value - begins) / (ends - begins))


def _relative(parent: Array, world: Array) -> Array:
    return rotations.normalize(rotations.multiply(rotations.inverse(parent), world))
