"""Parametric edits of a motion: held hands, leans, turns, crouches, steps; the feet are kept by inverse kinematics."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime import rotations
from runtime.arrays import Array
from runtime.feet import ik
from runtime.motion import features
from runtime.motion.features import FPS
from runtime.skeleton import ANKLE_HEIGHT, PART_JOINTS, SPORT_SKELETON, TOE_HEIGHT
from runtime.terrain.height_map import Terrain
from training.augmentation.catalogue import PartEdit
from training.augmentation.steps import bumps, held_in_stance, step_phase, swing_share
from training.frames import smooth

_REACH = 0.998  # of a leg, before the hips give way: seven degrees of the knee
_AT = SPORT_SKELETON.index
SIDES = {"left": (0, 1.0), "right": (1, -1.0)}  # column of contacts pairs and sign of X
_FRAME_JOINT = {"hips": "Hips", "chest": "Spine1", "head": "Head"}
_UPPER = (*PART_JOINTS["left_arm"], *PART_JOINTS["right_arm"], *PART_JOINTS["head"])
CHAIN = {0: 0.4, 11: 0.6, 12: 0.8, 13: 1.0}  # share of a lean taken by hips, lower back, spine, chest
SPINE_ONLY = {11: 0.25, 12: 0.6, 13: 1.0}
_ROUNDED = {11: -0.35, 12: 0.25, 13: 1.0}
_NECK = {14: 0.35, 15: 0.7, 16: 1.0}
ARM_FOLLOWS, HEAD_FOLLOWS = 0.35, 0.3  # arms keep hanging and eyes keep looking ahead when a torso leans


@dataclass(frozen=True)
class EditedMotion:
    """A motion being edited: hips `(T, 3)`, local rotations `(T, 31, 4)`, contacts `(T, 4)`, and its ground."""

    hips: Array
    local: Array
    contacts: NDArray[np.uint8]
    ground: Terrain
    gait: Array | None = None  # (T, 6) soft labels, where they are known

    @property
    def facing(self) -> Array:
        """Smoothed yaw `(T,)`."""
        positions, _ = SPORT_SKELETON.forward_kinematics(self.hips, self.local)
        return smooth(np.unwrap(features.facing_yaw(positions))[:, None], 12.0)[:, 0]

    def step_phase(self) -> Array:
        """Cycles `(T,)`: whole numbers where the left foot lands; a slow clock where it does not step."""
        return step_phase(self.contacts)


def cut(motion: EditedMotion, start: int, end: int) -> EditedMotion:
    """Frames `start` to `end` of a motion."""
    piece = slice(start, end)
    return replace(
        motion,
        hips=motion.hips[piece],
        local=motion.local[piece],
        contacts=motion.contacts[piece],
        gait=None if motion.gait is None else motion.gait[piece],
    )


# --- Torso and head ---------------------------------------------------------------------------------------------------


def turns(motion: EditedMotion, pitch: Array | float, yaw: Array | float, roll: Array | float) -> Array:
    """Axis-angle vectors `(T, 3)` in world space of turns in the facing frame, degrees; roll is towards the left."""
    zero = np.zeros(len(motion.hips))
    local = np.radians(np.stack([zero + pitch, zero + yaw, zero - roll], 1))
    return rotations.rotate(rotations.from_yaw(motion.facing), local)


def _scaled(vectors: Array, share: float) -> Array:
    angle = np.linalg.norm(vectors, axis=-1)
    axis = np.where(angle[:, None] > 1e-9, vectors / np.maximum(angle, 1e-9)[:, None], np.array([1.0, 0, 0]))
    return rotations.from_axis_angle(axis, share * angle)


def turn_joints(
    motion: EditedMotion, vectors: Array, shares: dict[int, float], ankles: Array | None = None
) -> EditedMotion:
    """Every joint of `shares` turned in world space by its share; joints not named keep their world rotation.

    When the hips turn, the ankles stay where they are, or go to `ankles` `(T, 2, 3)`.
    """
    _, world = SPORT_SKELETON.forward_kinematics(motion.hips, motion.local.astype(np.float64))
    positions, _ = SPORT_SKELETON.forward_kinematics(motion.hips, motion.local.astype(np.float64))
    turned = world.copy()
    if 0 in shares:  # the sockets of the thighs turn with the pelvis
        shares = shares | dict.fromkeys((int(j) for j in ik.LEG_HIP_JOINTS), shares[0])
    for joint, share in shares.items():
        turned[:, joint] = rotations.multiply(_scaled(vectors, share), world[:, joint])
    local = SPORT_SKELETON.local_rotations(turned)
    if 0 not in shares:
        return replace(motion, local=local)
    # the hips turned: the legs reach for their old feet
    ankles, feet = positions[:, ik.LEG_FEET] if ankles is None else ankles, world[:, ik.LEG_FEET]
    hips = within_reach(motion.hips, turned[:, 0], ankles)
    return replace(motion, hips=hips, local=ik.solve_legs(hips, local, ankles, feet))


def within_reach(hips: Array, hips_rotation: Array, ankles: Array) -> Array:
    """Hips `(T, 3)` lowered, smoothly, where a leg would be too short for its ankle `(T, 2, 3)`."""
    offsets = SPORT_SKELETON.offsets[ik.LEG_THIGHS].astype(np.float64)
    thighs = hips[:, None] + rotations.rotate(hips_rotation[:, None], offsets)
    to_ankle = thighs - ankles
    reach = _REACH * sum(np.linalg.norm(SPORT_SKELETON.offsets[j[0]]) for j in (ik.LEG_SHINS, ik.LEG_FEET))
    across = np.linalg.norm(to_ankle[..., [0, 2]], axis=-1)
    height = np.sqrt(np.maximum(reach**2 - across**2, 0.3**2))
    drop = np.maximum(to_ankle[..., 1] - height, 0.0).max(1)
    padded = np.pad(drop, 2, mode="edge")
    highest = np.lib.stride_tricks.sliding_window_view(padded, 5).max(-1)
    return hips - smooth(highest[:, None], 2.0) * np.array([0.0, 1.0, 0.0])


def lean_shares(chain: dict[int, float], arms: float, head: float) -> dict[int, float]:
    """Shares of a turn for the joints of `chain`, all of both arms, and neck and head."""
    shares = dict(chain)
    shares |= dict.fromkeys((*PART_JOINTS["left_arm"], *PART_JOINTS["right_arm"]), arms)
    return shares | dict.fromkeys(PART_JOINTS["head"], head)


def _lean(motion: EditedMotion, edit: PartEdit, random: np.random.Generator) -> EditedMotion:
    pitch, roll = float(edit.parameters.get("pitch", 0.0)), float(edit.parameters.get("roll", 0.0))
    amount = random.normal(1.0, 0.06)
    vectors = turns(motion, amount * pitch, 0.0, amount * roll)
    hips = motion.hips.copy()
    back = -0.13 * np.sin(np.radians(amount * pitch))  # the hips balance the upper body
    side = -0.12 * np.sin(np.radians(amount * roll))
    hips += rotations.rotate(rotations.from_yaw(motion.facing), np.array([side, 0.0, back]))
    ankles = SPORT_SKELETON.forward_kinematics(motion.hips, motion.local)[0][:, ik.LEG_FEET]
    shares = lean_shares(CHAIN, ARM_FOLLOWS, HEAD_FOLLOWS)
    return turn_joints(replace(motion, hips=hips), vectors, shares, ankles)


def _slump(motion: EditedMotion, edit: PartEdit, random: np.random.Generator) -> EditedMotion:
    pitch = float(edit.parameters["pitch"]) * random.normal(1.0, 0.06)
    shares = lean_shares(_ROUNDED, ARM_FOLLOWS, HEAD_FOLLOWS)
    return turn_joints(motion, turns(motion, pitch, 0.0, 0.0), shares)


def _sway(motion: EditedMotion, edit: PartEdit, random: np.random.Generator) -> EditedMotion:
    roll = float(edit.parameters["roll"]) * random.normal(1.0, 0.08)
    swing = roll * np.sin(2 * np.pi * (motion.step_phase() + 0.05))
    return turn_joints(motion, turns(motion, 0.0, 0.0, swing), lean_shares(CHAIN, 0.6, 0.4))


def _twist(motion: EditedMotion, edit: PartEdit, random: np.random.Generator) -> EditedMotion:
    yaw = float(edit.parameters["yaw"]) * random.normal(1.0, 0.08)
    swing = yaw * np.cos(2 * np.pi * motion.step_phase())
    return turn_joints(motion, turns(motion, 0.0, -swing, 0.0), lean_shares(SPINE_ONLY, 1.0, 0.15))


def _bounce(motion: EditedMotion, edit: PartEdit, random: np.random.Generator) -> EditedMotion:
    height = float(edit.parameters["height"]) * random.normal(1.0, 0.08)
    drop = 0.5 * height * (1.0 - np.cos(4 * np.pi * (motion.step_phase() - 0.04)))
    return _lowered(motion, drop)


def _head(motion: EditedMotion, edit: PartEdit, random: np.random.Generator) -> EditedMotion:
    p: dict[str, Any] = edit.parameters
    amount = random.normal(1.0, 0.07)
    pitch, yaw, roll = (amount * float(p.get(k, 0.0)) for k in ("pitch", "yaw", "roll"))
    if "wave" in p:
        wp, wy, wr, rate = p["wave"]
        clock = _beat(motion, rate, random)
        pitch, yaw, roll = pitch + amount * wp * clock, yaw + amount * wy * clock, roll + amount * wr * clock
    return turn_joints(motion, turns(motion, pitch, yaw, roll), _NECK)


# --- Arms -------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Arm:
    """The joints of one arm, and the mirror of points that are given for the left one."""

    collar: int
    shoulder: int
    elbow: int
    hand: int
    mirror: Array

    @staticmethod
    def of(slot: str) -> _Arm:
        side = slot.removesuffix("_arm")
        collar, shoulder, elbow, hand = (
            _AT(side.capitalize() + name) for name in ("Shoulder", "Arm", "ForeArm", "Hand")
        )
        return _Arm(collar, shoulder, elbow, hand, np.array([SIDES[side][1], 1.0, 1.0]))


def _hand(motion: EditedMotion, edit: PartEdit, random: np.random.Generator) -> EditedMotion:
    p: dict[str, Any] = edit.parameters
    arm = _Arm.of(edit.slot)
    positions, world = SPORT_SKELETON.forward_kinematics(motion.hips, motion.local.astype(np.float64))
    facing = rotations.from_yaw(motion.facing)
    length = len(motion.hips)
    point = np.broadcast_to(np.array(p["point"]), (length, 3)) + random.normal(0.0, 0.015, 3)
    point = point + 0.008 * _drift(length, random)
    if "wave" in p:
        *amplitude, rate = p["wave"]
        clock = _beat(motion, rate, random)
        point = point + clock[:, None] * np.array(amplitude) * random.normal(1.0, 0.08)
    at_shoulder = p["frame"] == "shoulder"
    joint = arm.shoulder if at_shoulder else _AT(_FRAME_JOINT[p["frame"]])
    axes = facing if at_shoulder else world[:, joint]
    target = positions[:, joint] + rotations.rotate(axes, point * arm.mirror)
    body = facing if at_shoulder else world[:, _AT("Spine1")]
    pole = rotations.rotate(body, np.broadcast_to(np.array(p["pole"]) * arm.mirror, (length, 3)))
    upper, lower = _reaching(arm, positions, world, target, pole)
    local = motion.local.astype(np.float64).copy()
    local[:, arm.shoulder] = rotations.multiply(rotations.inverse(world[:, arm.collar]), upper)
    local[:, arm.elbow] = rotations.multiply(rotations.inverse(upper), lower)
    local[:, arm.hand] = rotations.slerp(local[:, arm.hand], rotations.identity((length,)), 0.7)
    return replace(motion, local=local)


def _reaching(arm: _Arm, positions: Array, world: Array, target: Array, pole: Array) -> tuple[Array, Array]:
    """World rotations `(T, 4)` of upper arm and forearm that bring the hand to `target`, the elbow towards `pole`.

    The elbow is first bent by hand towards the pole: the solver then keeps that bending plane.
    """
    shoulder = positions[:, arm.shoulder]
    middle = shoulder + 0.5 * (target - shoulder)
    upper = np.linalg.norm(SPORT_SKELETON.offsets[arm.elbow])
    lower = np.linalg.norm(SPORT_SKELETON.offsets[arm.hand])
    elbow = shoulder + upper * rotations.normalize(middle + 0.3 * rotations.normalize(pole) - shoulder)
    hand = elbow + lower * rotations.normalize(target - elbow)
    arm_turn = rotations.between(
        rotations.normalize(positions[:, arm.elbow] - shoulder), rotations.normalize(elbow - shoulder)
    )
    first_upper = rotations.multiply(arm_turn, world[:, arm.shoulder])
    along = rotations.rotate(first_upper, np.array([1.0, 0.0, 0.0]) * arm.mirror)
    fore_turn = rotations.between(along, rotations.normalize(hand - elbow))
    first_lower = rotations.multiply(fore_turn, first_upper)
    upper_turn, lower_turn = ik.two_bone(shoulder, elbow, hand, target)
    return rotations.multiply(upper_turn, first_upper), rotations.multiply(lower_turn, first_lower)


def _beat(motion: EditedMotion, rate: float, random: np.random.Generator) -> Array:
    """Oscillation `(T,)` of `rate` cycles per stride, in step but for a little lag."""
    size = random.normal(1.0, 0.06)
    return size * np.sin(2 * np.pi * (rate * motion.step_phase() + 0.08 * random.random()))


def _swing(motion: EditedMotion, edit: PartEdit, random: np.random.Generator) -> EditedMotion:
    scale = float(edit.parameters["scale"]) * random.normal(1.0, 0.05)
    name = edit.slot.removesuffix("_arm").capitalize()
    local = motion.local.astype(np.float64).copy()
    for joint in (_AT(f"{name}Arm"), _AT(f"{name}ForeArm")):
        own = rotations.continuous(local[:, joint])
        mean = rotations.normalize(smooth(own, 45.0))
        away = rotations.multiply(rotations.inverse(mean), own)
        away *= np.where(away[:, :1] < 0, -1.0, 1.0)
        angle = 2.0 * np.arctan2(np.linalg.norm(away[:, 1:], axis=1), away[:, 0])
        axis = rotations.normalize(away[:, 1:])
        local[:, joint] = rotations.multiply(
            mean, rotations.from_axis_angle(axis, np.clip(scale * angle, 0, 1.5))
        )
    return replace(motion, local=local)


def _drift(length: int, random: np.random.Generator) -> Array:
    """Slow unit noise `(T, 3)`: a held hand never stands perfectly still."""
    time = np.arange(length)[:, None] / FPS
    drift = np.zeros((length, 3))
    for _ in range(2):
        drift += np.sin(2 * np.pi * (random.uniform(0.1, 0.7, 3) * time + random.random(3)))
    return drift


# --- Legs -------------------------------------------------------------------------------------------------------------


def keep_feet(moved: EditedMotion, original: EditedMotion) -> Array:
    """Local rotations with the moved hips and the original's feet."""
    positions, world = SPORT_SKELETON.forward_kinematics(original.hips, original.local.astype(np.float64))
    return ik.solve_legs(moved.hips, moved.local, positions[:, ik.LEG_FEET], world[:, ik.LEG_FEET])


