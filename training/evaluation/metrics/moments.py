"""Measures of transitions from world positions: starts, stops, turns and jumps.

Points are world positions `(T, 3)` by the keys of `training.data.gait` at 60 frames per second, of a body with 0.82 m legs;
speeds are m/s, angles degrees. The measures are independent of the program's controller, so that raw capture can be
measured too.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d
from scipy.signal import find_peaks

from runtime.arrays import Array
from runtime.controls import Gait
from runtime.formats.bvh import read_bvh
from runtime.motion.control_scripts import StickScript, StickSegment
from runtime.takes.footplants import stretches
from training.data.gait import GaitJoints, angle

FPS = 60
STANDING_SPEED_M_PER_S = 0.08  # of the smoothed hips: slower is standing
CALM_LIMBS_M_PER_S = 0.25  # of head, wrists and knees relative to the hips
REACHED_SPEED_FRACTION = 0.9  # of the steady speed, which ends a start
MIN_POP_DEG_PER_FRAME2 = 6.0  # captured knees have no pops
POP_FRAMES = 6  # nearer ones are the same pop
HIPS_SIGMA_FRAMES, YAW_SIGMA_FRAMES = 6, 2  # of Gaussians
BEGIN_FRAMES = round(1.5 * FPS)  # duration of a start or turn
BEFORE_STOP_S = 1.5  # of steady movement before a stop
SETTLED_FRAMES = FPS  # after which a standing body is at rest
NEAR_GROUND_M = 0.01  # above a toe's resting height
MIN_TURN_DEG_PER_S = 60.0  # of the hips: slower rotation is swing
IN_AIR_M = 0.04  # of both toes above their resting height
LIMBS = ("lw", "rw", "head", "lk", "rk")
Points = dict[str, Array]


# a segment of the stick script: `kind` ("start", "stop", "turn", "spin" (a turn on the spot), "change" (of gait), "steady",
# "stand", "jump"), its `gait` ("half walk" at half deflection), `first` and last frame (`end`), and `figures`
Moment = dict[str, Any]


def read_points(path: Path) -> Points:
    """Read joints of a BVH of any known skeleton, resampled to 60 frames per second."""
    joints = GaitJoints.of(read_bvh(path))
    count = len(joints.points["hips"])
    if abs(joints.fps - FPS) < 1.0:
        return joints.points
    seconds = np.arange(count) / joints.fps
    at = np.arange(0.0, seconds[-1], 1.0 / FPS)
    return {
        k: np.stack([np.interp(at, seconds, v[:, i]) for i in range(3)], -1) for k, v in joints.points.items()
    }


# --- curves ----------------------------------------------------------------------------------------------------------


def speed(points: Array) -> Array:
    """Return the speed `(T,)` in m/s of points `(T, 2)` or `(T, 3)`."""
    return np.asarray(np.linalg.norm(np.gradient(points, axis=0) * FPS, axis=-1))


def hips_speed(p: Points) -> Array:
    """Return the horizontal speed of the hips, smoothed over 0.1 s."""
    return np.asarray(gaussian_filter1d(speed(p["hips"][:, [0, 2]]), HIPS_SIGMA_FRAMES))


def hips_turn(p: Points) -> Array:
    """Return the absolute yaw rate of the hip line, degrees per second."""
    across = p["lh"] - p["rh"]
    yaw = np.degrees(np.unwrap(np.arctan2(-across[:, 2], across[:, 0])))
    return np.abs(np.gradient(gaussian_filter1d(yaw, YAW_SIGMA_FRAMES))) * FPS


def bend(p: Points, joint: str, upper: str, lower: str) -> Array:
    """Return the flexion of a joint between two others, degrees `(T,)`."""
    return angle(p[joint] - p[upper], p[lower] - p[joint])


def pops(flexion: Array) -> NDArray[np.intp]:
    """Return the first frame of each pop: second difference of a flexion `(T,)` above `MIN_POP_DEG_PER_FRAME2`."""
    found = np.flatnonzero(np.abs(np.diff(flexion, n=2)) > MIN_POP_DEG_PER_FRAME2) + 1
    return found[np.diff(found, prepend=-1 - POP_FRAMES) > POP_FRAMES]


def joint_pops(p: Points) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return the frames of pops of both knees, and of both elbows."""
    knees = [pops(bend(p, s + "k", s + "h", s + "a")) for s in "lr"]
    elbows = [pops(bend(p, s + "e", s + "s", s + "w")) for s in "lr"]
    return np.sort(np.concatenate(knees)), np.sort(np.concatenate(elbows))


def toe_heights(p: Points, resting: NDArray[np.bool_]) -> Array:
    """Return heights of both toe joints `(T, 2)` above their median in `resting` frames `(T,)`; no columns if unknown."""
    if "lt" not in p or not resting.any():
        return np.zeros((len(p["hips"]), 0))
    heights = np.stack([p["lt"][:, 1], p["rt"][:, 1]], -1)
    return np.asarray(heights - np.median(heights[resting], axis=0))


