"""Is a blend even? Of the change between two styles, how much lies in the largest of six equal steps of the blend.

    python -m training.evaluation.motion.blend_steps [--model FOLDER] [--pairs 24] [--out docs/results/walks.md]

Two prompts are blended by seven weights from 0 to 1, as the slider and `sport generate --blend` do; at each the character walks straight on, and its walk is summed up as the
mean and the deviation of every joint's place seen from the root. A step is the distance between two neighbours. 1/6 is even.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from runtime.assets import asset_path, model_folder
from runtime.controls import Controls
from runtime.errors import run_command
from runtime.motion.controller import Controller
from runtime.motion.features import FPS
from runtime.motion.model import MotionModel, load_model
from runtime.motion.style_mix import StyleMix
from runtime.prompts.blend import ALL_A, BlendedPrompt
from runtime.prompts.english.library_data import load_styles
from runtime.prompts.prompter import Prompter
from runtime.skeleton import SPORT_SKELETON
from training.evaluation.motion.driving import flat_ground
from training.evaluation.motion.motion import GESTURES
from training.evaluation.report.markers import check_section, write_section
from training.frames import root_motion

Array = NDArray[np.floating]

STEPS = 6
PAIRS = 24
LEAD_IN_SECONDS = 3.0
SECONDS = 8.0
STICK = 0.7
SECTION = "blend steps"  # of a document, between its markers


def walk_summary(model: MotionModel, style: Array | StyleMix) -> Array:
    """Mean and deviation of the joints `(186,)` in metres of a straight walk, seen from the root."""
    controller = Controller(model, flat_ground(), 0)
    controller.set_style(style, 0.0)
    ahead = Controls(move=(0.0, STICK))
    for _ in range(round(LEAD_IN_SECONDS * FPS)):
        controller.step(ahead)
    poses = []
    for _ in range(round(SECONDS * FPS)):
        controller.step(ahead)
        poses.append(controller.unlocked)
    hips, local = (np.stack(values) for values in zip(*poses, strict=True))
    joints = SPORT_SKELETON.forward_kinematics(hips, local)[0].astype(np.float64)
    xz, yaw = root_motion(joints)
    c, s = np.cos(yaw)[:, None], np.sin(yaw)[:, None]
    x, z = joints[..., 0] - xz[:, :1], joints[..., 2] - xz[:, 1:]
    seen = np.stack([c * x - s * z, joints[..., 1], s * x + c * z], -1).reshape(len(joints), -1)
    return np.concatenate([seen.mean(0), seen.std(0)])


def largest_step(summaries: Array) -> float:
    """Share of the largest step in all steps, of summaries `(7, n)`."""
    steps = np.linalg.norm(np.diff(summaries, axis=0), axis=1)
    return float(steps.max() / max(steps.sum(), 1e-9))


def random_pairs(names: list[str], count: int) -> list[tuple[str, str]]:
    """Pairs of different styles, the same in every run."""
    rng = np.random.default_rng(0)
    return [tuple(rng.choice(names, 2, replace=False)) for _ in range(count)]


def measure(model: MotionModel, count: int = PAIRS) -> dict[tuple[str, str], float]:
    """Largest step of every pair."""
    to_style = Prompter(model)
    styles = load_styles(asset_path("prompts/styles.json"))
    names = sorted(name for name in styles if not name.startswith(GESTURES))
    result = {}
    for first, second in random_pairs(names, count):
        words = (styles[name].descriptions[0] for name in (first, second))
        blend = BlendedPrompt(*words, ALL_A)
        mixes = [to_style(replace(blend, weights=(k / STEPS,) * len(ALL_A))) for k in range(STEPS + 1)]
        result[first, second] = largest_step(np.stack([walk_summary(model, mix) for mix in mixes]))
    return result


def table(found: dict[tuple[str, str], float]) -> str:
    """The Markdown table."""
    values = np.array(list(found.values()))
    worst = max(found, key=lambda pair: found[pair])
    return "\n".join(
        [
            f"| largest of six equal steps, {len(found)} random pairs | share |",
            "| --- | --- |",
            f"| median | {np.median(values):.2f} |",
            f"| worst ({worst[0]} to {worst[1]}) | {values.max():.2f} |",
        ]
    )


def main(argv: list[str] | None = None) -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--model", type=model_folder, help="default: the shipped one")
    parser.add_argument("--pairs", type=int, default=PAIRS)
    parser.add_argument("--out", type=Path, help="document whose section between the markers is exchanged")
    args = parser.parse_args(argv)
    if args.out is not None:
        check_section(args.out, SECTION)
    text = table(measure(load_model(args.model), args.pairs))
    if args.out is not None:
        write_section(args.out, SECTION, text)
    print(text)


if __name__ == "__main__":
    raise SystemExit(run_command("blend_steps", main))
