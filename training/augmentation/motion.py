"""A motion being edited, and what edits are made of: turned joints, feet kept by inverse kinematics, a changed path or pace.

Planted feet stay planted by construction: every foot is carried by what the root's path changed where it passes the
foot, and that is held through a stance.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime import rotations
from runtime.arrays import Array
from runtime.feet import ik
from runtime.motion import features
from runtime.skeleton import ANKLE_HEIGHT, SPORT_SKELETON, TOE_HEIGHT
from runtime.terrain.height_map import Terrain
from training.augmentation.gait import cycle_frames, cycle_mean, held_in_stance, step_phase
from training.frames import extrapolate, smooth

UP = np.array([0.0, 1.0, 0.0])
LEFT = np.array([1.0, 0.0, 0.0])
SIDES = {"left": (0, 1.0), "right": (1, -1.0)}  # column of contacts pairs and sign of X
AHEAD = np.array([0.0, 0.0, 1.0])
LEVEL = np.array([1.0, 0.0, 1.0])
THIGHS = SPORT_SKELETON.offsets[ik.LEG_THIGHS].astype(np.float64)
_BONES = [np.linalg.norm(SPORT_SKELETON.offsets[joints[0]]) for joints in (ik.LEG_SHINS, ik.LEG_FEET)]
_REACH_M = 0.998 * sum(_BONES)  # of a leg, before the hips give way: seven degrees of the knee
_RAISED_REACH_M = 0.985 * sum(map(float, _BONES))  # of a leg, before the heel behind rises
_WINDOW = 75  # frames before and after in which the path passes a foot
_HEEL = np.radians(np.arange(0.0, 41.0, 5.0))  # by which a heel rises behind to let a stride be longer


@dataclass(frozen=True)
class CycleAxes:
    """The direction that a body faces over a cycle: rotations `(T, 4)`, and its horizontal unit vectors `(T, 3)`."""

    facing: Array
    left: Array
    ahead: Array


@dataclass(frozen=True)
class EditedMotion:
    """A motion being edited: hips `(T, 3)`, local rotations `(T, 31, 4)` in double precision, contacts `(T, 4)`, ground."""

    hips: Array
    local: Array
    contacts: NDArray[np.uint8]
    ground: Terrain
    gait: Array | None = None  # (T, 6) soft labels, where they are known

    @cached_property
    def joints(self) -> tuple[Array, Array]:
        """World positions `(T, 31, 3)` and rotations `(T, 31, 4)`; not to be changed."""
        return SPORT_SKELETON.forward_kinematics(self.hips, self.local)

    @cached_property
    def facing(self) -> Array:
        """Rotations `(T, 4)` by the smoothed yaw."""
        yaw = np.unwrap(features.facing_yaw(self.joints[0]))
        return rotations.from_yaw(smooth(yaw[:, None], 12.0)[:, 0])

    @cached_property
    def step_phase(self) -> Array:
        """Cycles `(T,)`: whole numbers where the left foot lands; a slow clock where it does not step."""
        return step_phase(self.contacts)

    def cycle_mean(self, values: Array) -> Array:
        """Mean `(T, n)` of values `(T, n)` over a gait cycle."""
        return cycle_mean(values, cycle_frames(self.contacts))

    @cached_property
    def path(self) -> Array:
        """Mean `(T, 3)` of the hips over a gait cycle."""
        return self.cycle_mean(self.hips)

    @cached_property
    def axes(self) -> CycleAxes:
        """The facing direction over a gait cycle."""
        yaw = np.unwrap(features.facing_yaw(self.joints[0]))
        facing = rotations.from_yaw(self.cycle_mean(yaw[:, None])[:, 0])
        return CycleAxes(facing, rotations.rotate(facing, LEFT), rotations.rotate(facing, AHEAD))

    def stands(self, column: int) -> NDArray[np.bool_]:
        """Frames `(T,)` in which a foot (0 left, 1 right) stands."""
        return np.asarray(self.contacts[:, 2 * column : 2 * column + 2].any(1))

    def feet(self) -> tuple[Array, Array, Array]:
        """Copies of ankles `(T, 2, 3)`, toes `(T, 2, 3)` and rotations of the feet `(T, 2, 4)` in world space."""
        positions, world = self.joints
        return positions[:, ik.LEG_FEET], positions[:, ik.LEG_TOES], world[:, ik.LEG_FEET]

    def hips_turn(self) -> Array:
        """How far the hips are turned from their mean of a cycle: rotation vectors `(T, 3)` in the facing direction.

        They are pitch, yaw and roll to the right, radians.
        """
        own = rotations.multiply(rotations.inverse(self.axes.facing), self.local[:, 0])
        own = rotations.continuous(own)
        mean = rotations.normalize(self.cycle_mean(own))
        away = rotations.multiply(own, rotations.inverse(mean))
        away = away * np.where(away[:, :1] < 0, -1.0, 1.0)
        size = np.linalg.norm(away[:, 1:], axis=1)
        angle = 2.0 * np.arctan2(size, away[:, 0])
        return away[:, 1:] * (angle / np.maximum(size, 1e-9))[:, None]


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


@dataclass(frozen=True)
class Edit:
    """An edit by its numbers: `parameters` are those of `kind`, the slot one of left_arm, right_leg, torso, head, legs, ..."""

    slot: str
    kind: str
    parameters: dict[str, Any]

    @property
    def sides(self) -> list[tuple[int, float]]:
        """Column of contacts pairs and sign of X of each side that it is of."""
        return [side for name, side in SIDES.items() if self.slot == "legs" or self.slot.startswith(name)]

    def size(self, name: str) -> float:
        """A size, 0 where it has none."""
        return float(self.parameters.get(name, 0.0))

    def amount(self, name: str, random: np.random.Generator, deviation: float) -> float:
        """The same, a little varied."""
        return self.size(name) * random.normal(1.0, deviation)

    def factor(self, name: str, random: np.random.Generator, deviation: float = 0.04) -> float:
        """A factor or size, 1 where it has none, a little varied; exactly 1 stays as it is."""
        value = float(self.parameters.get(name, 1.0))
        return value if value == 1.0 else value * float(np.exp(deviation * random.normal()))


# --- Joints and feet --------------------------------------------------------------------------------------------------


def turns(motion: EditedMotion, pitch: Array | float, yaw: Array | float, roll: Array | float) -> Array:
    """Rotation vectors `(T, 3)` in world space of turns in the facing frame, degrees; roll is towards the left."""
    zero = np.zeros(len(motion.hips))
    local = np.radians(np.stack([zero + pitch, zero + yaw, zero - roll], 1))
    return rotations.rotate(motion.facing, local)


def turn_joints(
    motion: EditedMotion, vectors: Array, fractions: dict[int, float], ankles: Array | None = None
) -> EditedMotion:
    """Every joint of `fractions` turned in world space by its fraction; joints not named keep their world rotation.

    When the hips turn, the ankles stay where they are, or go to `ankles` `(T, 2, 3)`.
    """
    world = motion.joints[1]
    turned = world.copy()
    if 0 in fractions:  # the sockets of the thighs turn with the pelvis
        fractions = fractions | dict.fromkeys((int(j) for j in ik.LEG_HIP_JOINTS), fractions[0])
    angle = np.linalg.norm(vectors, axis=-1)
    axis = np.where(angle[:, None] > 1e-9, vectors / np.maximum(angle, 1e-9)[:, None], LEFT)
    for joint, fraction in fractions.items():
        turn = rotations.from_axis_angle(axis, fraction * angle)
        turned[:, joint] = rotations.multiply(turn, world[:, joint])
    local = SPORT_SKELETON.local_rotations(turned)
    if 0 not in fractions:
        return replace(motion, local=local)
    # the hips turned: the legs reach for their old feet
    old_ankles, _, feet = motion.feet()
    return with_feet(
        replace(motion, local=local), motion.hips, old_ankles if ankles is None else ankles, feet
    )


def with_feet(motion: EditedMotion, hips: Array, ankles: Array, feet: Array) -> EditedMotion:
    """The motion with other hips `(T, 3)`, its ankles at `ankles` `(T, 2, 3)` with rotations `feet` `(T, 2, 4)`.

    The hips sink, smoothly, where a leg would be too short.
    """
    thighs = hips[:, None] + rotations.rotate(motion.local[:, :1], THIGHS)
    to_ankle = thighs - ankles
    across = np.linalg.norm(to_ankle[..., [0, 2]], axis=-1)
    height = np.sqrt(np.maximum(_REACH_M**2 - across**2, 0.3**2))
    drop = np.maximum(to_ankle[..., 1] - height, 0.0).max(1)
    hips = hips - smooth(_most_of(drop, 5)[:, None], 2.0) * UP
    return replace(motion, hips=hips, local=ik.solve_legs(hips, motion.local, ankles, feet))


def raised(motion: EditedMotion, rise: Array) -> EditedMotion:
    """The motion with its hips raised by metres `(T,)` over feet that stay; they rise no higher than legs reach."""
    ankles, _, feet = motion.feet()
    return with_feet(motion, motion.hips + rise[:, None] * UP, ankles, feet)


def lowered(motion: EditedMotion, drop: Array | float) -> EditedMotion:
    """The motion with its hips lowered by metres over feet that stay."""
    hips = motion.hips.copy()
    hips[:, 1] -= drop
    moved = replace(motion, hips=hips)
    return replace(moved, local=keep_feet(moved, motion))


def keep_feet(moved: EditedMotion, original: EditedMotion) -> Array:
    """Local rotations with the moved hips and the original's feet."""
    ankles, _, feet = original.feet()
    return ik.solve_legs(moved.hips, moved.local, ankles, feet)


