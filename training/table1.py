"""Comparison of models: Table I of the paper, every row and column, over several seeds; and distances to capture.

    python -m training.evaluation table1 --train --clips DIR --runs RUNS --markdown docs/results/table1.md

The models of a row are RUNS/<row>/seed<k>/model (without diffusion: RUNS/full/seed<k>/model-mixture), trained by --train
(`training.ablations`). Seed k also seeds the evaluation of seed k, so that untrained rows have a deviation too. The store
is written after each model: an interrupted run resumes.
"""

import json
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import t as student_t

from runtime.atomic import write_atomic
from runtime.errors import FileError, UsageError
from runtime.motion.model_files import read_metadata
from training.ablations import OPTIONS as TRAINING_OPTIONS
from training.ablations import check as check_training
from training.ablations import give_way, train_row
from training.data.readers import read_json
from training.evaluation import log
from training.evaluation.command import check_seconds, plan_of
from training.evaluation.experiment import PLAN, Arguments, Experiment, Setting, option
from training.evaluation.metrics.features import joined
from training.evaluation.metrics.frechet import compare
from training.evaluation.motion.capture import OVERALL_COMPONENTS, EvaluationPlan
from training.evaluation.motion.evaluated_model import EvaluatedModel, count_parameters, frame_times
from training.evaluation.motion.scores import (
    score_courses,
    score_diversity,
    score_following,
    score_held_out,
    score_terrain,
    score_transitions,
)
from training.evaluation.motion.tables import mean, mean_skating
from training.markdown import number, percent, table

Cells = dict[str, float]
SEED_IN_NAME = re.compile(r" seed\d+")  # in `EvaluatedModel.name`
SHIPPED, CAPTURE = "ours, as shipped", "capture, one half against the other"
# of evaluated walks per model: less than in `Options`, because every seed draws new ones
AMOUNTS = {"terrain_styles": 2, "diversity_clips": 12, "transitions": 10}
SHOWN_WINDOWS_FRACTION = 0.5  # of a style's windows that must be recognised for the style to count as shown


@dataclass(frozen=True)
class TableRow:
    """A row of the table: the folder of its models, and the figures of its counterpart in the paper's Table I."""

    title: str
    folder: str  # below RUNS
    model: str = "model"
    paper: tuple[str, ...] = ()  # FMD, skating, diversity, ms, parameters, styles, terrain, seamless


ROWS = (
    TableRow("ours", "full", paper=("0.96", "0.16", "2.47e-2", "52.09", "55.46 M", "100+", "yes", "yes")),
    TableRow("4 experts", "4-experts", paper=("1.27", "0.21", "2.32e-2", "46.27", "31.49 M", "100+", "yes", "yes")),
    TableRow("4 content experts", "4-content-experts", paper=("1.18", "0.17", "2.28e-2", "49.67", "47.05 M", "100+", "yes", "yes")),
    TableRow("without diffusion", "full", "model-mixture", ("4.33", "0.13", "0.00", "12.29", "47.98 M", "100+", "yes", "yes")),
    TableRow("PAE", "pae", paper=("0.99", "0.19", "2.41e-2", "52.09", "55.46 M", "100+", "yes", "yes")),
    TableRow("without content encoder", "no-content-encoder", paper=("1.06", "0.23", "2.18e-2", "53.65", "66.64 M", "100+", "yes", "yes")),
    TableRow("whole-body contrast", "whole-body-contrast"),
    TableRow("motion matching", "motion-matching"),
    TableRow("PFNN", "pfnn", paper=("10.25", "0.03", "0.00", "7.55", "2.39 M", "1", "yes", "no")),
    TableRow("Mason 2022", "mason2022", paper=("3.15", "0.20", "0.00", "8.30", "18.42 M", "100", "no", "no")),
    TableRow("style by label", "style-label"),
    TableRow("ours, 100STYLE alone", "100style", paper=("1.76", "0.11", "2.31e-2", "52.09", "55.46 M", "100+", "no", "yes")),
    TableRow("ours, terrain data alone", "terrain", paper=("1.94", "0.09", "2.16e-2", "52.09", "47.71 M", "1", "yes", "yes")),
)  # fmt: skip
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
# columns of the differences from our full model
COMPARED = ("fmd_encoder", "fmd_kinematic", "skating_soles", "diversity", "transitions", "recognition")


def model_of(setting: Setting, row: TableRow | None, seed: int) -> Path | None:
    """Return the exported model of a row, trained now if --train is given, or the shipped one; None if missing."""
    args = setting.args
    if row is None:
        return setting.folders[0]
    if args.train and (args.only is None or row.folder in args.only):
        train_row(args, args.runs, row.folder, seed)
    folder: Path = args.runs / row.folder / f"seed{seed}" / row.model
    return folder if (folder / "metadata.json").is_file() else None


