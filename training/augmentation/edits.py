"""All kinds of part edits, as functions of a motion, the edit's parameters and a random generator.

The generator varies strength and position slightly. The order of its draws must not change: it determines the data.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from runtime import rotations
from runtime.arrays import Array
from runtime.edits.legs import KNEE, LegEdit
from runtime.edits.request import LEG, MAX_TARGET, EditRequest
from runtime.feet import ik
from runtime.feet.leg import leg_bones, leg_forward
from runtime.motion.features import FPS
from runtime.skeleton import ANKLE_HEIGHT, PART_JOINTS, SPORT_SKELETON
from training.augmentation import gait
from training.augmentation.motion import (
    LEFT,
    SIDES,
    THIGHS,
    UP,
    Edit,
    EditedMotion,
    at_rate,
    drag_foot,
    lowered,
    on_path,
    raise_heel,
    raised,
    reaching,
    scaled_path,
    turn_joints,
    turns,
    with_feet,
)
from training.frames import smooth

_AT = SPORT_SKELETON.index
_FRAME_JOINT = {"hips": "Hips", "chest": "Spine1", "head": "Head"}
_CHAIN = {0: 0.4, 11: 0.6, 12: 0.8, 13: 1.0}  # cumulative fractions of a lean: hips, lower back, spine, chest
_ROCKING = {0: 0.35, 11: 0.6, 12: 0.8, 13: 1.0}
_SPINE_ONLY = {11: 0.25, 12: 0.6, 13: 1.0}
_ROUNDED = {11: -0.35, 12: 0.25, 13: 1.0}
_NECK = {14: 0.35, 15: 0.7, 16: 1.0}
_ARMS_FRACTION, _HEAD_FRACTION = (
    0.35,
    0.3,
)  # of the torso's lean: arms keep hanging and eyes keep looking ahead
_TIPTOE_RISE_M = 0.055  # rise of the hips
_HEEL_BEHIND_M = 0.05  # from the ankle backwards
_SETTLING_FRAMES = 60  # until the runtime's edit of legs has its full effect
_PAUSE_SIGMA_FRAMES = 2.5  # of the Gaussian that spreads a pause over time
_MAX_RISE_M = 0.06  # of the hips, for short steps
_VARIATION_GONE_FRACTION = 0.7  # part of the variation of stance width that an edit of it removes
_IN_STEP_LENGTH_FRACTION = (
    0.6  # part of an unequal step rate that becomes unequal step length; the rest is uneven speed
)
_SPINE_M = 0.23  # from the hips to the chest
_CHEST_STAYS_FRACTION = 0.6  # part of the added hip sway that the chest does not follow


def apply(motion: EditedMotion, edit: Edit, random: np.random.Generator) -> EditedMotion:
    """Apply one edit, slightly varied by `random` in strength and position; edits of rhythm may change the length."""
    return KINDS[edit.kind].apply(motion, edit, random)


def _beat(motion: EditedMotion, cycles: float, random: np.random.Generator) -> Array:
    """Return an oscillation `(T,)` of `cycles` per stride, in phase with the steps up to a small random lag."""
    size = random.normal(1.0, 0.06)
    return size * np.sin(2 * np.pi * (cycles * motion.step_phase + 0.08 * random.random()))


def _side_beat(motion: EditedMotion) -> Array:
    """Return an oscillation `(T,)` once per stride, highest while the left foot bears the weight."""
    return np.sin(2 * np.pi * (motion.step_phase + 0.05))


# --- Torso and head ---------------------------------------------------------------------------------------------------


def _with_limbs(chain: dict[int, float], arms: float, head: float) -> dict[int, float]:
    """Return the fraction of a rotation for each joint of `chain`, of both arms, and of neck and head."""
    fractions = chain | dict.fromkeys((*PART_JOINTS["left_arm"], *PART_JOINTS["right_arm"]), arms)
    return fractions | dict.fromkeys(PART_JOINTS["head"], head)


_TURNS: dict[str, tuple[dict[int, float], float, Callable[[EditedMotion], Array | float]]] = {
    "slump": (_with_limbs(_ROUNDED, _ARMS_FRACTION, _HEAD_FRACTION), 0.06, lambda _: 1.0),
    "sway": (_with_limbs(_CHAIN, 0.6, 0.4), 0.08, _side_beat),
    "twist": (_with_limbs(_SPINE_ONLY, 1.0, 0.15), 0.08, lambda m: -np.cos(2 * np.pi * m.step_phase)),
}


def _lean(motion: EditedMotion, edit: Edit, random: np.random.Generator) -> EditedMotion:
    amount = random.normal(1.0, 0.06)
    pitch, roll = (amount * edit.size(name) for name in ("pitch", "roll"))
    vectors = turns(motion, pitch, 0.0, roll)
    back = -0.13 * np.sin(np.radians(pitch))  # the hips balance the upper body
    side = -0.12 * np.sin(np.radians(roll))
    hips = motion.hips + rotations.rotate(motion.facing, np.array([side, 0.0, back]))
    fractions = _with_limbs(_CHAIN, _ARMS_FRACTION, _HEAD_FRACTION)
    return turn_joints(replace(motion, hips=hips), vectors, fractions, motion.feet()[0])


def _turned(motion: EditedMotion, edit: Edit, random: np.random.Generator) -> EditedMotion:
    """Turn the torso by its angles, constant or oscillating with the steps."""
    fractions, deviation, beat = _TURNS[edit.kind]
    amount, times = random.normal(1.0, deviation), beat(motion)
    angles = (edit.size(name) * amount * times for name in ("pitch", "yaw", "roll"))
    return turn_joints(motion, turns(motion, *angles), fractions)


def _bounce(motion: EditedMotion, edit: Edit, random: np.random.Generator) -> EditedMotion:
    height = edit.amount("height", random, 0.08)
    return lowered(motion, 0.5 * height * (1.0 - np.cos(4 * np.pi * (motion.step_phase - 0.04))))


def _head(motion: EditedMotion, edit: Edit, random: np.random.Generator) -> EditedMotion:
    amount = random.normal(1.0, 0.07)
    angles = [amount * edit.size(name) for name in ("pitch", "yaw", "roll")]
    if "wave" in edit.parameters:
        *sizes, cycles = edit.parameters["wave"]
        beat = _beat(motion, cycles, random)
        angles = [angle + amount * size * beat for angle, size in zip(angles, sizes, strict=True)]
    return turn_joints(motion, turns(motion, *angles), _NECK)


# --- Arms -------------------------------------------------------------------------------------------------------------


def _hand(motion: EditedMotion, edit: Edit, random: np.random.Generator) -> EditedMotion:
    p = edit.parameters
    side = edit.slot.removesuffix("_arm").capitalize()
    mirror = np.array([edit.sides[0][1], 1.0, 1.0])  # points are given for the left arm
    collar, shoulder, elbow, hand = (_AT(side + name) for name in ("Shoulder", "Arm", "ForeArm", "Hand"))
    positions, world = motion.joints
    length = len(motion.hips)
    point = np.broadcast_to(np.array(p["point"]), (length, 3)) + random.normal(0.0, 0.015, 3)
    point = point + 0.008 * gait.drift(length, random)
    if "wave" in p:
        *amplitude, cycles = p["wave"]
        beat = _beat(motion, cycles, random)
        point = point + beat[:, None] * np.array(amplitude) * random.normal(1.0, 0.08)
    at_shoulder = p["frame"] == "shoulder"
    joint = shoulder if at_shoulder else _AT(_FRAME_JOINT[p["frame"]])
    axes = motion.facing if at_shoulder else world[:, joint]
    target = positions[:, joint] + rotations.rotate(axes, point * mirror)
    body = motion.facing if at_shoulder else world[:, _AT("Spine1")]
    pole = rotations.rotate(body, np.broadcast_to(np.array(p["pole"]) * mirror, (length, 3)))
    upper, lower = reaching(motion, (shoulder, elbow, hand), target, pole, mirror * LEFT)
    local = motion.local.copy()
    local[:, shoulder] = rotations.multiply(rotations.inverse(world[:, collar]), upper)
    local[:, elbow] = rotations.multiply(rotations.inverse(upper), lower)
    local[:, hand] = rotations.slerp(local[:, hand], rotations.identity((length,)), 0.7)
    return replace(motion, local=local)


def _swing(motion: EditedMotion, edit: Edit, random: np.random.Generator) -> EditedMotion:
    scale = edit.amount("scale", random, 0.05)
    name = edit.slot.removesuffix("_arm").capitalize()
    local = motion.local.copy()
    for joint in (_AT(f"{name}Arm"), _AT(f"{name}ForeArm")):
        own = rotations.continuous(local[:, joint])
        mean = rotations.normalize(smooth(own, 45.0))
        away = rotations.multiply(rotations.inverse(mean), own)
        away *= np.where(away[:, :1] < 0, -1.0, 1.0)
        angle = 2.0 * np.arctan2(np.linalg.norm(away[:, 1:], axis=1), away[:, 0])
        axis = rotations.normalize(away[:, 1:])
        turn = rotations.from_axis_angle(axis, np.clip(scale * angle, 0, 1.5))
        local[:, joint] = rotations.multiply(mean, turn)
    return replace(motion, local=local)


# --- Posture of legs --------------------------------------------------------------------------------------------------


def _legs(motion: EditedMotion, edit: Edit, random: np.random.Generator) -> EditedMotion:
    p = {name: value * random.normal(1.0, 0.07) for name, value in edit.parameters.items()}
    if "lower" in p:
        return lowered(motion, p["lower"])
    ankles, toes, feet = motion.feet()
    hips, contacts = motion.hips.copy(), motion.contacts.copy()
    for column, sign in edit.sides:
        ankles[:, column], feet[:, column] = _placed_foot(
            motion, p, (ankles[:, column], toes[:, column], feet[:, column]), motion.stands(column), sign
        )
        if "tiptoe" in p:
            contacts[:, 2 * column] = 0
        if "toe_up" in p:
            contacts[:, 2 * column + 1] = 0
    if "tiptoe" in p:
        hips[:, 1] += _TIPTOE_RISE_M
    local = ik.solve_legs(hips, motion.local, ankles, feet)
    return replace(motion, hips=hips, local=local, contacts=contacts)


def _placed_foot(
    motion: EditedMotion,
    p: dict[str, float],
    leg: tuple[Array, Array, Array],
    down: NDArray[np.bool_],
    sign: float,
) -> tuple[Array, Array]:
    """Return ankle `(T, 3)` and rotation `(T, 4)` of a foot for parameters `p`; `leg` is ankle, toe and rotation."""
    ankle, toe, foot = leg[0].copy(), leg[1], leg[2].copy()
    if "lift" in p:
        ankle[:, 1] += p["lift"] * gait.over_swings(down, gait.hill)
    if "drag" in p:
        drag_foot(ankle, foot, toe, p["drag"] * gait.over_swings(down, gait.plateau), motion.ground)
    if "outward" in p:
        offset = rotations.rotate(motion.facing, np.array([sign * p["outward"], 0.0, 0.0]))
        before = motion.ground.height(ankle[:, 0], ankle[:, 2])
        ankle += gait.held_in_stance(offset, down)
        ankle[:, 1] += motion.ground.height(ankle[:, 0], ankle[:, 2]) - before
    if "toe_out" in p:
        foot = rotations.multiply(rotations.from_yaw(np.radians(sign * p["toe_out"])), foot)
    if "toe_up" in p:  # about the heel, on which the foot stands
        turn = rotations.from_axis_angle(rotations.rotate(foot, LEFT), np.radians(-p["toe_up"]))
        from_heel = rotations.rotate(foot, np.array([0.0, ANKLE_HEIGHT, _HEEL_BEHIND_M]))
        return ankle - from_heel + rotations.rotate(turn, from_heel), rotations.multiply(turn, foot)
    if "tiptoe" in p:
        return raise_heel(ankle, toe, foot, np.full(len(ankle), np.radians(p["tiptoe"])))
    return ankle, foot


def _stiff(motion: EditedMotion, edit: Edit, random: np.random.Generator) -> EditedMotion:
    """Apply the runtime's edit of knee flexion frame by frame."""
    knee = edit.amount("knee", random, 0.07)
    ankles, _, feet = motion.feet()
    shown = [[[0.0, 0.0, 0.0] for _ in LEG] for _ in SIDES]
    for column, _ in edit.sides:
        shown[column][KNEE] = [1.0, -MAX_TARGET, knee]
    yaw = rotations.to_euler(motion.facing, "YXZ")[:, 0]
    velocity = np.gradient(motion.path, axis=0)[:, [0, 2]] * FPS
    ground = motion.ground.height(motion.hips[:, 0], motion.hips[:, 2])
    state, bones, rise = LegEdit(), (leg_bones(0), leg_bones(1)), np.zeros(len(motion.hips))
    local, hips = motion.local.tolist(), motion.hips.tolist()
    contacts = motion.contacts.astype(float).tolist()
    for t in [*range(min(_SETTLING_FRAMES, len(hips))), *range(len(hips))]:
        legs = leg_forward(bones[0], hips[t], local[t]), leg_forward(bones[1], hips[t], local[t])
        request = EditRequest(shown, float(yaw[t]), tuple(velocity[t].tolist()), float(ground[t]))
        rise[t], placed = state.apply(hips[t][1], legs, list(contacts[t]), request)
        ankles[t], feet[t] = [leg.ankle for leg in placed], [leg.foot for leg in placed]
    return with_feet(motion, motion.hips + rise[:, None] * UP, ankles, feet)


