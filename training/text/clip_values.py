"""What every training clip does, in the numbers of `training.text.measure`, standardised, part by part."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import astuple
from functools import partial
from pathlib import Path

import numpy as np

from runtime.arrays import Array
from runtime.skeleton import PART_NAMES
from training.text.measure import measure, measure_names

MOST = 4.0  # deviations: what a clip that turns or jumps does beyond that says nothing more
_ONE_SIDED = ("roll", "turn")  # of torso and head: these change their sign in the mirror image


def signs_of(part: str) -> tuple[float, ...]:
    """Of each measure: -1 where it changes its sign in the mirror image, else 1."""
    return tuple(-1.0 if name in _ONE_SIDED else 1.0 for name in measure_names(part))


def clip_values(folder: Path, names: Sequence[str], workers: int = 2) -> list[Array]:
    """Six arrays `(clips, n)` of the clips called `names`, standardised over them and at most `MOST` from their mean.

    FileError of numpy's where a clip is missing. Signs survive: what changes its sign in the mirror image has mean 0.
    """
    with ProcessPoolExecutor(workers) as pool:
        rows = list(pool.map(partial(_measured, folder), names, chunksize=64))
    return [_standardised(np.array([row[k] for row in rows]), part) for k, part in enumerate(PART_NAMES)]


def _standardised(values: Array, part: str) -> Array:
    centre = np.median(values, axis=0) * (np.array(signs_of(part)) > 0)
    # percentiles: a clip that spins has a thousand times the others' range
    spread = np.percentile(np.abs(values - centre), 80, axis=0) + 1e-4
    return np.clip((values - centre) / spread, -MOST, MOST).astype(np.float32)


def _measured(folder: Path, name: str) -> list[tuple[float, ...]]:
    with np.load(folder / f"{name}.npz", allow_pickle=False) as clip:
        body = measure(clip["hips_positions"], clip["local_rotations"], clip["contacts"])
    return [astuple(getattr(body, part)) for part in PART_NAMES]
