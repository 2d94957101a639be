"""The first and the last second of everything: `python -m training.evaluation moments`, starts, stops, turns and jumps.

Clips are those of the public `generate_clip`, exported, and measured on the exported BVH alone, second by second of a known
stick. Points are world positions `(T, 3)` by the keys of `training.data.gait` at 60 frames a second, in a body with 0.82 m
legs; speeds are m/s, angles degrees. The measures know nothing of how the program moves a character, so that raw capture is
measured alike.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d
from scipy.signal import find_peaks

from runtime.arrays import Array
from runtime.controls import Gait
from runtime.errors import UsageError
from runtime.formats.bvh import read_bvh
from runtime.formats.bvh_clip import save_bvh
from runtime.generate import clip_of
from runtime.motion.control_scripts import StickScript, StickSegment, parse_stick
from runtime.motion.controller import Controller
from runtime.takes.clip import Clip
from runtime.terrain.library import load_terrain
from training.data.gait import GaitJoints
from training.evaluation.experiment import Arguments, Experiment, Setting, option
from training.evaluation.motion.driving import walk_together
from training.markdown import table

FPS = 60
STILL = 0.08  # m/s of the smoothed hips: slower is standing
CALM = 0.25  # m/s of head, wrists and knees against the hips
REACHED = 0.9  # of the steady speed
POP = 6.0  # degrees a frame squared: a captured knee has none
POP_APART = 6  # frames; nearer ones are one pop
SMOOTH_HIPS, SMOOTH_YAW = 6, 2  # frames, of a Gaussian
BEGIN = round(1.5 * FPS)  # frames of a start or turn
LAST = 1.5  # seconds of steady going before a stop
SETTLED = FPS  # frames after which a standing body is at rest
NEAR_GROUND = 0.01  # m over a toe's resting height
TURNING = 60.0  # degrees a second: slower hips do not turn, they swing
IN_AIR = 0.04  # m of both toes over their resting height
LIMBS = ("lw", "rw", "head", "lk", "rk")
Points = dict[str, Array]


@dataclass(frozen=True)
class Moment:
    """What happens in a segment of the stick: its kind, its gait, its first and last frame and its figures."""

    kind: str  # "start", "stop", "turn", "spin" (a turn on the spot), "change" (of gait), "steady", "stand", "jump"
    gait: str  # which is started, stopped or gone in; "half walk" with half of the stick
    first: int
    end: int
    figures: dict[str, float]


def read_points(path: Path) -> Points:
    """Joints of a BVH of any known skeleton, resampled to 60 frames a second."""
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
    """Of points `(T, 2)` or `(T, 3)`, m/s `(T,)`."""
    return np.asarray(np.linalg.norm(np.gradient(points, axis=0) * FPS, axis=-1))


def hips_speed(p: Points) -> Array:
    """Over the ground, smoothed over 0.1 s."""
    return np.asarray(gaussian_filter1d(speed(p["hips"][:, [0, 2]]), SMOOTH_HIPS))


def hips_turn(p: Points) -> Array:
    """Degrees a second at which the line across the hips turns, without sign."""
    across = p["lh"] - p["rh"]
    yaw = np.degrees(np.unwrap(np.arctan2(-across[:, 2], across[:, 0])))
    return np.abs(np.gradient(gaussian_filter1d(yaw, SMOOTH_YAW))) * FPS


def bend(p: Points, joint: str, upper: str, lower: str) -> Array:
    """Flexion of a joint between two others, degrees `(T,)`."""
    a, b = p[joint] - p[upper], p[lower] - p[joint]
    cosine = (a * b).sum(-1) / (np.linalg.norm(a, axis=-1) * np.linalg.norm(b, axis=-1))
    return np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0)))


def pops(flexion: Array) -> NDArray[np.intp]:
    """Frames at which a flexion `(T,)` bends its course by more than POP: the first of each pop."""
    found = np.flatnonzero(np.abs(np.diff(flexion, n=2)) > POP) + 1
    return found[np.diff(found, prepend=-1 - POP_APART) > POP_APART]


def joint_pops(p: Points) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Frames of the pops of both knees, and of both elbows."""
    knees = [pops(bend(p, s + "k", s + "h", s + "a")) for s in "lr"]
    elbows = [pops(bend(p, s + "e", s + "s", s + "w")) for s in "lr"]
    return np.sort(np.concatenate(knees)), np.sort(np.concatenate(elbows))


