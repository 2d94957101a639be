"""Experiments on the first and the last second of everything: starts, stops, turns, jumps, and standing for half a minute.

Clips are those of the public `generate_clip`, exported, and measured on the exported BVH alone.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from runtime.errors import SportError, UsageError
from runtime.formats.bvh_clip import save_bvh
from runtime.generate import clip_of
from runtime.motion.controller import Controller
from runtime.motion.crowd import Crowd
from runtime.motion.features import FPS
from runtime.motion.stick_script import StickScript, parse_stick
from runtime.prompts.parts import PartDescriptions
from runtime.takes.clip import Clip
from runtime.terrain.library import load_terrain
from training.evaluation.experiment import Arguments, Experiment, Setting
from training.evaluation.metrics import moments
from training.evaluation.metrics.moments import Points
from training.markdown import table as table_lines

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
    def asked(self) -> str:
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
    Row("wrists_share", "wrists at stops over steady", ("stop",), high=1.2),
    Row("reached_s", "start of a walk, 90 % after, s", ("start",), "walk", 0.6, 1.5),
    Row("reached_s", "start of a jog, 90 % after, s", ("start",), "jog", 0.6, 1.5),
    Row("peak_share", "start of a walk, peak over steady speed", ("start",), "walk", high=1.15),
    Row("tilt", "torso tilt, stand to jog, degrees", ("start",), "jog", high=30.0, digits=0),
    Row("tilt", "torso tilt at stops, degrees", ("stop",), digits=0),
    Row("turn", "hips' turn while walking, degrees/s", ("turn",), high=360.0, digits=0),
    Row("turn", "hips' turn on the spot, degrees/s", ("spin",), high=360.0, digits=0),
    Row("take_off_s", "jump: take-off, s", ("jump",), high=0.3),
    Row("rise_cm", "jump: hips rise, cm", ("jump",), low=25.0, digits=0),
    Row("toe_under_cm", "toe less its resting height, 0.1th percentile, cm", low=-0.5, digits=1),
    Row("toe_path_cm", "toe near the ground in starts and turns, path, 90 %, cm", ("start", "turn", "spin"), high=4.0, digits=1),
)  # fmt: skip
STANDING = (
    Row("wrists_median", "median", ("stand",), high=0.1),
    Row("wrists_largest", "largest", ("stand",), high=0.5),
)

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


def clips_of(
    setting: Setting, asked: dict[str, str | PartDescriptions], script: str
) -> dict[str, list[dict[str, Any]]]:
    """Figures of every prompt in every seed; the BVHs stay in --keep."""
    args = setting.args
    result: dict[str, list[dict[str, Any]]] = {label: [] for label in asked}
    stick = parse_stick(script)
    members = [(label, seed) for label in asked for seed in args.seeds]
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch) if args.keep is None else args.keep
        folder.mkdir(parents=True, exist_ok=True)
        for first in range(0, len(members), TOGETHER):
            few = members[first : first + TOGETHER]
            setting.report(", ".join(dict.fromkeys(label for label, _ in few)))
            styles = [(asked[label], seed) for label, seed in few]
            for (label, seed), clip in zip(few, clips_together(setting, styles, stick), strict=True):
                path = folder / f"{'_'.join(label.split())}_{seed}.bvh"
                save_bvh(clip, path)
                result[label].append({"seed": seed, **measure(path, script)})
    return result


def clips_together(
    setting: Setting, styles: Sequence[tuple[str | PartDescriptions, int]], stick: StickScript
) -> list[Clip]:
    """The clips that `generate_clip` makes of prompts and seeds, as one crowd in half of the time."""
    args, subject, ground = setting.args, setting.subject, load_terrain("flat")
    crowd = []
    for prompt, seed in styles:
        controller = Controller(subject.model, ground, seed, response=args.response)
        controller.set_style(subject.prompter(prompt), 0.0)
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
    args = setting.args
    return {
        "prompts": clips_of(setting, {p: p for p in args.prompts}, args.script),
        "raw": {} if args.data is None else raw_moments(args.data),
    }


def moment_table(figures: dict[str, Any]) -> str:
    """A row for each measure: raw, what is asked, and every prompt."""
    prompts = figures["prompts"]
    rows = [
        [
            row.title,
            _raw(row, figures["raw"]),
            row.asked,
            *(row.shown(row.values(c)) for c in prompts.values()),
        ]
        for row in ROWS
    ]
    return "\n".join(table_lines(["", "raw", "asked", *prompts], rows)).rstrip("\n")


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


_SEEDS: tuple[str, dict[str, Any]] = (
    "--seeds",
    {"type": int, "nargs": "+", "default": [1, 2], "help": "default: 1 2"},
)
_RESPONSE: tuple[str, dict[str, Any]] = (
    "--response",
    {"type": float, "default": 0.0, "help": "0 as in capture (default) to 1 as in a game"},
)
_DATA: tuple[str, dict[str, Any]] = (
    "--data",
    {"type": Path, "metavar": "DIR", "help": "folder of the unpacked source files, to measure beside ours"},
)
_KEEP: tuple[str, dict[str, Any]] = (
    "--keep",
    {"type": Path, "metavar": "DIR", "help": "write the measured BVH files into DIR"},
)

MOMENTS = Experiment(
    "Starts, stops, turns and jumps of an exported BVH beside raw capture: has the body weight?",
    moment_figures,
    moment_table,
    "moments",
    options=(
        (
            "--prompts",
            {"nargs": "+", "metavar": "PROMPT", "default": list(PROMPTS), "help": "default: seven"},
        ),
        ("--script", {"default": SCRIPT, "help": "the stick, as sport generate --controls"}),
        _SEEDS,
        _RESPONSE,
        _DATA,
        _KEEP,
    ),
    check=_sensible,
)

# --- standing: who moves that was not asked to ---------------------------------------------------------------------------

STAND_SECONDS = 31.0  # of which the first settles
# styles whose capture at rest waves, raises a hand, chops, looks around or holds the arms up
ASKED_TO_MOVE = ("raise_", "wave_", "karate_chop", "looking_around", "cmu_", "skipping")


def standing_figures(setting: Setting) -> dict[str, Any]:
    """Half a minute of every style at rest, and the captured idles of the same styles."""
    texts = setting.subject.texts
    names = setting.args.styles or list(texts)
    for name in names:
        if name not in texts and " " not in name:
            raise UsageError(f"--styles {name}: no style of the model.", f"Choose of {', '.join(texts)}.")
    asked = {n: texts[n][0] if n in texts else n for n in names}
    return {
        "styles": clips_of(setting, asked, f"stand {STAND_SECONDS:g}"),
        "raw": {} if setting.args.data is None else raw_idles(setting.args.data),
    }


def raw_idles(data: Path) -> dict[str, dict[str, float]]:
    """Wrists in the idle takes of 100STYLE, by style in our spelling."""
    result = {}
    for path in sorted(data.rglob("*_ID.bvh")):
        name = "".join(f"_{c.lower()}" if c.isupper() else c for c in path.stem[:-3]).strip("_")
        result[name] = moments.raw_stand(moments.read_points(path))
    return result


def standing_table(figures: dict[str, Any]) -> str:
    """A row for each style, those that move most first."""
    raw = figures["raw"]
    values = {name: [row.values(clips) for row in STANDING] for name, clips in figures["styles"].items()}
    rows = []
    for name in sorted(values, key=lambda n: -max(values[n][1])):
        asked = name.startswith(ASKED_TO_MOVE)
        cells = [
            f"{max(v):.2f}" if asked else row.shown(v) for row, v in zip(STANDING, values[name], strict=True)
        ]
        known = [f"{raw[name][row.key]:.2f}" if name in raw else "–" for row in STANDING]
        rows.append([name + (" (asked to move)" if asked else ""), *cells, *known])
    bars = [f"{row.title} ({row.asked})" for row in STANDING]
    head = ["wrists at rest, m/s", *bars, *(f"raw {row.title}" for row in STANDING)]
    return "\n".join(table_lines(head, rows)).rstrip("\n")


STANDING_STILL = Experiment(
    "Half a minute of standing in every style: nobody moves who was not asked to.",
    standing_figures,
    standing_table,
    "standing",
    options=(
        (
            "--styles",
            {"nargs": "+", "metavar": "STYLE", "help": "names of styles, or prompts; default: all styles"},
        ),
        _SEEDS,
        _RESPONSE,
        _DATA,
        _KEEP,
    ),
    check=_sensible,
)
