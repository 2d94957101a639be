"""Cutting of clips: removes lead-ins and spikes, and splits clips into training and held-out parts."""

import hashlib
from collections import Counter, defaultdict

import numpy as np
from numpy.typing import NDArray

from runtime import rotations
from runtime.arrays import Array
from runtime.takes.footplants import stretches
from training.data.labels import smooth
from training.data.retarget import FPS, speed

MIN_PART_S = 1.5
MAX_ROOT_M_PER_S = 8.0
MAX_ESTIMATED_M_PER_S2 = 45.0  # of a root that was estimated from contacts
MAX_JOINT_M_PER_S2 = 600.0  # the ankles of a sprint reach 400
MAX_JOINT_TURN = np.deg2rad(35.0)  # between two frames at 60 Hz
HELD_OUT_FRACTION = 0.08
TAIL_S = 20.0  # the tail of longer takes is held out
GAP_S = 2.0  # between training part and tail, so that no training window contains held-out frames

_LEFT_ARM, _RIGHT_ARM = 18, 25


def lead_in(positions: Array, content: str, has_tpose: bool) -> tuple[int, int]:
    """Return first and end frame without T-poses and long waits at both ends of `positions` `(T, 31, 3)`."""
    frames = len(positions)
    pace = speed(smooth(positions[:, 0] * np.array([1.0, 0, 1.0]), 0.3))
    tpose = _is_tpose(positions) & (pace < 0.3) & has_tpose
    third = frames // 3
    head = np.flatnonzero(tpose[:third])
    tail = np.flatnonzero(tpose[-third:])
    start = head[-1] + round(0.7 * FPS) if len(head) else 0
    end = frames - third + tail[0] - round(0.7 * FPS) if len(tail) else frames
    if "idle" not in content and "wave" not in content and "raise" not in content:
        moving = np.flatnonzero(smooth(pace, 0.5)[start:end] > 0.4)
        if len(moving):
            end = min(end, start + int(moving[-1]) + round(FPS))
            start = max(start, start + int(moving[0]) - round(FPS))
    return int(max(start, 0)), int(max(end, start))


def _is_tpose(positions: Array) -> NDArray[np.bool_]:
    """Return frames where both arms are stretched out horizontally to the sides."""
    result = np.ones(len(positions), bool)
    across = rotations.normalize(positions[:, _LEFT_ARM] - positions[:, _RIGHT_ARM])
    for arm, sign in ((_LEFT_ARM, 1.0), (_RIGHT_ARM, -1.0)):
        reach = rotations.normalize(positions[:, arm + 2] - positions[:, arm])
        result &= (np.sum(reach * across, axis=-1) * sign > 0.88) & (np.abs(reach[:, 1]) < 0.35)
    return result


def spikes(hips: Array, local: Array, positions: Array, tier: str) -> NDArray[np.bool_]:
    """Return frames `(T,)` with impossible motion of root or joints; `positions` `(T, 31, 3)` are the joints'."""
    from scipy.ndimage import binary_dilation

    bad = speed(hips) > MAX_ROOT_M_PER_S
    jerked = np.linalg.norm(np.diff(positions, 2, axis=0), axis=-1).max(axis=1) * FPS**2 > MAX_JOINT_M_PER_S2
    bad[1:-1] |= jerked
    turn = rotations.angle_between(local[:-1], local[1:]).max(axis=1)
    bad[1:] |= turn > MAX_JOINT_TURN
    if tier == "estimated_root":
        acceleration = np.linalg.norm(np.gradient(np.gradient(smooth(hips, 0.05), axis=0), axis=0), axis=-1)
        bad |= acceleration * FPS**2 > MAX_ESTIMATED_M_PER_S2
    return binary_dilation(bad, iterations=4) if bad.any() else bad


def segments(start: int, end: int, bad: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Return stretches of good frames in [start, end) that are long enough for training."""
    good = ~bad
    good[:start] = False
    good[end:] = False
    return [(a, b) for a, b in stretches(good) if b - a >= MIN_PART_S * FPS]


def hash_fraction(name: str) -> float:
    """Return a hash of the name in [0, 1)."""
    return int.from_bytes(hashlib.sha256(name.encode()).digest()[:6], "big") / 2**48


def held_out_names(clips: list[tuple[str, str, str]]) -> set[str]:
    """Choose clips (name, style, content) to hold out entirely: about 8 %, at least one of a style with four or more clips.

    The only example of a style and content stays in training.
    """
    count = Counter((style, content) for _, style, content in clips)
    spare: dict[str, list[str]] = defaultdict(list)
    for name, style, content in clips:
        if count[style, content] > 1:
            spare[style].append(name)
    size, held = Counter(style for _, style, _ in clips), set[str]()
    for style, names in spare.items():
        own = {name for name in names if hash_fraction(name) < HELD_OUT_FRACTION}
        held |= own or ({min(names, key=hash_fraction)} if size[style] >= 4 else set())
    return held


def tail_split(start: int, end: int) -> list[tuple[int, int, str]]:
    """Split a long take, the only one of its style and content, into training part and held-out tail."""
    tail = max(round(HELD_OUT_FRACTION * (end - start)), round(4.0 * FPS))
    cut = end - tail
    return [(start, cut - round(GAP_S * FPS), "train"), (cut, end, "held_out")]
