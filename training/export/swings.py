"""Swing gains that match a model's amplitudes to capture: `python -m training.export.swings --model FOLDER --data DIR`.

Every captured style is walked straight ahead, and the swings of hips, shoulders and arms are compared with the raw files.
The gains are written with the style's code into the model's metadata; `runtime.motion.swing` applies them.
"""

import argparse
import logging
from collections.abc import Mapping, Sequence
from copy import copy
from pathlib import Path

import numpy as np

from runtime.arrays import Array
from runtime.errors import run_command
from runtime.motion.mirror import mirrored_code
from runtime.motion.model_files import read_metadata, write_metadata
from runtime.motion.swing import MAX_GAIN, MIN_GAIN, PLAIN, SWINGS
from training.evaluation.motion.evaluated_model import EvaluatedModel, style_texts
from training.evaluation.on_straight_walks import Measures, generated_walks, raw_walks
from training.presets import OPEN

log = logging.getLogger("sport.train")

MEASURES = ("pelvis_yaw", "pelvis_roll", "shoulder_yaw", "arm_swing_cm", "bob_cm")  # of `SWINGS`
PASSES = 2


def measure_gains(evaluated: EvaluatedModel, raw: Mapping[str, Measures]) -> dict[str, Array]:
    """Return the gains of every style that bring its swings to the amplitudes of the raw files."""
    gained = copy(evaluated)
    gained.model = copy(evaluated.model)
    found: dict[str, Array] = {style: np.ones(len(SWINGS)) for style in raw}
    set_gains: dict[bytes, tuple[float, ...]] = {}  # keys: bytes of a code
    gained.model.swings = lambda z: set_gains.get(z.tobytes(), PLAIN)  # type: ignore[method-assign]
    for number in range(PASSES):
        for style, gains in found.items():
            for code in (evaluated.style(style, 0), mirrored_code(evaluated.style(style, 0))):
                set_gains[code.tobytes()] = tuple(gains.tolist())
        walked = generated_walks(gained, raw)
        for style, ours in walked.items():
            missing = np.array([raw[style][key] / max(ours[key], 1e-3) for key in MEASURES])
            found[style] = np.clip(found[style] * missing, MIN_GAIN, MAX_GAIN)
        log.info("pass %d: %d styles", number + 1, len(walked))
    return found


def fit_swings(folder: Path, data: Path) -> dict[str, Array]:
    """Measure a model folder against the raw files below `data`, and write the gains into its metadata.

    The model `open` is only compared with files that allow commercial use.
    """
    metadata = read_metadata(folder)
    if metadata.pop("swings", None) is not None:
        write_metadata(folder, metadata)
    raw = raw_walks(data, free_only=metadata["name"] == OPEN)
    evaluated = EvaluatedModel(folder, style_texts(raw))
    gains = measure_gains(evaluated, raw)
    rows = [_row(evaluated, style, own) for style, own in gains.items()]
    write_metadata(folder, metadata | {"swings": rows})
    return gains


def _row(evaluated: EvaluatedModel, style: str, gains: Array) -> dict[str, object]:
    """Return a metadata entry: gains and mean code of a style, the code as text to fit on one line."""
    code = np.mean([evaluated.style(style, k) for k in range(len(evaluated.texts[style]))], axis=0)
    return {"style": style, "gains": gains.round(2).tolist(), "code": " ".join(f"{v:.2f}" for v in code.flat)}


def main(argv: Sequence[str] | None = None) -> None:
    """Command line."""
    logging.basicConfig(level=logging.INFO, format="%(message)s")
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--model", type=Path, required=True, help="folder of an exported model")
    parser.add_argument("--data", type=Path, required=True, help="folder of the unpacked source files")
    args = parser.parse_args(argv)
    for style, gains in fit_swings(args.model, args.data).items():
        named = zip(SWINGS, gains, strict=True)
        print(f"{style}: " + ", ".join(f"{name} {gain:.2f}" for name, gain in named))


if __name__ == "__main__":
    raise SystemExit(run_command("swings", main))
