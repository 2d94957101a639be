"""A gait cycle's mean and what moves about it: rotations, curves of the root, landings."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from runtime import rotations
from runtime.arrays import Array
from runtime.motion import features
from runtime.skeleton import SPORT_SKELETON
from training.augmentation.pose_edits import EditedMotion
from training.augmentation.steps import left_landings

USUAL_CYCLE = 66  # frames, where there are too few landings to tell


class Axes(NamedTuple):
    """Horizontal unit vectors `(T, 3)` of the direction that a body faces over a cycle, and its yaw `(T,)`."""

    yaw: Array
    left: Array
    ahead: Array


def cycle_frames(contacts: NDArray[np.uint8]) -> int:
    """Frames of a gait cycle: the median from one landing of a foot to its next."""
    gaps = np.concatenate([np.diff(left_landings(contacts)), np.diff(right_landings(contacts))])
    return int(np.clip(np.median(gaps), 20, 150)) if len(gaps) else USUAL_CYCLE


def right_landings(contacts: NDArray[np.uint8]) -> NDArray[np.intp]:
    """Frames where the right foot comes down."""
    return left_landings(contacts[:, [2, 3, 0, 1]])


def cycle_mean(values: Array, frames: int) -> Array:
    """Mean `(T, n)` of values `(T, n)` over a cycle around every frame; the ends go on as they repeat and drift."""
    half = frames // 2
    if len(values) < frames + 2:
        return np.broadcast_to(values.mean(0), values.shape).copy()
    before = values[frames - half : frames] - (values[frames] - values[0])
    after = values[len(values) - frames : len(values) - frames + half] + (values[-1] - values[-1 - frames])
    total = np.cumsum(np.concatenate([np.zeros_like(values[:1]), before, values, after]), axis=0)
    return (total[2 * half + 1 :] - total[: -2 * half - 1]) / (2 * half + 1)


def axes(motion: EditedMotion) -> Axes:
    """The facing direction over a cycle."""
    positions, _ = SPORT_SKELETON.forward_kinematics(motion.hips, motion.local.astype(np.float64))
    facing_yaw = np.unwrap(features.facing_yaw(positions).astype(np.float64))
    yaw = cycle_mean(facing_yaw[:, None], cycle_frames(motion.contacts))[:, 0]
    facing = rotations.from_yaw(yaw)
    return Axes(
        yaw,
        rotations.rotate(facing, np.array([1.0, 0.0, 0.0])),
        rotations.rotate(facing, np.array([0.0, 0.0, 1.0])),
    )


def away_from_mean(rotation: Array, yaw: Array, frames: int) -> Array:
    """How far world rotations `(T, 4)` are turned from their mean of a cycle: axis times angle `(T, 3)`, in the facing
    frame: pitch, yaw, roll to the right, radians.
    """
    own = rotations.multiply(rotations.inverse(rotations.from_yaw(yaw)), rotation)
    own = rotations.continuous(own)
    mean = rotations.normalize(cycle_mean(own, frames))
    away = rotations.multiply(own, rotations.inverse(mean))
    away = away * np.where(away[:, :1] < 0, -1.0, 1.0)
    size = np.linalg.norm(away[:, 1:], axis=1)
    angle = 2.0 * np.arctan2(size, away[:, 0])
    return away[:, 1:] * (angle / np.maximum(size, 1e-9))[:, None]
