"""Tables of an evaluation as Markdown."""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from math import isnan
from pathlib import Path
from typing import Any

from runtime.errors import FileError, run_command
from training.evaluation.report.bars import check
from training.evaluation.report.markers import write_section

SKATING = ("soles", "toe_soles", "toes")  # the strictest first: the paper's formula is zero by construction
SECTION = "motion evaluation"  # of a document, between its markers


def markdown(results: dict[str, Any]) -> str:
    """All tables of `results`, what `--json` holds."""
    lines = [
        f"`{results['command']}`",
        "",
        *_table_one(results),
    ]
    for model in results["models"]:
        lines += [f"### {model['name']}", "", *_bars(model, results["held_out"])]
        lines += [*_styles(model, results), *_skating(model), *_terrain(model, results["rollouts"])]
    return "\n".join(lines) + "\n"


def _number(value: float | None, digits: int) -> str:
    return "–" if value is None or isnan(value) else f"{value:.{digits}f}"


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    return [
        "| " + " | ".join(head) + " |",
        "|" + " --- |" * len(head),
        *("| " + " | ".join(row) + " |" for row in rows),
        "",
    ]


def _table_one(results: dict[str, Any]) -> list[str]:
    sets = results["feature_sets"]
    head = [
        *(f"FMD, {n} features" for n in sets),
        "skating under soles / under toes / at toe joints, before lock",
        "after lock",
        "diversity T 1 / T 0",
        "network / frame (ms)",
        "parameters",
        "recognised / alike",
        "transition jerk",
        "path error (m)",
    ]
    rows = [_held_out_row(results["held_out"], sets)]
    if results["rollouts"]:
        rows.append(_rollouts_row(results["rollouts"], sets))
    rows += [_model_row(model, sets) for model in results["models"]]
    return _table(["", *head], rows)


def _held_out_row(row: dict[str, Any], sets: Sequence[str]) -> list[str]:
    found = row["recognition"]
    return [
        row["name"],
        *(f"{_number(row['fmd'][n]['distance'], 1)}, {row['fmd'][n]['windows']} windows" for n in sets),
        "–",
        _pair(mean_skating(row["skating"])),
        *("–", "–", "–"),
        f"{_mean(found['score']):.2f} / {_mean(found['merged_score']):.2f}, {len(found['score'])} styles",
        *("–", "–"),
    ]


def _rollouts_row(row: dict[str, Any], sets: Sequence[str]) -> list[str]:
    """Without a distance: other ground and other controls than those of the followed paths, so not comparable."""
    return [
        row["name"],
        *("–" for _ in sets),
        "–",
        _pair(mean_skating(row["skating"])),
        *("–", "–", "–", "–", "–", "–"),
    ]


def _model_row(model: dict[str, Any], sets: Sequence[str]) -> list[str]:
    following, diversity = model["following"], model["diversity"]
    found, times = following["recognition"], model["runtime"]
    courses = [c for gaits in model["courses"].values() for c in gaits.values()]
    errors = [c["flat"]["path_error_m"] for c in courses]
    transitions = model["transitions"]
    return [
        f"{model['name']} ({model['decoder']})",
        *(
            f"{_distance(following['fmd'][n])}, {following['fmd'][n]['takes']['windows']} windows"
            for n in sets
        ),
        _pair([_mean([c["flat"]["before"][m] for c in courses]) for m in SKATING]),
        _pair([_mean([c["flat"]["after"][m] for c in courses]) for m in SKATING]),
        f"{diversity['temperature_1']['pose']:.3f} / {diversity['temperature_0']['pose']:.3f}",
        f"{times['network_ms']:.2f} / {times['frame_ms']:.2f}",
        f"{model['parameters'] / 1e6:.2f} M",
        f"{_mean(found['score']):.2f} / {_mean(found['merged_score']):.2f}, {len(found['score'])} styles",
        _number(transitions.get("ratio"), 2),
        _number(_mean(errors), 2),
    ]


def mean_skating(gaits: dict[str, dict[str, float]]) -> list[float]:
    """The three measures over all frames of walking and jogging."""
    frames = sum(g["frames"] for g in gaits.values())
    return [
        sum(g[m] * g["frames"] for g in gaits.values() if g["frames"]) / frames if frames else float("nan")
        for m in SKATING
    ]


def _pair(values: Sequence[float]) -> str:
    return " / ".join(_number(v, 3) for v in values)


