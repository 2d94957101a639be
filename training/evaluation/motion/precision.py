"""A minute of play in full precision and with 8-bit weights, from the same seed and controls, and in another seed.

python -m training.evaluation.motion.precision                       the shipped model; its 8-bit twin is made where it has none

Two runs drift apart in the noise of the feet whatever the cause, so a second seed says how far is far.
"""

from __future__ import annotations

import argparse
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from runtime.assets import PROJECT_ROOT, model_folder
from runtime.errors import UsageError, run_command
from runtime.generate import simulate
from runtime.motion.controller import Controller
from runtime.motion.features import FPS
from runtime.motion.model import load_model
from runtime.motion.model_files import INT8_GRAPH, read_metadata
from runtime.motion.paths import control_script
from runtime.prompts.prompter import Prompter
from runtime.skeleton import SPORT_SKELETON
from runtime.terrain.library import load_terrain
from training.evaluation.motion import feet

Array = NDArray[np.floating]

RUNS = (("fp32", "fp32", 0), ("int8", "int8", 0), ("fp32, other seed", "fp32", 1))  # name, precision, seed
COURSES = (  # prompt, path, gait, terrain: equal shares of the minute
    ("a proud queen", "circle", "walk", "flat"),
    ("an exhausted soldier, left arm hanging", "figure8", "walk", "hills"),
    ("a happy child skipping along", "circle", "jog", "flat"),
)
LEAD_IN = 2 * FPS  # frames before the character moves as asked


def measures(positions: Array, name: str) -> dict[str, float]:
    """How a clip `(T, 31, 3)` on terrain `name` moves and stands: speed, posture and skating by their names."""
    joint = {joint: positions[:, SPORT_SKELETON.index(joint)] for joint in SPORT_SKELETON.names}
    hips, trunk = joint["Hips"], joint["Head"] - joint["Hips"]
    terrain = load_terrain(name)
    ground = terrain.height(hips[:, 0], hips[:, 2])
    lean = np.degrees(np.arctan2(np.hypot(trunk[:, 0], trunk[:, 2]), trunk[:, 1]))
    hands = {side: 100.0 * float((joint[f"{side}Hand"] - hips)[:, 1].mean()) for side in ("Left", "Right")}
    steps = np.linalg.norm(np.diff(hips[:, [0, 2]], axis=0), axis=1)
    spread = np.linalg.norm((joint["LeftFoot"] - joint["RightFoot"])[:, [0, 2]], axis=1)
    return {
        "root speed (m/s)": FPS * float(steps.mean()),
        "hips over the ground (cm)": 100.0 * float((hips[:, 1] - ground).mean()),
        "trunk from upright (degrees)": float(lean.mean()),
        "left hand over the hips (cm)": hands["Left"],
        "right hand over the hips (cm)": hands["Right"],
        "feet apart, p90 (cm)": 100.0 * float(np.percentile(spread, 90)),
        "skating at toe joints (cm a frame)": float(feet.skating(positions, terrain).mean()),
        "skating at the sole (cm a frame)": float(feet.sole_skating(positions, terrain).mean()),
    }


def compare(folder: Path, seconds: float) -> tuple[dict[str, dict[str, float]], dict[str, float]]:
    """Means of `measures` over COURSES of `seconds` together by run, and the mean distance (cm) of the hips from the
    first run's at the same time."""
    found: dict[str, list[dict[str, float]]] = {}
    away: dict[str, list[float]] = {}
    first: list[Array] = []
    for name, precision, seed in RUNS:
        model = load_model(folder, precision=precision)
        to_style = Prompter(model)
        for number, (prompt, path, gait, terrain) in enumerate(COURSES):
            controller = Controller(model, load_terrain(terrain), seed)
            frames = LEAD_IN + round(seconds * FPS / len(COURSES))
            poses = simulate(controller, control_script(path, gait), [(0.0, to_style(prompt))], frames)
            positions = np.stack([pose.positions for pose in poses[LEAD_IN:]])
            found.setdefault(name, []).append(measures(positions, terrain))
            if name == RUNS[0][0]:
                first.append(positions)
            apart = np.linalg.norm((positions - first[number])[:, SPORT_SKELETON.index("Hips"), ::2], axis=1)
            away.setdefault(name, []).append(100.0 * float(apart.mean()))
    means = {n: {key: float(np.mean([one[key] for one in ms])) for key in ms[0]} for n, ms in found.items()}
    return means, {name: float(np.mean(values)) for name, values in away.items()}


def table(means: dict[str, dict[str, float]], away: dict[str, float]) -> str:
    """The figures as Markdown, one column for each run."""
    rows = {key: [run[key] for run in means.values()] for key in next(iter(means.values()))}
    rows["hips from the first run's (cm)"] = list(away.values())
    return "\n".join(
        [
            f"| measure | {' | '.join(means)} |",
            "| --- " + "| --: " * len(means) + "|",
            *(
                f"| {key} | {' | '.join(f'{value:.3f}' for value in values)} |"
                for key, values in rows.items()
            ),
        ]
    )


def _with_twin(model: Path, folder: Path) -> Path:
    """`model`, or a copy of it in `folder` with an 8-bit graph."""
    if INT8_GRAPH in read_metadata(model)["sha256"]:
        return model
    copy = folder / "model"
    shutil.copytree(model, copy)
    command = [sys.executable, "-m", "training.export.quantize", str(copy)]
    done = subprocess.run(command, cwd=PROJECT_ROOT, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        last = (done.stderr.strip().splitlines() or ["no reason given"])[-1]
        raise UsageError(f"8-bit twin of {model}: {last[:300]}", "Run pip install -e '.[train]'.")
    print(done.stdout.strip())
    return copy


def main(argv: list[str] | None = None) -> int:
    """Command line."""
    parser = argparse.ArgumentParser(
        prog="training.evaluation.motion.precision", description="Play in fp32 and int8."
    )
    parser.add_argument(
        "--model", type=model_folder, metavar="DIR", help="exported model (default: the shipped one)"
    )
    parser.add_argument("--seconds", type=float, default=60.0, help="of play in each run (default 60)")
    options = parser.parse_args(argv)
    if not 1.0 <= options.seconds <= 3600.0:
        raise UsageError(f"--seconds {options.seconds}: expected 1 to 3600.", "Try 60.")
    with tempfile.TemporaryDirectory() as folder:
        model = _with_twin(options.model or model_folder(), Path(folder))
        print(table(*compare(model, options.seconds)))
    return 0


if __name__ == "__main__":
    raise SystemExit(run_command("precision", main))
