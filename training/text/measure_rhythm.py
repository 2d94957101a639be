"""Rhythm and weight of a motion in numbers: how long, even and hard steps are, and what hips and shoulders do in them."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from runtime import rotations
from runtime.arrays import Array
from runtime.motion.features import FPS
from runtime.skeleton import SPORT_SKELETON

CYCLE_SECONDS = 1.1  # about a gait cycle, which facing and path are averaged over
_LANDING = 8  # frames before a landing in which a foot comes down
_FLICKER = 6


def landings(down: NDArray[np.bool_]) -> NDArray[np.intp]:
    """Frames where contact `(T,)` begins; gaps of up to `_FLICKER` frames are none."""
    return np.flatnonzero(np.diff(closed(down).astype(int)) == 1) + 1


def closed(down: NDArray[np.bool_], frames: int = _FLICKER) -> NDArray[np.bool_]:
    """Contact flags with gaps of up to `frames` frames filled."""
    filled = down.copy()
    edges = np.flatnonzero(np.diff(down.astype(int)))
    for a, b in pairwise(edges):
        if not down[a + 1] and b - a <= frames:
            filled[a + 1 : b + 1] = True
    return filled


def walk_ratio(step_length: float, cadence: float) -> float:
    """Metres of a step over steps per second: one number for a manner of walking at whatever speed."""
    return step_length / cadence if cadence > 0.2 else 0.0


def stance_lead(own: NDArray[np.bool_], other: NDArray[np.bool_]) -> float:
    """By which share one foot carries alone longer than the other: 0 is even, -1 is never."""
    mine, theirs = float((own & ~other).sum()), float((other & ~own).sum())
    return 2.0 * (mine - theirs) / max(mine + theirs, 1.0)


def landing_speed(height: Array, down: NDArray[np.bool_]) -> float:
    """Metres per second at which an ankle of `height` `(T,)` comes down last, median over the landings."""
    fall = -np.diff(height, prepend=height[:1]) * FPS
    found = [float(fall[max(t - _LANDING, 0) : t + 1].max()) for t in landings(down) if t > _LANDING]
    return float(np.median(found)) if found else 0.0


def halting(hips: Array) -> float:
    """Deviation of the root's speed over its mean: 0 goes evenly, pauses let it grow."""
    path = smoothed(hips[:, [0, 2]], 0.15)
    speed = np.linalg.norm(np.diff(path, axis=0), axis=1) * FPS
    return float(speed.std() / max(float(speed.mean()), 0.1))


def torso_rhythm(positions: Array, hips: Array) -> dict[str, float]:
    """Ranges of pelvis and shoulders about the facing of a cycle in degrees, and how far the course wanders, metres."""
    at = SPORT_SKELETON.index
    pelvis = positions[:, at("LeftUpLeg")] - positions[:, at("RightUpLeg")]
    shoulders = positions[:, at("LeftArm")] - positions[:, at("RightArm")]
    yaw = smoothed(np.unwrap(np.arctan2(-pelvis[:, 2], pelvis[:, 0]))[:, None], CYCLE_SECONDS)[:, 0]
    undo = rotations.inverse(rotations.from_yaw(yaw))
    hip_line, shoulder_line = rotations.rotate(undo, pelvis), rotations.rotate(undo, shoulders)
    path = smoothed(hips, CYCLE_SECONDS)
    away = path - smoothed(hips, 4.0 * CYCLE_SECONDS)
    return {
        "pelvis_yaw_range": _range(_yaw(hip_line)),
        "pelvis_roll_range": _range(_roll(hip_line)),
        "shoulder_yaw_range": _range(_yaw(shoulder_line)),
        "shoulder_roll_range": _range(_roll(shoulder_line)),
        "wander": _range(away[:, 0] * np.cos(yaw) - away[:, 2] * np.sin(yaw)),
    }


def smoothed(x: Array, seconds: float) -> Array:
    """Moving average over `seconds`, the ends padded with their own values."""
    half = int(seconds * FPS / 2)
    padded = np.pad(x, [(half, half)] + [(0, 0)] * (x.ndim - 1), mode="edge")
    total = np.cumsum(np.concatenate([np.zeros_like(padded[:1]), padded], dtype=np.float64), axis=0)
    return (total[2 * half + 1 :] - total[: -2 * half - 1]) / (2 * half + 1)


def _yaw(across: Array) -> Array:
    return np.degrees(np.arctan2(-across[:, 2], across[:, 0]))


def _roll(across: Array) -> Array:
    return np.degrees(np.arctan2(across[:, 1], np.linalg.norm(across[:, [0, 2]], axis=1)))


def _range(x: Array) -> float:
    low, high = np.percentile(x, [10, 90])
    return float(high - low)
