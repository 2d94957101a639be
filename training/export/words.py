"""Measures how a model follows words: `python -m training.export.words --model FOLDER`.

Wordings that it follows better are written to `wording.json`, its calibration to the model's metadata, and its adherence
to each sentence to `shares.json`.
"""

from __future__ import annotations

import argparse
import json
import logging
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from runtime.assets import asset_path, model_folder
from runtime.atomic import check_target, write_atomic
from runtime.errors import run_command
from runtime.motion.model import load_model
from runtime.motion.model_files import read_metadata
from runtime.prompts.library_data import load_library, load_styles
from runtime.prompts.phrasing import ADHERENCE, PHRASINGS, ModelPhrasing, adherence_of, load_phrasings
from runtime.prompts.prompter import Prompter
from training.evaluation.text.prompt_adherence import PHRASE_S, measure_adherence
from training.evaluation.text.walks import Walker
from training.evaluation.text.wording import measure_wording
from training.export.calibrate import calibrate


def measure_words(folder: Path, assets: Path, workers: int) -> None:
    """Measure a calibrated model folder in `workers` processes; `assets` contains the tables. KeyError without calibration."""
    shares, wording = assets / ADHERENCE, assets / PHRASINGS
    check_target(shares)
    model, known = load_model(folder), adherence_of()
    prompter = Prompter(model, phrasing=ModelPhrasing())
    sentences = {*known.sentences, *known.clauses}
    _write(wording, model.name, measure_wording(Walker(folder, workers, PHRASE_S), prompter, sentences))
    phrasing = load_phrasings(wording)[model.name]
    calibrate(folder, read_metadata(folder)["calibration"]["phase"], phrasing, workers=workers)
    model = load_model(folder)
    styles = load_styles(asset_path("prompts/styles.json"))
    entries = [e.descriptions for e in load_library(asset_path("prompts/library.json"), styles).entries]
    prompter = Prompter(model, phrasing=phrasing)
    found = measure_adherence(model, prompter, Walker(folder, workers, PHRASE_S), entries)
    found.add_plain(styles)
    _write(shares, model.name, found.table())


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
    args = parser.parse_args(argv)
    measure_words(args.model, args.assets, args.workers)


if __name__ == "__main__":
    raise SystemExit(run_command("words", main))
