"""Transition smoothness: the jerk of the joints around a change of prompt against that inside the styles."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from runtime.motion.features import FPS

Array = NDArray[np.floating]


def jerk(positions: Array) -> Array:
    """Size of the third derivative `(T - 3, joints)` in m/s^3 of world joints `(T, joints, 3)` at 60 Hz."""
    return np.linalg.norm(np.diff(positions.astype(np.float64), n=3, axis=0), axis=-1) * FPS**3


@dataclass(frozen=True)
class TransitionJerk:
    """Mean jerk of all joints in m/s^3."""

    inside: (
        float  # mean of the second before the change, and of the one that begins when the change has settled
    )
    around: float  # in the blend, or in the half second after it where that is higher
    peak: float  # highest frame of the blend and that half second over the highest frame inside

    @property
    def ratio(self) -> float:
        """1 is a transition as smooth as the styles themselves."""
        return self.around / self.inside if self.inside > 0 else float("nan")


def transition_jerk(positions: Array, change: int, blend: int = FPS) -> TransitionJerk:
    """Jerk of `(T, joints, 3)` whose prompt changes at frame `change` and blends over `blend` frames.

    Inside are the same number of frames before the change, and those that begin half a second after the blend's end.
    A late jump falls into that half second: it counts where it is rougher than the blend itself.
    """
    before = positions[change - blend : change]
    during = positions[change : change + blend]
    begin = change + blend + FPS // 2
    settling, after = positions[change + blend : begin], positions[begin : begin + blend]
    if min(len(before), len(during), len(settling), len(after)) < 8:
        raise ValueError(f"{len(positions)} frames are too few for a change at {change}")
    within = [jerk(part).mean(1) for part in (before, after)]
    changing = [jerk(part).mean(1) for part in (during, settling)]
    inside = 0.5 * sum(float(part.mean()) for part in within)
    around = max(float(part.mean()) for part in changing)
    highest = max(float(part.max()) for part in within)
    return TransitionJerk(inside, around, max(float(part.max()) for part in changing) / max(highest, 1e-9))
