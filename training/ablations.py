"""The rows of Table I: ablations, other methods and single data sets, each trained for the same few steps and exported.

    python -m training.ablations --clips DIR --out RUNS --preset small --stage2-steps 3000 --stage3-steps 1000 --seeds 0 1 2

Each row is written to RUNS/<row>/seed<k>/model, the one without diffusion to RUNS/full/seed<k>/model-mixture. The row `full`
is trained first: rows that do not change its phases and content encoder reuse them, unless `--run` names another run to
take them from. After an interruption the same command resumes.
`python -m training.evaluation table1 --train` trains and scores row by row.
"""

import argparse
import json
import logging
import os
import shutil
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from runtime.assets import model_folder
from runtime.atomic import write_atomic
from runtime.errors import FileError, UsageError, run_command
from runtime.safe_read import open_npz
from training.arguments import log_progress
from training.frames import stored_for
from training.presets import ABLATIONS

log = logging.getLogger("sport.train")

FULL, FRAMES, STAGE2 = "full", "frames", "stage2.pt"
RECIPE = "recipe.json"  # the options of a row's training, and whether it is finished


@dataclass(frozen=True)
class TrainedRow:
    """A row: our network trained on all clips or on one data set, or another method."""

    ablation: str = FULL
    source: str = ""  # the only data set used
    method: str = ""  # of `training.baselines`


TRAINED_ROWS = {
    **{name: TrainedRow(name) for name in ABLATIONS},
    "100style": TrainedRow(source="100style"),
    "terrain": TrainedRow(source="pfnn_rollouts"),
    **{name: TrainedRow(method=name) for name in ("motion-matching", "pfnn", "mason2022", "style-label")},
}
# Files that an ablation can reuse from the full model, because its change does not affect their stages.
_PHASE, _CONTENT = ("phase.npy", "phase_final.pt"), ("content_final.pt",)
SHARED: dict[str, tuple[str, ...]] = {
    **dict.fromkeys(ABLATIONS, _PHASE),
    **dict.fromkeys(
        (FULL, "4-experts", "4-content-experts", "distilled-diffusion", "expert-shares"), _PHASE + _CONTENT
    ),
    **dict.fromkeys(("pae", "joined-hips"), _CONTENT),
}
# These differ from the full model only in stage 3, and reuse its stage 2 of the same seed.
OTHER_DIFFUSION = ("distilled-diffusion", "expert-shares")
STAGES = {"phase": 1000, "content": 2000, "words": 2000, "stage2": 2000, "stage3": 700}  # steps
# options of training, as arguments of `add_argument`
OPTIONS: tuple[tuple[str, dict[str, Any]], ...] = (
    ("--run", {"type": Path, "metavar": "DIR", "help": "finished run whose phases and content encoder are reused"}),
    ("--only", {"nargs": "+", "choices": tuple(TRAINED_ROWS), "metavar": "ROW", "help": "train only these rows"}),
    ("--preset", {"default": "small"}),
    *((f"--{stage}-steps", {"type": int, "default": steps}) for stage, steps in STAGES.items()),
    ("--batch", {"type": int, "default": 256}),
    ("--same-encoders", {"action": "store_true", "help": "reuse the phases and content encoder of the row's seed 0"}),
    ("--baseline-steps", {"type": int, "default": 4000, "help": "steps of the other methods, 256 frames each"}),
    ("--nice", {"type": int, "default": 19, "help": "niceness of the process, 0 to 19 (default: 19)"}),
)  # fmt: skip


def main(argv: Sequence[str] | None = None) -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description="Train and export the rows of Table I.")
    parser.add_argument("--clips", type=Path, required=True, metavar="DIR")
    parser.add_argument("--out", type=Path, required=True, metavar="RUNS")
    parser.add_argument("--seeds", type=int, nargs="+", default=[0], help="train every row with each seed")
    for name, settings in OPTIONS:
        parser.add_argument(name, **settings)
    args = parser.parse_args(argv)
    log_progress()
    give_way(args.nice)
    check(args, args.only or list(ABLATIONS))
    for seed in args.seeds:  # the whole table once, then again with the next seed
        for name in args.only or ABLATIONS:
            train_row(args, args.out, name, seed)


def give_way(nice: int) -> None:
    """Lower this process's priority, on systems that support it."""
    if hasattr(os, "nice"):
        os.nice(nice)


def check(args: argparse.Namespace, names: Sequence[str]) -> None:
    """Raise UsageError for options that cannot be trained, before hours of training."""
    if not 0 <= args.nice <= 19:
        raise UsageError(f"--nice {args.nice}: expected 0 to 19.", "Try 19.")
    present = {_source(path) for path in sorted(args.clips.glob("*.npz"))}
    for name in names:
        source = TRAINED_ROWS[name].source
        if source and source not in present:
            raise UsageError(
                f"--clips {args.clips}: no clips of {source}, the training data of row {name}.",
                "Import them too, or choose other rows with --only.",
            )


def _source(path: Path) -> str:
    with open_npz(path, "Run the importer again.") as clip:
        return str(clip["source"])


