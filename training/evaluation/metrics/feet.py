"""Feet: the paper's skating (Sec. IV-B2) at toe joints and at soles, and how deep they sink or how high they float."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from runtime.arrays import Array
from runtime.controls import Gait
from runtime.feet import skating as feet
from runtime.skeleton import ANKLE_HEIGHT, TOE_HEIGHT
from runtime.terrain.height_map import Terrain

GAITS = {"walk": Gait.WALK, "jog": Gait.JOG}


@dataclass(frozen=True)
class Skating:
    """Sums over frames of s_f (Sec. IV-B2), cm, mean over both feet, so that motions of any length can be added up.

    The means, cm a frame, are NaN without frames.
    """

    frames: int = 0
    toes_sum: float = 0.0
    toe_soles_sum: float = 0.0
    heel_soles_sum: float = 0.0

    def __add__(self, other: Skating) -> Skating:
        return Skating(*(a + b for a, b in zip(vars(self).values(), vars(other).values(), strict=True)))

    @property
    def toes(self) -> float:
        """At the toe joints, the paper's formula."""
        return self.toes_sum / self.frames if self.frames else float("nan")

    @property
    def toe_soles(self) -> float:
        """At the soles under the toes: toe joints less their resting height."""
        return self.toe_soles_sum / self.frames if self.frames else float("nan")

    @property
    def soles(self) -> float:
        """Mean of the soles under toes and heels (ankle joints less their resting height)."""
        both = self.toe_soles_sum + self.heel_soles_sum
        return 0.5 * both / self.frames if self.frames else float("nan")

    def as_dict(self) -> dict[str, float]:
        """For results."""
        return {"toes": self.toes, "toe_soles": self.toe_soles, "soles": self.soles, "frames": self.frames}


def foot_skating(positions: Array, terrain: Terrain, chosen: NDArray[np.bool_]) -> Skating:
    """Skating of the frames `chosen` `(T,)` of world joints `(T, 31, 3)`; the first frame has no speed and never counts."""
    chosen = np.asarray(chosen, bool)[1:]
    measures = (
        feet.skating(positions, terrain),
        feet.skating(positions, terrain, feet.TOES, TOE_HEIGHT),
        feet.skating(positions, terrain, feet.HEELS, ANKLE_HEIGHT),
    )
    return Skating(int(chosen.sum()), *(float(values[chosen].mean(1).sum()) for values in measures))


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
    sunk_joint = -np.percentile(heights, 1)
    sunk = -np.percentile(soles, [5, 1])
    above = np.percentile(soles.min(1), [50, 95])
    return TerrainFeet(*(max(0.0, float(v)) for v in (sunk_joint, *sunk, *above)))
