"""A motion being edited, and the operations of edits: turning joints, foot IK, and changes of path and timing.

Planted feet stay planted by construction: each foot moves by the displacement of the root's path at the point where it
passes the foot, held constant through a stance.
"""

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
_REACH_M = 0.998 * sum(_BONES)  # of a leg (knee flexion 7 degrees); beyond, the hips sink
_RAISED_REACH_M = 0.985 * sum(map(float, _BONES))  # of a leg; beyond, the rear heel rises
_WINDOW = 75  # frames before and after, in which the path passes a foot
_HEEL = np.radians(np.arange(0.0, 41.0, 5.0))  # angles by which the rear heel may rise in a longer stride


@dataclass(frozen=True)
class CycleAxes:
    """Facing direction averaged over a gait cycle: rotations `(T, 4)` and horizontal unit vectors `(T, 3)`."""

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
    gait: Array | None = None  # (T, 6) soft labels, if known

    @cached_property
    def joints(self) -> tuple[Array, Array]:
        """World positions `(T, 31, 3)` and rotations `(T, 31, 4)`; do not modify them."""
        return SPORT_SKELETON.forward_kinematics(self.hips, self.local)

    @cached_property
    def facing(self) -> Array:
        """Rotations `(T, 4)` of the smoothed yaw."""
        yaw = np.unwrap(features.facing_yaw(self.joints[0]))
        return rotations.from_yaw(smooth(yaw[:, None], 12.0)[:, 0])

    @cached_property
    def step_phase(self) -> Array:
        """Gait cycles `(T,)`: integer where the left foot lands; a slow clock if there are no steps."""
        return step_phase(self.contacts)

    def cycle_mean(self, values: Array) -> Array:
        """Return the mean of values `(T, n)` over a gait cycle."""
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
        """Return the frames `(T,)` in which a foot (0 left, 1 right) stands."""
        return np.asarray(self.contacts[:, 2 * column : 2 * column + 2].any(1))

    def feet(self) -> tuple[Array, Array, Array]:
        """Return copies of ankles `(T, 2, 3)`, toes `(T, 2, 3)` and rotations of the feet `(T, 2, 4)` in world space."""
        positions, world = self.joints
        return positions[:, ik.LEG_FEET], positions[:, ik.LEG_TOES], world[:, ik.LEG_FEET]

    def hips_turn(self) -> Array:
        """Return the rotation of the hips from their mean over a cycle, as rotation vectors `(T, 3)` in the facing frame.

        Components are pitch, yaw and roll to the right, radians.
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
    """Return frames `start` to `end` of a motion."""
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
    """An edit: `parameters` of its `kind`; `slot` is left_arm, right_leg, torso, head, legs, ..."""

    slot: str
    kind: str
    parameters: dict[str, Any]

    @property
    def sides(self) -> list[tuple[int, float]]:
        """Contact column and sign of X for each side of the edit."""
        return [side for name, side in SIDES.items() if self.slot == "legs" or self.slot.startswith(name)]

    def size(self, name: str) -> float:
        """Return a parameter, by default 0."""
        return float(self.parameters.get(name, 0.0))

    def amount(self, name: str, random: np.random.Generator, deviation: float) -> float:
        """Return a parameter, slightly varied."""
        return self.size(name) * random.normal(1.0, deviation)

    def factor(self, name: str, random: np.random.Generator, deviation: float = 0.04) -> float:
        """Return a factor, by default 1, slightly varied; exactly 1 is not varied."""
        value = float(self.parameters.get(name, 1.0))
        return value if value == 1.0 else value * float(np.exp(deviation * random.normal()))


# --- Joints and feet --------------------------------------------------------------------------------------------------


def turns(motion: EditedMotion, pitch: Array | float, yaw: Array | float, roll: Array | float) -> Array:
    """Convert angles in the facing frame, degrees, to rotation vectors `(T, 3)` in world space; roll is to the left."""
    zero = np.zeros(len(motion.hips))
    local = np.radians(np.stack([zero + pitch, zero + yaw, zero - roll], 1))
    return rotations.rotate(motion.facing, local)


def turn_joints(
    motion: EditedMotion, vectors: Array, fractions: dict[int, float], ankles: Array | None = None
) -> EditedMotion:
    """Turn every joint of `fractions` in world space by its fraction of `vectors`; others keep their world rotation.

    When the hips turn, ankles keep their positions, or move to `ankles` `(T, 2, 3)`.
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
    # the hips turned: legs reach for the old feet
    old_ankles, _, feet = motion.feet()
    return with_feet(
        replace(motion, local=local), motion.hips, old_ankles if ankles is None else ankles, feet
    )