def paths_near_ground(toe: Array, height: Array) -> list[float]:
    """Return the horizontal path length in cm of a toe `(T, 3)` in each period within `NEAR_GROUND_M` of its resting height."""
    steps = np.linalg.norm(np.diff(toe[:, [0, 2]], axis=0), axis=-1)
    return [100.0 * float(steps[a : b - 1].sum()) for a, b in stretches(height < NEAR_GROUND_M)]


class Curves:
    """Curves of a clip, and figures of events between two of its frames."""

    def __init__(self, p: Points, resting: NDArray[np.bool_] | None = None) -> None:
        """`resting` `(T,)`: frames in which the body stands; by default those with slow hips."""
        self.p, self.hips, self.turn = p, hips_speed(p), hips_turn(p)
        up = p["neck"] - p["hips"]
        self.tilt = np.degrees(np.arctan2(np.linalg.norm(up[:, [0, 2]], axis=-1), up[:, 1]))
        self.wrists = np.stack([speed(p[w] - p["hips"]) for w in ("lw", "rw")], -1)
        self.limbs = np.max([speed(p[k] - p["hips"]) for k in LIMBS], axis=0)
        self.toes = toe_heights(p, self.hips < STANDING_SPEED_M_PER_S if resting is None else resting)

    def start_figures(self, first: int, end: int, steady: float | None = None) -> dict[str, float]:
        """Measure a start from rest to a `steady` speed, by default that of the last second."""
        last_second = self.hips[first + max(end - first - FPS, (end - first) // 2) : end]
        if steady is None:
            steady = float(np.median(last_second))
        reached = np.flatnonzero(self.hips[first:end] > REACHED_SPEED_FRACTION * steady)
        begin = slice(first, min(end, first + BEGIN_FRAMES))
        return {
            "reached_s": float(reached[0]) / FPS if len(reached) else float("inf"),
            "peak_ratio": float(self.hips[begin].max()) / max(steady, 1e-6),
            "surge_ratio": float(last_second.max()) / max(steady, 1e-6),
            "tilt": float(self.tilt[begin].max()),
        } | self._toe_paths(begin)

    def stop_figures(self, first: int, end: int, until: int | None = None) -> dict[str, float]:
        """Measure a stop to rest, from a speed that is steady `until` a frame; later motion affects the last two frames."""
        stopped = np.flatnonzero(self.hips[first:end] < STANDING_SPEED_M_PER_S)
        stop = float(stopped[0]) / FPS if len(stopped) else float("inf")
        busy = np.flatnonzero(self.limbs[first : end - 2] > CALM_LIMBS_M_PER_S)
        settled = float(busy[-1] + 1) / FPS if len(busy) else 0.0
        until = max(first - 1, 1) if until is None else until
        steady = self.wrists[max(first - round(BEFORE_STOP_S * FPS), 0) : until].max()
        return {
            "stop_s": stop,
            "calm_after_s": max(settled - stop, 0.0),
            "wrists_ratio": float(self.wrists[first : end - 2].max() / max(steady, 1e-6)),
            "tilt": float(self.tilt[first:end].max()),
        }

    def turn_figures(self, first: int, end: int) -> dict[str, float]:
        """Measure the highest yaw rate of a turn."""
        fastest, tilt = float(self.turn[first:end].max()), float(self.tilt[first:end].max())
        return {"turn": fastest, "tilt": tilt} | self._toe_paths(slice(first, min(end, first + BEGIN_FRAMES)))

    def jump_figures(self, first: int, end: int) -> dict[str, float]:
        """Measure the time until both toes leave the ground, and the rise of the hips."""
        known = self.toes.shape[1] > 0
        air = np.flatnonzero((self.toes[first:end] > IN_AIR_M).all(-1) & known)
        height = self.p["hips"][:, 1]
        rise = height[first:end].max() - np.median(height[max(first - FPS, 0) : first + 1])
        return {
            "take_off_s": float(air[0]) / FPS if len(air) > 3 else float("inf"),
            "rise_cm": 100.0 * float(rise),
        }

    def _toe_paths(self, w: slice) -> dict[str, float]:
        """Return the 90th percentile of `paths_near_ground` in a window."""
        toes = zip(("lt", "rt"), self.toes.T, strict=False)
        paths = [path for key, heights in toes for path in paths_near_ground(self.p[key][w], heights[w])]
        return {"toe_path_cm": float(np.percentile(paths, 90))} if paths else {}


# --- moments of a script -----------------------------------------------------------------------------------------------


def moments(p: Points, script: StickScript) -> list[Moment]:
    """Measure every segment of the stick script."""
    curves = Curves(p, _resting(script, len(p["hips"])))
    of = {
        "start": curves.start_figures,
        "stop": curves.stop_figures,
        "turn": curves.turn_figures,
        "spin": curves.turn_figures,
        "jump": curves.jump_figures,
    }
    found = []
    for kind, gait, first, end in _segments(script, len(p["hips"])):
        figures = of[kind](first, end) if kind in of else {}
        found.append({"kind": kind, "gait": gait, "first": first, "end": end, "figures": figures})
    return found


def _segments(script: StickScript, frames: int) -> Iterator[tuple[str, str, int, int]]:
    """Yield kind, gait, first frame and end of every segment within the clip."""
    first, before = 0, StickSegment(Gait.STAND, 1.0)
    for segment in script.segments:
        end = min(first + round(segment.seconds * FPS), frames)
        if end - first >= 2:
            kind = _kind(segment, before)
            yield kind, _gait(before if kind in ("stop", "jump") else segment), first, end
        first = end
        if segment.gait != Gait.JUMP:
            before = segment


def _kind(segment: StickSegment, before: StickSegment) -> str:
    rests, turned = _rests(segment), segment.facing != before.facing
    if segment.gait == Gait.JUMP:
        return "jump"
    if rests != _rests(before):
        return "stop" if rests else "start"
    if rests:
        return "spin" if turned and segment.facing is not None else "stand"
    if turned or segment.heading != before.heading:
        return "turn"
    return "steady" if (segment.gait, segment.amount) == (before.gait, before.amount) else "change"


def _gait(segment: StickSegment) -> str:
    part = {0.0: "", 1.0: "", 0.5: "half "}.get(segment.amount, f"{segment.amount:g} ")
    return part + segment.gait.label


def _rests(segment: StickSegment) -> bool:
    return segment.gait == Gait.STAND or segment.amount == 0.0


def _resting(script: StickScript, frames: int) -> NDArray[np.bool_]:
    """Return the frames in which the body stands; all frames if the stick never rests for long."""
    result = np.zeros(frames, bool)
    for kind, _, first, end in _segments(script, frames):
        if kind in ("stand", "stop", "spin"):
            result[first + (0 if first == 0 else 2 * SETTLED_FRAMES) : end] = True
    return result if result.any() else np.ones(frames, bool)


def whole_clip(p: Points, script: StickScript) -> dict[str, float]:
    """Measure knee and elbow pops per minute outside and in jumps, and toe height above resting, cm (0.1th percentile)."""
    jumps = np.zeros(len(p["hips"]), bool)
    for kind, _, first, end in _segments(script, len(jumps)):
        jumps[first:end] |= kind == "jump"
    result = {}
    for name, frames in zip(("knee_pops", "elbow_pops"), joint_pops(p), strict=True):
        for there, title in ((~jumps, name), (jumps, name + "_in_jumps")):
            if there.any():
                result[title] = float(there[frames].sum()) / (there.sum() / FPS / 60.0)
    toes = toe_heights(p, _resting(script, len(p["hips"])))
    if toes.size:
        result["toe_under_cm"] = 100.0 * float(np.percentile(toes, 0.1))
    return result


# --- raw capture, without a stick script ------------------------------------------------------------------------------


def raw_start(p: Points) -> dict[str, float]:
    """Measure the start in a take that begins at rest: from the first movement to 90 % of the steady speed."""
    curves, steady, reached = _going(p)
    begins = np.flatnonzero(curves.hips[: reached[0] + 1] < STANDING_SPEED_M_PER_S)
    return curves.start_figures(int(begins[-1]) if len(begins) else 0, len(curves.hips), steady)


def raw_stop(p: Points) -> dict[str, float]:
    """Measure the stop in a take that ends at rest: from the last frame at 90 % of the steady speed to standing."""
    curves, _, reached = _going(p)
    last = int(reached[-1])
    stands = (curves.hips[last:] < STANDING_SPEED_M_PER_S).any()
    return curves.stop_figures(last, len(curves.hips) + 2, last + 1) if stands else {}


def _going(p: Points) -> tuple[Curves, float, NDArray[np.intp]]:
    """Return the curves of a take, its steady speed, and the frames that reach 90 % of it."""
    curves = Curves(p)
    steady = float(np.median(curves.hips[curves.hips > 0.5 * curves.hips.max()]))
    return curves, steady, np.flatnonzero(curves.hips > REACHED_SPEED_FRACTION * steady)


def raw_turns(p: Points) -> dict[str, float]:
    """Return the 90th percentile of peak yaw rates over all turns of the hips in a take, at most one per second."""
    turn = hips_turn(p)
    peaks, _ = find_peaks(turn, height=MIN_TURN_DEG_PER_S, distance=FPS)
    return {"turn": float(np.percentile(turn[peaks], 90))} if len(peaks) else {}


def raw_pops(p: Points) -> dict[str, float]:
    """Return knee and elbow pops per minute."""
    minutes = len(p["hips"]) / FPS / 60.0
    knees, elbows = joint_pops(p)
    return {"knee_pops": len(knees) / minutes, "elbow_pops": len(elbows) / minutes}


def raw_jumps(p: Points) -> dict[str, float]:
    """Return knee and elbow pops per minute of a take with continuous jumps."""
    return {f"{key}_in_jumps": value for key, value in raw_pops(p).items()}
