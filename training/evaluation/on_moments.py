"""The first and the last second of everything: starts, stops, turns and jumps.

Clips are those of the public `generate_clip`, exported, and measured on the exported BVH alone.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from runtime.errors import SportError, UsageError
from runtime.formats.bvh_clip import save_bvh
from runtime.generate import clip_of
from runtime.motion.control_scripts import StickScript, parse_stick
from runtime.motion.controller import Controller, Crowd
from runtime.motion.features import FPS
from runtime.takes.clip import Clip
from runtime.terrain.library import load_terrain
from training.evaluation.experiment import Arguments, Experiment, Setting, option
from training.evaluation.metrics import moments
from training.evaluation.metrics.moments import Points
from training.markdown import table

TOGETHER = 16  # characters of a crowd
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
    ("start walk", "*_StandToWalk.bvh", moments.raw_start),
    ("stop walk", "*_WalkToStand*.bvh", moments.raw_stop),
    ("start jog", "*_StandToRun.bvh", moments.raw_start),
    ("stop jog", "*_RunToStand.bvh", moments.raw_stop),
    ("turn", "*_WalkTurn*90.bvh", moments.raw_turns),
    ("turn", "WalkTurns1.bvh", moments.raw_turns),
    ("spin", "TurnOnSpot1.bvh", moments.raw_turns),
    ("whole", "Walk*1.bvh", moments.raw_pops),
    ("whole", "TurnOnSpot1.bvh", moments.raw_pops),
    ("whole", "Jumps1.bvh", moments.raw_jumps),
    ("whole", "*_RunToJumpToWalk.bvh", moments.raw_jumps),
)


def measure(path: Path, script: str) -> dict[str, Any]:
    """The figures of an exported BVH whose stick was `script`, as plain data."""
    points, stick = moments.read_points(path), parse_stick(script)
    found = [asdict(moment) for moment in moments.moments(points, stick)]
    return {"whole": moments.whole_clip(points, stick), "moments": found}


def clips_of(setting: Setting) -> dict[str, list[dict[str, Any]]]:
    """Figures of every prompt in every seed; the BVHs stay in --keep."""
    args = setting.args
    result: dict[str, list[dict[str, Any]]] = {prompt: [] for prompt in args.prompts}
    stick = parse_stick(args.script)
    members = list(product(args.prompts, args.seeds))
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch) if args.keep is None else args.keep
        folder.mkdir(parents=True, exist_ok=True)
        for first in range(0, len(members), TOGETHER):
            few = members[first : first + TOGETHER]
            setting.report(", ".join(dict.fromkeys(prompt for prompt, _ in few)))
            for (prompt, seed), clip in zip(few, clips_together(setting, few, stick), strict=True):
                path = folder / f"{'_'.join(prompt.split())}_{seed}.bvh"
                save_bvh(clip, path)
                result[prompt].append({"seed": seed, **measure(path, args.script)})
    return result


def clips_together(setting: Setting, styles: Sequence[tuple[str, int]], stick: StickScript) -> list[Clip]:
    """The clips that `generate_clip` makes of prompts and seeds, as one crowd in half of the time."""
    evaluated, ground = setting.model, load_terrain("flat")
    crowd = []
    for prompt, seed in styles:
        controller = Controller(evaluated.model, ground, seed, response=setting.args.response)
        controller.set_style(evaluated.prompter(prompt), 0.0)
        controller.settle(stick(0.0).gait)
        crowd.append(controller)
    together, poses = Crowd(crowd), []
    for frame in range(round(stick.seconds * FPS)):
        poses.append(together.step(stick(frame / FPS)))
        faults = [member.message for member in crowd if member.message]
        if faults:
            raise SportError(f"frame {frame}: {faults[0]}", "Try another seed or model.")
    together.close()
    return [clip_of(own, "moments", (), ground.name) for own in zip(*poses, strict=True)]


def raw_moments(data: Path) -> dict[str, Raw]:
    """Values by kind and measure of the takes in RAW."""
    result: dict[str, dict[str, Values]] = {}
    for kind, pattern, how in RAW:
        for path in sorted(data.rglob(pattern)):
            for key, value in how(moments.read_points(path)).items():
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
    kinds = row.kinds or ("whole",)
    values = [
        v
        for kind in kinds
        for name in (kind, f"{kind} {row.gait}".strip())
        for v in raw.get(name, {}).get(row.key, [])
    ]
    if row.kinds and not row.gait and not values:
        values = [
            v for name, found in raw.items() if name.split()[0] in kinds for v in found.get(row.key, [])
        ]
    if not values:
        return "–"
    ends = dict.fromkeys(f"{v:.{row.digits}f}" for v in (min(values), max(values)))
    return " to ".join(ends)


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
        option("--response", type=float, default=0.0, help="0 as in capture (default) to 1 as in a game"),
        option(
            "--data", type=Path, metavar="DIR", help="folder of the unpacked source files, to measure too"
        ),
        option("--keep", type=Path, metavar="DIR", help="write the measured BVH files into DIR"),
    ),
    check=_sensible,
)
