"""Transition smoothness: the jerk of the joints around a change of prompt against that inside the styles."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from runtime.features import FPS

Array = NDArray[np.floating]


def jerk(positions: Array) -> Array:
    """Size of the third derivative `(T - 3, joints)` in m/s^3 of world joints `(T, joints, 3)` at 60 Hz."""
    return np.linalg.norm(np.diff(positions.astype(np.float64), n=3, axis=0), axis=-1) * FPS**3


@dataclass(frozen=True)
class TransitionJerk:
    """Mean jerk of all joints in m/s^3."""

    inside: float  # mean of the second before the change and of the second after the blend
    around: float  # in the second of the blend
    peak: float  # highest frame of the blend over the highest frame inside

    @property
    def ratio(self) -> float:
        """1 is a transition as smooth as the styles themselves."""
        return self.around / self.inside if self.inside > 0 else float("nan")


def transition_jerk(positions: Array, change: int, blend: int = FPS) -> TransitionJerk:
    """Jerk of `(T, joints, 3)` whose prompt changes at frame `change` and blends over `blend` frames.

    Inside are the same number of frames before the change, and those that begin half a second after the blend's end.
    """
    before = positions[change - blend : change]
    during = positions[change : change + blend]
    begin = change + blend + FPS // 2
    after = positions[begin : begin + blend]
    if min(len(before), len(during), len(after)) < 8:
        raise ValueError(f"{len(positions)} frames are too few for a change at {change}")
    frames = [jerk(part).mean(1) for part in (before, during, after)]
    inside = 0.5 * float(frames[0].mean() + frames[2].mean())
    highest = max(float(frames[0].max()), float(frames[2].max()))
    return TransitionJerk(inside, float(frames[1].mean()), float(frames[1].max()) / max(highest, 1e-9))