# --- Steps: path and timing -------------------------------------------------------------------------------------------


def _steps(motion: EditedMotion, edit: Edit, random: np.random.Generator) -> EditedMotion:
    length, cadence = edit.factor("length", random), edit.factor("cadence", random)
    if length > 1.0:  # the pelvis turns more in proportion: legs alone are too short for a long stride
        yaw = motion.hips_turn() * np.array([0.0, length - 1.0, 0.0])
        motion = turn_joints(motion, rotations.rotate(motion.axes.facing, yaw), {0: 1.0})
    if length != 1.0:
        moved = on_path(motion, scaled_path(motion, length))
        motion = _as_straight(motion, moved) if length < 1.0 else moved
    return motion if cadence == 1.0 else at_rate(motion, np.full(len(motion.hips), cadence))


def _as_straight(before: EditedMotion, after: EditedMotion) -> EditedMotion:
    """Raise the hips of `after` until supporting legs are as extended as in `before`: short steps need higher hips."""
    room = np.full((len(after.hips), 2), np.inf)
    for column in range(2):
        old, new = (
            m.hips + rotations.rotate(m.local[:, 0], THIGHS[column]) - m.feet()[0][:, column]
            for m in (before, after)
        )
        across = np.linalg.norm(new[:, [0, 2]], axis=1)
        high = np.sqrt(np.maximum(np.sum(old**2, axis=1) - across**2, 0.0))
        room[:, column] = np.where(after.stands(column), high - new[:, 1], np.inf)
    rise = room.min(1)
    known = np.isfinite(rise)
    if not known.any():
        return after
    rise = np.interp(np.arange(len(rise)), np.flatnonzero(known), np.clip(rise[known], 0.0, _MAX_RISE_M))
    return raised(after, smooth(rise[:, None], 4.0)[:, 0])


