"""How motion changes: jerk around a change of prompt, and the difference between two generations (diversity, Sec. IV-B2)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from runtime.arrays import Array
from runtime.motion.features import FPS


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