def reaching(
    motion: EditedMotion, arm: tuple[int, int, int], target: Array, pole: Array, along: Array
) -> tuple[Array, Array]:
    """World rotations `(T, 4)` of upper arm and forearm that bring the hand to `target`, the elbow towards `pole`.

    `arm` are the joints shoulder, elbow and hand, `along` is the direction of its bones at rest. The elbow is first bent
    by hand towards the pole: the solver then keeps that bending plane.
    """
    positions, world = motion.joints
    shoulder = positions[:, arm[0]]
    middle = shoulder + 0.5 * (target - shoulder)
    upper, lower = (np.linalg.norm(SPORT_SKELETON.offsets[joint]) for joint in arm[1:])
    elbow = shoulder + upper * rotations.normalize(middle + 0.3 * rotations.normalize(pole) - shoulder)
    hand = elbow + lower * rotations.normalize(target - elbow)
    arm_turn = rotations.between(
        rotations.normalize(positions[:, arm[1]] - shoulder), rotations.normalize(elbow - shoulder)
    )
    first_upper = rotations.multiply(arm_turn, world[:, arm[0]])
    fore_turn = rotations.between(rotations.rotate(first_upper, along), rotations.normalize(hand - elbow))
    first_lower = rotations.multiply(fore_turn, first_upper)
    upper_turn, lower_turn = ik.two_bone(shoulder, elbow, hand, target)
    return rotations.multiply(upper_turn, first_upper), rotations.multiply(lower_turn, first_lower)


