"""What a model shows of the catalogue's edits: on which side better, and drawn out how far wholly (`runtime.motion.calibration`).

    python -m training.export.calibrate --run RUN --model FOLDER

The first sentence of every edit is walked once, on each side where it has two, and compared with what the edit does to the
model's own neutral walk; what is shown in part is walked again, drawn out farther. Edits that are held out are not
looked at: a side that training never saw is taken to be the weaker one, and has the gain of the other. `RUN` holds the
frames and phases of the training, for the signs of the phases.
"""

from __future__ import annotations

import argparse
import json
import logging
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from runtime.arrays import Float32Array
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
UNTRAINED = 0.4  # by which a side that training never saw is taken to be shown worse
SHOWN = 0.85  # share with which an edit is shown wholly
GAINS = (1.25, 1.5, 1.75, 2.0)
WORTH = 0.15  # of a share that a gain must bring
PAIRS = 400  # clips with their mirror images that the signs of the phases are read from
DRAWS = 50  # frames of each


def phase_signs(table: FrameTable, phase: np.ndarray) -> list[int] | None:
    """Of every channel -1 where its vectors change their sign in the mirror image, else 1; `phase` is `(N, 5, 2)`.

    None where no clip has its mirror image: such a network has no side to walk on but the one it saw.
    """
    number = {name: i for i, name in enumerate(table.names)}
    pairs = [(i, number[f"{n}_m"]) for n, i in number.items() if f"{n}_m" in number]
    if not pairs:
        return None
    random, total = np.random.default_rng(0), np.zeros(C)
    for k in random.permutation(len(pairs))[:PAIRS]:
        clip, image = pairs[k]
        length = table.start[clip + 1] - table.start[clip]
        at = random.integers(0, length, DRAWS)
        total += (phase[table.start[clip] + at] * phase[table.start[image] + at]).sum((0, 2))
    return [1 if value >= 0 else -1 for value in total]


@dataclass
class _Measured:
    """An edit that training saw, by its left side: the lead of that side, and the gain that shows the better side wholly."""

    name: str
    lead: float
    better: str  # the side that is shown better
    share: float  # of it
    gain: float = 1.0


def calibrated(model: MotionModel, prompter: Prompter, walker: Walker) -> list[dict[str, Any]]:
    """The codes of the edits that training saw, with leads and gains, as a model's metadata have them."""
    plain = prompter.expand(PLAIN_PROMPT).descriptions
    neutral = prompter(plain)
    examples = described_edits(neutral_motion(model, neutral))
    (walked,) = walker.make([Walk.of(neutral, 0)])

    def shares(asked: Iterable[tuple[str, float]]) -> list[float]:
        """Of edits, each drawn out by a gain."""
        asked = list(asked)
        codes = [neutral + np.float32(gain) * (prompter(_said(plain, n, 0)) - neutral) for n, gain in asked]
        made = walker.make([Walk.of(z, 0) for z in codes])
        return [edit_share(n, examples[n], walked, each) for (n, _), each in zip(asked, made, strict=True)]

    pairs = _trained()
    first = dict(
        zip(
            names := sorted({n for pair in pairs for n in pair}), shares((n, 1.0) for n in names), strict=True
        )
    )
    found = []
    for left, right in pairs:
        lead = _lead(left, right, first[left] - first[right])
        better = left if lead >= 0 else right
        found.append(_Measured(left, lead, better, first[better]))
    weak = [each for each in found if each.share < SHOWN]
    farther = shares((each.better, gain) for each in weak for gain in GAINS)
    for k, each in enumerate(weak):
        own = [each.share, *farther[k * len(GAINS) : (k + 1) * len(GAINS)]]
        enough = [n for n, share in enumerate(own) if share >= max(SHOWN, own[0] + WORTH)]
        each.gain = (1.0, *GAINS)[enough[0]] if enough else 1.0  # what it does not show so distorts the rest
        log.info("%s: %s", each.better, " ".join(f"{share:.2f}" for share in own))
    return [row for each in found for row in _rows(each, prompter, plain)]


