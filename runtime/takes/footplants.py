"""Footplant edits: a plant is lengthened, shortened, moved, added or removed.

The path of the foot is retimed: its motion between two plants takes the time left, and the leg follows by IK.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from runtime import rotations
from runtime.arrays import AnyArray, Array
from runtime.easing import smoothstep
from runtime.errors import UsageError
from runtime.feet.ik import LEG_FEET, LEG_THIGHS, LEG_TOES, solve_legs
from runtime.takes.clip import Clip
from runtime.takes.pinned import drop_to

BEARING_CONTACT_THRESHOLD = 0.5  # of a heel or toe that carries weight
LIFT_M = 0.06  # of a foot over a removed plant
MAX_WINDOW_FRAMES = 36_000  # ten minutes: a longer change is invalid
MIN_FRAMES = 2  # of a plant, and between two
EASE_FRAMES = 8  # landing time of an added plant
MAX_FRAME = 1 << 31
Frames = tuple[int, int]  # first, and one past the last


@dataclass(frozen=True)
class FootplantEdit:
    """An edit of a footplant of foot 0 (left) or 1: frames `old` become `new`; None for `old` adds it, None for `new` removes it."""

    foot: int
    old: Frames | None
    new: Frames | None


def footplants(contacts: Array) -> list[Frames]:
    """Return the frame ranges in which heel or toe of one foot is planted, from contacts `(T, 2)`."""
    return stretches(np.any(np.asarray(contacts) > BEARING_CONTACT_THRESHOLD, axis=1))


def stretches(flags: AnyArray) -> list[Frames]:
    """Return the frame ranges in which flags `(T,)` are true."""
    edges = np.flatnonzero(np.diff(flags, prepend=False, append=False))
    return [(int(first), int(end)) for first, end in edges.reshape(-1, 2)]


def fitted_footplant(known: Sequence[Frames], count: int, old: Frames | None, start: int, end: int) -> Frames:
    """Return the valid footplant nearest to frames `start` to `end`; UsageError if there is no room.

    `known` are the foot's plants in a clip of `count` frames, `old` is the one that is moved.
    """
    others = [p for p in known if p != old]
    middle = (start + end) / 2 if old is None else (old[0] + old[1]) / 2
    low, high = 0, count
    for a, b in others:
        if (a + b) / 2 <= middle:
            low = b + MIN_FRAMES
        else:
            high = min(high, a - MIN_FRAMES)
    inside = old is None and any(a <= middle < b for a, b in others)
    if inside or high - low < MIN_FRAMES:
        raise UsageError("The foot is already planted there.", "Choose frames in which it swings.")
    start = min(max(start, low), high - MIN_FRAMES)
    end = max(min(end, high), start + MIN_FRAMES)
    return start, end


def replanted(clip: Clip, edits: Sequence[FootplantEdit]) -> Clip:
    """Return the clip with footplant edits applied in order, skipping those that no longer fit."""
    return _each(clip, edits)[0]


def unfitted(clip: Clip, edits: Sequence[FootplantEdit]) -> int:
    """Return how many edits `replanted` skips because the steps of the take have changed."""
    return _each(clip, edits)[1]


def _each(clip: Clip, edits: Sequence[FootplantEdit]) -> tuple[Clip, int]:
    """Return the clip with the edits that fit, and the number of those that do not."""
    left_out, made = 0, clip
    for edit in edits:
        known = footplants(made.contacts[:, 2 * edit.foot : 2 * edit.foot + 2])
        part = _window(edit, known, len(clip))
        if not _fits(edit, known, part, len(clip)):
            left_out += 1
            continue
        if made is clip:
            made = clip.posed(*(array.copy() for array in clip.arrays))
        around = _replanted(made.trim(part.start, part.stop - 1), *_shifted(edit, known, part))
        for whole, inside in zip(made.arrays, around.arrays, strict=True):
            whole[part] = inside
    return made, left_out


def _fits(edit: FootplantEdit, known: list[Frames], part: slice, count: int) -> bool:
    there = edit.old is None or edit.old in known
    return there and max(edit.new or (0, 0)) <= count and part.stop - part.start <= MAX_WINDOW_FRAMES


def _window(edit: FootplantEdit, known: list[Frames], count: int) -> slice:
    """Return the frames that an edit can change: from the previous to the next plant, plus the hips' easing."""
    frames = [*(edit.old or ()), *(edit.new or ())]
    first, last = min(frames, default=0), max(frames, default=0)
    first = min([first, *(b for _, b in known[::-1] if b < first)][:2])
    last = max([last, *(a for a, _ in known if a > last)][:2])
    if not any(a > max(frames, default=0) for a, _ in known):
        last = count
    return slice(max(first - 4 * EASE_FRAMES, 0), min(last + 4 * EASE_FRAMES, count))


def _shifted(edit: FootplantEdit, known: list[Frames], part: slice) -> tuple[FootplantEdit, list[Frames]]:
    """Return an edit and plants with frames relative to a part of a clip."""
    low, high = part.start, part.stop

    def moved(frames: Frames | None) -> Frames | None:
        return None if frames is None else (frames[0] - low, frames[1] - low)

    inside = [(max(a, low) - low, min(b, high) - low) for a, b in known if a < high and b > low]
    return replace(edit, old=moved(edit.old), new=moved(edit.new)), inside


