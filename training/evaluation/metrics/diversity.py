"""Diversity (Sec. IV-B2): how far two generations apart under the same controls lie from each other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from runtime.motion.model import MotionModel
from training.evaluation.motion.driving import replay
from training.evaluation.motion.motion import Motion

Array = NDArray[np.floating]

CLIPS, FRAMES = 40, 180  # of the paper
LEAD_IN = 60  # frames at temperature 0, so that both of a pair begin in the same pose


@dataclass(frozen=True)
class Diversity:
    """Mean of ||p^1 - p^2||_2 over clips and frames, metres."""

    pose: float  # norm over all 31 joints of a pose relative to the root, as the formula reads
    joint: float  # mean over joints of the distance of one: comparable with a ruler
    before_lock: float  # `pose`, taken before foot lock


def pair_distance(first: Array, second: Array) -> tuple[float, float]:
    """Mean over frames of the norm of the whole pose difference, and of one joint's, of `(T, 31, 3)` twice."""
    difference = (first - second).astype(np.float64)
    whole = np.linalg.norm(difference.reshape(len(difference), -1), axis=-1)
    return float(whole.mean()), float(np.linalg.norm(difference, axis=-1).mean())


def diversity(model: MotionModel, clips: Sequence[tuple[Motion, Array]], temperature: float) -> Diversity:
    """Diversity over clips with their Z^t `(6, 64)`; each has `LEAD_IN` frames before those that count.

    Control variables are those of the clip in both generations; only the seed of the noise differs.
    """
    rows = []
    for clip, z in clips:
        pair = [replay(model, clip, z, seed, temperature, LEAD_IN) for seed in (1, 2)]
        whole, joint = pair_distance(pair[0][0], pair[1][0])
        rows.append((whole, joint, pair_distance(pair[0][1], pair[1][1])[0]))
    return Diversity(*(float(v) for v in np.mean(rows, axis=0)))
