"""Sixty prompts of animators, measured on exported files: `python -m training.evaluation animators`.

Each prompt is walked by a model, written as BVH and read back; angles and places of the file decide. The list is
data/animator_prompts.txt.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np

from runtime.arrays import Array
from runtime.formats.bvh_clip import load_clip_bvh
from runtime.generate import generate_clip
from runtime.measures.signals import smoothed
from runtime.motion.model import load_model
from runtime.prompts.prompter import Prompter
from runtime.skeleton import SPORT_SKELETON
from training.data.gait import measured_exports
from training.evaluation import log
from training.evaluation.experiment import Experiment, Setting, option
from training.evaluation.text.walks import PLAIN_PROMPT, body_of
from training.markdown import table

PROMPTS = Path(__file__).parent / "data" / "animator_prompts.txt"
LEAD_S, WALK_S = 2.0, 7.0  # walked before measuring, and in all
_EXPECTATION = re.compile(r"(\w+)\.(\w+) ([<>]) (n\*|n\+|n(?=-))?(-?[\d.]+)")
# a prompt, how many expectations it has, and those that do not hold with what was measured
Outcome = dict[str, Any]


def measured(path: Path) -> dict[str, float]:
    """Measures of an exported walk, "part.measure" → value; `torso.twist` in degrees to the left, `legs.apart` in metres."""
    read = load_clip_bvh(path)
    first = round(LEAD_S * read.fps)
    hips, local = read.hips_positions[first:], read.local_rotations[first:]
    parts = vars(body_of(hips, local)).items()
    values = {f"{part}.{name}": value for part, found in parts for name, value in vars(found).items()}
    positions = SPORT_SKELETON.forward_kinematics(hips, local)[0]
    return {**values, "torso.twist": _twist(positions), "legs.apart": _apart(positions)}


def _apart(positions: Array) -> float:
    """Metres of the left ankle to the left of the right one across the way of travel, median."""
    left, right = (positions[:, SPORT_SKELETON.index(foot)] for foot in ("LeftFoot", "RightFoot"))
    way = np.gradient(smoothed(positions[:, 0], 1.0), axis=0)
    across = way[:, 2] * (left - right)[:, 0] - way[:, 0] * (left - right)[:, 2]
    return float(np.median(across / np.hypot(way[:, 0], way[:, 2])))


def _twist(positions: Array) -> float:
    """Degrees by which the shoulders are turned to the left of the hips, median."""
    at = SPORT_SKELETON.index

    def heading(joint: str) -> Array:
        across = positions[:, at(f"Left{joint}")] - positions[:, at(f"Right{joint}")]
        return np.arctan2(-across[:, 2], across[:, 0])

    return float(np.degrees(np.median(np.angle(np.exp(1j * (heading("Arm") - heading("UpLeg")))))))


def outcome(line: str, values: dict[str, float], neutral: dict[str, float]) -> Outcome:
    """A line of the list against what was measured."""
    prompt, *expectations = line.split(" | ")
    failed = []
    for text in expectations:
        match = _EXPECTATION.fullmatch(text)
        if match is None:
            raise ValueError(f"{PROMPTS}: {text!r} is no expectation")
        part, name, sign, relative, number = match.groups()
        key, bound = f"{part}.{name}", float(number)
        if relative:
            bound = neutral[key] * bound if relative == "n*" else neutral[key] + bound
        if not (values[key] > bound if sign == ">" else values[key] < bound):
            failed.append(f"{text} (measured {values[key]:.2f}, neutral {neutral[key]:.2f})")
    return {"prompt": prompt, "expected": len(expectations), "failed": failed}


def animators(setting: Setting) -> dict[str, list[Outcome]]:
    """The outcomes of every section of the list."""
    model = load_model(setting.folders[0])
    prompter = Prompter(model)

    def walk(prompt: str) -> dict[str, float]:
        args = setting.args
        clip = generate_clip(
            prompt, seconds=WALK_S, seed=args.seed, prompter=prompter, model=model, exact_legs=not args.network_legs
        )  # fmt: skip
        return measured_exports([clip], measured)[0]

    neutral = walk(PLAIN_PROMPT)
    found: dict[str, list[Outcome]] = {}
    for name, lines in sections(setting.args.list).items():
        log.info(name)
        found[name] = [outcome(line, walk(line.split(" | ")[0]), neutral) for line in lines]
    return found


def sections(path: Path) -> dict[str, list[str]]:
    """Lines of prompts and expectations by the headings of a list; above the first stand comments."""
    _, *parts = re.split(r"^# (.*)\n", path.read_text("utf-8"), flags=re.M)
    pairs = zip(parts[::2], parts[1::2], strict=True)
    return {name: body.strip().splitlines() for name, body in pairs if body.strip()}


def animators_table(found: dict[str, list[Outcome]]) -> str:
    """A row for each section and one for all, then what failed."""
    every = [one for outcomes in found.values() for one in outcomes]
    rows, failed = [], [f"- {o['prompt']}: {'; '.join(o['failed'])}" for o in every if o["failed"]]
    for name, outcomes in [*found.items(), ("all", every)]:
        expected = sum(o["expected"] for o in outcomes)
        held = expected - sum(len(o["failed"]) for o in outcomes)
        whole = sum(not o["failed"] for o in outcomes)
        rows.append([name, f"{held} of {expected}", f"{whole} of {len(outcomes)}"])
    return "\n".join([*table(["prompts", "expectations that hold", "prompts whole"], rows), *failed])


ANIMATORS = Experiment(
    "Prompts of animators, measured on exported files: do angles and places of the BVH do what the words say?",
    animators,
    animators_table,
    "animators",
    options=(
        "model",
        option("--list", type=Path, default=PROMPTS, metavar="FILE", help="prompts and expectations"),
        option("--network-legs", action="store_true", help="legs as the network walks them"),
        "seed",
    ),
)
