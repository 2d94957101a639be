"""A database for motion matching out of imported clips: `python -m training.baselines motion-matching`.

All captured clips that training sees go in (no held-out ones, unless they are wanted for play), without mirror images,
copies on made terrain, layered clips and rollouts. Styles are labels; a prompt chooses the style whose descriptions lie nearest.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import shutil
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime import rotations
from runtime.arrays import Array
from runtime.assets import model_folder
from runtime.atomic import write_atomic
from runtime.controls import Gait
from runtime.errors import FileError, UsageError
from runtime.motion.features import INPUT, LAYOUT_VERSION, OUTPUT_SIZE, C, L, split_output
from runtime.motion.model import load_model
from runtime.motion.model_files import read_metadata
from runtime.prompts.prompter import Prompter
from runtime.skeleton import SPORT_SKELETON
from training.baselines.matching import (
    DATABASE,
    KIND,
    MAX_ROWS,
    STEP,
    Database,
    MatchingModel,
    feature_vectors,
)
from training.data.catalog import BY_NAME
from training.evaluation.metrics.motion import original_clips
from training.evaluation.motion.evaluated_model import style_texts
from training.frames import LAYERED, ClipFrames, clip_frames

MIN_FRAMES = 60  # of a clip
WALK_RANGE, JOG_RANGE = (0.3, 2.2), (1.2, 5.0)  # m/s that count
ROLLOUTS = "pfnn_rollouts"


@dataclass(frozen=True)
class ClipRows:
    """Rows of one clip, `STEP` frames apart."""

    style: str
    features: Array
    world: Array
    hips: Array
    root: Array
    contacts: NDArray[np.bool_]
    gait: NDArray[np.integer]


def clip_rows(frames: ClipFrames) -> ClipRows:
    """What the database keeps of a clip's training frames."""
    x, y = frames.x[::STEP].astype(np.float32), frames.y[::STEP].astype(np.float32)
    parts = split_output(y)
    hips = parts.joint_positions[:, 0].copy()
    hips[:, 1] -= frames.ground[::STEP, 0]
    joints = parts.joint_positions.copy()
    joints[..., 1] -= frames.ground[::STEP, :1]
    gait = x[:, INPUT["gait"]].reshape(len(x), L, -1)[:, L // 2].argmax(1)
    return ClipRows(
        frames.style,
        feature_vectors(x, joints, parts.joint_velocities),
        rotations.from_6d(parts.joint_rotations),
        hips,
        parts.root,
        parts.contacts > 0.5,
        gait,
    )


def build(clips: Iterable[ClipRows], codes: dict[str, list[Array]]) -> Database:
    """One database of many clips; `codes` are Z^t of each style's descriptions. FileError when there are none."""
    found = list(clips)
    if not found:
        raise FileError("No clips for a database.", "Import captured clips first: `sport train import`.")
    rows = sum(len(c.features) for c in found)
    if rows > MAX_ROWS:
        raise UsageError(
            f"{rows} rows: a place in the database is a number that stored states hold, at most {MAX_ROWS} rows.",
            "Import fewer clips, or add --free.",
        )
    styles = tuple(sorted({c.style for c in found}))
    lengths = [len(c.features) for c in found]
    ends = np.cumsum(lengths) - 1

    def joined(name: str) -> NDArray[Any]:
        return np.concatenate([getattr(c, name) for c in found])

    label = np.repeat([styles.index(c.style) for c in found], lengths)
    return Database(
        features=joined("features"),
        world=joined("world").astype(np.float16),
        hips=joined("hips"),
        root=joined("root"),
        contacts=joined("contacts").astype(np.uint8),
        last=np.repeat(ends, lengths),
        style=label,
        styles=styles,
        codes=np.concatenate([np.stack(codes[s]) for s in styles]).astype(np.float32),
        code_style=np.repeat(np.arange(len(styles)), [len(codes[s]) for s in styles]),
        speeds=speeds(joined("root"), joined("gait").astype(int), label, len(styles)),
    )


def speeds(root: Array, gait: NDArray[np.integer], label: NDArray[np.integer], styles: int) -> Array:
    """Median walking and jogging speed `(S, 2)` of each style, where it has none a usual one."""
    speed = np.linalg.norm(root[:, :2], axis=1)
    result = np.zeros((styles, 2), np.float32)
    for s in range(styles):
        walks = speed[(label == s) & (gait == Gait.WALK) & (speed > WALK_RANGE[0])]
        jogs = speed[(label == s) & (gait == Gait.JOG) & (speed > JOG_RANGE[0])]
        walk = float(np.clip(np.median(walks), *WALK_RANGE)) if len(walks) else 1.2
        jog = float(np.clip(np.median(jogs), *JOG_RANGE)) if len(jogs) else 1.8 * walk
        result[s] = walk, max(jog, 1.3 * walk)
    return result


def chosen(folder: Path, held_out: bool, free: bool, report: Callable[[str], None]) -> Iterable[ClipRows]:
    """Rows of the captured clips of a folder; `free`: of those whose licence lets the database be passed on."""
    paths = original_clips(folder)
    for number, path in enumerate(paths):
        if number % 200 == 0:
            report(f"clip {number} of {len(paths)}")
        with np.load(path, allow_pickle=False) as file:
            source, tier = str(file["source"]), str(file["tier"])
            skipped = source == ROLLOUTS or tier == LAYERED or bool(file["mirrored"])
            skipped |= str(file["split"]) == "held_out" and not held_out
            skipped |= free and not BY_NAME[source].free
            length = len(file["gait"])
        if not skipped and length >= MIN_FRAMES:
            yield clip_rows(clip_frames(path))


def export(base: Database, model: Path, out: Path, name: str) -> Path:
    """Write a model folder: the database, and the text side of the model whose prompts it is to understand."""
    out.mkdir(parents=True, exist_ok=True)
    beside = read_metadata(model)
    shutil.copy(model / "prompt.onnx", out / "prompt.onnx")
    base.save(out / DATABASE)
    metadata: dict[str, Any] = {
        "format": "sport-model",
        "kind": KIND,
        "layout_version": LAYOUT_VERSION,
        "name": name,
        "decoder": "motion matching",
        "config": {"output_size": OUTPUT_SIZE, "experts": 1, "style_size": 384},
        "reverse_steps": [0],
        "joints": list(SPORT_SKELETON.names),
        "styles": list(base.styles),
        "rows": len(base.last),
        "sha256": {n: _sha256(out / f) for n, f in (("prompt", "prompt.onnx"), ("database", DATABASE))},
        "start": {"output": [0.0] * OUTPUT_SIZE, "phase": [0.0] * (2 * C * (L + 1))},
    }
    metadata |= {k: beside[k] for k in ("text_encoder", "text_encoder_sha256") if k in beside}
    metadata["start"]["output"] = standing(MatchingModel(out, metadata, base))
    write_atomic(out / "metadata.json", json.dumps(metadata, indent=1) + "\n")
    return out


def standing(model: MatchingModel) -> list[float]:
    """The output of the neutral row that stands stillest."""
    base = model.database
    stands = base.features[:, 27 + Gait.STAND] > 0.5
    neutral = base.style == base.styles.index("neutral") if "neutral" in base.styles else stands
    rows = np.flatnonzero(stands & neutral) if (stands & neutral).any() else np.arange(len(stands))
    speed = np.abs(base.features[rows][:, 12:27]).sum(1)
    return [float(v) for v in model.output_of(int(rows[int(np.argmin(speed))]))]


def _sha256(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """What the command needs."""
    parser.add_argument("--clips", type=Path, required=True, metavar="DIR", help="folder of imported clips")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="model folder to write")
    parser.add_argument("--model", type=model_folder, metavar="DIR", help="whose prompts it understands")
    parser.add_argument(
        "--held-out", action="store_true", help="with held-out clips: for play, not to measure"
    )
    parser.add_argument(
        "--free", action="store_true", help="only of archives whose licence lets it be passed on"
    )


def main(args: argparse.Namespace, report: Callable[[str], None]) -> Path:
    """Build the database and write its model folder."""
    folder = args.model or model_folder()
    if args.out.exists() and any(args.out.iterdir()) and not (args.out / DATABASE).exists():
        raise UsageError(f"--out {args.out}: holds something else.", "Choose a new folder.")
    to_style = Prompter(load_model(folder))
    rows = list(chosen(args.clips, args.held_out, args.free, report))
    texts = style_texts({r.style for r in rows})
    codes = {style: [to_style(d) for d in descriptions] for style, descriptions in texts.items()}
    base = build(rows, codes)
    report(f"{len(base.last)} rows, {len(base.last) * STEP / 3600:.0f} minutes, {len(base.styles)} styles")
    return export(base, folder, args.out, args.out.name)
