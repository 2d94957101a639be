"""Feet on uneven ground: how deep soles sink, and how far the standing foot floats."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from runtime.feet import skating as feet
from runtime.terrain.height_map import Terrain

Array = NDArray[np.floating]


@dataclass(frozen=True)
class TerrainFeet:
    """Percentiles in cm over all frames."""

    sunk_joint_p99: float  # toe and ankle joints under the ground
    sunk_sole_p95: float  # points of the sole (joints less their resting height) under the ground
    sunk_sole_p99: float
    float_p50: float  # the lowest of the four points of the soles over the ground
    float_p95: float


def terrain_feet(positions: Array, terrain: Terrain) -> TerrainFeet:
    """Sinking and floating of world joints `(T, 31, 3)`.

    The resting heights hold for a foot that stands flat on level ground; on a slope or over an edge a point of the sole
    may read a few centimetres off although the foot stands well, so compare with captured motion only.
    In walking at least one foot stands, so the lowest of the four points should lie on the ground; jogging flies.
    """
    heights = 100.0 * feet.joint_heights(positions, terrain, feet.SOLE_POINTS)
    soles = heights - 100.0 * np.array(feet.SOLE_HEIGHTS)
    lowest = soles.min(1)
    return TerrainFeet(
        sunk_joint_p99=_sunk(heights, 99),
        sunk_sole_p95=_sunk(soles, 95),
        sunk_sole_p99=_sunk(soles, 99),
        float_p50=max(0.0, float(np.percentile(lowest, 50))),
        float_p95=max(0.0, float(np.percentile(lowest, 95))),
    )


def _sunk(heights: Array, percentile: float) -> float:
    return max(0.0, float(np.percentile(-heights, percentile)))
