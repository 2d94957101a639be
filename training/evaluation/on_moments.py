"""Starts, stops, turns and jumps: `python -m training.evaluation moments`.

Clips of the public `generate_clip` with a known stick script are exported, and only the BVH is measured
(`training.evaluation.metrics.moments`).
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from runtime.errors import UsageError
from runtime.generate import clip_of
from runtime.motion.control_scripts import parse_stick
from runtime.takes.clip import Clip
from runtime.terrain.library import load_terrain
from training.data.gait import measured_exports
from training.evaluation.experiment import Experiment, Setting, option
from training.evaluation.metrics import moments as measures
from training.evaluation.metrics.moments import FPS, Points
from training.evaluation.motion.driving import characters, walk_together
from training.markdown import table

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
    """A measure: title, kinds of moments, and allowed range."""

    key: str
    title: str
    kinds: tuple[str, ...] = ()  # of moments; empty: whole clips
    gait: str = ""
    low: float = -np.inf
    high: float = np.inf
    digits: int = 2

    def values(self, clips: Iterable[dict[str, Any]]) -> Values:
        """Return the values of the measure in all clips, or in all moments of its kinds."""
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
        """Return whether all values are in the allowed range."""
        return all(self.low <= v <= self.high for v in values)

    def shown(self, values: Values) -> str:
        """Format the most extreme value, or the range if both ends are limited; bold if out of range."""
        if not values:
            return "–"
        ends = [min(values)] if np.isfinite(self.low) else []
        ends += [max(values)] if np.isfinite(self.high) or not ends else []
        text = " to ".join(f"{v:.{self.digits}f}" for v in dict.fromkeys(ends))
        return text if self.right(values) else f"**{text}**"

    @property
    def bar(self) -> str:
        """Format the allowed range."""
        ends = [f"{v:g}" for v in (self.low, self.high) if np.isfinite(v)]
        least = "at least " if not np.isfinite(self.high) else "at most "
        return (least if len(ends) == 1 else "") + " to ".join(ends)


ROWS = (
    Row("knee_pops", "knee pops a minute", high=1.0, digits=1),
    Row("elbow_pops", "elbow pops a minute", high=1.0, digits=1),
    # as many as in captured landings
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
    Row("surge_ratio", "a second of steady walk, peak over steady speed", ("start",), "walk"),
    Row("tilt", "torso tilt, stand to jog, degrees", ("start",), "jog", high=30.0, digits=0),
    Row("tilt", "torso tilt at stops, degrees", ("stop",), digits=0),
    Row("turn", "hips' turn while walking, degrees/s", ("turn",), high=360.0, digits=0),
    Row("turn", "hips' turn on the spot, degrees/s", ("spin",), high=360.0, digits=0),
    Row("take_off_s", "jump: take-off, s", ("jump",), high=0.3),
    Row("rise_cm", "jump: hips rise, cm", ("jump",), low=25.0, digits=0),
    Row("toe_under_cm", "toe less its resting height, 0.1th percentile, cm", low=-0.5, digits=1),
    Row("toe_path_cm", "toe near the ground in starts and turns, path, 90 %, cm", ("start", "turn", "spin"), high=4.0, digits=1),
)  # fmt: skip
# raw takes of accad and o3de below --data: kind, file pattern and measurement
RAW: tuple[tuple[str, str, Callable[[Points], dict[str, float]]], ...] = (
    ("start walk", "*_StandToWalk.bvh", measures.raw_start),
    ("stop walk", "*_WalkToStand*.bvh", measures.raw_stop),
    ("start jog", "*_StandToRun.bvh", measures.raw_start),
    ("stop jog", "*_RunToStand.bvh", measures.raw_stop),
    ("turn", "*_WalkTurn*90.bvh", measures.raw_turns),
    ("turn", "WalkTurns1.bvh", measures.raw_turns),
    ("spin", "TurnOnSpot1.bvh", measures.raw_turns),
    ("whole", "Walk*1.bvh", measures.raw_pops),
    ("whole", "TurnOnSpot1.bvh", measures.raw_pops),
    ("whole", "Jumps1.bvh", measures.raw_jumps),
    ("whole", "*_RunToJumpToWalk.bvh", measures.raw_jumps),
)


def measure(path: Path, script: str) -> dict[str, Any]:
    """Measure an exported BVH generated with the stick `script`; returns plain data."""
    points, stick = measures.read_points(path), parse_stick(script)
    return {"whole": measures.whole_clip(points, stick), "moments": measures.moments(points, stick)}


def clips_together(setting: Setting, styles: Sequence[tuple[str, int]]) -> list[Clip]:
    """Generate the clips of `generate_clip` for prompts and seeds in one batch, in half the time."""
    evaluated, ground, stick = setting.models[0], load_terrain("flat"), parse_stick(setting.args.script)
    codes = [evaluated.prompter.style(prompt) for prompt, _ in styles]
    crowd = characters(
        evaluated.model, ground, codes, [seed for _, seed in styles], response=0.0
    )  # as in capture
    for member in crowd:
        member.settle(stick(0.0).gait)
    poses = walk_together(crowd, stick, round(stick.seconds * FPS))
    return [clip_of(own, "moments", (), ground.name) for own in poses]


def raw_moments(data: Path) -> dict[str, Raw]:
    """Measure the takes in RAW; returns values by kind and measure."""
    result: dict[str, dict[str, Values]] = {}
    for kind, pattern, how in RAW:
        for path in sorted(data.rglob(pattern)):
            for key, value in how(measures.read_points(path)).items():
                result.setdefault(kind, {}).setdefault(key, []).append(value)
    if not result:
        raise UsageError(f"--data {data}: none of the raw takes found.", "Give the unpacked accad and o3de.")
    return result


def moment_figures(setting: Setting) -> dict[str, Any]:
    """Measure every prompt with every seed on the script, and the raw takes."""
    args = setting.args
    members = list(product(args.prompts, args.seeds))
    found = measured_exports(clips_together(setting, members), partial(measure, script=args.script))
    prompts: dict[str, list[dict[str, Any]]] = {prompt: [] for prompt in args.prompts}
    for (prompt, seed), figures in zip(members, found, strict=True):
        prompts[prompt].append({"seed": seed, **figures})
    return {"prompts": prompts, "raw": {} if args.data is None else raw_moments(args.data)}


def moment_table(figures: dict[str, Any]) -> str:
    """Return a table with a row per measure: raw, allowed range, and every prompt."""
    prompts = figures["prompts"]
    rows = [
        [row.title, _raw(row, figures["raw"]), row.bar, *(row.shown(row.values(c)) for c in prompts.values())]
        for row in ROWS
    ]
    return "\n".join(table(["", "raw", "bar", *prompts], rows))


def _raw(row: Row, raw: dict[str, Raw]) -> str:
    """Format the range of a measure in raw takes of the row's kinds, and of its gait if there are such takes."""
    values: Values = []
    for name, found in raw.items():
        kind, _, gait = name.partition(" ")
        if kind in (row.kinds or ("whole",)) and (row.gait in ("", gait) or not gait):
            values += found.get(row.key, [])
    if not values:
        return "–"
    return " to ".join(dict.fromkeys(f"{v:.{row.digits}f}" for v in (min(values), max(values))))


MOMENTS = Experiment(
    "Starts, stops, turns and jumps of an exported BVH, compared with raw capture.",
    moment_figures,
    moment_table,
    "moments",
    options=(
        "model",
        option("--prompts", nargs="+", metavar="PROMPT", default=list(PROMPTS), help="default: seven"),
        option("--script", default=SCRIPT, help="stick script, as for sport generate --controls"),
        option("--seeds", type=int, nargs="+", default=[1, 2], help="default: 1 2"),
        "data",
    ),
)
