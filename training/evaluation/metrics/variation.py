"""How motion changes: jerk around a change of prompt, and the difference between two generations (diversity, Sec. IV-B2)."""

from __future__ import annotations

import numpy as np

from runtime.arrays import Array
from runtime.motion.features import FPS

CLIPS, FRAMES = 40, 180  # of the paper
LEAD_IN = 60  # frames at temperature 0, so that both of a pair begin in the same pose


def jerk(positions: Array) -> Array:
    """Size of the third derivative `(T - 3, joints)` in m/s^3 of world joints `(T, joints, 3)` at 60 Hz."""
    return np.linalg.norm(np.diff(positions.astype(np.float64), n=3, axis=0), axis=-1) * FPS**3


def transition_jerk(positions: Array, change: int, blend: int = FPS) -> float:
    """Mean jerk around a change over that inside the styles: 1 is a transition as smooth as the styles themselves.

    The prompt of `(T, joints, 3)` changes at frame `change` and blends over `blend` frames. Inside are the same number
    of frames before the change, and those that begin half a second after the blend's end. A late jump falls into that
    half second: it counts where it is rougher than the blend itself.
    """
    begin = change + blend + FPS // 2
    parts = np.split(positions[change - blend : begin + blend], [blend, 2 * blend, begin - change + blend])
    if min(map(len, parts)) < 8:
        raise ValueError(f"{len(positions)} frames are too few for a change at {change}")
    before, during, settling, after = (float(jerk(part).mean()) for part in parts)
    inside = 0.5 * (before + after)
    return max(during, settling) / inside if inside > 0 else float("nan")


def pair_distance(first: Array, second: Array) -> float:
    """Mean over frames of ||p^1 - p^2||_2, metres: the norm over all 31 joints of poses `(T, 31, 3)` relative to the root."""
    difference = (first - second).astype(np.float64)
    return float(np.linalg.norm(difference.reshape(len(difference), -1), axis=-1).mean())
