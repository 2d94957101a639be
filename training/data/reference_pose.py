"""Rest-pose corrections of skeletons whose axes follow no rule: measured where somebody stands in a known pose."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise

import numpy as np

from runtime import rotations
from runtime.arrays import Array

_UP, _DOWN = np.array([0.0, 1.0, 0.0]), np.array([0.0, -1.0, 0.0])


def standing_rotations(points: Mapping[str, Array]) -> dict[str, Array]:
    """Our world rotations `(4,)` of a figure that stands upright, looking ahead, from its joints `(3,)` by our names.

    Trunk, head and feet face where the hips do; arms and legs point where they point, twisted as little as possible.
    """
    left = points["LeftUpLeg"] - points["RightUpLeg"]
    heading: Array = rotations.from_yaw(np.arctan2(-left[2], left[0]))
    result = {n: heading for n in ("Hips", "LowerBack", "Spine", "Spine1", "Neck", "Neck1", "Head")}
    for side, outwards in (("Left", 1.0), ("Right", -1.0)):
        result[side + "Shoulder"] = heading
        chain = [side + "Arm", side + "ForeArm", side + "Hand"]
        result |= _limb(heading, np.array([outwards, 0.0, 0.0]), chain, points)
        chain = [side + "UpLeg", side + "Leg", side + "Foot"]
        result |= _limb(heading, _DOWN, chain, points)
        result[side + "Foot"] = result[side + "ToeBase"] = heading
    return result


def _limb(heading: Array, rest: Array, chain: list[str], points: Mapping[str, Array]) -> dict[str, Array]:
    """Rotations of a limb's joints: each bone points to the next joint, the last one follows its parent."""
    result, current = {}, heading
    for joint, child in pairwise(chain):
        wanted = rotations.normalize(points[child] - points[joint])
        current = rotations.multiply(rotations.between(rotations.rotate(current, rest), wanted), current)
        result[joint] = current
    result[chain[-1]] = current
    return result