def _trained() -> list[tuple[str, str]]:
    """Left and right of every edit that training saw, on one side at least; twice the same name for one without sides."""
    pairs = [(name, name.replace("left", "right")) for name in EDITS if "right" not in name]
    pairs = [(left, right if right in EDITS else left) for left, right in pairs]
    return [pair for pair in pairs if not set(pair) <= HELD_OUT]


def _lead(left: str, right: str, measured: float) -> float:
    """The lead of a left side: the measured one, or that of the only side that training saw."""
    if (left in HELD_OUT) != (right in HELD_OUT):
        return -UNTRAINED if left in HELD_OUT else UNTRAINED
    return round(measured, 2) if abs(measured) >= ALIKE else 0.0


def _rows(measured: _Measured, prompter: Prompter, plain: PartDescriptions) -> Iterable[dict[str, Any]]:
    """A row for each part that an edit describes, a right limb that says the same as the left one left out."""
    code = _mean_code(prompter, plain, measured.name)
    parts = EDITS[measured.name].phrases
    for part in parts:
        if (
            part.startswith("right")
            and part.replace("right", "left") in parts
            and EDITS[measured.name].slot == "legs"
        ):
            continue
        lead = measured.lead if part == EDITS[measured.name].slot else 0.0
        numbers = [round(float(v), 3) for v in code[PART_NAMES.index(part)]]
        yield {"part": part.replace("right", "left"), "lead": lead, "gain": measured.gain, "code": numbers}


def _said(plain: PartDescriptions, name: str, number: int) -> PartDescriptions:
    """A neutral walk with an edit, in one of its sentences."""
    for part, texts in EDITS[name].phrases.items():
        plain = plain.replace(part, texts[number % len(texts)])
    return plain


def _mean_code(prompter: Prompter, plain: PartDescriptions, name: str) -> Float32Array:
    """Z^t `(6, 64)` of a neutral walk with an edit, the mean over its sentences."""
    count = max(map(len, EDITS[name].phrases.values()))
    return np.asarray(np.mean([prompter(_said(plain, name, k)) for k in range(count)], axis=0), np.float32)


def calibrate(folder: Path, signs: Sequence[int], text_encoder: Path | None = None, workers: int = 1) -> None:
    """Measure a model folder as it is without calibration, and write that into its metadata."""
    metadata = read_metadata(folder)
    if metadata.pop("calibration", None) is not None:
        _write(folder, metadata)
    model = load_model(folder)
    prompter = Prompter(model, text_encoder=text_encoder, wording=Wording())
    codes = calibrated(model, prompter, Walker(folder, workers, SECONDS))
    _write(folder, metadata | {"calibration": {"phase": list(signs), "codes": codes}})


def _write(folder: Path, metadata: dict[str, Any]) -> None:
    write_atomic(folder / "metadata.json", json.dumps(metadata, indent=1) + "\n")


def main(argv: Sequence[str] | None = None) -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description="Measure what a model shows of the catalogue's edits.")
    parser.add_argument("--run", type=Path, required=True, metavar="RUN", help="folder of the training")
    parser.add_argument("--clips", type=Path, metavar="DIR", help="default: RUN/clips")
    parser.add_argument("--model", type=Path, required=True, metavar="FOLDER")
    parser.add_argument("--workers", type=int, default=2, metavar="N")
    args = parser.parse_args(argv)
    logging.basicConfig(level=logging.INFO, format="%(asctime)s %(message)s", datefmt="%H:%M:%S")
    table = load_frames(args.clips or args.run / "clips", args.run / "frames")
    signs = phase_signs(table, np.load(args.run / "phase.npy", mmap_mode="r"))
    if signs is None:
        raise FileError(
            f"{args.run}: no clip has its mirror image.", "Import the clips with `sport train import`."
        )
    calibrate(args.model, signs, None, args.workers)


if __name__ == "__main__":
    raise SystemExit(run_command("calibrate", main))
