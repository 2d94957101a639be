"""Feet: the paper's skating (Sec. IV-B2) at toe joints and at soles, and how deep they sink or how high they float."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from runtime.arrays import Array
from runtime.controls import Gait
from runtime.feet import skating as feet
from runtime.skeleton import ANKLE_HEIGHT, TOE_HEIGHT
from runtime.terrain.height_map import Terrain

GAITS = {"walk": Gait.WALK, "jog": Gait.JOG}
# at toe joints, the paper's formula; at soles under the toes (joints less their resting height); mean of these and of the
# soles under heels (ankle joints less theirs)
SKATING = ("toes", "toe_soles", "soles")


def foot_skating(positions: Array, terrain: Terrain, chosen: NDArray[np.bool_] | None = None) -> Array:
    """s_f (Sec. IV-B2) by `SKATING` `(n, 3)` of the frames `chosen` `(T,)` of world joints `(T, 31, 3)`, cm, mean of both feet.

    By default of all frames; the first has no speed and never counts.
    """
    toes = feet.skating(positions, terrain)
    toe_soles = feet.skating(positions, terrain, feet.TOES, TOE_HEIGHT)
    heel_soles = feet.skating(positions, terrain, feet.HEELS, ANKLE_HEIGHT)
    measures = np.stack([toes, toe_soles, 0.5 * (toe_soles + heel_soles)], -1).mean(1)
    return measures if chosen is None else measures[chosen[1:]]


def skating_means(parts: Iterable[Array]) -> dict[str, float]:
    """Means over the frames of several `foot_skating`, NaN without frames, and how many `frames` there are."""
    values = np.concatenate([np.zeros((0, len(SKATING))), *parts])
    means = values.mean(0) if len(values) else np.full(len(SKATING), np.nan)
    return {**dict(zip(SKATING, means.tolist(), strict=True)), "frames": len(values)}


def terrain_feet(positions: Array, terrain: Terrain) -> dict[str, float]:
    """Sinking and floating of world joints `(T, 31, 3)`: percentiles in cm over all frames.

    `sunk_joint` are toe and ankle joints under the ground, `sunk_sole` the four points of the soles (joints less their
    resting height), `float` the lowest of these over the ground. The resting heights hold for a foot that stands flat on
    level ground; on a slope or over an edge a point of the sole may read a few centimetres off although the foot stands
    well, so compare with captured motion only.
    In walking at least one foot stands, so the lowest of the four points should lie on the ground; jogging flies.
    """
    heights = 100.0 * feet.joint_heights(positions, terrain, feet.SOLE_POINTS)
    soles = heights - 100.0 * np.array(feet.SOLE_HEIGHTS)
    percentiles = {
        "sunk_joint_p99": -np.percentile(heights, 1),
        "sunk_sole_p95": -np.percentile(soles, 5),
        "sunk_sole_p99": -np.percentile(soles, 1),
        "float_p50": np.percentile(soles.min(1), 50),
        "float_p95": np.percentile(soles.min(1), 95),
    }
    return {name: max(0.0, float(value)) for name, value in percentiles.items()}
