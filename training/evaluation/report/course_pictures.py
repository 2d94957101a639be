"""A contact sheet of each obstacle course: the ground in profile, and a figure on it every half second, one style a row."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.motion.features import FPS
from runtime.skeleton import PART_JOINTS, SPORT_SKELETON
from training.evaluation.motion.obstacle_courses import CourseRun

Array = NDArray[np.floating]

COLOURS = {
    "left_arm": "#e8590c", "left_leg": "#d9480f", "right_arm": "#1971c2", "right_leg": "#1864ab",
    "torso": "#495057", "head": "#212529",
}  # fmt: skip
APART_M = 0.75  # between two figures; half a second and more
WAIT_S = 0.5
BODY_M = 1.9  # drawn over the highest ground
DPI = 80


def draw_courses(runs: Sequence[CourseRun], out: Path) -> None:
    """One course's runs, one in a row, seen from the character's left: left limbs orange, right limbs blue."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    first, last = 1.5, runs[0].course.obstacles[-1].end + 1.0
    lanes = np.linspace(-0.02, 0.02, 3)
    z = np.arange(first, last, 0.01)
    ground = runs[0].motion.terrain.height(lanes[:, None] + 0.0 * z, z + 0.0 * lanes[:, None]).max(0)
    low, high = float(ground.min()) - 0.1, float(ground.max()) + BODY_M
    width = 15.0
    row = width * (high - low) / (last - first)
    figure, axes = pyplot.subplots(len(runs), 1, figsize=(width, row * len(runs)), squeeze=False)
    for axis, run in zip(axes[:, 0], runs, strict=True):
        axis.fill_between(z, low, ground, color="#ced4da", lw=0)
        axis.plot(z, ground, color="#495057", lw=1.2)
        for frame in _moments(run, first, last):
            _figure(axis, run.motion.positions[frame])
        axis.set(xlim=(first, last), ylim=(low, high), aspect="equal")
        axis.axis("off")
        axis.text(first + 0.05, high - 0.25, run.motion.name, fontsize=11, va="top")
    figure.subplots_adjust(0, 0, 1, 1, 0, 0.02)
    figure.savefig(out, dpi=DPI)
    pyplot.close(figure)


def _moments(run: CourseRun, first: float, last: float) -> list[int]:
    """Frames in which the hips have gone on by `APART_M`, or have waited where they are."""
    z, chosen = run.motion.positions[:, 0, 2], []
    for frame in range(len(z)):
        if not first + 0.3 < z[frame] < last - 0.3:
            continue
        new = not chosen or z[frame] - z[chosen[-1]] >= APART_M
        waited = chosen and frame - chosen[-1] >= WAIT_S * FPS and z[frame] - z[chosen[-1]] > 0.25
        if new or waited:
            chosen.append(frame)
    return chosen


def _figure(axis: Any, p: Array) -> None:
    for part, joints in PART_JOINTS.items():
        for j in joints:
            parent = SPORT_SKELETON.parents[j]
            if parent >= 0:
                axis.plot(
                    p[[parent, j], 2], p[[parent, j], 1], color=COLOURS[part], lw=2.2, solid_capstyle="round"
                )
    head = p[16] + 0.6 * (p[16] - p[15])
    axis.plot(head[2], head[1], "o", color=COLOURS["head"], ms=7)