def _line(motion: EditedMotion, edit: Edit, random: np.random.Generator) -> EditedMotion:
    """Move footsteps to a line; their variation about it is a third of the capture's."""
    wanted = float(edit.parameters["outward"]) + 0.006 * random.normal()
    left = motion.axes.left[:, None]
    out = np.sum((motion.feet()[0] - motion.path[:, None]) * left, axis=-1)
    for column, sign in SIDES.values():
        standing = motion.stands(column)
        own = float(np.median(out[standing, column])) if standing.any() else 0.0
        out[:, column] = sign * wanted - own - _VARIATION_GONE_FRACTION * (out[:, column] - own)
    return on_path(motion, np.zeros_like(motion.path), out[..., None] * left)


def _stance(motion: EditedMotion, edit: Edit, random: np.random.Generator) -> EditedMotion:
    column, _ = edit.sides[0]
    alone = motion.stands(column).astype(np.float64) - motion.stands(1 - column)
    weight = smooth(alone[:, None], 3.0)[:, 0]
    rate = np.exp(-0.5 * np.log(edit.factor("uneven", random)) * weight)
    motion = on_path(motion, scaled_path(motion, rate**-_IN_STEP_LENGTH_FRACTION))
    drop = edit.amount("drop", random, 0.07)
    if drop:
        motion = raised(motion, -drop * smooth(np.maximum(alone, 0.0)[:, None], 5.0)[:, 0])
    return at_rate(motion, rate)


