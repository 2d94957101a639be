"""Overlays and contact darkness as plain arrays: what lies where, before any OpenGL."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from runtime.pose import Pose
from runtime.skeleton import ANKLE_HEIGHT, SPORT_SKELETON, TOE_HEIGHT

Array = NDArray[np.floating]

FOOT_RADIUS_M = 0.085
FOOT_STRENGTH = 0.55
BODY_RADIUS_M = 0.42
BODY_STRENGTH = 0.16
UP = np.array([0.0, 1.0, 0.0], np.float32)


def feet_of(poses: list[Pose]) -> Array:
    """What darkens the ground close by, `(n, 2, 4)`: per foot its heel and radius, its toe and strength; then bodies."""
    heel = [SPORT_SKELETON.index(name) for name in ("LeftFoot", "RightFoot")]
    toe = [SPORT_SKELETON.index(name) for name in ("LeftToeBase", "RightToeBase")]
    rows = []
    for pose in poses:
        for h, t in zip(heel, toe, strict=True):
            sole = pose.positions[h] - ANKLE_HEIGHT * UP, pose.positions[t] - TOE_HEIGHT * UP
            rows.append([[*sole[0], FOOT_RADIUS_M], [*sole[1], FOOT_STRENGTH]])
        rows.append([[*pose.root_position, BODY_RADIUS_M], [*pose.root_position, BODY_STRENGTH]])
    return np.array(rows, np.float32).reshape(-1, 2, 4)
