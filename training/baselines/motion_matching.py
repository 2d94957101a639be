"""Builds a motion-matching database from imported clips: `python -m training.ablations --only motion-matching`.

It contains all captured training clips without mirror images, copies on synthetic terrain, layered clips and rollouts.
Styles are labels; a prompt selects the style with the nearest descriptions.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime import rotations
from runtime.arrays import Array
from runtime.controls import Gait
from runtime.errors import FileError, UsageError
from runtime.motion.features import INPUT, OUTPUT_SIZE, C, L, split_output
from training.baselines import folders, matching
from training.baselines.folders import Order, Report
from training.baselines.matching import DATABASE, STEP, Database, MatchingModel
from training.evaluation.motion.capture import TERRAIN_GROUP
from training.frames import ClipFrames, clip_frames


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
    """Return the database rows of a clip's training frames."""
    x, y = frames.x[::STEP].astype(np.float32), frames.y[::STEP].astype(np.float32)
    parts = split_output(y)
    joints = parts.joint_positions.copy()
    joints[..., 1] -= frames.ground[::STEP, :1]
    return ClipRows(
        frames.style,
        matching.feature_vectors(x, joints, parts.joint_velocities),
        rotations.from_6d(parts.joint_rotations),
        joints[:, 0],
        parts.root,
        parts.contacts > 0.5,
        x[:, INPUT["gait"]].reshape(len(x), L, -1)[:, L // 2].argmax(1),
    )


def build(clips: Iterable[ClipRows], codes: dict[str, Array]) -> Database:
    """Build a database of many clips; `codes` are Z^t of each style's descriptions. FileError if there are no clips."""
    found = list(clips)
    if not found:
        raise FileError("No clips for a database.", "Import captured clips first: `sport train import`.")
    styles = tuple(sorted({c.style for c in found}))
    lengths = [len(c.features) for c in found]
    if sum(lengths) > matching.MAX_ROWS:
        raise UsageError(
            f"{sum(lengths)} rows: the encoding of positions allows at most {matching.MAX_ROWS}.",
            "Import fewer clips.",
        )

    def joined(name: str) -> NDArray[Any]:
        return np.concatenate([getattr(c, name) for c in found])

    label = np.repeat([styles.index(c.style) for c in found], lengths)
    return Database(
        features=joined("features"),
        world=joined("world").astype(np.float16),
        hips=joined("hips"),
        root=joined("root"),
        contacts=joined("contacts").astype(np.uint8),
        last=np.repeat(np.cumsum(lengths) - 1, lengths),
        style=label,
        styles=styles,
        codes=np.concatenate([codes[s] for s in styles]).astype(np.float32),
        code_style=np.repeat(np.arange(len(styles)), [len(codes[s]) for s in styles]),
        speeds=folders.speeds(joined("root"), joined("gait").astype(int), label, len(styles)),
    )


def export(base: Database, model: Path, out: Path) -> Path:
    """Write a model folder: the database, and the text side of a model."""
    folders.copy_text_side(model, out)
    base.save(out / DATABASE)
    own: dict[str, Any] = {
        "kind": matching.KIND,
        "name": out.name,
        "decoder": "motion matching",
        "styles": list(base.styles),
        "parameters": sum(getattr(base, n).size for n in ("features", "world", "hips", "root", "contacts")),
        "start": {"output": [0.0] * OUTPUT_SIZE, "phase": [0.0] * (2 * C * (L + 1))},
    }
    own["start"]["output"] = standing(MatchingModel(out, own, base))
    return folders.write_metadata(model, out, [DATABASE], own)


def standing(model: MatchingModel) -> list[float]:
    """Return the output of the calmest standing row of neutral style."""
    base = model.database
    stands = base.features[:, 27 + Gait.STAND] > 0.5
    neutral = base.style == base.styles.index("neutral") if "neutral" in base.styles else stands
    rows = np.flatnonzero(stands & neutral) if (stands & neutral).any() else np.arange(len(stands))
    speed = np.abs(base.features[rows][:, matching.POSE]).sum(1)
    return [float(v) for v in model.output_of(int(rows[int(np.argmin(speed))]))]


def make(order: Order, report: Report) -> Path:
    """Build the database and write its model folder."""
    if order.out.exists() and any(order.out.iterdir()) and not (order.out / DATABASE).exists():
        raise UsageError(f"--out {order.out}: contains something else.", "Choose a new folder.")
    clips = [c for c in folders.training_clips(order.clips) if c.group != TERRAIN_GROUP]
    report(f"{len(clips)} clips")
    rows = [clip_rows(clip_frames(c.path)) for c in clips]
    base = build(rows, folders.style_codes(order.model, sorted({r.style for r in rows})))
    report(f"{len(base.last)} rows, {len(base.last) * STEP / 3600:.0f} minutes, {len(base.styles)} styles")
    return export(base, order.model, order.out)
