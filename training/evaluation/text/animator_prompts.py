"""Sixty prompts of animators, measured on exported files: `python -m training.evaluation.text.animator_prompts`.

Each prompt is walked by a model, written as BVH and read back; angles and places of the file decide. The list,
written before its writer had read the library, is data/animator_prompts.txt.
"""

from __future__ import annotations

import argparse
import re
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from runtime.errors import run_command
from runtime.formats.bvh_clip import load_clip_bvh, save_bvh
from runtime.generate import generate_clip
from runtime.motion.model import MotionModel, load_model
from runtime.prompts.prompter import Prompter
from runtime.skeleton import SPORT_SKELETON
from training.data.labels import foot_contacts
from training.text.measure import BodyMeasures, measure

PROMPTS = Path(__file__).parent / "data" / "animator_prompts.txt"
NEUTRAL = "a person walking normally"
LEAD, SECONDS = 2.0, 7.0  # walked before measuring, and in all
_EXPECTATION = re.compile(r"(\w+)\.(\w+) ([<>]) (n\*|n\+|n(?=-))?(-?[\d.]+)")


@dataclass(frozen=True)
class Outcome:
    """One prompt: how many of its expectations hold, and those that do not with what was measured."""

    prompt: str
    expected: int
    failed: tuple[str, ...]


def measured(
    prompt: str, prompter: Prompter, model: MotionModel, folder: Path, seed: int
) -> dict[str, float]:
    """Measures of the exported walk under a prompt, "part.measure" → value; `torso.twist` in degrees to the left."""
    clip = generate_clip(prompt, seconds=SECONDS, seed=seed, prompter=prompter, model=model)
    path = folder / f"{re.sub(r'[^a-z]+', '_', prompt.lower())[:60]}.bvh"
    save_bvh(clip, path)
    read = load_clip_bvh(path)
    first = round(LEAD * read.fps)
    hips, local = read.hips_positions[first:], read.local_rotations[first:]
    positions, _ = SPORT_SKELETON.forward_kinematics(hips, local)
    contacts = foot_contacts(positions, np.zeros((len(hips), 4), np.float32)).astype(np.float32)
    body = measure(hips, local, contacts)
    return {**_values(body), "torso.twist": _twist(positions)}


def _values(body: BodyMeasures) -> dict[str, float]:
    return {
        f"{part}.{name}": value
        for part, measures in vars(body).items()
        for name, value in vars(measures).items()
    }


def _twist(positions: np.ndarray) -> float:
    """Degrees by which the shoulders are turned to the left of the hips, median."""
    at = SPORT_SKELETON.index

    def heading(joint: str) -> np.ndarray:
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
    return Outcome(prompt, len(expectations), tuple(failed))


def main(argv: list[str] | None = None) -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description="Measure prompts of animators on exported files.")
    parser.add_argument("--out", type=Path, help="folder that keeps the BVH files")
    parser.add_argument("--model", help="a shipped model, or the folder of an exported one")
    parser.add_argument("--list", type=Path, default=PROMPTS, help="file of prompts and expectations")
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args(argv)
    _, *parts = re.split(r"^# (.*)\n", given.list.read_text("utf-8"), flags=re.M)
    sections = [(name, body.strip().splitlines()) for name, body in zip(parts[::2], parts[1::2], strict=True)]
    with TemporaryDirectory() as temporary:
        folder = given.out or Path(temporary)
        folder.mkdir(parents=True, exist_ok=True)
        model = load_model(given.model)
        walk = partial(measured, prompter=Prompter(model), model=model, folder=folder, seed=given.seed)
        neutral = walk(NEUTRAL)
        for name, lines in (section for section in sections if section[1]):  # above the first stand comments
            found = []
            for line in lines:
                found.append(outcome(line, walk(line.split(" | ")[0]), neutral))
                if found[-1].failed:
                    print(f"{found[-1].prompt}: {'; '.join(found[-1].failed)}", flush=True)
            held = sum(o.expected - len(o.failed) for o in found)
            whole = sum(not o.failed for o in found)
            expected = sum(o.expected for o in found)
            print(
                f"{name}: {held} of {expected} expectations, {whole} of {len(found)} prompts whole",
                flush=True,
            )


if __name__ == "__main__":
    raise SystemExit(run_command("animator prompts", main))
