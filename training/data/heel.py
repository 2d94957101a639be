"""Heels that rise as far as the leg above asks: a foot that pivots over its toes keeps the knee's angle."""

from __future__ import annotations

import numpy as np

from runtime import rotations
from runtime.arrays import Array
from runtime.skeleton import SPORT_SKELETON

FOOT_OFFSET = SPORT_SKELETON.offsets[5].astype(np.float64)  # ankle to toe in the rest pose
MAX_FLATTER, MAX_STEEPER = np.deg2rad(20.0), np.deg2rad(30.0)
_LATERAL = np.array([1.0, 0.0, 0.0])


def heel_rise(hip: Array, toe: Array, foot: Array, length: Array) -> Array:
    """Radians by which feet `(..., 4)` over standing toes `(..., 3)` are to pitch (positive: the heel rises).

    After the turn the ankle is `length` `(...)` metres from `hip` `(..., 3)`. Feet of another length than the source's
    would bend the knee otherwise in every push-off, or stretch the leg beyond its length. Limited to what a foot does;
    where no turn reaches the length the nearest is taken.
    """
    arm = -rotations.rotate(foot, np.broadcast_to(FOOT_OFFSET, toe.shape))  # toe to ankle
    across = rotations.rotate(foot, np.broadcast_to(_LATERAL, toe.shape))
    to_hip = hip - toe
    # |arm(d) - to_hip| = length, where arm(d) . to_hip = a cos d + b sin d
    a, b = np.sum(arm * to_hip, axis=-1), np.sum(np.cross(across, arm) * to_hip, axis=-1)
    wanted = 0.5 * (np.sum(arm * arm, axis=-1) + np.sum(to_hip * to_hip, axis=-1) - length * length)
    most = np.arctan2(b, a)  # the shortest leg
    away = np.arccos(np.clip(wanted / np.maximum(np.hypot(a, b), 1e-9), -1.0, 1.0))
    first, second = _wrapped(most - away), _wrapped(most + away)
    nearest = np.where(np.abs(first) < np.abs(second), first, second)
    return np.clip(nearest, -MAX_FLATTER, MAX_STEEPER)


def pitched(foot: Array, angle: Array | float) -> Array:
    """Rotations `(..., 4)` turned about their own lateral axis so that +Z (toes, face) sinks by `angle`."""
    return rotations.multiply(foot, rotations.from_axis_angle(_LATERAL, np.asarray(angle)))


def _wrapped(angle: Array) -> Array:
    return (angle + np.pi) % (2.0 * np.pi) - np.pi
