"""Walking on a beam: feet are moved sideways onto its middle and around each other, and the arms are held out."""

from __future__ import annotations

from dataclasses import dataclass
from math import exp, sqrt

import numpy as np

from runtime import rotations
from runtime.arrays import Array
from runtime.feet.leg import LegPose
from runtime.scalar_math import Vector, add, damp, dot, scale, subtract
from runtime.skeleton import SPORT_SKELETON
from runtime.terrain.height_map import PointHeights

DROP_M = 0.12  # the ground on both sides is lower than a beam by this; less is an ordinary step
LEVEL_M = 0.06  # allowed height difference across a beam
BESIDE_M = 0.35  # the ground is low this far to both sides of the hips,
ALONG_M = 0.2  # and high this far ahead of and behind them, unlike at a hurdle, step or wall
MAX_LEAD_M = 0.3  # sideways displacement of a foot
SCAN_M = 0.45  # search range to both sides
SPACING_M = 0.025
LANDING_OFFSET_M = 0.02  # distance from the middle, on its own side, at which a foot is put down
PASSING_OFFSET_M = 0.08  # extra distance while it passes the other foot,
PASSING_RANGE_M = 0.25  # within this distance along the path
PASSING_HEIGHT_M = 0.06  # and at this height
HALF_LIFE_S = 0.06
PULL_PER_S, MAX_PULL_M_PER_S = 1.5, 0.3  # velocity per metre from the middle; its limit
MIN_HIPS_WIDTH_M = 1e-3  # seen from above; narrower hips have no left and right
MIN_SQUARED_OFFSET = 1e-8  # m2, sideways offset of a foot; less is ignored
NOTHING: Vector = (0.0, 0.0, 0.0)

ARMS = (SPORT_SKELETON.index("LeftArm"), SPORT_SKELETON.index("RightArm"))
ARMS_OUT_RAD = 0.5  # upper arms turned outwards
ARMS_HALF_LIFE_S = 0.25  # to both directions
LN_2_FACTOR = 0.693  # of an exponent, for a half-life
MIN_ARMS_OUT_FRACTION = 1e-3  # of `ARMS_OUT_RAD`; less is invisible


def may_be_narrow(ground: PointHeights) -> bool:
    """Return whether any slope of this ground is steep enough for the side of a beam."""
    return ground.steepest * BESIDE_M >= DROP_M


def side_of_beam(hips: Vector, legs: tuple[LegPose, LegPose], ground: PointHeights) -> Vector | None:
    """Return the unit vector to the character's left if the ground is as narrow as a beam, else None."""
    across = subtract(legs[0].hip, legs[1].hip)
    size = sqrt(across[0] * across[0] + across[2] * across[2])
    if size < MIN_HIPS_WIDTH_M:
        return None
    side = (across[0] / size, 0.0, across[2] / size)
    top = max(ground.height(p[0], p[2]) for p in (hips, legs[0].toe, legs[1].toe))
    for sign in (BESIDE_M, -BESIDE_M):
        if ground.height(hips[0] + sign * side[0], hips[2] + sign * side[2]) > top - DROP_M:
            return None
    middle = to_middle(hips, side, ground)
    if middle is None:
        return None
    over = add(hips, scale(side, middle))
    top = ground.height(over[0], over[2])
    for sign in (ALONG_M, -ALONG_M):
        if ground.height(over[0] - sign * side[2], over[2] + sign * side[0]) < top - DROP_M:
            return None
    return side


def to_middle(point: Vector, side: Vector, ground: PointHeights) -> float | None:
    """Return the distance (metres along `side`) to the middle of the highest ground; None if that ground is not narrow."""
    count = round(SCAN_M / SPACING_M)
    ways = [SPACING_M * k for k in range(-count, count + 1)]
    heights = [ground.height(point[0] + way * side[0], point[2] + way * side[2]) for way in ways]
    top = max(heights)
    high = [way for way, height in zip(ways, heights, strict=True) if height > top - LEVEL_M]
    if max(heights[0], heights[-1]) > top - DROP_M:
        return None
    way = 0.5 * (high[0] + high[-1])
    return way if abs(way) <= MAX_LEAD_M else None


