"""Table I of the paper, every row and column, over several seeds: what was trained is measured, what was not says so.

    python -m training.evaluation table1 --clips DIR --runs RUNS --store table1.json --markdown docs/results/table1.md

A row's models lie in RUNS/<row>/seed<k>/model (the one without diffusion in RUNS/full/seed<k>/model-mixture), or in RUNS/<row>/model
as one seed: what `python -m training.ablations` and `python -m training.baselines` write. Each model is measured once; the store is
written after each, and a run that was stopped goes on where it was.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from runtime.assets import model_folder
from runtime.atomic import write_atomic
from runtime.errors import FileError
from runtime.motion.model_files import read_metadata
from runtime.motion.motion_encoder import ExportedMotionEncoder
from training.evaluation.experiment import Arguments, Experiment, Setting
from training.evaluation.metrics.features import has_encoder, joined
from training.evaluation.metrics.frechet import compare
from training.evaluation.motion.capture import (
    OVERALL_COMPONENTS,
    TERRAIN_GROUP,
    EvaluationPlan,
    Options,
    make_plan,
)
from training.evaluation.motion.scores import score_held_out, score_model
from training.evaluation.motion.subject import Subject
from training.evaluation.report.tables import mean_skating
from training.markdown import number, table

Cells = dict[str, float]
SHIPPED, CAPTURE = "ours, as shipped", "capture, one half against the other"
SHOWN = 0.5  # share of its windows from which on a style counts as shown


@dataclass(frozen=True)
class TableRow:
    """A line of the table: where its models lie, and what the paper's Table I says of its counterpart."""

    title: str
    folder: str  # below RUNS
    model: str = "model"
    paper: tuple[str, ...] = ()  # FMD, skating, diversity, ms, parameters, styles, terrain, seamless


ROWS = (
    TableRow("ours", "full", paper=("0.96", "0.16", "2.47e-2", "52.09", "55.46 M", "100+", "yes", "yes")),
    TableRow(
        "4 experts", "4-experts", paper=("1.27", "0.21", "2.32e-2", "46.27", "31.49 M", "100+", "yes", "yes")
    ),
    TableRow(
        "4 content experts",
        "4-content-experts",
        paper=("1.18", "0.17", "2.28e-2", "49.67", "47.05 M", "100+", "yes", "yes"),
    ),
    TableRow(
        "without diffusion",
        "full",
        "model-mixture",
        ("4.33", "0.13", "0.00", "12.29", "47.98 M", "100+", "yes", "yes"),
    ),
    TableRow("PAE", "pae", paper=("0.99", "0.19", "2.41e-2", "52.09", "55.46 M", "100+", "yes", "yes")),
    TableRow(
        "without content encoder",
        "no-content-encoder",
        paper=("1.06", "0.23", "2.18e-2", "53.65", "66.64 M", "100+", "yes", "yes"),
    ),
    TableRow("whole-body contrast", "whole-body-contrast"),
    TableRow("motion matching", "motion-matching"),
    TableRow("PFNN", "pfnn", paper=("10.25", "0.03", "0.00", "7.55", "2.39 M", "1", "yes", "no")),
    TableRow("Mason 2022", "mason2022", paper=("3.15", "0.20", "0.00", "8.30", "18.42 M", "100", "no", "no")),
    TableRow("style by label", "style-label"),
    TableRow(
        "ours, 100STYLE alone",
        "100style",
        paper=("1.76", "0.11", "2.31e-2", "52.09", "55.46 M", "100+", "no", "yes"),
    ),
    TableRow(
        "ours, terrain data alone",
        "terrain",
        paper=("1.94", "0.09", "2.16e-2", "52.09", "47.71 M", "1", "yes", "yes"),
    ),
)
COLUMNS: dict[str, tuple[str, int]] = {
    "fmd_encoder": ("FMD, encoder", 1),
    "fmd_kinematic": ("FMD, kinematic", 1),
    "skating_formula": ("skating, formula (cm)", 3),
    "skating_soles": ("skating, soles (cm)", 3),
    "diversity": ("diversity (m)", 3),
    "ms": ("network (ms)", 2),
    "parameters": ("parameters (M)", 2),
    "styles": ("styles shown", 0),
    "terrain": ("soles sunk on uneven ground (cm)", 1),
    "transitions": ("transition jerk", 2),
    "recognition": ("recognised", 2),
}