def _hesitation(motion: EditedMotion, edit: Edit, random: np.random.Generator) -> EditedMotion:
    seconds = edit.factor("pause", random)
    landings = np.sort(gait.all_landings(motion.contacts))
    frames = np.arange(len(motion.hips))[:, None]
    size = seconds * FPS / (_PAUSE_SIGMA_FRAMES * np.sqrt(2 * np.pi))
    longer = 1.0 + size * np.exp(-0.5 * ((frames - (landings[None] + 5)) / _PAUSE_SIGMA_FRAMES) ** 2).sum(1)
    return at_rate(motion, 1.0 / longer)


def _stagger(motion: EditedMotion, edit: Edit, random: np.random.Generator) -> EditedMotion:
    """Stagger: the path meanders slowly, footsteps scatter, the torso lags, and the step rate is uneven."""
    seconds = np.arange(len(motion.hips)) / FPS
    slow, quick = random.uniform(2.6, 3.6), random.uniform(1.5, 2.0)
    turn = 2 * np.pi * random.random(2)
    wave = 0.75 * np.sin(2 * np.pi * seconds / slow + turn[0])
    wave = wave + 0.35 * np.sin(2 * np.pi * seconds / quick + turn[1])
    left = motion.axes.left
    size = edit.factor("wander", random)
    extra = np.stack([gait.per_stance(motion.stands(column), random) for column in range(2)], axis=1)
    moved = on_path(motion, size * wave[:, None] * left, 0.2 * size * extra[..., None] * left[:, None])
    lag = np.interp(seconds - 0.15, seconds, np.gradient(wave, seconds))
    roll = edit.factor("roll", random) * lag / max(float(np.abs(lag).max()), 0.5)
    rolled = turn_joints(moved, turns(moved, 0.4 * np.abs(roll), 0.0, roll), _with_limbs(_CHAIN, 0.5, 0.5))
    uneven = np.exp(0.12 * np.sin(2 * np.pi * seconds / random.uniform(1.7, 2.5) + turn[1]))
    return at_rate(rolled, uneven)


