"""Feet relative to the ground: heights over a terrain, contacts, and the paper's foot skating (Sec. IV-B)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from runtime.arrays import Array
from runtime.skeleton import ANKLE_HEIGHT, TOE_HEIGHT
from runtime.terrain.height_map import Terrain

TOES = (5, 10)
HEELS = (4, 9)  # the ankle joints, which are above the heels
SOLE_POINTS = (4, 5, 9, 10)
# resting heights of SOLE_POINTS on a flat foot
SOLE_HEIGHTS = ANKLE_HEIGHT, TOE_HEIGHT, ANKLE_HEIGHT, TOE_HEIGHT
SKATING_HEIGHT_M = 0.025  # H
# thresholds of a loaded sole: its speed, and its height over its lowest positions,
MAX_STANDING_SPEED_M_PER_S = 0.25
MAX_STANDING_HEIGHT_M = 0.04
RESTING_FRACTION = 0.05  # which it has in this fraction of the frames
CM_PER_M = 100.0


def joint_heights(positions: Array, terrain: Terrain, joints: Sequence[int] = TOES) -> Array:
    """Return heights `(T, n)` (metres) above the terrain of `joints`, for world positions `(T, 31, 3)`."""
    points = positions[:, list(joints)].astype(np.float64)
    return points[..., 1] - terrain.height(points[..., 0], points[..., 2])


def measured_contacts(positions: Array, fps: float, terrain: Terrain | None) -> Array:
    """Return contacts `(T, 4)`, 0 or 1, measured from world positions `(T, 31, 3)`: soles that are slow and close to the terrain.

    Heights are relative to each sole's own resting height, so the ground may have any level; None is level ground.
    """
    feet = positions[:, list(SOLE_POINTS)].astype(np.float64)
    step = np.gradient(feet, axis=0) if len(feet) > 1 else np.zeros_like(feet)
    above = feet[..., 1] if terrain is None else joint_heights(positions, terrain, SOLE_POINTS)
    low = above - np.quantile(above, RESTING_FRACTION, axis=0) < MAX_STANDING_HEIGHT_M
    return (low & (np.linalg.norm(step, axis=-1) * fps < MAX_STANDING_SPEED_M_PER_S)).astype(np.float32)


def skating(
    positions: Array, terrain: Terrain, joints: Sequence[int] = TOES, resting_m: float | Sequence[float] = 0.0
) -> Array:
    """Return foot skating s_f = v_f clamp(2 - 2^(h_f / H), 0, 1) `(T - 1, n)`, cm per frame, of world positions `(T, 31, 3)`.

    v_f is the horizontal displacement since the previous frame. `resting_m` is subtracted from the joints' heights:
    with the heights of a flat standing foot it measures the sole, which is stricter than the paper's formula.
    """
    way = np.diff(positions[:, list(joints)][..., [0, 2]].astype(np.float64), axis=0)
    height = joint_heights(positions, terrain, joints)[1:] - np.asarray(resting_m)
    weight = np.clip(2.0 - 2.0 ** (height / SKATING_HEIGHT_M), 0.0, 1.0)
    return CM_PER_M * np.linalg.norm(way, axis=-1) * weight
