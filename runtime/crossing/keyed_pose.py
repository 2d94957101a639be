"""What keyed motion is made of: curves through keys, arms that reach, legs that stand, and the pose they give."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sport.runtime import rotations
from sport.runtime.feet.ik import two_bone
from sport.runtime.skeleton import SPORT_SKELETON

Array = NDArray[np.floating]

UPPER_ARMS = [SPORT_SKELETON.index("LeftArm"), SPORT_SKELETON.index("RightArm")]
FOREARMS = [SPORT_SKELETON.index("LeftForeArm"), SPORT_SKELETON.index("RightForeArm")]
HANDS = [SPORT_SKELETON.index("LeftHand"), SPORT_SKELETON.index("RightHand")]
BACK = [SPORT_SKELETON.index(name) for name in ("LowerBack", "Spine", "Spine1")]
NECK = [SPORT_SKELETON.index(name) for name in ("Neck1", "Head")]
SIDEWAYS = np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]])  # where an arm and its hand point at rest
LEAN_HIPS, LEAN_HEAD = 0.4, 0.5  # share of a lean that the hips take, and that the head takes back


@dataclass(frozen=True)
class CrossingPose:
    """A pose in the frame of a crossing: x to the left, y over the ground before the obstacle, z along the way."""

    hips: Array  # (3,) metres
    local: Array  # (31, 4) local rotations; that of the hips is in the frame
    contacts: Array  # (4,) left heel, left toe, right heel, right toe: 0 or 1


def smooth(share: Array | float) -> Array:
    """From 0 to 1 as `share` does, with no speed at both ends."""
    s = np.clip(share, 0.0, 1.0)
    return s * s * (3.0 - 2.0 * s)


class Curve:
    """A smooth curve through keys that never swings beyond them (Fritsch and Carlson, 1980)."""

    def __init__(self, keys: Sequence[tuple[float, ...]]) -> None:
        """Each key is a time and one or more values; times increase."""
        table = np.array(keys, np.float64)
        self._times, self._values = table[:, 0], table[:, 1:]
        steps = np.diff(self._values, axis=0) / np.diff(self._times)[:, None]
        self._slopes = np.zeros_like(self._values)
        before, after = steps[:-1], steps[1:]
        same = before * after > 0.0
        mean = 2.0 * before * after / np.where(same, before + after, 1.0)
        self._slopes[1:-1] = np.where(same, mean, 0.0)

    def at(self, time: float) -> Array:
        """Values at a time; those of the nearest key outside."""
        t = min(max(time, float(self._times[0])), float(self._times[-1]))
        i = min(int(np.searchsorted(self._times, t, side="right")) - 1, len(self._times) - 2)
        width = self._times[i + 1] - self._times[i]
        s = (t - self._times[i]) / width
        a, b, m, n = (
            self._values[i],
            self._values[i + 1],
            self._slopes[i] * width,
            self._slopes[i + 1] * width,
        )
        result: Array = (
            (2 * s**3 - 3 * s**2 + 1) * a
            + (s**3 - 2 * s**2 + s) * m
            + (3 * s**2 - 2 * s**3) * b
            + (s**3 - s**2) * n
        )
        return result


def leaned(local: Array, angle: float) -> Array:
    """Local rotations `(31, 4)` with the body bent forward by `angle` radians, and the head looking ahead still."""
    result = np.array(local, np.float64)
    ahead = np.array([1.0, 0.0, 0.0])
    result[0] = rotations.multiply(rotations.from_axis_angle(ahead, np.array(LEAN_HIPS * angle)), result[0])
    for joints, share in ((BACK, 1.0 - LEAN_HIPS), (NECK, -LEAN_HEAD)):
        bend = rotations.from_axis_angle(ahead, np.array(share * angle / len(joints)))
        result[joints] = rotations.multiply(bend, result[joints])
    return result


def reaching(hips: Array, local: Array, wrists: Array, hands: Array, weight: float, poles: Array) -> Array:
    """Local rotations with both wrists brought to `wrists` `(2, 3)` by `weight` 0..1.

    Hands take the world rotations `hands` `(2, 4)`; elbows bend towards `poles` `(2, 3)`.
    """
    if weight <= 0.0:
        return local
    positions, world = SPORT_SKELETON.forward_kinematics(hips, local)
    p, w = positions.astype(np.float64), world.astype(np.float64)
    targets = p[HANDS] + weight * (wrists - p[HANDS])
    upper, lower = two_bone(p[UPPER_ARMS], p[FOREARMS], p[HANDS], targets, poles)
    arm, forearm = rotations.multiply(upper, w[UPPER_ARMS]), rotations.multiply(lower, w[FOREARMS])
    hand = rotations.slerp(rotations.multiply(lower, w[HANDS]), hands, weight)
    result = np.array(local, np.float64)
    parents = w[[SPORT_SKELETON.parents[j] for j in UPPER_ARMS]]
    for joints, parent, rotation in (
        (UPPER_ARMS, parents, arm),
        (FOREARMS, arm, forearm),
        (HANDS, forearm, hand),
    ):
        result[joints] = rotations.normalize(rotations.multiply(rotations.inverse(parent), rotation))
    return result
