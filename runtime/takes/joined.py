"""Joins takes: the seam is inertialised, and standing feet keep their place.

Inertialization (Bollo, GDC 2018): the second take is rotated and moved to the end of the first; the remaining difference
between their poses is an offset that decays to zero from its initial velocity.
"""

from dataclasses import replace
from functools import reduce
from itertools import groupby
from operator import attrgetter

import numpy as np

from runtime import rotations
from runtime.arrays import Array
from runtime.errors import UsageError
from runtime.feet.ik import LEG_FEET, LEG_TOES
from runtime.takes.clip import Clip
from runtime.takes.footplants import BEARING_CONTACT_THRESHOLD
from runtime.takes.loop import led_legs
from runtime.takes.metadata import UNKNOWN, PromptEvent, gait_seconds
from runtime.takes.root import SMOOTHING_S, Placement, root_track, smooth
from runtime.terrain.height_map import Terrain

BLEND_S = 0.4  # in which the body's offset decays
STEP_S = 0.3  # of its time in the air, in which a foot moves to its own place
SAME_TOLERANCE = 1e-4  # metres and quaternion components within which pieces of one take meet
HELD_M = 0.2  # a standing foot farther from its place in the second take makes a step
LIFT_FRACTION, MAX_LIFT_M = 0.2, 0.06  # of such a step, relative to its length
MAX_GAP_M_PER_S, MAX_GAP_RAD_PER_S = 2.0, 6.0  # limits of an offset's velocity at the seam


Grounds = tuple[Terrain, Terrain]  # of the first clip, which is also the result's, and of the second


def joined(first: Clip, second: Clip, grounds: Grounds | None = None) -> Clip:
    """Return two clips joined: the second is placed so that its first frame meets the first clip's last.

    With `grounds`, the feet of the second clip keep their heights over the ground. Raises UsageError for different body sizes.
    """
    if first.size != second.size:
        raise UsageError("The takes have different body sizes.", "Join takes of one character.")
    second = second.resampled(first.fps)
    same = np.allclose(
        second.hips_positions[0], first.hips_positions[-1], atol=SAME_TOLERANCE
    ) and np.allclose(second.local_rotations[0], first.local_rotations[-1], atol=SAME_TOLERANCE)
    if not same and min(len(first), len(second)) > 1:
        second = _continued(first, _placed(first, second, grounds))
    gaits = None
    if first.gaits is not None and second.gaits is not None:
        gaits = np.concatenate([first.gaits, second.gaits[1:]])
    both = zip(first.arrays, second.arrays, strict=True)
    return replace(
        first.posed(*(np.concatenate([own, added[1:]]) for own, added in both)),
        prompts=_prompts(first, second),
        gaits=gaits,
        gait_seconds=gait_seconds(gaits, first.fps),
        origin=first.origin if first.origin == second.origin else UNKNOWN,
        placed=first.placed if same else None,
    )


def _prompts(first: Clip, second: Clip) -> tuple[PromptEvent, ...]:
    """Return the prompts of both clips, without repetitions."""
    later = (replace(event, seconds=event.seconds + first.seconds) for event in second.prompts)
    alike = groupby([*first.prompts, *later], attrgetter("prompt", "words"))
    return tuple(next(events) for _, events in alike)


def repeated(clip: Clip, times: int, ground: Terrain | None = None) -> Clip:
    """Return the clip repeated, each repetition starting where the last one ends, on its `ground`."""
    grounds = None if ground is None else (ground, ground)
    return reduce(lambda before, again: joined(before, again, grounds), [clip] * times)


def without(clip: Clip, first: int, last: int, ground: Terrain | None = None) -> Clip:
    """Return the clip without the frames between `first` and `last`; UsageError if nothing would be left."""
    kept = [clip.trim(0, first)] if first > 0 else []
    kept += [clip.trim(last, len(clip) - 1)] if last < len(clip) - 1 else []
    if not kept:
        raise UsageError("Nothing would be left.", "Trim to the frames to cut out.")
    grounds = None if ground is None else (ground, ground)
    return joined(kept[0], kept[1], grounds) if len(kept) == 2 else kept[0]


def _placed(first: Clip, second: Clip, grounds: Grounds | None) -> Clip:
    """Return the second clip, rotated and moved so that its root continues the first one's, on that ground."""
    before, after = root_track(first), root_track(second)
    turn = float(before.yaw[-1] - after.yaw[0])
    turned = Placement(turn).points(after.positions[0])
    x, y, z = (float(v) for v in before.positions[-1] - turned)
    placed = Placement(turn, (x, y, z)).clip(second)
    return placed if grounds is None else _on_ground(placed, second, grounds)


def _on_ground(moved: Clip, before: Clip, grounds: Grounds) -> Clip:
    """Return a moved clip with its feet as high above the first ground as they were `before` above the second."""
    (places, turns), was = moved.world(), before.world()[0][:, LEG_FEET].astype(np.float64)
    ankles, feet = places[:, LEG_FEET].astype(np.float64), turns[:, LEG_FEET].astype(np.float64)
    now, own = (ground.seen_by(moved.size) for ground in grounds)
    targets = ankles.copy()
    targets[..., 1] = was[..., 1] - own.height(was[..., 0], was[..., 2])
    targets[..., 1] += now.height(ankles[..., 0], ankles[..., 2])
    rises = targets[..., 1] - ankles[..., 1]
    if np.abs(rises).max() < SAME_TOLERANCE:
        return moved
    hips = moved.hips_positions.astype(np.float64)
    body = hips, moved.local_rotations.astype(np.float64)
    raised = hips.copy()
    raised[:, 1] += smooth(rises.min(axis=1)[:, None], SMOOTHING_S * moved.fps)[:, 0]
    solved = led_legs((raised, body[1].copy()), (targets, feet), body, (ankles, feet))
    return moved.posed(raised, rotations.normalize(solved))


