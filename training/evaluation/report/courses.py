"""The obstacle courses as Markdown tables and as contact sheets, one style a row."""

from __future__ import annotations

from collections.abc import Sequence
from math import isnan
from pathlib import Path
from typing import Any

import numpy as np

from runtime.arrays import Array
from runtime.motion.features import FPS
from runtime.skeleton import PART_JOINTS, SPORT_SKELETON
from training.evaluation.metrics.crossing import mean_of
from training.evaluation.motion.obstacles import COURSES, ObstacleRun
from training.markdown import number, percent, table

SECTION = "obstacle courses"  # of a document, between its markers
Row = dict[str, Any]


def markdown(results: dict[str, Any]) -> str:
    """All tables of `results`, what `--json` holds."""
    lines = [f"`{results['command']}`", "", *_overview(results)]
    for course in COURSES:
        rows = [r for r in results["rows"] if r["course"] == course.name]
        if rows:
            lines += [f"### {course.title[0].upper()}{course.title[1:]}", "", *_course(course.name, rows)]
    return "\n".join(lines) + "\n"


def _overview(results: dict[str, Any]) -> list[str]:
    """A row for each course: means over styles and gaits."""
    level = mean_of(results["level"], "recognised")
    rows = []
    for course in COURSES:
        found = [r for r in results["rows"] if r["course"] == course.name]
        if not found:
            continue
        known = mean_of(found, "recognised")
        rows.append(
            [
                course.title,
                f"{sum(r['passed'] for r in found)} of {sum(r['obstacles'] for r in found)}",
                _both(found, "sole_p99"),
                _both(found, "joint_inside", percent),
                _both(found, "joint_deep", percent),
                *(_both(found, f"{limb}_deep", percent) for limb in ("thighs", "shins", "hands")),
                number(mean_of(found, "skating"), 2),
                str(sum(r["frozen_s"] for r in found)),
                percent(mean_of(found, "keyed_share")),
                _share(found, "sound"),
                _share(found, "own"),
                percent(known) + ("" if isnan(known / level) else f" ({known / level:.2f})"),
            ]
        )
    head = ["means over styles and gaits; before > after foot lock", "got over", "soles sunk p99, cm"]
    head += [
        "joint inside",
        "over 3 cm",
        "thigh over 3 cm",
        "shin",
        "hand",
        "soles slide, cm a frame",
        "frozen s",
        "keyed",
        "crossings that pass every check",
        "by the network alone",
    ]
    return table([*head, f"recognised (of level ground's {percent(level)})"], rows)


def _both(rows: Sequence[Row], key: str, show: Any = number) -> str:
    return " > ".join(show(mean_of([r[side] for r in rows], key)) for side in ("before", "after"))


def _share(rows: Sequence[Row], key: str) -> str:
    return percent(sum(r[key] for r in rows) / sum(r["obstacles"] for r in rows))


def _course(name: str, rows: Sequence[Row]) -> list[str]:
    head = ["", "got over", "s each", "slowest / asked m/s", "soles p99, cm", "deepest joint, cm"]
    head += ["thigh, shin, hand p99, cm, after lock", *_OWN_HEADS.get(name, ()), "recognised"]
    return table(head, [_row(name, r) for r in rows])


def _row(name: str, row: Row) -> list[str]:
    after = row["after"]
    return [
        f"{row['style']} {row['gait']}",
        f"{row['passed']} of {row['obstacles']}",
        number(row["seconds_each"]),
        f"{number(row['slowest_m_s'], 2)} / {number(row['asked_m_s'], 2)}",
        _both([row], "sole_p99"),
        _both([row], "joint_max"),
        ", ".join(number(after.get(f"{limb}_p99")) for limb in ("thighs", "shins", "hands")),
        *_own_cells(name, row),
        percent(row["recognised"]),
    ]


_OWN_HEADS: dict[str, tuple[str, ...]] = {
    "hurdles": ("clearance, median cm", "feet that touch"),
    "beam": ("contacts on it", "falls off"),
    "platforms": ("gaps flown over, after lock", "not stepped into"),
    "wall": ("both hands on the edge, s", "both feet on top after, s", "keyed s"),
}


def _own_cells(name: str, row: Row) -> list[str]:
    before, after = row["before"], row["after"]
    if name == "hurdles":
        return [_both([row], "clearance"), _both([row], "touched", percent)]
    if name == "beam":
        return [_both([row], "on_beam", percent), f"{before['falls']} > {after['falls']}"]
    if name == "platforms":
        return [f"{after[k]} of {after['gaps']}" for k in ("flown", "not_stepped_into")]
    if name == "wall":
        lists = [" / ".join(number(v) for v in after[k]) for k in ("hands_s", "on_top_s")]
        return [*lists, number(row["keyed_s"])]
    return []


COLOURS = {
    "left_arm": "#e8590c", "left_leg": "#d9480f", "right_arm": "#1971c2", "right_leg": "#1864ab",
    "torso": "#495057", "head": "#212529",
}  # fmt: skip
APART_M = 0.75  # between two figures; half a second and more
WAIT_S = 0.5
BODY_M = 1.9  # drawn over the highest ground
DPI = 80


def draw_courses(runs: Sequence[ObstacleRun], out: Path) -> None:
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


def _moments(run: ObstacleRun, first: float, last: float) -> list[int]:
    """Frames in which the hips have gone on by `APART_M`, or have waited where they are."""
    z = run.motion.positions[:, 0, 2]
    chosen: list[int] = []
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