def drag_foot(ankle: Array, foot: Array, toe: Array, fraction: Array, ground: Terrain) -> None:
    """Lay the foot flat and lower it to the ground by `fraction` `(T,)` of what it is away from both, in place.

    `ankle` and `toe` are positions `(T, 3)`, `foot` its rotations `(T, 4)`.
    """
    fraction = np.clip(fraction, 0.0, 1.0)
    toe_ground = ground.height(toe[:, 0], toe[:, 2])
    ankle_ground = ground.height(ankle[:, 0], ankle[:, 2])
    apart = np.maximum(np.linalg.norm((toe - ankle)[:, [0, 2]], axis=1), 0.05)
    slope = np.arctan2(ankle_ground - toe_ground, apart)
    ahead = rotations.rotate(foot, AHEAD)
    pitch = np.arcsin(np.clip(-ahead[:, 1], -1, 1)) - slope  # positive: the heel is up
    turn = rotations.from_axis_angle(rotations.rotate(foot, LEFT), -fraction * pitch)
    to_toe = rotations.rotate(turn, toe - ankle)
    ankle[:] = np.where(pitch[:, None] > 0, toe - to_toe, ankle)  # about whichever is lower, toe or heel
    foot[:] = rotations.multiply(turn, foot)
    lowest = ankle + to_toe
    room = np.minimum(
        lowest[:, 1] - ground.height(lowest[:, 0], lowest[:, 2]) - TOE_HEIGHT,
        ankle[:, 1] - ground.height(ankle[:, 0], ankle[:, 2]) - ANKLE_HEIGHT,
    )
    ankle[:, 1] -= fraction * np.maximum(room, 0.0)


# --- Path and time ----------------------------------------------------------------------------------------------------