def with_feet(motion: EditedMotion, hips: Array, ankles: Array, feet: Array) -> EditedMotion:
    """Return the motion with new `hips` `(T, 3)`, `ankles` `(T, 2, 3)` and foot rotations `feet` `(T, 2, 4)`.

    The hips sink, smoothly, if a leg is too short.
    """
    thighs = hips[:, None] + rotations.rotate(motion.local[:, :1], THIGHS)
    to_ankle = thighs - ankles
    across = np.linalg.norm(to_ankle[..., [0, 2]], axis=-1)
    height = np.sqrt(np.maximum(_REACH_M**2 - across**2, 0.3**2))
    drop = np.maximum(to_ankle[..., 1] - height, 0.0).max(1)
    hips = hips - smooth(_most_of(drop, 5)[:, None], 2.0) * UP
    return replace(motion, hips=hips, local=ik.solve_legs(hips, motion.local, ankles, feet))


def raised(motion: EditedMotion, rise: Array) -> EditedMotion:
    """Raise the hips by `rise` metres `(T,)` above unchanged feet, at most as high as legs reach."""
    ankles, _, feet = motion.feet()
    return with_feet(motion, motion.hips + rise[:, None] * UP, ankles, feet)


def lowered(motion: EditedMotion, drop: Array | float) -> EditedMotion:
    """Lower the hips by `drop` metres above unchanged feet."""
    hips = motion.hips.copy()
    hips[:, 1] -= drop
    moved = replace(motion, hips=hips)
    return replace(moved, local=keep_feet(moved, motion))


def keep_feet(moved: EditedMotion, original: EditedMotion) -> Array:
    """Return local rotations with the moved hips and the original feet, by IK."""
    ankles, _, feet = original.feet()
    return ik.solve_legs(moved.hips, moved.local, ankles, feet)


def reaching(
    motion: EditedMotion, arm: tuple[int, int, int], target: Array, pole: Array, along: Array
) -> tuple[Array, Array]:
    """Return world rotations `(T, 4)` of upper arm and forearm that bring the hand to `target`, the elbow towards `pole`.

    `arm` are the joints shoulder, elbow and hand, `along` is the direction of the bones at rest. The elbow is bent towards
    the pole first, because the solver keeps the bending plane.
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
    """Flatten the foot and lower it to the ground, by `fraction` `(T,)` of the difference from both, in place.

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
    """Move the root by `moved` `(T, 3)`, and each foot by the displacement of the root where it passes the foot.

    `extra` `(T, 2, 3)` is added to the feet. Both are constant in stance.
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
    """Return ankle `(T, 3)` and rotation `(T, 4)` of a foot turned about its toe by `angle` `(T,)`."""
    turn = rotations.from_axis_angle(rotations.rotate(foot, LEFT), angle)
    return toe + rotations.rotate(turn, ankle - toe), rotations.multiply(turn, foot)


def _heel_angle(thigh: Array, ankle: Array, toe: Array, foot: Array, behind: NDArray[np.bool_]) -> Array:
    """Return the angle `(T,)`, radians, by which a heel `behind` rises about its toe if the leg is too short."""
    lengths = []
    for angle in _HEEL:
        raised, _ = raise_heel(ankle, toe, foot, np.full(len(ankle), angle))
        lengths.append(np.linalg.norm(raised - thigh, axis=1))
    enough = np.array(lengths) <= _RAISED_REACH_M
    first = np.where(enough.any(0), enough.argmax(0), len(_HEEL) - 1)
    wanted = np.where(behind, _HEEL[first], 0.0)
    return smooth(_most_of(wanted, 7)[:, None], 3.0)[:, 0]


def scaled_path(motion: EditedMotion, factor: Array | float) -> Array:
    """Return the displacement `(T, 3)` of a root that moves `factor` `(T,)` times as far, with unchanged lateral sway."""
    path, ahead = motion.path, motion.axes.ahead
    own = (motion.hips - path) * LEVEL
    along = np.sum(own * ahead, axis=1)[:, None] * ahead  # the oscillation along the path is scaled too
    step = np.diff(path + along, axis=0, prepend=(path + along)[:1]) * LEVEL
    return np.cumsum((np.zeros(len(path)) + factor - 1.0)[:, None] * step, axis=0)


def _passed(path: Array, foot: Array) -> NDArray[np.intp]:
    """Return indices into the extended path `(T + 2 W, 3)` where it passes each `foot` `(T, 3)`."""
    windows = np.arange(len(foot))[:, None] + np.arange(2 * _WINDOW + 1)
    away = (path[windows] - foot[:, None])[..., [0, 2]]
    distance = np.sum(away**2, axis=-1) + 1e-7 * (np.arange(2 * _WINDOW + 1) - _WINDOW) ** 2
    return np.arange(len(foot)) + np.argmin(distance, axis=1)


def at_rate(motion: EditedMotion, rate: Array) -> EditedMotion:
    """Resample the motion at `rate` `(T,)` times its speed, with its contacts and gait."""
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
    """Return the moving maximum of values `(T,)` over `frames`."""
    padded = np.pad(values, frames // 2, "edge")
    return np.lib.stride_tricks.sliding_window_view(padded, frames).max(-1)
