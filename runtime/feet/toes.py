"""Toes bend at push-off: where the foot tips forward over them, they stay on the ground."""

from __future__ import annotations

from math import sqrt

from runtime.feet.leg_scalar import (
    Quaternion,
    Vector,
    add,
    between,
    multiply,
    relative,
    rotate,
    unit,
)
from runtime.skeleton import TOE_HEIGHT
from runtime.terrain.height_map import PointHeights

TOE_LENGTH = 0.06  # m, from the toe joint to the tip
STEEPEST = 0.055  # m that the tip may be raised over the joint: about 65 degrees


def bent(toe: Quaternion, foot: Quaternion, joint: Vector, ground: PointHeights, sink: float) -> Quaternion:
    """Local rotation of the toes for the network's `toe`; `foot` is the foot's world rotation, `joint` where the toe joint is."""
    world = multiply(foot, toe)
    along = rotate(world, (0.0, 0.0, TOE_LENGTH))
    tip = add(joint, along)
    rise = min(ground.height(tip[0], tip[2]) + TOE_HEIGHT - sink - joint[1], STEEPEST)
    if along[1] >= rise:
        return toe
    across = sqrt(along[0] * along[0] + along[2] * along[2])
    share = sqrt(max(TOE_LENGTH * TOE_LENGTH - rise * rise, 0.0)) / max(across, 1e-6)
    raised = (along[0] * share, rise, along[2] * share)
    return relative(foot, multiply(between(unit(along), unit(raised)), world))
