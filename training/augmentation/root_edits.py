"""Edits of where and when a body goes: step length, cadence, stance time, pauses, course and stance width.

Planted feet stay planted by construction: the root's path is changed, every foot is carried by what the path changed
where it passes the foot, and that is held through a stance. Time is changed by playing the same frames at another rate.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime import rotations
from runtime.arrays import Array
from runtime.feet import ik
from runtime.motion.features import FPS
from runtime.skeleton import SPORT_SKELETON
from training.augmentation.catalogue import PartEdit
from training.augmentation.cycle import away_from_mean, axes, cycle_frames, cycle_mean, right_landings
from training.augmentation.pose_edits import (
    CHAIN,
    SIDES,
    EditedMotion,
    lean_shares,
    turn_joints,
    turns,
    within_reach,
)
from training.augmentation.steps import held_in_stance, left_landings
from training.frames import smooth

_WINDOW = 75  # frames before and after in which the path passes a foot
_END = 12  # frames whose mean change goes on beyond an end
_HEEL = np.radians(np.arange(0.0, 41.0, 5.0))  # by which a heel rises behind to let a stride be longer
_PAUSE_SIGMA = 2.5  # frames of the capture over which a pause is spread
_HIGHEST = 0.06  # m that hips rise for short steps
_VARIATION_GONE = 0.7  # of the stance width, where one is asked for
_STEP_SHARE = 0.6  # of an unequal rate that becomes an unequal step length; the rest is an uneven speed


def feet_of(motion: EditedMotion) -> tuple[Array, Array, Array]:
    """Ankles `(T, 2, 3)`, toes `(T, 2, 3)` and rotations of the feet `(T, 2, 4)` in world space."""
    positions, world = SPORT_SKELETON.forward_kinematics(motion.hips, motion.local.astype(np.float64))
    return positions[:, ik.LEG_FEET], positions[:, ik.LEG_TOES], world[:, ik.LEG_FEET]


def with_feet(motion: EditedMotion, hips: Array, ankles: Array, feet: Array) -> EditedMotion:
    """The motion with other hips `(T, 3)`, its ankles at `ankles` `(T, 2, 3)` with rotations `feet`; the hips sink where
    a leg would be too short.
    """
    hips = within_reach(hips, motion.local[:, 0].astype(np.float64), ankles)
    return replace(
        motion, hips=hips, local=ik.solve_legs(hips, motion.local.astype(np.float64), ankles, feet)
    )


def down(motion: EditedMotion, column: int) -> NDArray[np.bool_]:
    """Frames in which a foot (0 left, 1 right) stands."""
    return np.asarray(motion.contacts[:, 2 * column : 2 * column + 2].any(1))


# --- Path -------------------------------------------------------------------------------------------------------------


def on_path(motion: EditedMotion, moved: Array, extra: Array | None = None) -> EditedMotion:
    """The motion with its root moved by `moved` `(T, 3)`, and every foot by what the root moves where it passes it.

    `extra` `(T, 2, 3)` is added to the feet. Both are held in stance.
    """
    frames = cycle_frames(motion.contacts)
    ankles, toes, feet = feet_of(motion)
    path = _extended(cycle_mean(motion.hips.astype(np.float64), frames))
    carried = _extended(moved)
    for column in range(2):
        at = _passed(path, ankles[:, column])
        offset = carried[at] + (0.0 if extra is None else extra[:, column])
        offset = held_in_stance(offset * np.array([1.0, 0.0, 1.0]), down(motion, column))
        ankles[:, column] += offset
        toes[:, column] += offset
    hips = motion.hips.astype(np.float64) + moved
    ankles, feet, contacts = _heels_up(motion, hips, ankles, toes, feet)
    return with_feet(replace(motion, contacts=contacts), hips, ankles, feet)


def scaled_path(motion: EditedMotion, share: Array | float) -> Array:
    """What a root moves `(T, 3)` that goes `share` `(T,)` times as far; its sideways curve about the path stays."""
    path = cycle_mean(motion.hips.astype(np.float64), cycle_frames(motion.contacts))
    ahead = axes(motion).ahead
    own = (motion.hips - path) * np.array([1.0, 0.0, 1.0])
    along = np.sum(own * ahead, axis=1)[:, None] * ahead  # the curve along the path scales with it
    step = np.diff(path + along, axis=0, prepend=(path + along)[:1]) * np.array([1.0, 0.0, 1.0])
    return np.cumsum((np.zeros(len(path)) + share - 1.0)[:, None] * step, axis=0)


def _extended(values: Array) -> Array:
    n = min(_END, len(values) - 1)
    steps = np.arange(1, _WINDOW + 1)[:, None]
    before = values[0] - steps[::-1] * (values[n] - values[0]) / n
    after = values[-1] + steps * (values[-1] - values[-1 - n]) / n
    return np.concatenate([before, values, after])


def _passed(path: Array, foot: Array) -> NDArray[np.intp]:
    """Index into the extended path `(T + 2 W, 3)` of the place where it passes each `foot` `(T, 3)`."""
    windows = np.arange(len(foot))[:, None] + np.arange(2 * _WINDOW + 1)
    away = (path[windows] - foot[:, None])[..., [0, 2]]
    distance = np.sum(away**2, axis=-1) + 1e-7 * (np.arange(2 * _WINDOW + 1) - _WINDOW) ** 2
    return np.arange(len(foot)) + np.argmin(distance, axis=1)


def _heels_up(
    motion: EditedMotion, hips: Array, ankles: Array, toes: Array, feet: Array
) -> tuple[Array, Array, NDArray[np.uint8]]:
    """Ankles and feet with the heel raised about the toe where a leg behind would be too short, and the contacts."""
    ahead = axes(motion).ahead
    contacts = motion.contacts.copy()
    sockets = SPORT_SKELETON.offsets[ik.LEG_THIGHS].astype(np.float64)
    reach = 0.985 * sum(
        float(np.linalg.norm(SPORT_SKELETON.offsets[j[0]])) for j in (ik.LEG_SHINS, ik.LEG_FEET)
    )
    for column in range(2):
        thigh = hips + rotations.rotate(motion.local[:, 0].astype(np.float64), sockets[column])
        ankle, toe, foot = ankles[:, column], toes[:, column], feet[:, column]
        behind = np.sum((ankle - hips) * ahead, axis=1) < -0.05
        axis = rotations.rotate(foot, np.array([1.0, 0.0, 0.0]))
        lengths = []
        for angle in _HEEL:
            turn = rotations.from_axis_angle(axis, np.full(len(axis), angle))
            lengths.append(np.linalg.norm(toe + rotations.rotate(turn, ankle - toe) - thigh, axis=1))
        enough = np.array(lengths) <= reach
        first = np.where(enough.any(0), enough.argmax(0), len(_HEEL) - 1)
        wanted = np.where(behind, _HEEL[first], 0.0)
        padded = np.pad(wanted, 3, mode="edge")
        angle = smooth(np.lib.stride_tricks.sliding_window_view(padded, 7).max(-1)[:, None], 3.0)[:, 0]
        turn = rotations.from_axis_angle(axis, angle)
        ankles[:, column] = toe + rotations.rotate(turn, ankle - toe)
        feet[:, column] = rotations.multiply(turn, foot)
        contacts[:, 2 * column] &= (angle < np.radians(6.0)).astype(np.uint8)
    return ankles, feet, contacts


# --- Time -------------------------------------------------------------------------------------------------------------


def at_rate(motion: EditedMotion, rate: Array) -> EditedMotion:
    """The motion played at `rate` `(T,)` times its speed: contacts and gait go with their frames."""
    clock = np.concatenate([[0.0], np.cumsum(0.5 / rate[:-1] + 0.5 / rate[1:])])
    at = np.interp(np.arange(int(clock[-1]) + 1), clock, np.arange(len(rate)))
    low = np.minimum(np.floor(at).astype(int), len(rate) - 2)
    share = (at - low)[:, None]
    nearest = np.round(at).astype(int)
    hips = motion.hips.astype(np.float64)
    local = motion.local.astype(np.float64)
    return replace(
        motion,
        hips=(1.0 - share) * hips[low] + share * hips[low + 1],
        local=rotations.continuous(rotations.slerp(local[low], local[low + 1], share)),
        contacts=motion.contacts[nearest],
        gait=None if motion.gait is None else motion.gait[nearest],
    )


# --- The kinds of edits -----------------------------------------------------------------------------------------------


def steps(motion: EditedMotion, edit: PartEdit, random: np.random.Generator) -> EditedMotion:
    """`length`: times the step length; `cadence`: times the steps a minute."""
    p: dict[str, Any] = edit.parameters
    length = _varied(float(p.get("length", 1.0)), random)
    cadence = _varied(float(p.get("cadence", 1.0)), random)
    if length > 1.0:  # the pelvis turns as much more: a leg alone is too short for a long stride
        own = away_from_mean(
            motion.local[:, 0].astype(np.float64), axes(motion).yaw, cycle_frames(motion.contacts)
        )
        more = rotations.rotate(
            rotations.from_yaw(axes(motion).yaw), own * np.array([0.0, length - 1.0, 0.0])
        )
        motion = turn_joints(motion, more, {0: 1.0}, feet_of(motion)[0])
    if length != 1.0:
        moved = on_path(motion, scaled_path(motion, length))
        motion = _as_straight(motion, moved) if length < 1.0 else moved
    return motion if cadence == 1.0 else at_rate(motion, np.full(len(motion.hips), cadence))


def _as_straight(before: EditedMotion, after: EditedMotion) -> EditedMotion:
    """`after` with its hips raised so far that the legs that stand are as long as in `before`: short steps, high hips."""
    sockets = SPORT_SKELETON.offsets[ik.LEG_THIGHS].astype(np.float64)
    ankles, _, feet = feet_of(after)
    room = np.full((len(after.hips), 2), np.inf)
    for column in range(2):
        leg = [
            m.hips + rotations.rotate(m.local[:, 0].astype(np.float64), sockets[column]) - a[:, column]
            for m, a in ((before, feet_of(before)[0]), (after, ankles))
        ]
        across = np.linalg.norm(leg[1][:, [0, 2]], axis=1)
        high = np.sqrt(np.maximum(np.sum(leg[0] ** 2, axis=1) - across**2, 0.0))
        room[:, column] = np.where(down(after, column), high - leg[1][:, 1], np.inf)
    rise = room.min(1)
    known = np.isfinite(rise)
    if not known.any():
        return after
    rise = np.interp(np.arange(len(rise)), np.flatnonzero(known), np.clip(rise[known], 0.0, _HIGHEST))
    return with_feet(after, after.hips + smooth(rise[:, None], 4.0) * np.array([0.0, 1.0, 0.0]), ankles, feet)


def line(motion: EditedMotion, edit: PartEdit, random: np.random.Generator) -> EditedMotion:
    """`outward`: metres of both feet from the middle line; steps vary about it a third as much as in the capture."""
    wanted = float(edit.parameters["outward"]) + 0.006 * random.normal()
    path = cycle_mean(motion.hips.astype(np.float64), cycle_frames(motion.contacts))
    left = axes(motion).left
    ankles, _, _ = feet_of(motion)
    out = np.sum((ankles - path[:, None]) * left[:, None], axis=-1)
    for column, sign in SIDES.values():
        standing = down(motion, column)
        own = float(np.median(out[standing, column])) if standing.any() else 0.0
        out[:, column] = sign * wanted - own - _VARIATION_GONE * (out[:, column] - own)
    extra = out[..., None] * left[:, None]
    return on_path(motion, np.zeros_like(path), extra)


def stance(motion: EditedMotion, edit: PartEdit, random: np.random.Generator) -> EditedMotion:
    """`uneven`: how many times as long one foot carries alone as the other, below 1 a limp; `drop`: of the hips on it."""
    p: dict[str, Any] = edit.parameters
    column, _ = SIDES[edit.slot.removesuffix("_leg")]
    alone = down(motion, column).astype(np.float64) - down(motion, 1 - column)
    weight = smooth(alone[:, None], 3.0)[:, 0]
    rate = np.exp(-0.5 * np.log(_varied(float(p["uneven"]), random)) * weight)
    motion = on_path(motion, scaled_path(motion, rate**-_STEP_SHARE))
    drop = float(p.get("drop", 0.0)) * random.normal(1.0, 0.07)
    if drop:
        ankles, _, feet = feet_of(motion)
        carries = smooth(np.maximum(alone, 0.0)[:, None], 5.0)[:, 0]
        motion = with_feet(
            motion, motion.hips - (drop * carries)[:, None] * np.array([0.0, 1.0, 0.0]), ankles, feet
        )
    return at_rate(motion, rate)


def hesitation(motion: EditedMotion, edit: PartEdit, random: np.random.Generator) -> EditedMotion:
    """`pause`: seconds that are spent between steps while both feet stand, `every`: steps between two pauses."""
    p: dict[str, Any] = edit.parameters
    seconds = _varied(float(p["pause"]), random)
    landings = np.sort(np.concatenate([left_landings(motion.contacts), right_landings(motion.contacts)]))
    frames = np.arange(len(motion.hips))[:, None]
    at = landings[:: int(p.get("every", 1))][None] + 5
    size = seconds * FPS / (_PAUSE_SIGMA * np.sqrt(2 * np.pi))
    longer = 1.0 + size * np.exp(-0.5 * ((frames - at) / _PAUSE_SIGMA) ** 2).sum(1)
    return at_rate(motion, 1.0 / longer)


def stagger(motion: EditedMotion, edit: PartEdit, random: np.random.Generator) -> EditedMotion:
    """`wander`: metres that the course leaves its line to either side, `roll`: degrees that the torso follows."""
    p: dict[str, Any] = edit.parameters
    seconds = np.arange(len(motion.hips)) / FPS
    slow, quick = random.uniform(2.6, 3.6), random.uniform(1.5, 2.0)
    turn = 2 * np.pi * random.random(2)
    wave = 0.75 * np.sin(2 * np.pi * seconds / slow + turn[0]) + 0.35 * np.sin(
        2 * np.pi * seconds / quick + turn[1]
    )
    left = axes(motion).left
    size = _varied(float(p["wander"]), random)
    extra = np.stack([_per_stance(down(motion, c), random) for c in range(2)], axis=1)
    moved = on_path(motion, size * wave[:, None] * left, 0.2 * size * extra[..., None] * left[:, None])
    lag = np.interp(seconds - 0.15, seconds, np.gradient(wave, seconds))
    roll = _varied(float(p["roll"]), random) * lag / max(float(np.abs(lag).max()), 0.5)
    ankles, _, _ = feet_of(moved)
    rolled = turn_joints(
        moved, turns(moved, 0.4 * np.abs(roll), 0.0, roll), lean_shares(CHAIN, 0.5, 0.5), ankles
    )
    uneven = np.exp(0.12 * np.sin(2 * np.pi * seconds / random.uniform(1.7, 2.5) + turn[1]))
    return at_rate(rolled, uneven)


def _per_stance(standing: NDArray[np.bool_], random: np.random.Generator) -> Array:
    """One number of unit deviation for every stance, `(T,)`."""
    number = np.cumsum(np.diff(standing.astype(int), prepend=0) == 1)
    return random.normal(size=int(number.max()) + 1).clip(-1.5, 1.5)[number]


def _varied(value: float, random: np.random.Generator) -> float:
    """A factor or size a little varied; exactly 1 stays as it is."""
    return value if value == 1.0 else value * float(np.exp(0.04 * random.normal()))


KINDS = {"steps": steps, "line": line, "stance": stance, "hesitation": hesitation, "stagger": stagger}