def cells_of(plan: EvaluationPlan, evaluated: EvaluatedModel) -> Cells:
    """Measure the columns of the table for one model, with no more walks than they need."""
    following = score_following(plan, evaluated)
    courses = score_courses(plan, evaluated, rough=False)
    flat = [gait["flat"]["after"] for gaits in courses.values() for gait in gaits.values()]
    cells = {f"fmd_{name}": found["takes"]["distance"] for name, found in following["fmd"].items()}
    return cells | {
        "skating_formula": mean([skating["toes"] for skating in flat]),
        "skating_soles": mean([skating["soles"] for skating in flat]),
        "diversity": score_diversity(plan, evaluated, (1.0,))["temperature_1"],
        "ms": frame_times(evaluated.model)["network_ms"],
        "parameters": count_parameters(evaluated.model.metadata) / 1e6,
        "terrain": mean([t["sunk_sole_p99"] for t in score_terrain(plan, evaluated).values()]),
        "transitions": score_transitions(plan, evaluated).get("ratio", float("nan")),
        **_recognised(following["recognition"]["score"]),
    }


def _recognised(scores: dict[str, float]) -> Cells:
    shown = float(sum(score >= SHOWN_WINDOWS_FRACTION for score in scores.values()))
    return {"styles": shown, "recognition": mean(scores)}


def capture_cells(plan: EvaluationPlan) -> Cells:
    """Measure the columns of the capture: one half of its takes against the other, and its held-out clips."""
    held_out = score_held_out(plan)
    reference = joined([plan.reference[style] for style in plan.styles])
    cells = {}
    for name in plan.feature_sets:
        rows = plan.projection(name, OVERALL_COMPONENTS)(reference.of(name))
        cells[f"fmd_{name}"] = compare(rows, rows, reference.unit)["takes"]["reference"]
    soles, _, formula = mean_skating(held_out["skating"])
    recognised = _recognised(held_out["recognition"]["score"])
    return cells | {"skating_formula": formula, "skating_soles": soles, **recognised}


def table_one(setting: Setting) -> dict[str, Any]:
    """Measure rows missing in the store, all with the first seed, then with the next; returns all cells by row and seed.

    The store is read again for each row: other commands may fill it at the same time, each with its own seeds.
    """
    args, options = setting.args, _options(setting)
    store = args.store or (None if args.runs is None else args.runs / "table1.json")
    kept = {"options": options, "cells": _stored(store, options)}
    for seed in args.seeds:
        plan = None  # made when the first row needs it
        for title, row in _rows(args):
            if store is not None:
                kept["cells"] = _stored(store, options)
            if str(seed) in kept["cells"].get(title, {}):
                continue
            folder = model_of(setting, row, seed)
            if folder is None:
                continue
            log.info(f"{title}, seed {seed}")
            plan = plan or plan_of(setting, seed, **AMOUNTS)
            cells = _scored(plan, None if title == CAPTURE else folder)
            if store is not None:
                kept["cells"] = _stored(store, options)
            kept["cells"].setdefault(title, {})[str(seed)] = cells
            if store is not None:
                write_atomic(store, json.dumps(kept, indent=1) + "\n")
    return kept


def _rows(args: Arguments) -> list[tuple[str, TableRow | None]]:
    """Return titles and their trained rows, None for the capture and the shipped model."""
    trained = ROWS if args.runs is not None else ()
    return [(CAPTURE, None), (SHIPPED, None), *((row.title, row) for row in trained)]


def _scored(plan: EvaluationPlan, folder: Path | None) -> Cells:
    """Measure a model, or the capture itself if `folder` is None."""
    if folder is None:
        return capture_cells(plan)
    return cells_of(plan, EvaluatedModel(folder, plan.texts))


def _options(setting: Setting) -> dict[str, Any]:
    """Return the options that determine the figures."""
    args = setting.args
    features = read_metadata(args.features or setting.folders[0])["sha256"].get("motion", "")
    chosen = {name: getattr(args, name) for name in ("styles", "seconds", "quick")}
    return chosen | {"features": features} | AMOUNTS


def _stored(path: Path | None, options: dict[str, Any]) -> dict[str, dict[str, Cells]]:
    """Read the cells of the store, empty if it is missing; FileError if its options differ."""
    if path is None or not path.is_file():
        return {}
    kept = read_json(path, "Choose another --store.")
    if not isinstance(kept, dict) or kept.get("options") != options:
        raise FileError(
            f"{path}: figures of other options.", "Choose another --store, or repeat its options."
        )
    return kept["cells"]


def check_table_one(args: Arguments) -> None:
    """Raise UsageError for inconsistent options, before anything is trained."""
    check_seconds(args)
    if args.train and args.known is None:
        if args.runs is None:
            raise UsageError("--train: no folder for the rows is given.", "Add --runs DIR.")
        check_training(args, args.only or [row.folder for row in ROWS])
        give_way(args.nice)


def markdown(kept: dict[str, Any]) -> str:
    """Return the table, mean ± deviation over seeds, then the differences from our full model, then the paper's table.

    Rows that are not trained have no figures.
    """
    titles = (CAPTURE, SHIPPED, *(row.title for row in ROWS))
    rows = [[title, *_cells(list(kept["cells"].get(title, {}).values()))] for title in titles]
    head = ["", "seeds", *(name for name, _ in COLUMNS.values())]
    names = ["FMD", "skating (cm)", "diversity", "ms", "parameters", "styles", "terrain", "seamless"]
    note = "The paper's Table I. Its FMD rests on another encoder and its times on a GPU: not comparable."
    paper = table(["", *names], [[row.title, *row.paper] for row in ROWS if row.paper])
    return "\n".join([*table(head, rows), *_differences(kept["cells"]), note, "", *paper])