# --- Within a gait cycle: footsteps unchanged -------------------------------------------------------------------------


def _bobbing(motion: EditedMotion, scale: float) -> EditedMotion:
    """Scale the vertical motion of the hips. Their highest point is kept or lowered, as legs cannot become longer."""
    away = (motion.hips - motion.path)[:, 1]
    top = motion.cycle_mean(np.maximum(away, 0.0)[:, None])[:, 0] * 2.0
    return raised(motion, (scale - 1.0) * away - abs(scale - 1.0) * top)


def _hips(motion: EditedMotion, edit: Edit, random: np.random.Generator) -> EditedMotion:
    axes = motion.axes
    sideways = np.sum((motion.hips - motion.path) * axes.left, axis=1)[:, None] * axes.left
    moved_by = (edit.factor("sideways", random, 0.05) - 1.0) * sideways
    moved = replace(motion, hips=motion.hips + moved_by)
    back = np.degrees(np.arctan2(-_CHEST_STAYS_FRACTION * np.sum(moved_by * axes.left, axis=1), _SPINE_M))
    moved = turn_joints(moved, turns(moved, 0.0, 0.0, back), {11: 1.0, 12: 1.0})
    yaw, roll = (edit.factor(name, random, 0.05) - 1.0 for name in ("yaw", "roll"))
    more = rotations.rotate(axes.facing, motion.hips_turn() * np.array([0.0, yaw, roll]))
    return turn_joints(moved, more, {0: 1.0}, motion.feet()[0])


def _shoulders(motion: EditedMotion, edit: Edit, random: np.random.Generator) -> EditedMotion:
    positions = motion.joints[0]
    across = positions[:, _AT("LeftArm")] - positions[:, _AT("RightArm")]
    yaw = np.unwrap(np.arctan2(-across[:, 2], across[:, 0]))[:, None]
    turn = yaw - motion.cycle_mean(yaw)
    more = turn * np.array([0.0, edit.factor("yaw", random, 0.05) - 1.0, 0.0])
    vectors = rotations.rotate(motion.axes.facing, more)
    moved = turn_joints(motion, vectors, _with_limbs(_SPINE_ONLY, 1.0, 0.1))
    roll = edit.amount("roll", random, 0.06)
    if not roll:
        return moved
    rolls = turns(moved, 0.0, 0.0, roll * _side_beat(motion))
    return turn_joints(moved, rolls, _with_limbs(_SPINE_ONLY, 0.8, 0.2))


