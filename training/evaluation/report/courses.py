"""The obstacle courses as Markdown tables."""

from __future__ import annotations

from collections.abc import Sequence
from math import isnan
from typing import Any

from training.evaluation.metrics.crossing import mean_of
from training.evaluation.motion.obstacles import COURSES
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
                percent(mean_of(found, "keyed_fraction")),
                _fraction(found, "sound"),
                _fraction(found, "own"),
                percent(known) + ("" if isnan(known / level) else f" ({known / level:.2f})"),
            ]
        )
    head = ["means over styles and gaits; before > after foot lock", "got over", "soles sunk p99, cm"]
    head += ["joint inside", "over 3 cm", "thigh over 3 cm", "shin", "hand", "soles slide, cm a frame"]
    head += ["frozen s", "keyed", "crossings that pass every check", "by the network alone"]
    return table([*head, f"recognised (of level ground's {percent(level)})"], rows)


def _both(rows: Sequence[Row], key: str, show: Any = number) -> str:
    return " > ".join(show(mean_of([r[side] for r in rows], key)) for side in ("before", "after"))


def _fraction(rows: Sequence[Row], key: str) -> str:
    return percent(sum(r[key] for r in rows) / sum(r["obstacles"] for r in rows))


def _course(name: str, rows: Sequence[Row]) -> list[str]:
    head = ["", "got over", "s each", "slowest / requested m/s", "soles p99, cm", "deepest joint, cm"]
    head += ["thigh, shin, hand p99, cm, after lock", *_OWN_HEADS.get(name, ()), "recognised"]
    return table(head, [_row(name, r) for r in rows])


def _row(name: str, row: Row) -> list[str]:
    after = row["after"]
    return [
        f"{row['style']} {row['gait']}",
        f"{row['passed']} of {row['obstacles']}",
        number(row["seconds_each"]),
        f"{number(row['slowest_m_s'], 2)} / {number(row['requested_m_s'], 2)}",
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