def models_of(row: TableRow, runs: Path) -> dict[str, Path]:
    """Exported models of a row by seed, those that are there."""
    found = {
        path.parent.name.removeprefix("seed"): path
        for path in sorted((runs / row.folder).glob(f"seed*/{row.model}"))
        if (path / "metadata.json").is_file()
    }
    alone = runs / row.folder / row.model
    if not found and (alone / "metadata.json").is_file():
        return {"0": alone}
    return found


def cells_of(scores: dict[str, Any]) -> Cells:
    """The columns of the table out of the scores of one model."""
    following = scores["following"]
    courses = [c for gaits in scores["courses"].values() for c in gaits.values()]
    recognised = following["recognition"]["score"]
    cells = {f"fmd_{name}": found["takes"]["distance"] for name, found in following["fmd"].items()}
    cells |= {
        "skating_formula": _mean([c["flat"]["after"]["toes"] for c in courses]),
        "skating_soles": _mean([c["flat"]["after"]["soles"] for c in courses]),
        "diversity": scores["diversity"]["temperature_1"]["pose"],
        "ms": scores["runtime"]["network_ms"],
        "parameters": scores["parameters"] / 1e6,
        "styles": float(sum(score >= SHOWN for score in recognised.values())),
        "terrain": _mean([t["sunk_sole_p99"] for t in scores["terrain"].values()]),
        "transitions": scores["transitions"].get("ratio", float("nan")),
        "recognition": _mean(list(recognised.values())),
    }
    return cells


def capture_cells(plan: EvaluationPlan, report: Callable[[str], None]) -> Cells:
    """The same of the capture: one half of its takes against the other, and its held-out clips."""
    held_out = score_held_out(plan, report)
    reference = joined([plan.reference[g] for g in plan.groups if g != TERRAIN_GROUP])
    cells = {}
    for name in plan.feature_sets:
        rows = plan.projection(name, OVERALL_COMPONENTS)(reference.of(name))
        cells[f"fmd_{name}"] = compare(rows, rows, reference.unit).takes.reference
    soles, _, formula = mean_skating(held_out["skating"])
    recognised = held_out["recognition"]["score"]
    shown = float(sum(s >= SHOWN for s in recognised.values()))
    return cells | {
        "skating_formula": formula,
        "skating_soles": soles,
        "styles": shown,
        "recognition": _mean(list(recognised.values())),
    }


def _mean(values: Sequence[float]) -> float:
    return float(np.mean(values)) if len(values) else float("nan")


def table_one(setting: Setting) -> dict[str, Any]:
    """Measure what is there and not in the store yet; all cells by row and seed."""
    args = setting.args
    kept: dict[str, Any] = {"options": _options(args), "cells": {}}
    if args.store is not None and args.store.is_file():
        kept = _read(args.store)
        if kept.get("options") != _options(args):
            raise FileError(
                f"{args.store}: measured with other options.",
                "Name another --store, or take the same options.",
            )
    models = [
        (number, title, seed, folder)
        for title, seeds in _models(args).items()
        for number, (seed, folder) in enumerate(seeds.items())
    ]
    waiting = [  # every row once, then its other seeds
        each for each in sorted(models, key=lambda m: m[0]) if each[2] not in kept["cells"].get(each[1], {})
    ]
    if waiting or CAPTURE not in kept["cells"]:
        plan = _plan(setting)
        if CAPTURE not in kept["cells"]:
            kept["cells"][CAPTURE] = {"0": capture_cells(plan, setting.report)}
            _keep(args, kept)
        for _, title, seed, folder in waiting:
            setting.report(f"{title}, seed {seed}")
            cells = cells_of(score_model(plan, Subject(folder, plan.texts), setting.report))
            kept["cells"].setdefault(title, {})[seed] = cells
            _keep(args, kept)
    return kept