def pull_of_beam(hips: Vector, side: Vector | None, ground: PointHeights) -> tuple[float, float]:
    """Return the velocity (m/s, XZ) that keeps the root over the middle of a beam; `side` is from `side_of_beam`."""
    way = None if side is None else to_middle(hips, side, ground)
    if side is None or way is None:
        return 0.0, 0.0
    speed = min(max(PULL_PER_S * way, -MAX_PULL_M_PER_S), MAX_PULL_M_PER_S)
    return speed * side[0], speed * side[2]


@dataclass
class SidewaysLead:
    """Sideways displacement of one foot on a beam, carried from frame to frame."""

    sign: float = 1.0  # 1 left, -1 right
    offset: Vector = NOTHING
    velocity: Vector = NOTHING

    def apply(
        self, leg: LegPose, other: LegPose, side: Vector | None, held: bool, ground: PointHeights, dt: float
    ) -> LegPose:
        """Return the leg with toe and ankle moved along `side` (see `side_of_beam`); a held foot keeps its displacement."""
        if not held:
            goal = NOTHING if side is None else self._lead(leg, other, side, ground)
            if goal == NOTHING == self.offset:
                return leg
            x, vx = damp(self.offset[0], self.velocity[0], goal[0], HALF_LIFE_S, dt)
            z, vz = damp(self.offset[2], self.velocity[2], goal[2], HALF_LIFE_S, dt)
            self.offset, self.velocity = (x, 0.0, z), (vx, 0.0, vz)
            if goal == NOTHING and x * x + z * z < MIN_SQUARED_OFFSET:
                self.offset = self.velocity = NOTHING
        elif self.offset == NOTHING:
            return leg
        return leg._replace(toe=add(leg.toe, self.offset), ankle=add(leg.ankle, self.offset))

    def _lead(self, leg: LegPose, other: LegPose, side: Vector, ground: PointHeights) -> Vector:
        """Displacement (m) that brings the foot over the middle of the beam, and around the other foot while it passes."""
        middle = scale(add(leg.toe, leg.ankle), 0.5)
        way = to_middle(middle, side, ground)
        if way is None:
            return NOTHING
        forward = (-side[2], 0.0, side[0])
        near = 1.0 - (dot(forward, subtract(leg.ankle, other.ankle)) / PASSING_RANGE_M) ** 2
        lifted = (leg.ankle[1] - other.ankle[1]) / PASSING_HEIGHT_M
        around = PASSING_OFFSET_M * max(near, 0.0) * min(max(lifted, 0.0), 1.0)
        return scale(side, way + self.sign * (LANDING_OFFSET_M + around))


@dataclass
class Balance:
    """How far the arms are held out on a beam, carried from frame to frame."""

    fraction: float = 0.0

    def apply(self, local: Array, on_beam: bool, dt: float) -> Array:
        """Return local rotations `(31, 4)` with the upper arms turned out, easing in on a beam and out elsewhere."""
        self.fraction += (float(on_beam) - self.fraction) * (1.0 - exp(-LN_2_FACTOR * dt / ARMS_HALF_LIFE_S))
        if self.fraction < MIN_ARMS_OUT_FRACTION:
            self.fraction = 0.0
            return local
        result = np.array(local, np.float64)
        # about the facing direction of the chest
        angle = ARMS_OUT_RAD * self.fraction * np.array([1.0, -1.0])
        turn = rotations.from_axis_angle(np.tile([0.0, 0.0, 1.0], (2, 1)), angle)
        result[list(ARMS)] = rotations.multiply(turn, result[list(ARMS)])
        return result.astype(local.dtype)