def _replanted(clip: Clip, edit: FootplantEdit, known: list[Frames]) -> Clip:
    positions, world = clip.world()
    ankle, toe = LEG_FEET[edit.foot], LEG_TOES[edit.foot]
    path, turns = positions[:, ankle].astype(float), world[:, ankle].astype(float)
    bends = clip.local_rotations[:, toe].astype(float)
    contacts = clip.contacts.copy()
    ours = contacts[:, 2 * edit.foot : 2 * edit.foot + 2]  # a view
    old, new = edit.old, edit.new
    if old is None and new is not None:
        path, turns = _put_down(path, turns, new)
        ours[slice(*new)] = 1.0
    elif new is None and old is not None:
        path[slice(*old), 1] += LIFT_M * np.sin(np.linspace(0.0, np.pi, old[1] - old[0])) ** 2
        ours[slice(*old)] = 0.0
    elif old is not None and new is not None:
        place = known.index(old)
        before = known[place - 1][1] if place else 0
        after = known[place + 1][0] if place + 1 < len(known) else len(clip)
        at = _retimed(len(clip), before, old, new, after)
        path, turns, bends = _sampled(path, at), _turned(turns, at), _turned(bends, at)
        ours[:] = ours[np.clip(np.round(at).astype(int), 0, len(clip) - 1)]
        ours[before : new[0]], ours[new[1] : after] = 0.0, 0.0
        still = ours[slice(*new)]
        still[:] = np.where((still > BEARING_CONTACT_THRESHOLD).any(axis=1, keepdims=True), still, 1.0)
    targets, feet = positions[:, LEG_FEET].astype(float), world[:, LEG_FEET].astype(float)
    changed = np.any(np.abs(path - targets[:, edit.foot]) > 1e-6, axis=1) | np.any(
        contacts != clip.contacts, axis=1
    )
    targets[:, edit.foot], feet[:, edit.foot] = path, turns
    drop = np.where(changed, drop_to(positions[:, LEG_THIGHS[edit.foot]], path), 0.0)
    drop -= np.where(changed, drop_to(positions[:, LEG_THIGHS[edit.foot]], positions[:, ankle]), 0.0)
    drop = _smoothed(np.maximum(drop, 0.0))
    changed |= drop > 1e-5
    hips = clip.hips_positions - (drop * changed)[:, None] * np.array([0.0, 1.0, 0.0])
    local = solve_legs(hips, clip.local_rotations.astype(float), targets, feet)
    made = clip.local_rotations.copy()
    made[changed], made[changed, toe] = local[changed], bends[changed]
    return clip.posed(hips, made, contacts)


def _smoothed(drop: Array) -> Array:
    """Return the hips' lowering, eased before and after, and nowhere less than `drop`."""
    around = np.lib.stride_tricks.sliding_window_view(np.pad(drop, EASE_FRAMES), 2 * EASE_FRAMES + 1)
    most = np.pad(around.max(axis=1), EASE_FRAMES, mode="edge")
    window = np.hanning(2 * EASE_FRAMES + 3)[1:-1]
    return np.asarray(np.convolve(most, window / window.sum(), mode="valid"))


def _put_down(path: Array, turns: Array, new: Frames) -> tuple[Array, Array]:
    """Hold the foot at its position in the middle of the new plant, at its lowest height there."""
    first, end = new
    middle = (first + end) // 2
    around = slice(max(first - EASE_FRAMES, 0), min(end + EASE_FRAMES, len(path)))
    place = path[middle].copy()
    place[1] = path[around, 1].min()
    flat = rotations.from_yaw(rotations.yaw_of(turns[middle]))
    frames = np.arange(len(path))
    away = np.maximum(np.maximum(first - frames, frames - (end - 1)), 0) / EASE_FRAMES
    weight = smoothstep(1.0 - away)
    path = path + weight[:, None] * (place - path)
    return path, rotations.slerp(turns, np.broadcast_to(flat, turns.shape), weight)


def _retimed(count: int, before: int, old: Frames, new: Frames, after: int) -> Array:
    """Return the source time (frames) of each frame, `(count,)`."""
    # the last frame of the swing stays distinct from the first one of the plant
    now = [before, new[0], new[1] - 1, after]
    then = [before, old[0], old[1] - 1, after]
    at = np.arange(count, dtype=float)
    part = slice(before, min(after + 1, count))
    at[part] = np.interp(at[part], now, then) if new[0] > before else np.interp(at[part], now[1:], then[1:])
    return at


def _sampled(path: Array, at: Array) -> Array:
    return np.stack([np.interp(at, np.arange(len(path)), path[:, k]) for k in range(3)], axis=1)


def _turned(turns: Array, at: Array) -> Array:
    low = np.clip(np.floor(at).astype(int), 0, len(turns) - 1)
    high = np.minimum(low + 1, len(turns) - 1)
    return rotations.slerp(turns[low], turns[high], at - low)