def train_row(args: argparse.Namespace, out: Path, name: str, seed: int) -> None:
    """Train and export one row below `out`, unless it exists.

    FileError if training of the row was started with other options.
    """
    row, folder = TRAINED_ROWS[name], out / name / f"seed{seed}"
    recipe = {**asdict(row), "seed": seed, **_numbers(args, row)}
    if args.same_encoders and seed and not row.method:
        recipe["encoders"] = "of seed 0"
    stored = folder / RECIPE
    known = json.loads(stored.read_text(encoding="utf-8")) if stored.exists() else {}
    if known.pop("trained", False) and known == recipe:
        log.info("%s, seed %d: already trained", name, seed)
        return
    if known and known != recipe:
        raise FileError(f"{folder}: trained with other options.", "Choose another folder, or those options.")
    _keep(folder, recipe, False)
    log.info("%s, seed %d", name, seed)
    if row.method:
        _train_method(args, row, folder, seed)
    else:
        _train_ours(args, out, name, seed)
    _keep(folder, recipe, True)


def _numbers(args: argparse.Namespace, row: TrainedRow) -> dict[str, Any]:
    """Return the options that determine a row's weights."""
    if row.method:
        return {"steps": args.baseline_steps}
    return {name: getattr(args, name) for name in ("preset", *(f"{s}_steps" for s in STAGES), "batch")}


def _keep(folder: Path, recipe: dict[str, Any], trained: bool) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    write_atomic(folder / RECIPE, json.dumps(recipe | {"trained": trained}, indent=1) + "\n")


def _train_method(args: argparse.Namespace, row: TrainedRow, folder: Path, seed: int) -> None:
    """Train another method from scratch, which takes minutes."""
    from training.baselines import motion_matching, train
    from training.baselines.folders import Order

    shutil.rmtree(folder / "model", ignore_errors=True)  # left by an interrupted run
    method = motion_matching if row.method == "motion-matching" else train
    order = Order(row.method, args.clips, folder / "model", model_folder(), args.baseline_steps, seed)
    method.make(order, log.info)


def _train_ours(args: argparse.Namespace, out: Path, name: str, seed: int) -> None:
    """Train one of our networks; every stage resumes from its checkpoint."""
    from training import pipeline

    row, folder, full = TRAINED_ROWS[name], out / name / f"seed{seed}", out / FULL / f"seed{seed}"
    clips = args.clips
    if row.source:
        clips = clips_of(args.clips, row.source, folder / "clips")
    if args.same_encoders and seed:
        first = out / name / "seed0"
        if not (first / "model").exists():
            raise FileError(f"{first}: not trained.", "Train seed 0 first.")
        prepare(first, folder, [f for f in _PHASE + _CONTENT if (first / f).exists()], clips)
    elif args.run is not None and not row.source:
        prepare(args.run, folder, SHARED[name], clips)
    elif name != FULL and not row.source:
        train_row(args, out, FULL, seed)
        prepare(full, folder, SHARED[name], clips)
    stage2 = full / STAGE2
    if name in OTHER_DIFFUSION and stage2.exists():
        _copy_once(stage2, folder / STAGE2)
    steps = [f"--{stage}-steps={getattr(args, f'{stage}_steps')}" for stage in STAGES]
    steps += [f"--batch={args.batch}", f"--seed={seed}"]
    common = ["--preset", args.preset, "--clips", str(clips), "--out", str(folder), "--layers", "0"]
    pipeline.main(["all", *common, "--ablation", row.ablation, *steps])
    if name == FULL:  # its stage 2 also gives the row without diffusion
        pipeline.main(["export", *common, "--ablation", name, "--decoder", "mixture"])


def prepare(run: Path, out: Path, files: Sequence[str], clips: Path) -> None:
    """Copy `files` of `run` into `out`, unless they are there; FileError names what is missing."""
    out.mkdir(parents=True, exist_ok=True)
    # the table of all frames: gigabytes, memory-mapped by every variant of the same clips
    if stored_for(run / FRAMES, clips) and not (out / FRAMES).exists():
        (out / FRAMES).symlink_to((run / FRAMES).resolve(), target_is_directory=True)
    for file in files:
        if not (out / file).exists() and not (run / file).exists():
            raise FileError(f"{run / file}: missing.", "Train stages phase and content there first.")
        _copy_once(run / file, out / file)


def _copy_once(file: Path, to: Path) -> None:
    if not to.exists():
        shutil.copy(file, to)


def clips_of(clips: Path, source: str, to: Path) -> Path:
    """Fill the folder `to` with links to the clips of one data set and to their descriptions, and return it."""
    to.mkdir(parents=True, exist_ok=True)
    paths = [path for path in sorted(clips.glob("*.npz")) if _source(path) == source]
    for path in [*paths, *sorted(clips.glob("*.json"))]:
        link = to / path.name
        if not link.exists():
            link.symlink_to(path.resolve())
    return to


if __name__ == "__main__":
    raise SystemExit(run_command("ablations", main))
