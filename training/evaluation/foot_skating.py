"""Foot skating of a motion, per gait: the paper's formula on toe joints, and the same at the soles of toes and heels."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from runtime import feet
from runtime.controls import Gait
from runtime.terrain import Terrain

Array = NDArray[np.floating]

GAITS = {"walk": Gait.WALK, "jog": Gait.JOG}


@dataclass(frozen=True)
class Skating:
    """Sums over frames, so that motions of any length can be added up."""

    frames: int = 0
    toes_sum: float = 0.0
    soles_sum: float = 0.0

    def __add__(self, other: Skating) -> Skating:
        return Skating(
            self.frames + other.frames, self.toes_sum + other.toes_sum, self.soles_sum + other.soles_sum
        )

    @property
    def toes(self) -> float:
        """s_f of Sec. IV-B at the toe joints, mean over feet and frames, cm per frame; NaN without frames."""
        return self.toes_sum / self.frames if self.frames else float("nan")

    @property
    def soles(self) -> float:
        """The same at the soles: toe and ankle joints less their resting heights, mean over the four points."""
        return self.soles_sum / self.frames if self.frames else float("nan")


def foot_skating(positions: Array, terrain: Terrain, chosen: NDArray[np.bool_]) -> Skating:
    """Skating of the frames `chosen` `(T,)` of world joints `(T, 31, 3)`; the first frame has no speed and never counts."""
    chosen = np.asarray(chosen, bool)[1:]
    toes = feet.skating(positions, terrain)
    soles = feet.skating(positions, terrain, feet.SOLE_POINTS, feet.SOLE_HEIGHTS)
    return Skating(int(chosen.sum()), float(toes[chosen].mean(1).sum()), float(soles[chosen].mean(1).sum()))
