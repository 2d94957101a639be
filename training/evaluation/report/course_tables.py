"""Tables of the obstacle courses as Markdown."""

from __future__ import annotations

from collections.abc import Sequence
from math import isnan
from typing import Any

import numpy as np

from training.evaluation.metrics.crossing import mean_of
from training.evaluation.motion.obstacle_courses import COURSES

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


def _number(value: float | None, digits: int = 1) -> str:
    return "–" if value is None or isnan(value) else f"{value:.{digits}f}"


def _percent(value: float | None) -> str:
    return "–" if value is None or isnan(value) else f"{100.0 * value:.0f} %"


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    lines = ["| " + " | ".join(head) + " |", "| --- " * len(head) + "|"]
    return [*lines, *("| " + " | ".join(row) + " |" for row in rows), ""]


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
                _both(found, "joint_inside", _percent),
                _both(found, "joint_deep", _percent),
                *(_both(found, f"{limb}_deep", _percent) for limb in ("thighs", "shins", "hands")),
                _number(mean_of(found, "skating"), 2),
                str(sum(r["frozen_s"] for r in found)),
                _percent(known) + ("" if isnan(known / level) else f" ({known / level:.2f})"),
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
    ]
    return _table([*head, f"recognised (of level ground's {_percent(level)})"], rows)


def _both(rows: Sequence[Row], key: str, show: Any = _number) -> str:
    return " > ".join(show(mean_of([r[side] for r in rows], key)) for side in ("before", "after"))


def _course(name: str, rows: Sequence[Row]) -> list[str]:
    head = ["", "got over", "s each", "slowest / asked m/s", "soles p99, cm", "deepest joint, cm"]
    head += ["thigh, shin, hand p99, cm, after lock", *_OWN_HEADS.get(name, ()), "recognised"]
    return _table(head, [_row(name, r) for r in rows])


def _row(name: str, row: Row) -> list[str]:
    after = row["after"]
    return [
        f"{row['style']} {row['gait']}",
        f"{row['passed']} of {row['obstacles']}",
        _number(row["seconds_each"]),
        f"{_number(row['slowest_m_s'], 2)} / {_number(row['asked_m_s'], 2)}",
        _both([row], "sole_p99"),
        _both([row], "joint_max"),
        ", ".join(_number(after.get(f"{limb}_p99")) for limb in ("thighs", "shins", "hands")),
        *_own_cells(name, row),
        _percent(row["recognised"]),
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
        return [_both([row], "clearance"), _both([row], "touched", _percent)]
    if name == "beam":
        return [_both([row], "on_beam", _percent), f"{before['falls']} > {after['falls']}"]
    if name == "platforms":
        return [f"{after[k]} of {after['gaps']}" for k in ("flown", "not_stepped_into")]
    if name == "wall":
        lists = [" / ".join(_number(v) for v in after[k]) for k in ("hands_s", "on_top_s")]
        return [*lists, _number(row["keyed_s"])]
    return []


def worst(results: dict[str, Any], course: str, side: str, key: str) -> float:
    """The highest value of a measure over styles and gaits."""
    values = [r[side].get(key) for r in results["rows"] if r["course"] == course]
    return float(np.nanmax([v for v in values if v is not None] or [np.nan]))
