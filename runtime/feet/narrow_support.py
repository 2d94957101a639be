"""Feet on a beam: a foot that would come down beside high, narrow ground is led sideways onto it while it swings."""

from __future__ import annotations

from math import sqrt

from sport.runtime.feet.leg_scalar import LegPose, Vector, add, damp, dot, subtract
from sport.runtime.terrain.point_heights import PointHeights

DROP_M = 0.12  # that the ground beside must be lower than under the hips: less is a step, which a foot takes
LEVEL_M = 0.06  # and that the ground led to may be lower
BESIDE_M = 0.35  # on both sides of the hips the ground is low,
ALONG_M = 0.2  # and before and behind them it is high: no hurdle, no step, no wall
FARTHEST_M = 0.16  # that a foot is led
SPACING_M = 0.02
INSIDE_M = 0.02  # farther onto it than its edge
HALFLIFE_S = 0.06
NOTHING: Vector = (0.0, 0.0, 0.0)


def side_of_beam(hips: Vector, legs: tuple[LegPose, LegPose], ground: PointHeights) -> Vector | None:
    """Unit vector to the left where the hips are over ground as narrow as a beam; None elsewhere."""
    across = subtract(legs[0].hip, legs[1].hip)
    size = sqrt(across[0] * across[0] + across[2] * across[2])
    if size < 1e-3:
        return None
    side = (across[0] / size, 0.0, across[2] / size)
    top = ground.height(hips[0], hips[2])
    for sign in (BESIDE_M, -BESIDE_M):
        if ground.height(hips[0] + sign * side[0], hips[2] + sign * side[2]) > top - DROP_M:
            return None
    for sign in (ALONG_M, -ALONG_M):
        if ground.height(hips[0] - sign * side[2], hips[2] + sign * side[0]) < top - DROP_M:
            return None
    return side


class SidewaysLead:
    """How far one foot is led sideways, from frame to frame."""

    def __init__(self) -> None:
        self.offset: Vector = NOTHING
        self.velocity: Vector = NOTHING

    def apply(
        self, leg: LegPose, hips: Vector, side: Vector | None, held: bool, ground: PointHeights, dt: float
    ) -> LegPose:
        """The leg with its toe and ankle led along `side` (see `side_of_beam`); a held foot keeps its lead."""
        if not held:
            goal = NOTHING if side is None else _lead(leg, hips, side, ground)
            if goal == NOTHING == self.offset:
                return leg
            x, vx = damp(self.offset[0], self.velocity[0], goal[0], HALFLIFE_S, dt)
            z, vz = damp(self.offset[2], self.velocity[2], goal[2], HALFLIFE_S, dt)
            self.offset, self.velocity = (x, 0.0, z), (vx, 0.0, vz)
            if goal == NOTHING and x * x + z * z < 1e-8:
                self.offset = self.velocity = NOTHING
        elif self.offset == NOTHING:
            return leg
        return leg._replace(toe=add(leg.toe, self.offset), ankle=add(leg.ankle, self.offset))


def _lead(leg: LegPose, hips: Vector, side: Vector, ground: PointHeights) -> Vector:
    """The way (m) that brings both ends of a foot over the ground that carries the hips; nothing where it is too far."""
    top = ground.height(hips[0], hips[2])
    ends = (leg.toe, leg.ankle)
    if min(ground.height(p[0], p[2]) for p in ends) > top - DROP_M:
        return NOTHING
    sign = 1.0 if dot(side, subtract(hips, leg.ankle)) > 0.0 else -1.0
    for step in range(1, round(FARTHEST_M / SPACING_M) + 1):
        way = sign * step * SPACING_M
        if all(ground.height(p[0] + way * side[0], p[2] + way * side[2]) > top - LEVEL_M for p in ends):
            way += sign * INSIDE_M
            return (way * side[0], 0.0, way * side[2])
    return NOTHING