def _lowered(motion: EditedMotion, drop: Array | float) -> EditedMotion:
    hips = motion.hips.astype(np.float64).copy()
    hips[:, 1] -= drop
    moved = replace(motion, hips=hips)
    return replace(moved, local=keep_feet(moved, motion))


def _leg(motion: EditedMotion, edit: PartEdit, random: np.random.Generator) -> EditedMotion:
    p: dict[str, Any] = edit.parameters
    column, sign = SIDES[edit.slot.removesuffix("_leg")]
    return _legs_edit(motion, {k: v * random.normal(1.0, 0.07) for k, v in p.items()}, ((column, sign),))


def _legs(motion: EditedMotion, edit: PartEdit, random: np.random.Generator) -> EditedMotion:
    p: dict[str, Any] = edit.parameters
    both = tuple(SIDES.values())
    return _legs_edit(motion, {k: v * random.normal(1.0, 0.07) for k, v in p.items()}, both)


def _legs_edit(
    motion: EditedMotion, p: dict[str, float], sides: tuple[tuple[int, float], ...]
) -> EditedMotion:
    if "lower" in p:
        return _lowered(motion, p["lower"])
    positions, world = SPORT_SKELETON.forward_kinematics(motion.hips, motion.local.astype(np.float64))
    ankles, feet = positions[:, ik.LEG_FEET].copy(), world[:, ik.LEG_FEET].copy()
    toes = positions[:, ik.LEG_TOES]
    hips = motion.hips.astype(np.float64).copy()
    facing = rotations.from_yaw(motion.facing)
    for column, sign in sides:
        down = np.asarray(motion.contacts[:, 2 * column : 2 * column + 2].any(1))
        ankle, foot = ankles[:, column], feet[:, column]
        if "lift" in p:
            ankle[:, 1] += p["lift"] * bumps(down)
        if "drag" in p:
            _drag(ankle, foot, toes[:, column], p["drag"] * swing_share(down), motion.ground)
        if "outward" in p:
            offset = rotations.rotate(facing, np.array([sign * p["outward"], 0.0, 0.0]))
            offset = held_in_stance(offset, down)
            before = motion.ground.height(ankle[:, 0], ankle[:, 2])
            ankle += offset
            ankle[:, 1] += motion.ground.height(ankle[:, 0], ankle[:, 2]) - before
        if "toe_out" in p:
            feet[:, column] = rotations.multiply(rotations.from_yaw(np.radians(sign * p["toe_out"])), foot)
        if "tiptoe" in p:
            axis = rotations.rotate(foot, np.array([1.0, 0.0, 0.0]))
            turn = rotations.from_axis_angle(axis, np.full(len(axis), np.radians(p["tiptoe"])))
            toe = toes[:, column]
            ankles[:, column] = toe + rotations.rotate(turn, ankle - toe)
            feet[:, column] = rotations.multiply(turn, foot)
    contacts = motion.contacts.copy()
    if "tiptoe" in p:
        hips[:, 1] += 0.055
        contacts[:, [2 * c for c, _ in sides]] = 0
    local = ik.solve_legs(hips, motion.local, ankles, feet)
    return replace(motion, hips=hips, local=local, contacts=contacts)


