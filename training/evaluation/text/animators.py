"""Sixty prompts of animators, measured on exported files: `python -m training.evaluation animators`.

A model walks each prompt; the exported BVH is read back, and its angles and positions are compared with the expectations
in data/animator_prompts.txt.
"""

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
LEAD_S, WALK_S = 2.0, 7.0  # walked before measuring, and in total
_EXPECTATION = re.compile(r"(\w+)\.(\w+) ([<>]) (n\*|n\+|n(?=-))?(-?[\d.]+)")
# a prompt, its number of expectations, and the failed ones with measured values
Outcome = dict[str, Any]


def measured(path: Path) -> dict[str, float]:
    """Measure an exported walk, {"part.measure": value}; `torso.twist` in degrees to the left, `legs.apart` in metres."""
    read = load_clip_bvh(path)
    first = round(LEAD_S * read.fps)
    hips, local = read.hips_positions[first:], read.local_rotations[first:]
    parts = vars(body_of(hips, local)).items()
    values = {f"{part}.{name}": value for part, found in parts for name, value in vars(found).items()}
    positions = SPORT_SKELETON.forward_kinematics(hips, local)[0]
    return {**values, "torso.twist": _twist(positions), "legs.apart": _apart(positions)}


def _apart(positions: Array) -> float:
    """Return the median lateral distance from right to left ankle, metres."""
    left, right = (positions[:, SPORT_SKELETON.index(foot)] for foot in ("LeftFoot", "RightFoot"))
    way = np.gradient(smoothed(positions[:, 0], 1.0), axis=0)
    across = way[:, 2] * (left - right)[:, 0] - way[:, 0] * (left - right)[:, 2]
    return float(np.median(across / np.hypot(way[:, 0], way[:, 2])))


def _twist(positions: Array) -> float:
    """Return the median yaw of the shoulders relative to the hips, degrees to the left."""
    at = SPORT_SKELETON.index

    def heading(joint: str) -> Array:
        across = positions[:, at(f"Left{joint}")] - positions[:, at(f"Right{joint}")]
        return np.arctan2(-across[:, 2], across[:, 0])

    return float(np.degrees(np.median(np.angle(np.exp(1j * (heading("Arm") - heading("UpLeg")))))))


def outcome(line: str, values: dict[str, float], neutral: dict[str, float]) -> Outcome:
    """Compare a line of the list with measured values."""
    prompt, *expectations = line.split(" | ")
    failed = []
    for text in expectations:
        match = _EXPECTATION.fullmatch(text)
        if match is None:
            raise ValueError(f"{PROMPTS}: {text!r} is not an expectation")
        part, name, sign, relative, number = match.groups()
        key, bound = f"{part}.{name}", float(number)
        if relative:
            bound = neutral[key] * bound if relative == "n*" else neutral[key] + bound
        if not (values[key] > bound if sign == ">" else values[key] < bound):
            failed.append(f"{text} (measured {values[key]:.2f}, neutral {neutral[key]:.2f})")
    return {"prompt": prompt, "expected": len(expectations), "failed": failed}


def animators(setting: Setting) -> dict[str, list[Outcome]]:
    """Measure all prompts; returns the outcomes by section of the list."""
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
    """Read lines of prompts and expectations by heading; lines above the first heading are comments."""
    _, *parts = re.split(r"^# (.*)\n", path.read_text("utf-8"), flags=re.M)
    pairs = zip(parts[::2], parts[1::2], strict=True)
    return {name: body.strip().splitlines() for name, body in pairs if body.strip()}


def animators_table(found: dict[str, list[Outcome]]) -> str:
    """Return a table with a row per section and one for all, followed by failed expectations."""
    every = [one for outcomes in found.values() for one in outcomes]
    rows, failed = [], [f"- {o['prompt']}: {'; '.join(o['failed'])}" for o in every if o["failed"]]
    for name, outcomes in [*found.items(), ("all", every)]:
        expected = sum(o["expected"] for o in outcomes)
        held = expected - sum(len(o["failed"]) for o in outcomes)
        whole = sum(not o["failed"] for o in outcomes)
        rows.append([name, f"{held} of {expected}", f"{whole} of {len(outcomes)}"])
    return "\n".join([*table(["prompts", "expectations that hold", "prompts whole"], rows), *failed])


ANIMATORS = Experiment(
    "Prompts of animators, measured on angles and positions of exported BVH files.",
    animators,
    animators_table,
    "animators",
    options=(
        "model",
        option("--list", type=Path, default=PROMPTS, metavar="FILE", help="file of prompts and expectations"),
        option("--network-legs", action="store_true", help="legs as the network walks them"),
        "seed",
    ),
)
