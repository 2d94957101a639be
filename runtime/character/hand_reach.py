"""Where a hand that touches the body belongs on a character of other proportions.

Joint angles alone bring a longer forearm past the hip and onto the belly. A hand near trunk or head therefore keeps its
place beside them, and the arm follows by inverse kinematics; an arm that hangs or swings keeps its angles.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime import rotations
from runtime.skeleton import SPORT_SKELETON

Array = NDArray[Any]

ANCHORS = tuple(SPORT_SKELETON.index(name) for name in ("Hips", "Spine1", "Head"))
# Of our own body, metres: half width and depth of the trunk, from under the hips to the neck; the head about its middle.
TRUNK_WIDTH, TRUNK_DEPTH, TRUNK_LOW, TRUNK_HIGH = 0.16, 0.11, -0.06, 0.5
HEAD_RADIUS, HEAD_UP = 0.13, 0.08
NEAR_M, FAR_M = 0.06, 0.14  # from the surface to the wrist: touching, and free
BENT, STRAIGHT = np.radians((75.0, 40.0))  # of the elbow


def touching(positions: Array, world_rotations: Array, arm: tuple[int, ...]) -> Array:
    """How far `(...)` the hand of an arm (SPORT joints) of a pose touches trunk or head: 0 free, 1 on it."""
    wrist = positions[..., arm[2], :]
    seen = rotations.rotate(rotations.inverse(world_rotations[..., 0, :]), wrist - positions[..., 0, :])
    over = np.maximum(np.maximum(TRUNK_LOW - seen[..., 1], seen[..., 1] - TRUNK_HIGH), 0.0)
    widths = np.hypot(seen[..., 0] / TRUNK_WIDTH, seen[..., 2] / TRUNK_DEPTH)
    aside = np.hypot(seen[..., 0], seen[..., 2]) * (1.0 - 1.0 / np.maximum(widths, 1.0))
    trunk = np.hypot(aside, over)
    middle = positions[..., ANCHORS[2], :] + np.array([0.0, HEAD_UP, 0.0])
    head = np.maximum(np.linalg.norm(wrist - middle, axis=-1) - HEAD_RADIUS, 0.0)
    upper, fore = (positions[..., arm[k + 1], :] - positions[..., arm[k], :] for k in (0, 1))
    cosine = np.sum(upper * fore, axis=-1) / np.linalg.norm(upper, axis=-1) / np.linalg.norm(fore, axis=-1)
    bent = np.arccos(np.clip(cosine, -1.0, 1.0))
    return ramp(np.minimum(trunk, head), FAR_M, NEAR_M) * ramp(bent, STRAIGHT, BENT)


def reach(positions: Array, anchors: Array, arm: tuple[int, ...]) -> Array:
    """Where `(..., 3)` the wrist belongs beside a character's own joints `anchors` `(..., 3, 3)`: those of `ANCHORS`.

    Near an anchor it keeps the place from there. Trunks are turned alike, so places from them can be compared.
    """
    away = positions[..., arm[2], None, :] - positions[..., ANCHORS, :]
    weight = 1.0 / np.maximum(np.sum(away * away, axis=-1, keepdims=True), 1e-4)
    place: Array = ((anchors + away) * weight).sum(axis=-2) / weight.sum(axis=-2)
    return place


def ramp(value: Array, none: float, full: float) -> Array:
    """0 at `none`, 1 at `full`, smooth between."""
    t = np.clip((value - none) / (full - none), 0.0, 1.0)
    return np.asarray(t * t * (3.0 - 2.0 * t))