def on_path(motion: EditedMotion, moved: Array, extra: Array | None = None) -> EditedMotion:
    """The motion with its root moved by `moved` `(T, 3)`, and every foot by what the root moves where it passes it.

    `extra` `(T, 2, 3)` is added to the feet. Both are held in stance.
    """
    ankles, toes, feet = motion.feet()
    path, carried = extrapolate(motion.path, _WINDOW), extrapolate(moved, _WINDOW)
    for column in range(2):
        at = _passed(path, ankles[:, column])
        offset = carried[at] + (0.0 if extra is None else extra[:, column])
        offset = held_in_stance(offset * LEVEL, motion.stands(column))
        ankles[:, column] += offset
        toes[:, column] += offset
    hips = motion.hips + moved
    contacts = motion.contacts.copy()
    for column in range(2):
        thigh = hips + rotations.rotate(motion.local[:, 0], THIGHS[column])
        behind = np.sum((ankles[:, column] - hips) * motion.axes.ahead, axis=1) < -0.05
        raised = _heel_angle(thigh, ankles[:, column], toes[:, column], feet[:, column], behind)
        ankles[:, column], feet[:, column] = raise_heel(
            ankles[:, column], toes[:, column], feet[:, column], raised
        )
        contacts[:, 2 * column] &= (raised < np.radians(6.0)).astype(np.uint8)
    return with_feet(replace(motion, contacts=contacts), hips, ankles, feet)


def raise_heel(ankle: Array, toe: Array, foot: Array, angle: Array) -> tuple[Array, Array]:
    """Ankle `(T, 3)` and rotation `(T, 4)` of a foot that is turned about its toe by `angle` `(T,)`."""
    turn = rotations.from_axis_angle(rotations.rotate(foot, LEFT), angle)
    return toe + rotations.rotate(turn, ankle - toe), rotations.multiply(turn, foot)


def _heel_angle(thigh: Array, ankle: Array, toe: Array, foot: Array, behind: NDArray[np.bool_]) -> Array:
    """Radians `(T,)` by which a heel `behind` rises about its toe, where the leg would be too short."""
    lengths = []
    for angle in _HEEL:
        raised, _ = raise_heel(ankle, toe, foot, np.full(len(ankle), angle))
        lengths.append(np.linalg.norm(raised - thigh, axis=1))
    enough = np.array(lengths) <= _RAISED_REACH_M
    first = np.where(enough.any(0), enough.argmax(0), len(_HEEL) - 1)
    wanted = np.where(behind, _HEEL[first], 0.0)
    return smooth(_most_of(wanted, 7)[:, None], 3.0)[:, 0]


def scaled_path(motion: EditedMotion, factor: Array | float) -> Array:
    """What a root moves `(T, 3)` that goes `factor` `(T,)` times as far; its sideways curve about the path stays."""
    path, ahead = motion.path, motion.axes.ahead
    own = (motion.hips - path) * LEVEL
    along = np.sum(own * ahead, axis=1)[:, None] * ahead  # the curve along the path scales with it
    step = np.diff(path + along, axis=0, prepend=(path + along)[:1]) * LEVEL
    return np.cumsum((np.zeros(len(path)) + factor - 1.0)[:, None] * step, axis=0)


def _passed(path: Array, foot: Array) -> NDArray[np.intp]:
    """Index into the extended path `(T + 2 W, 3)` of the place where it passes each `foot` `(T, 3)`."""
    windows = np.arange(len(foot))[:, None] + np.arange(2 * _WINDOW + 1)
    away = (path[windows] - foot[:, None])[..., [0, 2]]
    distance = np.sum(away**2, axis=-1) + 1e-7 * (np.arange(2 * _WINDOW + 1) - _WINDOW) ** 2
    return np.arange(len(foot)) + np.argmin(distance, axis=1)


def at_rate(motion: EditedMotion, rate: Array) -> EditedMotion:
    """The motion played at `rate` `(T,)` times its speed: contacts and gait go with their frames."""
    clock = np.concatenate([[0.0], np.cumsum(0.5 / rate[:-1] + 0.5 / rate[1:])])
    at = np.interp(np.arange(int(clock[-1]) + 1), clock, np.arange(len(rate)))
    low = np.minimum(np.floor(at).astype(int), len(rate) - 2)
    fraction = (at - low)[:, None]
    nearest = np.round(at).astype(int)
    hips, local = motion.hips, motion.local
    return replace(
        motion,
        hips=(1.0 - fraction) * hips[low] + fraction * hips[low + 1],
        local=rotations.continuous(rotations.slerp(local[low], local[low + 1], fraction)),
        contacts=motion.contacts[nearest],
        gait=None if motion.gait is None else motion.gait[nearest],
    )


def _most_of(values: Array, frames: int) -> Array:
    """Return for each of values `(T,)` the largest of so many `frames` around it."""
    padded = np.pad(values, frames // 2, "edge")
    return np.lib.stride_tricks.sliding_window_view(padded, frames).max(-1)
