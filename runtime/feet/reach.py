"""Leg reach: the position of a foot that its leg cannot put where the ground asks for it."""

from __future__ import annotations

from math import cos, dist, sin
from typing import NamedTuple

from runtime.feet.ik import EASE_REACH_FRACTION, MAX_REACH
from runtime.feet.leg import LegBones, LegPose, roll_cosine, rolled, soft_reach
from runtime.feet.next_step import has_edges
from runtime.feet.settings import SETTINGS
from runtime.scalar_math import (
    MIN_SIZE,
    Quaternion,
    Vector,
    add,
    add_scaled,
    between,
    dot,
    length,
    multiply,
    perpendicular,
    rotate,
    scale,
    subtract,
    unit,
)
from runtime.skeleton import ANKLE_HEIGHT, TOE_HEIGHT
from runtime.terrain.height_map import PointHeights

MAX_ROLL_RAD = 0.6  # limit of the foot roll when the knee cannot follow
SOLE_FIRST_FRACTION = 0.3  # of the sole's direction, blended into the ankle's
REACH_TRIALS = 4  # iterations of raising a foot out of reach; usually one suffices


class SpannedFoot(NamedTuple):
    """A foot at a distance that its leg can reach."""

    toe: Vector
    ankle: Vector
    rotation: Quaternion  # in the world
    depth: float  # m, depth in the ground

    def lifted(self, joint: Vector) -> Vector:
        """Return the position of `joint`, lifted out of the ground."""
        return joint[0], joint[1] + self.depth, joint[2]


def span(leg: LegPose) -> float:
    """Return the hip-ankle distance (metres) of the incoming pose."""
    return dist(leg.ankle, leg.hip)


def depth_in_ground(toe: Vector, ankle: Vector, ground: PointHeights) -> float:
    """Return how far (metres) a foot at `toe` and `ankle` is below the depth that a sole may sink into the ground."""
    return max(
        ground.height(toe[0], toe[2]) + TOE_HEIGHT - SETTINGS.sink - toe[1],
        ground.height(ankle[0], ankle[2]) + ANKLE_HEIGHT - SETTINGS.sink - ankle[1],
    )


def spanned_foot(
    bones: LegBones, rotation: Quaternion, hip: Vector, target: Vector, reach: float, ground: PointHeights
) -> SpannedFoot:
    """Return the foot with its ankle `reach` metres from `hip` instead of at `target`: rolled over the toe, or slid on the heel."""
    sole = rotate(rotation, bones.offsets[4])
    toe = add(target, sole)
    to_hip, along = subtract(hip, toe), unit(scale(sole, -1.0))
    cosine = roll_cosine(to_hip, bones.foot_length, reach)
    if has_edges(ground):
        sole_down = rotate(rotation, (0.0, -1.0, 0.0))
        toe, ankle, turned = _rolled_a_little(bones, hip, toe, (along, sole_down), reach)
        rotation = multiply(between(along, turned), rotation)
    elif abs(cosine) > 1.0:
        to_target = subtract(target, hip)
        ankle = add_scaled(hip, to_target, reach / max(length(to_target), MIN_SIZE))
        toe = add(ankle, sole)
    else:
        turned = rolled(to_hip, along, cosine)
        ankle = add_scaled(toe, turned, bones.foot_length)
        rotation = multiply(between(along, turned), rotation)
    return SpannedFoot(toe, ankle, rotation, max(0.0, depth_in_ground(toe, ankle, ground)))


def _rolled_a_little(
    bones: LegBones, hip: Vector, toe: Vector, foot: tuple[Vector, Vector], reach: float
) -> tuple[Vector, Vector, Vector]:
    """Return toe, ankle and the direction between them: rolled by at most `MAX_ROLL_RAD`, then slid.

    On a bar, a foot whose knee is at its speed limit would turn over its toe, and back in the next frame. `foot` is the
    vector from toe to ankle, and the direction of the sole: on tiptoe under the hip it rolls back onto its sole.
    """
    to_hip, (along, sole_down) = subtract(hip, toe), foot
    back = add_scaled(along, sole_down, SOLE_FIRST_FRACTION)
    turned = rolled(to_hip, back, roll_cosine(to_hip, bones.foot_length, reach))
    if dot(along, turned) < cos(MAX_ROLL_RAD):
        aside = unit(perpendicular(turned, along))
        turned = add_scaled(scale(along, cos(MAX_ROLL_RAD)), aside, sin(MAX_ROLL_RAD))
    from_hip = subtract(add_scaled(toe, turned, bones.foot_length), hip)
    ankle = add_scaled(hip, from_hip, reach / max(length(from_hip), 1e-6))
    return add_scaled(ankle, turned, -bones.foot_length), ankle, turned


def ankle_target(
    bones: LegBones, rotation: Quaternion, leg: LegPose, ankle: Vector, drop: float, ground: PointHeights
) -> Vector:
    """Return the ankle target for the IK, raised if the leg is too short and its reachable position lies inside a step."""
    hip, target = leg.raised(-drop), ankle
    for _ in range(REACH_TRIALS):
        to_target = subtract(target, hip)
        wanted = length(to_target)
        if wanted <= (MAX_REACH - EASE_REACH_FRACTION) * bones.length:
            break
        reached = add_scaled(hip, to_target, soft_reach(wanted, bones.length, span(leg)) / wanted)
        toe = add(reached, rotate(rotation, bones.offsets[4]))
        missing = depth_in_ground(toe, reached, ground)
        if missing <= 0.0:
            break
        target = (target[0], target[1] + 2.0 * missing, target[2])  # twice: the reach takes up a part
    return target
