"""The obstacle courses as Markdown tables."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import isnan
from typing import Any

from training.evaluation.metrics.crossing import mean_of
from training.evaluation.motion.obstacles import COURSES
from training.markdown import number, percent, table

SECTION = "obstacle courses"  # of a document, between its markers
Row = dict[str, Any]


def markdown(results: dict[str, Any]) -> str:
    """All tables of `results`, what `--json` holds."""
    found = {c.title: [r for r in results["rows"] if r["course"] == c.name] for c in COURSES}
    found = {title: rows for title, rows in found.items() if rows}
    lines = [f"`{results['command']}`", "", *_overview(found, mean_of(results["level"], "recognised"))]
    for title, rows in found.items():
        lines += [f"### {title[0].upper()}{title[1:]}", "", *_course(rows)]
    return "\n".join(lines) + "\n"


def _overview(found: dict[str, list[Row]], level: float) -> list[str]:
    """A row for each course: means over styles and gaits."""
    rows = []
    for title, runs in found.items():
        known, obstacles = mean_of(runs, "recognised"), sum(r["obstacles"] for r in runs)
        limbs = [_both(runs, f"{limb}_deep", percent) for limb in ("thighs", "shins", "hands")]
        rows.append(
            [
                title,
                f"{sum(r['passed'] for r in runs)} of {obstacles}",
                _both(runs, "sole_p99"),
                _both(runs, "joint_inside", percent),
                _both(runs, "joint_deep", percent),
                *limbs,
                number(mean_of(runs, "skating"), 2),
                str(sum(r["frozen_s"] for r in runs)),
                percent(mean_of(runs, "keyed_fraction")),
                *(percent(sum(r[key] for r in runs) / obstacles) for key in ("sound", "own")),
                percent(known) + ("" if isnan(known / level) else f" ({known / level:.2f})"),
            ]
        )
    head = ["means over styles and gaits; before > after foot lock", "got over", "soles sunk p99, cm"]
    head += ["joint inside", "over 3 cm", "thigh over 3 cm", "shin", "hand", "soles slide, cm a frame"]
    head += ["frozen s", "keyed", "crossings that pass every check", "by the network alone"]
    return table([*head, f"recognised (of level ground's {percent(level)})"], rows)


def _both(rows: Sequence[Row], key: str, show: Any = number) -> str:
    return " > ".join(show(mean_of([r[side] for r in rows], key)) for side in ("before", "after"))


def _course(rows: Sequence[Row]) -> list[str]:
    """A row for each style and gait, with the columns that only this course has."""
    own = OWN_COLUMNS.get(rows[0]["course"], {})
    head = ["", "got over", "s each", "slowest / requested m/s", "soles p99, cm", "deepest joint, cm"]
    head += ["thigh, shin, hand p99, cm, after lock", *own, "recognised"]
    cells = [
        [
            f"{r['style']} {r['gait']}",
            f"{r['passed']} of {r['obstacles']}",
            number(r["seconds_each"]),
            f"{number(r['slowest_m_s'], 2)} / {number(r['requested_m_s'], 2)}",
            _both([r], "sole_p99"),
            _both([r], "joint_max"),
            ", ".join(number(r["after"].get(f"{limb}_p99")) for limb in ("thighs", "shins", "hands")),
            *(cell(r) for cell in own.values()),
            percent(r["recognised"]),
        ]
        for r in rows
    ]
    return table(head, cells)


def _each(row: Row, key: str) -> str:
    return " / ".join(number(v) for v in row["after"][key])


OWN_COLUMNS: dict[str, dict[str, Callable[[Row], str]]] = {
    "hurdles": {
        "clearance, median cm": lambda r: _both([r], "clearance"),
        "feet that touch": lambda r: _both([r], "touched", percent),
    },
    "beam": {
        "contacts on it": lambda r: _both([r], "on_beam", percent),
        "falls off": lambda r: f"{r['before']['falls']} > {r['after']['falls']}",
    },
    "platforms": {
        "gaps flown over, after lock": lambda r: f"{r['after']['flown']} of {r['after']['gaps']}",
        "not stepped into": lambda r: f"{r['after']['not_stepped_into']} of {r['after']['gaps']}",
    },
    "wall": {
        "both hands on the edge, s": lambda r: _each(r, "hands_s"),
        "both feet on top after, s": lambda r: _each(r, "on_top_s"),
        "keyed s": lambda r: number(r["keyed_s"]),
    },
}
