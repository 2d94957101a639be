"""Foot skating of a motion, per gait: the paper's formula on toe joints, and the same at the soles of toes and heels."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from runtime.controls import Gait
from runtime.feet import skating as feet
from runtime.skeleton import ANKLE_HEIGHT, TOE_HEIGHT
from runtime.terrain.height_map import Terrain

Array = NDArray[np.floating]

GAITS = {"walk": Gait.WALK, "jog": Gait.JOG}


@dataclass(frozen=True)
class Skating:
    """Sums over frames, so that motions of any length can be added up."""

    frames: int = 0
    toes_sum: float = 0.0
    toe_soles_sum: float = 0.0
    heel_soles_sum: float = 0.0

    def __add__(self, other: Skating) -> Skating:
        return Skating(*(a + b for a, b in zip(vars(self).values(), vars(other).values(), strict=True)))

    @property
    def toes(self) -> float:
        """s_f of Sec. IV-B at the toe joints, mean over feet and frames, cm per frame; NaN without frames."""
        return self.toes_sum / self.frames if self.frames else float("nan")

    @property
    def toe_soles(self) -> float:
        """The same at the soles under the toes: toe joints less their resting height."""
        return self.toe_soles_sum / self.frames if self.frames else float("nan")

    @property
    def soles(self) -> float:
        """The same, mean of the soles under toes and heels (ankle joints less their resting height)."""
        both = self.toe_soles_sum + self.heel_soles_sum
        return 0.5 * both / self.frames if self.frames else float("nan")

    def as_dict(self) -> dict[str, float]:
        """For results."""
        return {"toes": self.toes, "toe_soles": self.toe_soles, "soles": self.soles, "frames": self.frames}


def foot_skating(positions: Array, terrain: Terrain, chosen: NDArray[np.bool_]) -> Skating:
    """Skating of the frames `chosen` `(T,)` of world joints `(T, 31, 3)`; the first frame has no speed and never counts."""
    chosen = np.asarray(chosen, bool)[1:]
    toes = feet.skating(positions, terrain)
    toe_soles = feet.skating(positions, terrain, feet.TOES, TOE_HEIGHT)
    heel_soles = feet.skating(positions, terrain, feet.HEELS, ANKLE_HEIGHT)
    sums = (float(values[chosen].mean(1).sum()) for values in (toes, toe_soles, heel_soles))
    return Skating(int(chosen.sum()), *sums)
