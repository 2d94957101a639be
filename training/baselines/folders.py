"""Common parts of all methods: training clips, codes and speeds of styles, and the model folder."""

import hashlib
import json
import shutil
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.arrays import Array
from runtime.atomic import write_atomic
from runtime.controls import Gait
from runtime.motion.features import LAYOUT_VERSION, OUTPUT_SIZE
from runtime.motion.model import load_model
from runtime.motion.model_files import read_metadata
from runtime.prompts.prompter import Prompter
from runtime.skeleton import SPORT_SKELETON
from training.evaluation.metrics.motion import original_clips
from training.evaluation.motion.capture import ClipInfo, read_capture
from training.evaluation.motion.evaluated_model import style_texts

Report = Callable[[str], None]


@dataclass(frozen=True)
class Order:
    """A request to build a method's model folder `out` from `clips`, with the text side of `model`."""

    method: str
    clips: Path
    out: Path
    model: Path
    steps: int  # of training, if the method is trained
    seed: int


MIN_FRAMES = 60  # shortest usable clip
WALK_RANGE, JOG_RANGE = (0.3, 2.2), (1.2, 5.0)  # m/s


def training_clips(folder: Path, seed: int | None = None) -> Iterator[ClipInfo]:
    """Yield captured training clips and rollouts; in random order if a seed is given."""
    infos = {c.path: c for c in read_capture(folder, least_frames=MIN_FRAMES).clips if not c.held_out}
    paths = original_clips(folder)
    order = range(len(paths)) if seed is None else np.random.default_rng(seed).permutation(len(paths))
    return (infos[paths[number]] for number in order if paths[number] in infos)


def style_codes(model: Path, styles: Sequence[str]) -> dict[str, Array]:
    """Return Z^t `(n, 6, 64)` of each style's descriptions, from the text side of a model."""
    to_style = Prompter(load_model(model))
    texts = style_texts(styles)
    return {style: np.stack([to_style(d) for d in texts[style]]).astype(np.float32) for style in styles}


def speeds(root: Array, gait: NDArray[np.integer], label: NDArray[np.integer], styles: int) -> Array:
    """Return the median walking and jogging speed `(S, 2)` of each style, or a default."""
    speed = np.linalg.norm(root[:, :2], axis=1)
    result = np.zeros((styles, 2), np.float32)
    for s in range(styles):
        walks = speed[(label == s) & (gait == Gait.WALK) & (speed > WALK_RANGE[0])]
        jogs = speed[(label == s) & (gait == Gait.JOG) & (speed > JOG_RANGE[0])]
        walk = float(np.clip(np.median(walks), *WALK_RANGE)) if len(walks) else 1.2
        jog = float(np.clip(np.median(jogs), *JOG_RANGE)) if len(jogs) else 1.8 * walk
        result[s] = walk, max(jog, 1.3 * walk)
    return result


def copy_text_side(model: Path, out: Path) -> None:
    """Create the folder `out` with the text side of a model."""
    out.mkdir(parents=True, exist_ok=True)
    shutil.copy(model / "prompt.onnx", out / "prompt.onnx")


def write_metadata(model: Path, out: Path, files: Sequence[str], own: dict[str, Any]) -> Path:
    """Write `metadata.json` with the text side of `model`, `files` and the method's `own` values; returns the folder."""
    text_side = read_metadata(model)
    metadata: dict[str, Any] = {
        "format": "sport-model",
        "layout_version": LAYOUT_VERSION,
        "config": {"output_size": OUTPUT_SIZE, "experts": 1, "style_size": 384},
        "reverse_steps": [0],
        "joints": list(SPORT_SKELETON.names),
        "sha256": {
            Path(name).stem: hashlib.sha256((out / name).read_bytes()).hexdigest()
            for name in ("prompt.onnx", *files)
        },
        **{k: text_side[k] for k in ("text_encoder", "text_encoder_sha256") if k in text_side},
        **own,
    }
    write_atomic(out / "metadata.json", json.dumps(metadata, indent=1) + "\n")
    return out