def _rock(motion: EditedMotion, edit: Edit, random: np.random.Generator) -> EditedMotion:
    size = random.normal(1.0, 0.06)
    beat = _side_beat(motion)
    sideways = size * float(edit.parameters["sideways"]) * beat
    moved = replace(motion, hips=motion.hips + sideways[:, None] * motion.axes.left)
    roll = size * float(edit.parameters["roll"]) * beat
    fractions = _with_limbs(_ROCKING, 0.6, 0.4)
    return turn_joints(moved, turns(moved, 0.0, 0.0, roll), fractions, motion.feet()[0])


def _landing(motion: EditedMotion, edit: Edit, random: np.random.Generator) -> EditedMotion:
    p, size = edit.parameters, random.normal(1.0, 0.06)
    ankles, _, feet = motion.feet()
    for column in range(2):
        standing, height = motion.stands(column), ankles[:, column, 1]
        if "lift" in p:
            height += size * p["lift"] * gait.over_swings(standing, gait.late_hill)
        if "soft" in p:
            early = gait.over_swings(standing, gait.early_rise)
            height -= p["soft"] * gait.height_in_swing(height, standing) * early
    jolts = gait.jolts(motion.contacts)
    lower = size * edit.size("drop") * jolts
    moved = with_feet(motion, motion.hips - lower[:, None] * UP, ankles, feet)
    if "bob" in p:
        moved = _bobbing(moved, p["bob"])
    pitch = size * edit.size("jolt") * jolts
    if not pitch.any():
        return moved
    return turn_joints(moved, turns(moved, pitch, 0.0, 0.0), _with_limbs(_SPINE_ONLY, 0.6, 0.4))


@dataclass(frozen=True)
class Kind:
    """A kind of edit, with its allowed parameters.

    `moves_feet`: it changes footsteps, or the length of a clip. `of_steps`: it edits rhythm and weight, visible only in
    walking. `scales`: it scales captured movement, so it has no effect on a body without that movement.
    """

    apply: Callable[[EditedMotion, Edit, np.random.Generator], EditedMotion]
    parameters: frozenset[str]
    moves_feet: bool = False
    of_steps: bool = False
    scales: bool = False


def _kind(apply: Callable[..., EditedMotion], parameters: str, **flags: bool) -> Kind:
    return Kind(apply, frozenset(parameters.split()), **flags)


_FEET = {"moves_feet": True, "of_steps": True}
_SCALES = {"of_steps": True, "scales": True}
KINDS = {
    "hand": _kind(_hand, "frame point pole wave"),
    "swing": _kind(_swing, "scale", scales=True),
    "leg": _kind(_legs, "lift drag outward toe_out"),
    "legs": _kind(_legs, "lower tiptoe outward toe_up"),
    "stiff": _kind(_stiff, "knee"),
    "lean": _kind(_lean, "pitch roll"),
    "slump": _kind(_turned, "pitch"),
    "sway": _kind(_turned, "roll"),
    "twist": _kind(_turned, "yaw"),
    "bounce": _kind(_bounce, "height"),
    "head": _kind(_head, "pitch yaw roll wave"),
    "bob": _kind(
        lambda motion, edit, random: _bobbing(motion, edit.factor("scale", random, 0.05)), "scale", **_SCALES
    ),
    "hips": _kind(_hips, "sideways roll yaw", **_SCALES),
    "shoulders": _kind(_shoulders, "yaw roll", **_SCALES),
    "rock": _kind(_rock, "roll sideways", of_steps=True),
    "landing": _kind(_landing, "lift drop jolt soft bob", of_steps=True),
    "steps": _kind(_steps, "length cadence", **_FEET),
    "line": _kind(_line, "outward", **_FEET),
    "stance": _kind(_stance, "uneven drop", **_FEET),
    "hesitation": _kind(_hesitation, "pause", **_FEET),
    "stagger": _kind(_stagger, "wander roll", **_FEET),
}