def _mean(values: Sequence[float] | dict[str, float]) -> float:
    listed = list(values.values()) if isinstance(values, dict) else list(values)
    return sum(listed) / len(listed) if listed else float("nan")


def _bars(model: dict[str, Any], held_out: dict[str, Any]) -> list[str]:
    rows = []
    for bar in check(model, held_out):
        missed = ", ".join(bar.missed[:4]) + (" …" if len(bar.missed) > 4 else "")
        rows.append([bar.name, "pass" if bar.passed else "**miss**", f"{bar.met} of {bar.cases}", missed])
    return _table(["asked", "", "met by", "worst"], rows)


def _styles(model: dict[str, Any], results: dict[str, Any]) -> list[str]:
    sets = results["feature_sets"]
    own, target = model["following"]["recognition"], results["held_out"]["recognition"]
    rows = []
    for style, found in model["following"]["styles"].items():
        fmd = found["fmd"]
        score = own["score"].get(style)
        rows.append(
            [
                style,
                *(_distance(fmd[n]) for n in sets),
                f"{fmd[sets[0]]['takes']['windows']} / {fmd[sets[0]]['windows']}",
                "–"
                if score is None
                else f"{score:.2f} / {target['score'][style]:.2f}"
                + _taken(style, score, own["taken_for"][style]),
                f"{found['speed_ratio']:.2f}",
                f"{found['path_error_m']:.2f}",
            ]
        )
    head = ["style", *(f"FMD {n}" for n in sets), "windows", "recognised: own / held out"]
    return _table([*head, "speed", "path error (m)"], rows)


def _distance(found: dict[str, Any]) -> str:
    """The distance, and in brackets what it is of that between two halves: of whole takes, and of takes cut in two."""
    ratios = f"{_number(found['takes']['ratio'], 1)} x, {_number(found['ratio'], 1)} x"
    return f"{_number(found['takes']['distance'], 1)} ({ratios})"


def _taken(style: str, score: float, taken_for: str) -> str:
    return f" ({taken_for})" if score < 0.5 and taken_for != style else ""


def _skating(model: dict[str, Any]) -> list[str]:
    rows = []
    for style, gaits in model["courses"].items():
        for gait, found in gaits.items():
            mark = "" if found["captured"]["held_out"] else "*"
            cells = [found["captured"], found["flat"]["before"], found["flat"]["after"]]
            cells += [found["rough"]["before"], found["rough"]["after"]]
            speed = f"{found['flat']['speed_m_s']:.2f} / {found['flat']['asked_m_s']:.2f}"
            rows.append([f"{style} {gait}{mark}", *(_pair([c[m] for m in SKATING]) for c in cells), speed])
    head = [
        "skating under soles / under toes / at toe joints",
        "capture",
        "flat, before lock",
        "after",
        "rough, before",
        "after",
    ]
    return _table([*head, "m/s: real / asked"], rows)


def _terrain(model: dict[str, Any], rollouts: dict[str, Any] | None) -> list[str]:
    keys = ("sunk_joint_p99", "sunk_sole_p95", "sunk_sole_p99", "float_p50", "float_p95", "path_error_m")
    found = dict(model["terrain"])
    for gait, row in (rollouts or {}).get("terrain", {}).items():
        found[f"{gait}, terrain rollouts (PFNN)"] = row | {"path_error_m": None}
    rows = [[name, *(_number(row[k], 2) for k in keys)] for name, row in found.items()]
    head = ["ground", "joints sunk p99 (cm)", "soles sunk p95", "p99", "lowest point over ground p50", "p95"]
    return _table([*head, "path error (m)"], rows)


def main(argv: Sequence[str] | None = None) -> int:
    """`python -m training.evaluation.report.tables RESULTS.json FILE.md`: the tables of an evaluation that was kept."""
    parser = argparse.ArgumentParser(prog="training.evaluation.report.tables", description=main.__doc__)
    parser.add_argument("json", type=Path)
    parser.add_argument("markdown", type=Path)
    args = parser.parse_args(argv)
    try:
        results = json.loads(args.json.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise FileError(
            f"{args.json}: not a readable JSON file.", "Run `sport evaluate --json FILE` first."
        ) from error
    write_section(args.markdown, SECTION, markdown(results))
    return 0


if __name__ == "__main__":
    raise SystemExit(run_command("evaluation report", main))