def _models(args: Arguments) -> dict[str, dict[str, Path]]:
    shipped = args.model or model_folder()
    found = {SHIPPED: {"0": shipped}}
    if args.runs is not None:
        found |= {row.title: models_of(row, args.runs) for row in ROWS}
    return found


def _plan(setting: Setting) -> EvaluationPlan:
    args = setting.args
    options = replace(Options.quick() if args.quick else Options(), seed=args.seed)
    if args.seconds is not None:
        options = replace(options, follow_seconds=args.seconds)
    folder = args.features or model_folder()
    encoder = ExportedMotionEncoder(folder) if has_encoder(folder) else None
    return make_plan(setting.clips, args.styles, options, encoder, setting.report)


def _options(args: Arguments) -> dict[str, Any]:
    """What decides the figures."""
    features = args.features or model_folder()
    return {
        "styles": args.styles,
        "seconds": args.seconds,
        "quick": args.quick,
        "seed": args.seed,
        "features": read_metadata(features)["sha256"].get("motion", ""),
    }


def _read(path: Path) -> dict[str, Any]:
    try:
        kept = json.loads(path.read_text(encoding="utf-8"))
        if not isinstance(kept["cells"], dict):
            raise ValueError("cells")
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise FileError(f"{path}: no store of this command.", "Name another --store.") from error
    return dict(kept)


def _keep(args: Arguments, kept: dict[str, Any]) -> None:
    if args.store is not None:
        write_atomic(args.store, json.dumps(kept, indent=1) + "\n")


def markdown(kept: dict[str, Any]) -> str:
    """The table: mean ± deviation over seeds; rows whose training has not run have no figures. The paper's below it."""
    rows = []
    for title in (CAPTURE, SHIPPED, *(row.title for row in ROWS)):
        seeds = kept["cells"].get(title, {})
        if not seeds:
            rows.append([title, "not run", *("–" for _ in COLUMNS)])
            continue
        rows.append([title, str(len(seeds)), *(_cell(list(seeds.values()), key) for key in COLUMNS)])
    head = ["", "seeds", *(name for name, _ in COLUMNS.values())]
    lines = table(head, rows)
    names = ["FMD", "skating (cm)", "diversity", "ms", "parameters", "styles", "terrain", "seamless"]
    paper = [[row.title, *row.paper] for row in ROWS if row.paper]
    lines += [
        "The paper's Table I. Its FMD rests on another encoder and its times on a GPU: not comparable.",
        "",
    ]
    return "\n".join([*lines, *table(["", *names], paper)])


def _cell(seeds: Sequence[Cells], key: str) -> str:
    digits = COLUMNS[key][1]
    values = [s[key] for s in seeds if key in s]
    if not values:
        return "–"
    spread = f" ± {np.std(values, ddof=1):.{digits}f}" if len(values) > 1 else ""
    return number(_mean(values), digits) + spread


TABLE1 = Experiment(
    "Table I: every row over its seeds, resumable; rows whose training has not run are listed as not run.",
    table_one,
    markdown,
    "table 1",
    clips=True,
    options=(
        (
            "--runs",
            {"type": Path, "metavar": "DIR", "help": "folder of trained rows: DIR/<row>/seed<k>/model"},
        ),
        ("--store", {"type": Path, "metavar": "FILE", "help": "figures so far; the run goes on from them"}),
        (
            "--features",
            {"type": model_folder, "metavar": "DIR", "help": "model whose motion encoder serves all rows"},
        ),
        ("--styles", {"nargs": "+", "metavar": "STYLE", "help": "default: every style of the clips"}),
        ("--seconds", {"type": float, "metavar": "S", "help": "of followed paths per style (default: 40)"}),
        ("--quick", {"action": "store_true", "help": "a trial: too little motion for figures to quote"}),
        ("--seed", {"type": int, "default": 0}),
    ),
)
