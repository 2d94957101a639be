"""Measures of imported clips, for captions in the words of prompts and as targets of training."""

import json
from collections import defaultdict
from collections.abc import Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path

import numpy as np

from runtime.arrays import Array
from runtime.atomic import write_atomic
from runtime.errors import FileError
from runtime.measures.table import BodyMeasures, PartMeasures, measure, measures_of
from runtime.pose import FPS
from runtime.safe_read import open_npz
from runtime.skeleton import PART_NAMES
from training.text.descriptions import describe

PARAPHRASES = 4
_GESTURE = "hand"  # occurs in the content of clips captured standing
_NOT_FORWARD = (
    "back", "left", "right", "side", "jump", "terrain", "transition", "idle", "run", "dash", "navigate",
)  # fmt: skip
MAX_TILT_CORRECTION_DEGREES = 10.0  # a neutral walk with a lower gaze really looks down
MAX_DEVIATIONS = 4.0  # limit in standard deviations, for clips that turn or jump
_OF_CAPTURE = {"torso": ("pitch", "arch"), "head": ("pitch", "forward")}  # retargeting may offset these


@dataclass(frozen=True)
class ClipMeasures:
    """Measures of one clip: `capture` is its data set, `forward` whether it walks ahead."""

    name: str
    capture: str
    style: str
    forward: bool
    seconds: float
    body: BodyMeasures


def measure_clips(directory: Path) -> list[ClipMeasures]:
    """Measure the unmirrored training clips in `directory`; FileError if there are none.

    Lean and head pitch of a capture's neutral walk come from retargeting, not from style, and are subtracted.
    """
    paths = sorted(
        p for p in directory.glob("*.npz") if not p.stem.endswith("_m") and not p.stem.startswith("layer_")
    )
    if not paths:
        raise FileError(f"{directory}: no clips (*.npz).", "Run the importer first.")
    with ProcessPoolExecutor() as pool:
        measured = pool.map(_read, paths, chunksize=16)
        return _relative_to_neutral([clip for clip in measured if clip is not None])


def write_clip_captions(clips: Path, path: Path) -> None:
    """Write {clip name: measured descriptions} of all captured training clips."""
    captions = {clip.name: captions_of(clip.body) for clip in measure_clips(clips)}
    write_atomic(path, json.dumps(captions, indent=1, ensure_ascii=False) + "\n")


def captions_of(body: BodyMeasures) -> list[dict[str, str]]:
    """Return up to `PARAPHRASES` different descriptions of a motion."""
    found = [describe(body, k).to_mapping() for k in range(PARAPHRASES)]
    return [caption for i, caption in enumerate(found) if caption not in found[:i]]


def _read(path: Path) -> ClipMeasures | None:
    with open_npz(path, "Run the importer again.") as clip:
        if bool(clip["mirrored"]) or str(clip["split"]) != "train":
            return None
        style, content = str(clip["style"]), str(clip["content"])
        hips, local, contacts = clip["hips_positions"], clip["local_rotations"], clip["contacts"]
    forward = _GESTURE in content or not any(word in content for word in _NOT_FORWARD)
    capture, body = path.stem.split("_")[0], measure(hips, local, contacts)
    return ClipMeasures(path.stem, capture, style, forward, len(hips) / FPS, body)


def _relative_to_neutral(clips: list[ClipMeasures]) -> list[ClipMeasures]:
    neutral: dict[str, list[tuple[BodyMeasures, float]]] = defaultdict(list)
    for clip in clips:
        walking = 0.3 < clip.body.left_leg.speed < 1.3
        if clip.style.startswith("neutral") and clip.forward and walking:
            neutral[clip.capture].append((clip.body, clip.seconds))
    base = {capture: average(items) for capture, items in neutral.items()}
    return [replace(c, body=_subtract(c.body, base[c.capture])) if c.capture in base else c for c in clips]


def average(measures: Iterable[tuple[BodyMeasures, float]]) -> BodyMeasures:
    """Return the weighted median of every measure over (measures, weight in seconds)."""
    bodies, weights = zip(*measures, strict=True)
    found = {}
    for part in PART_NAMES:
        rows = [vars(getattr(body, part)) for body in bodies]
        found[part] = PartMeasures(
            **{name: _median([row[name] for row in rows], weights) for name in rows[0]}
        )
    return BodyMeasures(**found)


def _median(values: Sequence[float], weights: Sequence[float]) -> float:
    order = np.argsort(values)
    total = np.cumsum(np.array(weights)[order])
    return float(values[order[int(np.searchsorted(total, total[-1] / 2))]])


def _subtract(body: BodyMeasures, base: BodyMeasures) -> BodyMeasures:
    changed = {}
    for part, names in _OF_CAPTURE.items():
        own, usual = vars(getattr(body, part)), vars(getattr(base, part))
        most = MAX_TILT_CORRECTION_DEGREES if part == "head" else np.inf
        less = {name: own[name] - float(np.clip(usual[name], -most, most)) for name in names}
        changed[part] = getattr(body, part).changed(**less)
    return replace(body, **changed)


# --- Standardised, for training ---------------------------------------------------------------------------------------


def signs_of(part: str) -> tuple[float, ...]:
    """Return the sign of each measure under mirroring: -1 where it changes, else 1."""
    return tuple(-1.0 if row.sided else 1.0 for row in measures_of(part).values())


def clip_values(folder: Path, names: Sequence[str]) -> list[Array]:
    """Return six arrays `(clips, n)` of the clips `names`, standardised over them and limited to ±`MAX_DEVIATIONS`.

    FileError if a clip is missing. Signed measures have mean 0, so that mirroring changes only their sign.
    """
    rows = _all_measured(folder, tuple(names))
    return [_standardised(np.array([row[k] for row in rows]), part) for k, part in enumerate(PART_NAMES)]


@cache
def _all_measured(folder: Path, names: tuple[str, ...]) -> list[list[tuple[float, ...]]]:
    """Measure all clips; cached, because it takes minutes and rows of Table I need it repeatedly in one process."""
    with ProcessPoolExecutor() as pool:
        return list(pool.map(partial(_measured, folder), names, chunksize=64))


def _standardised(values: Array, part: str) -> Array:
    centre = np.median(values, axis=0) * (np.array(signs_of(part)) > 0)
    # percentiles, as a spinning clip has a thousand times the range of others
    spread = np.percentile(np.abs(values - centre), 80, axis=0) + 1e-4
    return np.clip((values - centre) / spread, -MAX_DEVIATIONS, MAX_DEVIATIONS).astype(np.float32)


def _measured(folder: Path, name: str) -> list[tuple[float, ...]]:
    with open_npz(folder / f"{name}.npz", "Run the importer again.") as clip:
        body = measure(clip["hips_positions"], clip["local_rotations"], clip["contacts"])
    return [tuple(vars(getattr(body, part)).values()) for part in PART_NAMES]
