"""Measures how a model follows words: `python -m training.export.words --model FOLDER`.

Wordings that it follows better are written to `wording.json`, its calibration to the model's metadata, and its adherence
to each sentence to `shares.json`.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import logging
import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from runtime.assets import asset_path, model_folder
from runtime.atomic import check_target, write_atomic
from runtime.errors import run_command
from runtime.motion.model import load_model
from runtime.motion.model_files import read_metadata, write_metadata
from runtime.prompts.library_data import load_library, load_styles
from runtime.prompts.phrasing import ADHERENCE, PHRASINGS, ModelPhrasing, adherence_of, load_phrasings
from runtime.prompts.prompter import Prompter
from training.evaluation.text.prompt_adherence import PHRASE_S, measure_adherence
from training.evaluation.text.walks import Walker
from training.evaluation.text.wording import measure_wording
from training.export.calibrate import calibrate


def measure_words(folder: Path, assets: Path, workers: int, work: Path) -> None:
    """Measure a calibrated model folder in `workers` processes; `assets` contains the tables. KeyError without calibration.

    Walks and results of steps are kept under `work` until the end: a run that was killed continues with them. Remove them
    after a change of `runtime`, which they do not know of.
    """
    check_target(assets / ADHERENCE)
    metadata = read_metadata(folder)
    signs, name = metadata["calibration"]["phase"], metadata["name"]
    # a folder of its own for these graphs and this calibration
    work /= f"{name}-{hashlib.sha256((folder / 'metadata.json').read_bytes()).hexdigest()[:12]}"
    wording, calibrated, done = work / "wording.json", work / "model", work / "calibrated"
    if not wording.is_file():
        known = adherence_of()
        prompter = Prompter(load_model(folder), phrasing=ModelPhrasing())
        walker = Walker(folder, workers, PHRASE_S, work / "wording")
        _write(wording, name, measure_wording(walker, prompter, {*known.sentences, *known.clauses}))
    phrasing = load_phrasings(wording)[name]
    if not done.is_file():
        shutil.copytree(folder, calibrated, dirs_exist_ok=True)
        calibrate(calibrated, signs, phrasing, workers=workers, store=work / "calibration")
        write_atomic(done, "")
    model = load_model(calibrated)
    styles = load_styles(asset_path("prompts/styles.json"))
    entries = [e.descriptions for e in load_library(asset_path("prompts/library.json"), styles).entries]
    walker = Walker(calibrated, workers, PHRASE_S, work / "adherence")
    found = measure_adherence(model, Prompter(model, phrasing=phrasing), walker, entries)
    found.add_plain(styles)
    _write(assets / ADHERENCE, name, found.table())
    _write(assets / PHRASINGS, name, json.loads(wording.read_text("utf-8"))[name])
    write_metadata(folder, read_metadata(calibrated))
    shutil.rmtree(work)


def _write(path: Path, model: str, table: dict[str, Any]) -> None:
    """Write a model's table into a file, keeping those of others."""
    tables = json.loads(path.read_text("utf-8")) if path.is_file() else {}
    tables[model] = table
    write_atomic(path, json.dumps(tables, indent=0, ensure_ascii=False, sort_keys=True) + "\n")


def main(argv: Sequence[str] | None = None) -> None:
    """Command line."""
    logging.basicConfig(level=logging.INFO, format="%(asctime)s %(message)s", datefmt="%H:%M:%S")
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--model", type=model_folder, default=model_folder(), metavar="DIR")
    parser.add_argument(
        "--assets", type=Path, default=Path("assets"), metavar="DIR", help="folder of the tables"
    )
    parser.add_argument("--workers", type=int, default=2, metavar="N")
    parser.add_argument(
        "--work",
        type=Path,
        default=Path("out/words"),
        metavar="DIR",
        help="folder of walks already made, with which a killed run continues",
    )
    args = parser.parse_args(argv)
    measure_words(args.model, args.assets, args.workers, args.work)


if __name__ == "__main__":
    raise SystemExit(run_command("words", main))
