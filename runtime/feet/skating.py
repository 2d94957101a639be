"""Feet against the ground: heights of toes and heels over a terrain, and the paper's foot skating (Sec. IV-B)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from runtime.arrays import Array
from runtime.skeleton import ANKLE_HEIGHT, TOE_HEIGHT
from runtime.terrain.height_map import Terrain

TOES = (5, 10)
HEELS = (4, 9)  # the ankle joints, over the heels
SOLE_POINTS = (4, 5, 9, 10)
SOLE_HEIGHTS = (
    ANKLE_HEIGHT,
    TOE_HEIGHT,
    ANKLE_HEIGHT,
    TOE_HEIGHT,
)  # of SOLE_POINTS on a foot that stands flat
SKATING_HEIGHT_M = 0.025  # H


def joint_heights(positions: Array, terrain: Terrain, joints: Sequence[int] = TOES) -> Array:
    """Heights `(T, n)` in metres over the terrain of `joints` of world positions `(T, 31, 3)`."""
    points = positions[:, list(joints)].astype(np.float64)
    return points[..., 1] - terrain.height(points[..., 0], points[..., 2])


def skating(
    positions: Array, terrain: Terrain, joints: Sequence[int] = TOES, resting_m: float | Sequence[float] = 0.0
) -> Array:
    """s_f = v_f clamp(2 - 2^(h_f / H), 0, 1) `(T - 1, n)`, cm per frame, of world positions `(T, 31, 3)`.

    v_f is the horizontal way from the frame before. `resting_m` is taken off the joints' heights: with the heights of
    joints on a foot that stands flat it is the sole that counts, which is stricter than the paper's formula.
    """
    way = np.diff(positions[:, list(joints)][..., [0, 2]].astype(np.float64), axis=0)
    height = joint_heights(positions, terrain, joints)[1:] - np.asarray(resting_m)
    weight = np.clip(2.0 - 2.0 ** (height / SKATING_HEIGHT_M), 0.0, 1.0)
    return 100.0 * np.linalg.norm(way, axis=-1) * weight
