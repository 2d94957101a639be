"""Which side of what one part can do a model shows better: what `runtime.motion.mirror` goes by.

    python -m training.export.sides --run RUN --model FOLDER

The first sentence of every edit of the catalogue that has a side is walked once on each of them, and compared with what the
edit does to the model's own neutral walk. `RUN` holds the frames and phases of the training, for the signs of the phases.
"""

from __future__ import annotations

import argparse
import json
import logging
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from runtime.atomic import write_atomic
from runtime.errors import FileError, run_command
from runtime.motion.features import C
from runtime.motion.model import MotionModel, load_model
from runtime.motion.model_files import read_metadata
from runtime.prompts.parts import PartDescriptions
from runtime.prompts.prompter import Prompter
from runtime.prompts.wording import Wording
from runtime.skeleton import PART_NAMES
from training.evaluation.text.command import PLAIN_PROMPT
from training.evaluation.text.phrase_shares import SECONDS, described_edits, edit_share, neutral_motion
from training.evaluation.text.walks import Walk, Walker
from training.frames import FrameTable, load_frames
from training.layering.catalog import EDITS, HELD_OUT

log = logging.getLogger("sport.train")

ALIKE = 0.05  # shares of two sides that differ by less are the same
UNTRAINED = 0.4  # by which a side that training never saw is taken to be shown worse, at least
PAIRS = 400  # clips with their mirror images that the signs of the phases are read from
DRAWS = 50  # frames of each


def phase_signs(table: FrameTable, phase: np.ndarray) -> list[int]:
    """Of every channel -1 where its vectors change their sign in the mirror image, else 1; `phase` is `(N, 5, 2)`.

    FileError where no clip has its mirror image.
    """
    number = {name: i for i, name in enumerate(table.names)}
    pairs = [(i, number[f"{n}_m"]) for n, i in number.items() if f"{n}_m" in number]
    if not pairs:
        raise FileError("No clip has its mirror image.", "Import the clips with `sport train import`.")
    random, total = np.random.default_rng(0), np.zeros(C)
    for k in random.permutation(len(pairs))[:PAIRS]:
        clip, image = pairs[k]
        length = table.start[clip + 1] - table.start[clip]
        at = random.integers(0, length, DRAWS)
        total += (phase[table.start[clip] + at] * phase[table.start[image] + at]).sum((0, 2))
    return [1 if value >= 0 else -1 for value in total]


def measured_sides(model: MotionModel, prompter: Prompter, walker: Walker) -> list[dict[str, Any]]:
    """Codes of the left sides, with the share by which a walk shows them better than the right ones."""
    plain = prompter.expand(PLAIN_PROMPT).descriptions
    neutral = prompter(plain)
    pairs = [
        (name, twin) for name in EDITS if (twin := name.replace("left", "right")) != name and twin in EDITS
    ]
    walks = [prompter(_said(plain, name, 0)) for pair in pairs for name in pair]
    summaries = iter(walker.make([Walk.of(z, 0) for z in (neutral, *walks)]))
    walked, examples = next(summaries), described_edits(neutral_motion(model, neutral))
    found = []
    for left, right in pairs:
        shares = [edit_share(name, examples[name], walked, next(summaries)) for name in (left, right)]
        part, lead = EDITS[left].slot, _lead(left, right, shares[0] - shares[1])
        log.info("%s: left %.2f, right %.2f", left, *shares)
        code = _mean_code(prompter, plain, left)[PART_NAMES.index(part)]
        found.append({"part": part, "lead": lead, "code": [round(float(v), 3) for v in code]})
    return found


def _lead(left: str, right: str, measured: float) -> float:
    """The lead of a left side: the measured one, or that of the only side that training saw."""
    if (left in HELD_OUT) != (right in HELD_OUT):
        return round(min(measured, -UNTRAINED) if left in HELD_OUT else max(measured, UNTRAINED), 2)
    return round(measured, 2) if abs(measured) >= ALIKE else 0.0


def _said(plain: PartDescriptions, name: str, number: int) -> PartDescriptions:
    """A neutral walk with an edit, in one of its sentences."""
    for part, texts in EDITS[name].phrases.items():
        plain = plain.replace(part, texts[number % len(texts)])
    return plain


def _mean_code(prompter: Prompter, plain: PartDescriptions, name: str) -> np.ndarray:
    """Z^t `(6, 64)` of a neutral walk with an edit, the mean over its sentences."""
    count = max(map(len, EDITS[name].phrases.values()))
    return np.mean([prompter(_said(plain, name, k)) for k in range(count)], axis=0)


def fit_sides(folder: Path, signs: Sequence[int], text_encoder: Path | None = None, workers: int = 1) -> None:
    """Measure the sides of a model folder on walks that are not mirrored, and write them into its metadata."""
    metadata = read_metadata(folder)
    if metadata.pop("mirror", None) is not None:
        _write(folder, metadata)
    model = load_model(folder)
    prompter = Prompter(model, text_encoder=text_encoder, wording=Wording())
    codes = measured_sides(model, prompter, Walker(folder, workers, SECONDS))
    _write(folder, metadata | {"mirror": {"phase": list(signs), "codes": codes}})


def _write(folder: Path, metadata: dict[str, Any]) -> None:
    write_atomic(folder / "metadata.json", json.dumps(metadata, indent=1) + "\n")


def main(argv: Sequence[str] | None = None) -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description="Measure which sides a model shows better.")
    parser.add_argument("--run", type=Path, required=True, metavar="RUN", help="folder of the training")
    parser.add_argument("--clips", type=Path, metavar="DIR", help="default: RUN/clips")
    parser.add_argument("--model", type=Path, required=True, metavar="FOLDER")
    parser.add_argument("--workers", type=int, default=2, metavar="N")
    args = parser.parse_args(argv)
    logging.basicConfig(level=logging.INFO, format="%(asctime)s %(message)s", datefmt="%H:%M:%S")
    table = load_frames(args.clips or args.run / "clips", args.run / "frames")
    fit_sides(
        args.model, phase_signs(table, np.load(args.run / "phase.npy", mmap_mode="r")), None, args.workers
    )


if __name__ == "__main__":
    raise SystemExit(run_command("sides", main))