def toe_heights(p: Points, resting: NDArray[np.bool_]) -> Array:
    """Of both toe joints over their own median height in `resting` frames `(T,)`; `(T, 2)`, without columns if unknown."""
    if "lt" not in p or not resting.any():
        return np.zeros((len(p["hips"]), 0))
    heights = np.stack([p["lt"][:, 1], p["rt"][:, 1]], -1)
    return np.asarray(heights - np.median(heights[resting], axis=0))


def paths_near_ground(toe: Array, height: Array) -> list[float]:
    """Centimetres that a toe `(T, 3)` travels over the ground in each stay within NEAR_GROUND of its resting height."""
    edges = np.flatnonzero(np.diff(height < NEAR_GROUND, prepend=False, append=False))
    steps = np.linalg.norm(np.diff(toe[:, [0, 2]], axis=0), axis=-1)
    return [100.0 * float(steps[a : b - 1].sum()) for a, b in edges.reshape(-1, 2).tolist()]


class Curves:
    """The curves of a clip, and the figures of what happens between two of its frames."""

    def __init__(self, p: Points, resting: NDArray[np.bool_] | None = None) -> None:
        """`resting` `(T,)`: when the body stands; by default while its hips do."""
        self.p, self.hips, self.turn = p, hips_speed(p), hips_turn(p)
        up = p["neck"] - p["hips"]
        self.tilt = np.degrees(np.arctan2(np.linalg.norm(up[:, [0, 2]], axis=-1), up[:, 1]))
        self.wrists = np.stack([speed(p[w] - p["hips"]) for w in ("lw", "rw")], -1)
        self.limbs = np.max([speed(p[k] - p["hips"]) for k in LIMBS], axis=0)
        self.toes = toe_heights(p, self.hips < STILL if resting is None else resting)

    def start_figures(self, first: int, end: int, steady: float | None = None) -> dict[str, float]:
        """From rest to a speed, by default that of the last second."""
        if steady is None:
            steady = float(np.median(self.hips[first + max(end - first - FPS, (end - first) // 2) : end]))
        reached = np.flatnonzero(self.hips[first:end] > REACHED * steady)
        begin = slice(first, min(end, first + BEGIN))
        return {
            "reached_s": float(reached[0]) / FPS if len(reached) else float("inf"),
            "peak_ratio": float(self.hips[begin].max()) / max(steady, 1e-6),
            "tilt": float(self.tilt[begin].max()),
        } | self._toe_paths(begin)

    def stop_figures(self, first: int, end: int, until: int | None = None) -> dict[str, float]:
        """From a speed, steady `until` a frame, to rest; the last two frames see what comes next."""
        stopped = np.flatnonzero(self.hips[first:end] < STILL)
        stop = float(stopped[0]) / FPS if len(stopped) else float("inf")
        busy = np.flatnonzero(self.limbs[first : end - 2] > CALM)
        settled = float(busy[-1] + 1) / FPS if len(busy) else 0.0
        until = max(first - 1, 1) if until is None else until
        steady = self.wrists[max(first - round(LAST * FPS), 0) : until].max()
        return {
            "stop_s": stop,
            "calm_after_s": max(settled - stop, 0.0),
            "wrists_ratio": float(self.wrists[first : end - 2].max() / max(steady, 1e-6)),
            "tilt": float(self.tilt[first:end].max()),
        }

    def turn_figures(self, first: int, end: int) -> dict[str, float]:
        """The fastest moment of a turn."""
        fastest, tilt = float(self.turn[first:end].max()), float(self.tilt[first:end].max())
        return {"turn": fastest, "tilt": tilt} | self._toe_paths(slice(first, min(end, first + BEGIN)))

    def jump_figures(self, first: int, end: int) -> dict[str, float]:
        """When both toes leave the ground, and how far the hips rise."""
        known = self.toes.shape[1] > 0
        air = np.flatnonzero((self.toes[first:end] > IN_AIR).all(-1) & known)
        height = self.p["hips"][:, 1]
        rise = height[first:end].max() - np.median(height[max(first - FPS, 0) : first + 1])
        return {
            "take_off_s": float(air[0]) / FPS if len(air) > 3 else float("inf"),
            "rise_cm": 100.0 * float(rise),
        }

    def _toe_paths(self, w: slice) -> dict[str, float]:
        """The 90th percentile of `paths_near_ground` in a window."""
        toes = zip(("lt", "rt"), self.toes.T, strict=False)
        paths = [path for key, heights in toes for path in paths_near_ground(self.p[key][w], heights[w])]
        return {"toe_path_cm": float(np.percentile(paths, 90))} if paths else {}


# --- moments of a script -----------------------------------------------------------------------------------------------


def moments(p: Points, script: StickScript) -> list[Moment]:
    """Every segment of the stick with its figures."""
    curves = Curves(p, _resting(script, len(p["hips"])))
    of = {
        "start": curves.start_figures,
        "stop": curves.stop_figures,
        "turn": curves.turn_figures,
        "spin": curves.turn_figures,
        "jump": curves.jump_figures,
    }
    return [
        Moment(kind, gait, first, end, of[kind](first, end) if kind in of else {})
        for kind, gait, first, end in _segments(script, len(p["hips"]))
    ]


def _segments(script: StickScript, frames: int) -> Iterator[tuple[str, str, int, int]]:
    """Kind, gait, first frame and end of every segment that lies within the clip."""
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
    """Frames in which a body stands; all of them where the stick never rests for long."""
    result = np.zeros(frames, bool)
    for kind, _, first, end in _segments(script, frames):
        if kind in ("stand", "stop", "spin"):
            result[first + (0 if first == 0 else 2 * SETTLED) : end] = True
    return result if result.any() else np.ones(frames, bool)


def whole_clip(p: Points, script: StickScript) -> dict[str, float]:
    """Pops of knees and elbows a minute without jumps, and in jumps; toes under their resting height, cm (0.1th percentile)."""
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


# --- raw capture, whose stick is unknown -----------------------------------------------------------------------------


def raw_start(p: Points) -> dict[str, float]:
    """Of a take that begins at rest and goes: from the first frame that moves to 90 % of the steady speed."""
    curves = Curves(p)
    v = curves.hips
    steady = float(np.median(v[v > 0.5 * v.max()]))
    begins = np.flatnonzero(v[: int(np.argmax(v > REACHED * steady)) + 1] < STILL)
    return curves.start_figures(int(begins[-1]) if len(begins) else 0, len(v), steady)


def raw_stop(p: Points) -> dict[str, float]:
    """Of a take that goes and ends at rest: from the last frame at 90 % of the steady speed to the first that stands."""
    curves = Curves(p)
    v = curves.hips
    steady = float(np.median(v[v > 0.5 * v.max()]))
    last = int(np.flatnonzero(v > REACHED * steady)[-1])
    return curves.stop_figures(last, len(v) + 2, last + 1) if (v[last:] < STILL).any() else {}


def raw_turns(p: Points) -> dict[str, float]:
    """Of all turns of the hips in a take, one a second at most: the 90th percentile of their fastest moments."""
    turn = hips_turn(p)
    peaks, _ = find_peaks(turn, height=TURNING, distance=FPS)
    return {"turn": float(np.percentile(turn[peaks], 90))} if len(peaks) else {}


def raw_pops(p: Points) -> dict[str, float]:
    """Pops of knees and elbows a minute."""
    minutes = len(p["hips"]) / FPS / 60.0
    knees, elbows = joint_pops(p)
    return {"knee_pops": len(knees) / minutes, "elbow_pops": len(elbows) / minutes}


def raw_jumps(p: Points) -> dict[str, float]:
    """The same of a take that is full of jumps."""
    return {f"{key}_in_jumps": value for key, value in raw_pops(p).items()}


# --- the experiment and its table -------------------------------------------------------------------------------------


Values = list[float]
Raw = dict[str, Values]

SCRIPT = (
    "stand 3; walk 4; stand 5; jog 4; stand 5; walk 3; walk@90 3; walk@-90 3; stand 4; walk*0>90 2; walk*0>-90 3; "
    "walk*0.5 5; stand 4; walk 3; jump 2.5; jog 3; jump 2.5"
)
PROMPTS = (
    "a person walking normally", "a proud queen", "a frail old man", "walk like a drunk",
    "an exhausted soldier, left arm hanging", "a happy child", "an angry man",
)  # fmt: skip


@dataclass(frozen=True)
class Row:
    """A measure: its title, of which moments, and the range in which it is right."""

    key: str
    title: str
    kinds: tuple[str, ...] = ()  # of moments; none: of whole clips
    gait: str = ""
    low: float = -np.inf
    high: float = np.inf
    digits: int = 2

    def values(self, clips: Iterable[dict[str, Any]]) -> Values:
        """Of every clip, or of every moment of the kind in it."""
        if not self.kinds:
            return [clip["whole"][self.key] for clip in clips if self.key in clip["whole"]]
        return [
            moment["figures"][self.key]
            for clip in clips
            for moment in clip["moments"]
            if moment["kind"] in self.kinds
            and self.gait in ("", moment["gait"])
            and self.key in moment["figures"]
        ]

    def right(self, values: Values) -> bool:
        """Whether all values are in the range."""
        return all(self.low <= v <= self.high for v in values)

    def shown(self, values: Values) -> str:
        """The value that is farthest out, or the range where both ends count; bold where one is not right."""
        if not values:
            return "–"
        ends = [min(values)] if np.isfinite(self.low) else []
        ends += [max(values)] if np.isfinite(self.high) or not ends else []
        text = " to ".join(f"{v:.{self.digits}f}" for v in dict.fromkeys(ends))
        return text if self.right(values) else f"**{text}**"

    @property
    def bar(self) -> str:
        """The range in words."""
        ends = [f"{v:g}" for v in (self.low, self.high) if np.isfinite(v)]
        least = "at least " if not np.isfinite(self.high) else "at most "
        return (least if len(ends) == 1 else "") + " to ".join(ends)


ROWS = (
    Row("knee_pops", "knee pops a minute", high=1.0, digits=1),
    Row("elbow_pops", "elbow pops a minute", high=1.0, digits=1),
    # captured knees take a landing by as many
    Row("knee_pops_in_jumps", "knee pops a minute of jumps", high=60.0, digits=1),
    Row("elbow_pops_in_jumps", "elbow pops a minute of jumps", high=1.0, digits=1),
    Row("stop_s", "hips stop from half a walk, s", ("stop",), "half walk"),
    Row("stop_s", "hips stop from a walk, s", ("stop",), "walk", 0.7, 1.6),
    Row("stop_s", "hips stop from a jog, s", ("stop",), "jog", 1.0, 2.2),
    Row("calm_after_s", "body calm after the hips stop, walk, s", ("stop",), "walk", high=0.7),
    Row("calm_after_s", "body calm after the hips stop, jog, s", ("stop",), "jog", high=0.7),
    Row("wrists_ratio", "wrists at stops over steady", ("stop",), high=1.2),
    Row("reached_s", "start of a walk, 90 % after, s", ("start",), "walk", 0.6, 1.5),
    Row("reached_s", "start of a jog, 90 % after, s", ("start",), "jog", 0.6, 1.5),
    Row("peak_ratio", "start of a walk, peak over steady speed", ("start",), "walk", high=1.15),
    Row("tilt", "torso tilt, stand to jog, degrees", ("start",), "jog", high=30.0, digits=0),
    Row("tilt", "torso tilt at stops, degrees", ("stop",), digits=0),
    Row("turn", "hips' turn while walking, degrees/s", ("turn",), high=360.0, digits=0),
    Row("turn", "hips' turn on the spot, degrees/s", ("spin",), high=360.0, digits=0),
    Row("take_off_s", "jump: take-off, s", ("jump",), high=0.3),
    Row("rise_cm", "jump: hips rise, cm", ("jump",), low=25.0, digits=0),
    Row("toe_under_cm", "toe less its resting height, 0.1th percentile, cm", low=-0.5, digits=1),
    Row("toe_path_cm", "toe near the ground in starts and turns, path, 90 %, cm", ("start", "turn", "spin"), high=4.0, digits=1),
)  # fmt: skip
# raw takes: what is measured on files of which name (of accad and o3de, below --data)
RAW: tuple[tuple[str, str, Callable[[Points], dict[str, float]]], ...] = (
    ("start walk", "*_StandToWalk.bvh", raw_start),
    ("stop walk", "*_WalkToStand*.bvh", raw_stop),
    ("start jog", "*_StandToRun.bvh", raw_start),
    ("stop jog", "*_RunToStand.bvh", raw_stop),
    ("turn", "*_WalkTurn*90.bvh", raw_turns),
    ("turn", "WalkTurns1.bvh", raw_turns),
    ("spin", "TurnOnSpot1.bvh", raw_turns),
    ("whole", "Walk*1.bvh", raw_pops),
    ("whole", "TurnOnSpot1.bvh", raw_pops),
    ("whole", "Jumps1.bvh", raw_jumps),
    ("whole", "*_RunToJumpToWalk.bvh", raw_jumps),
)


def measure(path: Path, script: str) -> dict[str, Any]:
    """The figures of an exported BVH whose stick was `script`, as plain data."""
    points, stick = read_points(path), parse_stick(script)
    found = [asdict(moment) for moment in moments(points, stick)]
    return {"whole": whole_clip(points, stick), "moments": found}


def clips_of(setting: Setting) -> dict[str, list[dict[str, Any]]]:
    """Figures of every prompt in every seed."""
    args = setting.args
    result: dict[str, list[dict[str, Any]]] = {prompt: [] for prompt in args.prompts}
    members = list(product(args.prompts, args.seeds))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "clip.bvh"
        for (prompt, seed), clip in zip(members, clips_together(setting, members), strict=True):
            save_bvh(clip, path)
            result[prompt].append({"seed": seed, **measure(path, args.script)})
    return result


def clips_together(setting: Setting, styles: Sequence[tuple[str, int]]) -> list[Clip]:
    """The clips that `generate_clip` makes of prompts and seeds, as one crowd in half of the time."""
    evaluated, ground, stick = setting.model, load_terrain("flat"), parse_stick(setting.args.script)
    crowd = []
    for prompt, seed in styles:
        controller = Controller(evaluated.model, ground, seed, response=0.0)  # as in capture
        controller.set_style(evaluated.prompter.style(prompt), 0.0)
        controller.settle(stick(0.0).gait)
        crowd.append(controller)
    poses = walk_together(crowd, stick, round(stick.seconds * FPS))
    return [clip_of(own, "moments", (), ground.name) for own in poses]


def raw_moments(data: Path) -> dict[str, Raw]:
    """Values by kind and measure of the takes in RAW."""
    result: dict[str, dict[str, Values]] = {}
    for kind, pattern, how in RAW:
        for path in sorted(data.rglob(pattern)):
            for key, value in how(read_points(path)).items():
                result.setdefault(kind, {}).setdefault(key, []).append(value)
    if not result:
        raise UsageError(
            f"--data {data}: none of the raw takes is there.", "Give the unpacked accad and o3de."
        )
    return result


def moment_figures(setting: Setting) -> dict[str, Any]:
    """Every prompt through the script of moments, and the raw takes."""
    data = setting.args.data
    return {"prompts": clips_of(setting), "raw": {} if data is None else raw_moments(data)}


def moment_table(figures: dict[str, Any]) -> str:
    """A row for each measure: raw, the bar, and every prompt."""
    prompts = figures["prompts"]
    rows = [
        [row.title, _raw(row, figures["raw"]), row.bar, *(row.shown(row.values(c)) for c in prompts.values())]
        for row in ROWS
    ]
    return "\n".join(table(["", "raw", "bar", *prompts], rows))


def _raw(row: Row, raw: dict[str, Raw]) -> str:
    """The range of a measure in raw takes of the row's kinds, of its gait where such takes are."""
    values: Values = []
    for name, measures in raw.items():
        kind, _, gait = name.partition(" ")
        if kind in (row.kinds or ("whole",)) and (row.gait in ("", gait) or not gait):
            values += measures.get(row.key, [])
    if not values:
        return "–"
    return " to ".join(dict.fromkeys(f"{v:.{row.digits}f}" for v in (min(values), max(values))))


def _sensible(args: Arguments) -> None:
    if min(args.seeds) < 0:
        raise UsageError(f"--seeds {min(args.seeds)}: expected 0 or more.", "Try 1 2.")


MOMENTS = Experiment(
    "Starts, stops, turns and jumps of an exported BVH and of raw capture: has the body weight?",
    moment_figures,
    moment_table,
    "moments",
    options=(
        option("--prompts", nargs="+", metavar="PROMPT", default=list(PROMPTS), help="default: seven"),
        option("--script", default=SCRIPT, help="the stick, as sport generate --controls"),
        option("--seeds", type=int, nargs="+", default=[1, 2], help="default: 1 2"),
        option(
            "--data", type=Path, metavar="DIR", help="folder of the unpacked source files, to measure too"
        ),
    ),
    check=_sensible,
)
