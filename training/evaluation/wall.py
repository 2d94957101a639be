"""Fig. 9: ours and other methods over walls: the same way, the same keyed crossing, another network.

python -m training.evaluation wall --model compact --model RUNS/pfnn/seed0/model --figures docs/images --markdown docs/results/wall.md
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from runtime.arrays import Array
from runtime.controls import Gait
from runtime.motion.features import FPS
from training.evaluation.experiment import Experiment, Setting
from training.evaluation.metrics.crossing import mean_of
from training.evaluation.motion.obstacles import ObstacleRun, by_name, run_obstacles, score_run
from training.evaluation.report.courses import draw_courses
from training.markdown import number, percent, table

GAITS = (Gait.WALK, Gait.JOG)


def jerk(positions: Array) -> float:
    """Of joints `(T, J, 3)`: root mean square of the third difference over time, km/s^3."""
    return float(np.sqrt((np.diff(positions, 3, axis=0) ** 2).sum(-1).mean()) * FPS**3 / 1000.0)


def over_walls(setting: Setting) -> dict[str, Any]:
    """A row for each model and gait; draws Fig. 9 with --figures."""
    args = setting.args
    (course,) = by_name(("wall",))
    results: dict[str, Any] = {}
    drawn: list[ObstacleRun] = []
    for subject in setting.subjects:
        rows = []
        for gait in GAITS:
            setting.report(f"{subject.name}: {gait.label}")
            code = subject.style(args.style, 0)
            run = run_obstacles(subject.model, course, args.style, code, gait, args.seed)
            rows.append(score_run(run) | {"gait": gait.label, "jerk": jerk(run.motion.positions)})
            if gait is Gait.WALK:
                drawn.append(replace(run, motion=replace(run.motion, name=subject.name)))
        results[subject.name] = rows
    if args.figures is not None:
        args.figures.mkdir(parents=True, exist_ok=True)
        draw_courses(drawn, args.figures / "fig9_walls.png")
    return results


def walls_table(results: dict[str, Any]) -> str:
    """A row for each model: means of walking and jogging."""
    head = [
        "model",
        "got over",
        "s each",
        "joint inside the wall, before > after foot lock",
        "thigh, shin, hand p99, cm, after",
        "both hands on the edge, s",
        "soles slide, cm a frame",
        "jerk, km/s³",
    ]
    rows = []
    for name, found in results.items():
        after = [r["after"] for r in found]
        inside = " > ".join(
            percent(mean_of([r[s] for r in found], "joint_inside")) for s in ("before", "after")
        )
        hands = [s for row in after for s in row["hands_s"] if s is not None]
        rows.append(
            [
                name,
                f"{sum(r['passed'] for r in found)} of {sum(r['obstacles'] for r in found)}",
                number(mean_of(found, "seconds_each"), 1),
                inside,
                ", ".join(number(mean_of(after, f"{limb}_p99")) for limb in ("thighs", "shins", "hands")),
                number(float(np.mean(hands)) if hands else None, 1),
                number(mean_of(found, "skating"), 2),
                number(mean_of(found, "jerk"), 1),
            ]
        )
    return "\n".join(table(head, rows))


WALL = Experiment(
    "Fig. 9: walls of 0.6, 1.0 and 1.4 m by several methods, walking and jogging.",
    over_walls,
    walls_table,
    "walls",
    models=2,
    options=(
        ("--style", {"default": "neutral"}),
        ("--seed", {"type": int, "default": 0}),
        ("--figures", {"metavar": "DIR", "help": "draw fig9_walls.png into DIR", "type": Path}),
    ),
)