def _continued(first: Clip, second: Clip) -> Clip:
    """Return the second clip continued from the pose and velocity at the end of the first."""
    fps = first.fps
    frames = np.arange(len(second)) / fps
    old, new = first.local_rotations[-2:].astype(np.float64), second.local_rotations.astype(np.float64)
    gap, speed = _turn_gap(old, new, fps)
    fade, drift = _decay(frames / BLEND_S)
    turns = fade[:, None, None] * gap + drift[:, None, None] * BLEND_S * speed
    local = rotations.multiply(rotations.from_rotation_vector(turns), new)
    hips = second.hips_positions.astype(np.float64)
    gap, speed = _gap(first.hips_positions[-2:].astype(np.float64), hips, fps)
    hips = hips + fade[:, None] * gap + drift[:, None] * BLEND_S * speed
    return _with_feet(first, second, hips, rotations.normalize(local))


def _with_feet(first: Clip, second: Clip, hips: Array, local: Array) -> Clip:
    """Return the second clip with new hips and rotations; standing feet are held, and step to their places."""
    fps, now = first.fps, second.local_rotations.astype(np.float64)
    (old, old_turns), (at, turns) = first.trim(len(first) - 2, len(first) - 1).world(), second.world()
    ankles, feet = at[:, LEG_FEET].astype(np.float64), turns[:, LEG_FEET].astype(np.float64)
    targets, goals, contacts = ankles.copy(), feet.copy(), second.contacts.copy()
    for side in range(2):
        soles = slice(2 * side, 2 * side + 2)
        stood = bool((first.contacts[-1, soles] > BEARING_CONTACT_THRESHOLD).any())
        stands = np.any(second.contacts[:, soles] > BEARING_CONTACT_THRESHOLD, axis=1)
        gap, speed = _gap(old[:, LEG_FEET[side]].astype(np.float64), ankles[:, side], fps)
        away = float(np.linalg.norm(gap[[0, 2]]))
        steps = bool(stands[0]) and (not stood or away > HELD_M)
        free = ~stands
        if steps:
            first_swing = int(np.argmax(free)) if free.any() else len(free)
            free[:first_swing] = True
        time = np.concatenate([[0.0], np.cumsum(free[1:])]) / fps / STEP_S
        fade, drift = _decay(time)
        targets[:, side] += fade[:, None] * gap
        if steps:
            contacts[: round(STEP_S * fps), soles] = 0.0
            lift = min(LIFT_FRACTION * away, MAX_LIFT_M) if stood else 0.0
            targets[:, side, 1] += lift * np.sin(np.pi * np.minimum(time, 1.0)) ** 2
        if not stood:
            targets[:, side] += drift[:, None] * STEP_S * speed
        turn, _ = _turn_gap(old_turns[:, LEG_FEET[side]].astype(np.float64), feet[:, side], fps)
        goals[:, side] = rotations.multiply(
            rotations.from_rotation_vector(fade[:, None] * turn), feet[:, side]
        )
        toe = LEG_TOES[side]
        bend, _ = _turn_gap(first.local_rotations[-2:, toe].astype(np.float64), now[:, toe], fps)
        local[:, toe] = rotations.multiply(rotations.from_rotation_vector(fade[:, None] * bend), now[:, toe])
    before = second.hips_positions.astype(np.float64), now
    solved = led_legs((hips, local), (targets, goals), before, (ankles, feet))
    return second.posed(hips, rotations.normalize(solved), contacts)


def _decay(t: Array) -> tuple[Array, Array]:
    """Return the rest at times `(T,)` in 0 to 1 of an offset of 1 at rest, and of an offset of 0 with velocity 1 (quintics)."""
    t = np.clip(t, 0.0, 1.0)
    rest = (1.0 - t) ** 3
    return rest * (1.0 + 3.0 * t + 6.0 * t * t), rest * t * (1.0 + 3.0 * t)


def _gap(old: Array, new: Array, fps: float) -> tuple[Array, Array]:
    """Return the offset from the last of two positions `(2, 3)` to the first of the new ones, and its velocity, limited."""
    speed = ((old[1] - old[0]) - (new[1] - new[0])) * fps
    return old[1] - new[0], _limited(speed, MAX_GAP_M_PER_S)


def _turn_gap(old: Array, new: Array, fps: float) -> tuple[Array, Array]:
    """Return the same for rotations `(2, ..., 4)`, as rotation vectors on the parent's side."""

    def between(a: Array, b: Array) -> Array:
        return rotations.to_rotation_vector(rotations.multiply(b, rotations.inverse(a)))

    speed = (between(old[0], old[1]) - between(new[0], new[1])) * fps
    return between(new[0], old[1]), _limited(speed, MAX_GAP_RAD_PER_S)


def _limited(speed: Array, fastest: float) -> Array:
    length = np.linalg.norm(speed, axis=-1, keepdims=True)
    return speed * np.minimum(1.0, fastest / np.maximum(length, 1e-9))