def _drag(ankle: Array, foot: Array, toe: Array, share: Array, ground: Terrain) -> None:
    """Lay the foot flat and lower it to the ground by `share` `(T,)` of what it is away from both, in place.

    `ankle` and `toe` are positions `(T, 3)`, `foot` its rotations `(T, 4)`.
    """
    share = np.clip(share, 0.0, 1.0)
    toe_ground = ground.height(toe[:, 0], toe[:, 2])
    ankle_ground = ground.height(ankle[:, 0], ankle[:, 2])
    apart = np.maximum(np.linalg.norm((toe - ankle)[:, [0, 2]], axis=1), 0.05)
    slope = np.arctan2(ankle_ground - toe_ground, apart)
    ahead = rotations.rotate(foot, np.array([0.0, 0.0, 1.0]))
    pitch = np.arcsin(np.clip(-ahead[:, 1], -1, 1)) - slope  # positive: the heel is up
    turn = rotations.from_axis_angle(rotations.rotate(foot, np.array([1.0, 0.0, 0.0])), -share * pitch)
    to_toe = rotations.rotate(turn, toe - ankle)
    ankle[:] = np.where(pitch[:, None] > 0, toe - to_toe, ankle)  # about whichever is lower, toe or heel
    foot[:] = rotations.multiply(turn, foot)
    lowest = ankle + to_toe
    room = np.minimum(
        lowest[:, 1] - ground.height(lowest[:, 0], lowest[:, 2]) - TOE_HEIGHT,
        ankle[:, 1] - ground.height(ankle[:, 0], ankle[:, 2]) - ANKLE_HEIGHT,
    )
    ankle[:, 1] -= share * np.maximum(room, 0.0)


KINDS: dict[str, Callable[[EditedMotion, PartEdit, np.random.Generator], EditedMotion]] = {
    "lean": _lean,
    "slump": _slump,
    "sway": _sway,
    "twist": _twist,
    "bounce": _bounce,
    "head": _head,
    "hand": _hand,
    "swing": _swing,
    "leg": _leg,
    "legs": _legs,
}