def _differences(cells: dict[str, dict[str, Cells]]) -> list[str]:
    """Return the table of differences from our full model at the same seed; bold: significant at 95 % (Student's t)."""
    full = cells.get(ROWS[0].title, {})
    rows = []
    for row in ROWS[1:]:
        own = cells.get(row.title, {})
        pairs = [(own[seed], full[seed]) for seed in sorted(full) if seed in own]
        if len(pairs) > 1:
            shown = [_difference([a[k] - b[k] for a, b in pairs], COLUMNS[k][1]) for k in COMPARED]
            rows.append([row.title, *shown])
    if not rows:
        return []
    note = "Differences from *ours*, seed by seed: the same seed is scored on the same paths. Bold: not 0 at 95 % (Student's t)."
    return [note, "", *table(["", *(COLUMNS[k][0] for k in COMPARED)], rows)]


def _difference(values: Sequence[float], digits: int) -> str:
    error = float(np.std(values, ddof=1)) / len(values) ** 0.5
    certain = abs(mean(values)) > student_t.ppf(0.975, len(values) - 1) * error
    text = _spread(values, digits)
    return f"**{text}**" if certain else text


def _cells(seeds: Sequence[Cells]) -> list[str]:
    columns = [_spread([s[key] for s in seeds if key in s], digits) for key, (_, digits) in COLUMNS.items()]
    return [str(len(seeds)) if seeds else "not run", *columns]


def _spread(values: Sequence[float], digits: int) -> str:
    """Format mean ± deviation over seeds; the deviation needs two."""
    spread = f" ± {np.std(values, ddof=1):.{digits}f}" if len(values) > 1 else ""
    return number(mean(values), digits) + spread


TABLE1 = Experiment(
    "Table I: every row over its seeds, resumable; untrained rows are listed as not run.",
    table_one,
    markdown,
    "table 1",
    needs=("clips",),
    options=(
        "clips",
        "model",
        option("--runs", type=Path, metavar="DIR", help="folder of trained rows: DIR/<row>/seed<k>/model"),
        option("--store", type=Path, metavar="FILE", help="figures so far (default: RUNS/table1.json)"),
        option("--seeds", type=int, nargs="+", default=[0, 1, 2], help="default: 0 1 2"),
        option("--train", action="store_true", help="train missing rows, each before it is scored"),
        *TRAINING_OPTIONS,
        *PLAN,
        "seconds",
    ),
    check=check_table_one,
)

# --- distances: the value of the diffusion and of each part of the model --------------------------------------------


def distances(setting: Setting) -> dict[str, Any]:
    """Measure Frechet distances and recognition of several models, in a tenth of the time of the whole evaluation.

    All use one encoder: that of --features, or of the first model that has one.
    """
    plan = plan_of(setting)
    plan = replace(plan, options=replace(plan.options, recognise_seconds=8.0))
    models = [EvaluatedModel(folder, plan.texts) for folder in setting.folders]
    return {f"{m.name} ({m.decoder})": score_following(plan, m) for m in models}


def distances_table(results: dict[str, dict[str, Any]]) -> str:
    """Return a table of overall distance, its ratios to two halves of the capture (whole takes, cut takes), and recognition.

    Seeds of one model share a row: means, and the deviation of the distance.
    """
    sets = sorted({name for r in results.values() for name in r["fmd"]})
    groups: dict[str, dict[str, dict[str, Any]]] = {}
    for label, found in results.items():
        groups.setdefault(SEED_IN_NAME.sub("", label), {})[label] = found
    rows = [_distances_row(name, seeds, sets) for name, seeds in groups.items()]
    return "\n".join(table(["model", *(f"FMD, {n} (halves)" for n in sets), "styles recognised, mean"], rows))


def _distances_row(name: str, seeds: dict[str, dict[str, Any]], sets: list[str]) -> list[str]:
    title = next(iter(seeds)) if len(seeds) == 1 else f"{name}, {len(seeds)} seeds"
    scores = [v for r in seeds.values() for v in r["recognition"]["score"].values()]
    return [title, *(_distances([r["fmd"][n] for r in seeds.values()]) for n in sets), percent(mean(scores))]


def _distances(seeds: Sequence[dict[str, Any]]) -> str:
    takes, cut = np.mean([[f["takes"]["ratio"], f["ratio"]] for f in seeds], axis=0)
    return f"{_spread([f['takes']['distance'] for f in seeds], 2)} ({takes:.1f} x, {cut:.1f} x)"


DISTANCES = Experiment(
    "Several models: distance to capture and style recognition along captured paths.",
    distances,
    distances_table,
    "distances",
    needs=("clips",),
    options=(
        "clips",
        "models",
        *PLAN,
        "seed",
        option("--seconds", type=float, default=12.0, help="of each style's paths (default: 12)"),
    ),
    check=check_seconds,
)
