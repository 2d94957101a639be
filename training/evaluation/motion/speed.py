"""How the root keeps to the speed that the stick asks for: setting off, and walking on.

python -m training.evaluation.motion.speed [--seconds 14] [--json FILE]

Per walk: seconds until 80 % of the requested speed, and over half seconds (a stride speeds up and slows down) the highest
speed, the lowest after SETTLED, the mean error from then on, and the deviation, all as shares of the requested speed.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from itertools import product
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from runtime.atomic import check_target, write_atomic
from runtime.controls import Controls
from runtime.errors import UsageError, run_command
from runtime.motion.controller import Controller
from runtime.motion.features import FPS
from runtime.motion.model import load_model
from runtime.prompts.prompter import Prompter
from runtime.terrain.library import load_terrain

PROMPTS = (
    "walking in a relaxed, everyday way",
    "a child pretending to be an aeroplane",
    "a karate fighter chopping",
    "an old man with a bad back",
    "a proud, self-important person",
)
STICKS, TERRAINS = (1.0, 0.6), ("flat", "stairs")
SETTLED = 5.0  # seconds after setting off
WINDOW = FPS // 2


@dataclass(frozen=True)
class Walk:
    """Figures of one walk; shares of the requested speed, seconds."""

    prompt: str
    terrain: str
    stick: float
    asked: float  # m/s
    set_off: float
    highest: float
    lowest: float
    error: float
    deviation: float


def describe(speeds: NDArray[np.floating], asked: float) -> tuple[float, float, float, float, float]:
    """`set_off`, `highest`, `lowest`, `error` and `deviation` of the root's speeds `(T,)`, m/s."""
    share = speeds / asked
    reached = np.flatnonzero(share > 0.8)
    smooth = np.convolve(share, np.full(WINDOW, 1.0 / WINDOW), "valid")
    settled = smooth[round(SETTLED * FPS) :]
    return (
        float(reached[0] / FPS) if len(reached) else float("inf"),
        float(smooth.max()),
        float(settled.min()),
        float(abs(settled.mean() - 1.0)),
        float(settled.std()),
    )


def walk(controller: Controller, stick: float, seconds: float) -> tuple[NDArray[np.floating], float]:
    """Speeds of the root `(T,)` straight ahead from standing, and the asked one, m/s."""
    track = [controller.pose.root_position]
    for _ in range(round(seconds * FPS)):
        track.append(controller.step(Controls(move=(0.0, stick))).root_position)
    steps = np.diff(np.array(track, np.float64)[:, [0, 2]], axis=0)
    return np.linalg.norm(steps, axis=1) * FPS, controller.requested_speed


def main(argv: Sequence[str] | None = None) -> int:
    """Command line."""
    parser = argparse.ArgumentParser(
        prog="training.evaluation.motion.speed", description="Asked and walked speeds."
    )
    parser.add_argument("--seconds", type=float, default=14.0, help="of each walk")
    parser.add_argument("--json", type=Path, metavar="FILE")
    options = parser.parse_args(argv)
    if options.seconds < SETTLED + 1.0:
        raise UsageError(
            f"--seconds {options.seconds:g}: expected {SETTLED + 1.0:g} or more.", "Walk longer."
        )
    if options.json is not None:
        check_target(options.json)
    model = load_model()
    to_style = Prompter(model)
    walks = []
    print("| prompt | ground | stick | asked m/s | sets off in s | highest | lowest | error | deviation |")
    print("| --- | --- | --: | --: | --: | --: | --: | --: | --: |")
    for prompt, terrain, stick in product(PROMPTS, TERRAINS, STICKS):
        controller = Controller(model, load_terrain(terrain), seed=1)
        controller.set_style(to_style(prompt), 0.0)
        speeds, asked = walk(controller, stick, options.seconds)
        walks.append(Walk(prompt, terrain, stick, asked, *describe(speeds, asked)))
        w = walks[-1]
        print(
            f"| {prompt} | {terrain} | {stick:g} | {asked:.2f} | {w.set_off:.2f} | {w.highest:.2f} | {w.lowest:.2f}"
            f" | {100 * w.error:.1f} % | {100 * w.deviation:.1f} % |",
            flush=True,
        )
    means = [float(np.mean([getattr(w, k) for w in walks])) for k in ("set_off", "highest", "lowest")]
    error, deviation = (100 * float(np.mean([getattr(w, k) for w in walks])) for k in ("error", "deviation"))
    print("| mean | | | |", " | ".join(f"{m:.2f}" for m in means), f"| {error:.1f} % | {deviation:.1f} % |")
    if options.json is not None:
        write_atomic(options.json, json.dumps([asdict(w) for w in walks], indent=1) + "\n")
    return 0


if __name__ == "__main__":
    raise SystemExit(run_command("speed", main))
