"""Foot metrics: the paper's skating (Sec. IV-B2) at toe joints and soles, and sinking and floating."""

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from runtime.arrays import Array
from runtime.controls import Gait
from runtime.feet import skating as feet
from runtime.skeleton import ANKLE_HEIGHT, TOE_HEIGHT
from runtime.terrain.height_map import Terrain

GAITS = {"walk": Gait.WALK, "jog": Gait.JOG}
# at toe joints, the paper's formula; at soles under the toes (joints minus resting height); mean of the latter and of
# soles under heels (ankle joints minus resting height)
SKATING = ("toes", "toe_soles", "soles")


def foot_skating(positions: Array, terrain: Terrain, chosen: NDArray[np.bool_] | None = None) -> Array:
    """Return s_f (Sec. IV-B2) by `SKATING` `(n, 3)`, cm, mean of both feet, of world joints `(T, 31, 3)`.

    `chosen` `(T,)` selects frames, by default all; the first frame has no speed and is excluded.
    """
    toes = feet.skating(positions, terrain)
    toe_soles = feet.skating(positions, terrain, feet.TOES, TOE_HEIGHT)
    heel_soles = feet.skating(positions, terrain, feet.HEELS, ANKLE_HEIGHT)
    measures = np.stack([toes, toe_soles, 0.5 * (toe_soles + heel_soles)], -1).mean(1)
    return measures if chosen is None else measures[chosen[1:]]


def skating_means(parts: Iterable[Array]) -> dict[str, float]:
    """Return means over the frames of several `foot_skating` results, NaN without frames, and the number of `frames`."""
    values = np.concatenate([np.zeros((0, len(SKATING))), *parts])
    means = values.mean(0) if len(values) else np.full(len(SKATING), np.nan)
    return {**dict(zip(SKATING, means.tolist(), strict=True)), "frames": len(values)}


def terrain_feet(positions: Array, terrain: Terrain) -> dict[str, float]:
    """Return sinking and floating of world joints `(T, 31, 3)`: percentiles in cm over all frames.

    `sunk_joint` is the depth of toe and ankle joints below the ground, `sunk_sole` that of the four points of the soles
    (joints minus resting height), `float` the height of the lowest of these. Resting heights are valid for a flat foot on
    level ground; on a slope or an edge the points of a well-placed foot may be a few centimetres off, so compare only with
    captured motion.
    In walking at least one foot stands, so the lowest point should be on the ground; jogging has flight phases.
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
