"""Gait biomechanics of a walk in a BVH: the same measures for raw capture and for exports.

Lengths are scaled to a leg of 0.82 m (hip, knee, ankle), angles are degrees; all refer to the steady walking part.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from runtime.arrays import Array
from runtime.atomic import temporary_folder
from runtime.formats.bvh import BvhMotion, read_bvh
from runtime.formats.bvh_clip import save_bvh
from runtime.takes.clip import Clip

Measured = TypeVar("Measured")

LEG_M = 0.82
MIN_SPEED, MAX_SPEED = 0.55, 2.2  # m/s of the hips: slower is standing, faster is running
LOW_PERCENTILE, HIGH_PERCENTILE = 3.0, 97.0  # that bound a range of motion
MIN_STRIDES, STRIDE_SAMPLES = 5, 50
STRIDE_S = (0.7, 2.2)  # a stride is two steps
MIN_STRIKE_INTERVAL_S, MIN_STRIDE_M = 0.2, 0.1  # between heel strikes; foot ahead of the hips
STRAIGHT_RAD_PER_S = 0.6  # turn of a straight walk
_UP = np.array([0.0, 1.0, 0.0])


def _names() -> dict[str, tuple[str, ...]]:
    """Map our joint keys to lower-case names in known files; the first one present is used."""
    names = {"hips": ("hips", "hip"), "neck": ("neck", "neck1"), "head": ("head",)}
    for c, side in (("l", "left"), ("r", "right")):
        names |= {
            c + "h": (f"{side}upleg", f"{side}upperleg", f"{side}hip", f"upperleg_{c}", f"{c}thigh"),
            c + "k": (f"{side}leg", f"{side}lowerleg", f"{side}knee", f"lowerleg_{c}", f"{c}shin"),
            c + "a": (f"{side}foot", f"{side}ankle", f"foot_{c}", f"{c}foot"),
            c + "t": (f"{side}toebase", f"{side}toes", f"{side}toe", f"toes_{c}"),
            c + "s": (f"{side}arm", f"{side}upperarm", f"upperarm_{c}", f"{c}shldr", f"{side}shoulder"),
            c + "e": (f"{side}forearm", f"{side}lowerarm", f"{side}elbow", f"lowerarm_{c}", f"{c}forearm"),
            c + "w": (f"{side}hand", f"{side}wrist", f"hand_{c}", f"{c}hand"),
        }
    return names


@dataclass(frozen=True)
class GaitJoints:
    """World positions `(T, 3)` by key (`hips`, `neck`, `lh` left hip, `lk` knee, `la` ankle, `lt` toe, ...)."""

    points: dict[str, Array]
    fps: float

    @staticmethod
    def of(motion: BvhMotion, first_frame: int = 0) -> GaitJoints:
        """Read a BVH of any known skeleton, at 60 frames per second or its own rate if lower."""
        positions = motion.world()[0][first_frame:].astype(np.float64)
        low = [n.lower().split(":")[-1] for n in motion.skeleton.names]
        found: dict[str, Array] = {}
        for key, candidates in _names().items():
            known = [n for n in candidates if n in low]
            if known:
                found[key] = positions[:, low.index(known[0])]
        return GaitJoints.scaled(found, motion.fps)

    @staticmethod
    def scaled(points: dict[str, Array], fps: float) -> GaitJoints:
        """Scale points to a leg of LEG_M."""
        p = points
        leg = np.median(_norm(p["lh"] - p["lk"]) + _norm(p["lk"] - p["la"]))
        step = round(fps / 60) if fps > 61 else 1
        return GaitJoints({k: v[::step] * (LEG_M / leg) for k, v in p.items()}, fps / step)


def measure_file(path: Path, first_frame: int = 0) -> dict[str, float] | None:
    """Measure a BVH file, see `measure`."""
    return measure(GaitJoints.of(read_bvh(path), first_frame))


def measured_exports(clips: Iterable[Clip], measured: Callable[[Path], Measured]) -> list[Measured]:
    """Measure the exported BVH of each clip."""
    with temporary_folder() as folder:
        return [measured(save_bvh(clip, folder / "clip.bvh")) for clip in clips]


def walking(joints: GaitJoints) -> NDArray[np.bool_]:
    """Return frames `(T,)` at walking speed, without the first second."""
    hips, fps = joints.points["hips"], joints.fps
    if len(hips) <= int(fps * 0.5):
        return np.zeros(len(hips), bool)
    v = _speed(hips, fps)
    mask = (v > MIN_SPEED) & (v < MAX_SPEED)
    mask[: int(fps)] = False
    return mask


def _speed(hips: Array, fps: float) -> Array:
    """Return the horizontal speed `(T,)` in m/s, over half a second."""
    n = int(fps * 0.5)
    v = _norm((hips[n:] - hips[:-n])[:, [0, 2]]) / (n / fps)
    return np.concatenate([v[:1].repeat(n // 2), v, v[-1:].repeat(len(hips) - len(v) - n // 2)])


def measure(joints: GaitJoints, mask: NDArray[np.bool_] | None = None) -> dict[str, float] | None:
    """Return measures over walking frames; None if they are fewer than two seconds.

    Body and limbs are measured on straight walking only, because in a curve a body leans and turns further.
    """
    fps = joints.fps
    m = walking(joints) if mask is None else mask
    if m.sum() < 2 * fps:
        return None
    p = joints.points
    forward = np.cross(p["lh"] - p["rh"], _UP)
    forward[:, 1] = 0.0
    forward /= _norm(forward)[:, None]
    heading = np.stack([_second(forward[:, i], fps) for i in range(3)], -1)
    heading /= _norm(heading)[:, None]
    side = np.cross(_UP, heading)
    turn = np.abs(np.gradient(np.unwrap(np.arctan2(heading[:, 0], heading[:, 2])))) * fps
    straight = m & (_second(turn, fps) < STRAIGHT_RAD_PER_S)
    if straight.sum() < 2 * fps:  # walks only in curves
        straight = m
    result = _pace(p, heading, m, fps)
    result |= _trunk(p, forward, heading, side, straight, fps)
    result |= _limbs(p, heading, straight)
    if "lt" in p:
        result |= _feet(p, straight)
    return result | _variation(p, heading, side, turn, m, fps)


def _pace(p: dict[str, Array], heading: Array, m: NDArray[np.bool_], fps: float) -> dict[str, float]:
    ahead = _dot(p["la"] - p["ra"], heading)[m]
    ahead = ahead - ahead.mean()
    steps = int((np.diff(np.signbit(ahead).astype(np.int8)) != 0).sum())
    speed, cadence = float(np.median(_speed(p["hips"], fps)[m])), 60.0 * steps / (m.sum() / fps)
    return {"speed": speed, "cadence": cadence}


def _trunk(
    p: dict[str, Array], forward: Array, heading: Array, side: Array, m: NDArray[np.bool_], fps: float
) -> dict[str, float]:
    height = p["hips"][:, 1]
    yaw = np.degrees(np.arcsin(np.clip(np.cross(heading, forward)[:, 1], -1, 1)))
    hips, shoulders = p["lh"] - p["rh"], p["ls"] - p["rs"]
    roll = np.degrees(np.arcsin(hips[:, 1] / _norm(hips)))
    turn = np.degrees(np.arctan2(_dot(shoulders, heading), _dot(shoulders, side)))
    up = p["neck"] - p["hips"] if "neck" in p else p["head"] - p["hips"]
    return {
        "bob_cm": 100.0 * _range((height - _second(height, fps))[m]),
        "pelvis_yaw": _range(yaw[m]),
        "pelvis_roll": _range((roll - _second(roll, fps))[m]),
        "shoulder_yaw": _range((turn - _second(turn, fps))[m]),
        "lean": float(np.median(np.degrees(np.arctan2(_dot(up, heading), up[:, 1]))[m])),
    }


def _limbs(p: dict[str, Array], heading: Array, m: NDArray[np.bool_]) -> dict[str, float]:
    swings, elbows, knees = [], [], []
    for c in "lr":
        swings.append(100.0 * _range(_dot(p[c + "w"] - p[c + "s"], heading)[m]))
        knee = angle(p[c + "k"] - p[c + "h"], p[c + "a"] - p[c + "k"])[m]
        knees.append(_percentiles(knee))
        elbows.append(angle(p[c + "e"] - p[c + "s"], p[c + "w"] - p[c + "e"])[m])
    knee_min, knee_max = (0.5 * (left + right) for left, right in zip(*knees, strict=True))
    clearance = [_range(p[a][:, 1][m]) for a in ("la", "ra")]
    return {
        "knee_min": knee_min,
        "knee_max": knee_max,
        "arm_swing_cm": float(np.mean(swings)),
        "elbow": float(np.median(np.concatenate(elbows))),
        "clearance_cm": 100.0 * float(np.mean(clearance)),
    }


def _feet(p: dict[str, Array], m: NDArray[np.bool_]) -> dict[str, float]:
    pitch = []
    for c in "lr":
        foot = p[c + "t"] - p[c + "a"]
        pitch.append(np.degrees(np.arctan2(foot[:, 1], _norm(foot[:, [0, 2]])))[m])
    both = np.stack(pitch)
    both = both - np.median(both)
    return {"foot_up": _percentiles(both)[1]}


def _variation(
    p: dict[str, Array], heading: Array, side: Array, turn: Array, m: NDArray[np.bool_], fps: float
) -> dict[str, float]:
    """Return the variation between straight strides, cm: of the paths of both hands, the highest point of a hand, and the
    left step length. Empty for fewer than `MIN_STRIDES`."""
    strides = _straight_strides(p, heading, turn, m, fps)
    if len(strides) < MIN_STRIDES:
        return {}
    hands, tops = [], []
    for key in ("lw", "rw"):
        away = p[key] - p["hips"]
        seen = np.stack([_dot(away, side), away[:, 1], _dot(away, heading)], -1)
        moments = np.stack([np.linspace(first, last, STRIDE_SAMPLES) for first, last in strides])
        paths = np.stack([np.interp(moments, np.arange(len(seen)), seen[:, i]) for i in range(3)], -1)
        hands.append(100.0 * float(np.sqrt(paths.var(0, ddof=1).sum(-1).mean())))
        tops.append(100.0 * float(paths[..., 1].max(1).std(ddof=1)))
    lengths = _dot(p["la"] - p["ra"], heading)[[first for first, _ in strides]]
    return {
        "hands_vary_cm": float(np.mean(hands)),
        "tops_vary_cm": float(np.mean(tops)),
        "steps_vary_cm": 100.0 * float(lengths.std(ddof=1)),
    }


def _straight_strides(
    p: dict[str, Array], heading: Array, turn: Array, m: NDArray[np.bool_], fps: float
) -> list[tuple[int, int]]:
    """Return first and last frame of all straight strides, between frames with the left foot farthest ahead."""
    from scipy.ndimage import maximum_filter1d

    ahead, near = _dot(p["la"] - p["hips"], heading), int(MIN_STRIKE_INTERVAL_S * fps)
    farthest = maximum_filter1d(ahead, 2 * near + 1)
    strikes = np.flatnonzero((ahead == farthest) & (ahead > MIN_STRIDE_M))
    return [
        (int(first), int(last))
        for first, last in pairwise(strikes)
        if STRIDE_S[0] < (last - first) / fps < STRIDE_S[1]
        and m[first:last].all()
        and turn[first:last].max() < STRAIGHT_RAD_PER_S
    ]


def median(measured: Iterable[dict[str, float]]) -> dict[str, float]:
    """Return the median of every measure over the entries that have it."""
    values: dict[str, list[float]] = {}
    for key, value in (item for m in measured for item in m.items()):
        values.setdefault(key, []).append(value)
    return {key: float(np.median(found)) for key, found in values.items()}


def _second(values: Array, fps: float) -> Array:
    """Return the moving average over one second."""
    k = int(fps) | 1
    return np.convolve(np.pad(values, k // 2, mode="edge"), np.ones(k) / k, "valid")


def _percentiles(values: Array) -> tuple[float, float]:
    low, high = np.percentile(values, [LOW_PERCENTILE, HIGH_PERCENTILE])
    return float(low), float(high)


def _range(values: Array) -> float:
    low, high = _percentiles(values)
    return high - low


def _dot(a: Array, b: Array) -> Array:
    return np.sum(a * b, axis=-1)


def _norm(v: Array) -> Array:
    return np.linalg.norm(v, axis=-1)


def angle(a: Array, b: Array) -> Array:
    """Return the angle `(...)` in degrees between vectors `(..., 3)`."""
    return np.degrees(np.arccos(np.clip(_dot(a, b) / (_norm(a) * _norm(b)), -1.0, 1.0)))
