"""Toes bend at push-off: where the foot tips forward over them, they stay on the ground."""

from __future__ import annotations

from math import acos, atan2, cos, hypot, sin

from runtime.feet.leg_scalar import Quaternion, Vector, add, multiply, rotate, scale
from runtime.skeleton import TOE_HEIGHT
from runtime.terrain.height_map import PointHeights

TOE_LENGTH = 0.06  # m, from the toe joint to the tip
STEEPEST = 0.055  # m that the tip may be raised over the joint: about 65 degrees


def bent(toe: Quaternion, foot: Quaternion, joint: Vector, ground: PointHeights, sink: float) -> Quaternion:
    """Local rotation of the toes for the network's `toe`; `foot` is the foot's world rotation, `joint` where the toe joint is.

    They turn about their own cross axis, as toes do: where they point straight down, a heading taken from the way they
    point would flip from one frame to the next.
    """
    world = multiply(foot, toe)
    ahead, up = rotate(world, (0.0, 0.0, 1.0)), rotate(world, (0.0, 1.0, 0.0))
    tip = add(joint, scale(ahead, TOE_LENGTH))
    rise = min(ground.height(tip[0], tip[2]) + TOE_HEIGHT - sink - joint[1], STEEPEST) / TOE_LENGTH
    if ahead[1] >= rise:
        return toe
    # after a bend b the tip is raised by ahead_y cos b + up_y sin b
    most = hypot(ahead[1], up[1])
    bend = atan2(up[1], ahead[1]) - acos(max(min(rise / max(most, 1e-6), 1.0), -1.0))
    return multiply(toe, (cos(0.5 * bend), -sin(0.5 * bend), 0.0, 0.0))
