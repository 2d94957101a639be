"""Room for a body: ground so near and so high that a walker who stood beside it would be in it.

A way ahead is looked at along a strip (`obstacles`); this is what lies around the root on all sides, so that nobody grazes
a wall on a diagonal, turns into a spike or stands in the ground that came in place of another.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from runtime.arrays import Array
from runtime.terrain.height_map import Terrain

REACH_M, RISE_M = 0.45, 0.8  # of knees and elbows: higher ground within that is a wall for them,
HAND_M, HAND_RISE_M = 0.65, 1.3  # and for hands
STEEP_M, STEEP_RUN_M = 0.8, 0.15  # nobody stands where the ground falls so far within so little
TOWARDS, HAND_TOWARDS = 0.5, 0.7  # cosines of the angle to such ground from which on a way leads towards it
LANDING_M = (0.2, 0.35, 0.5)  # behind an edge that is leapt, where feet come down;
RUN_OUT_M, RUN_OUT_RISE_M = (0.75, 1.0, 1.25), 0.6  # and where the body comes to, no higher;
LANDING_RISE_M = 0.3  # higher there it is no step but a slope too steep
BODY_M = 0.35  # of trunk and legs: with a wall within that the root drifts away,
DRIFT_M, DRIFT_SPEED = 2.0, 1.2  # to a place no farther (m/s),
DRIFT_RISE_M = 0.4  # over ground no higher
CLIMB_LENGTH_M = 0.9  # behind an edge that is climbed, where a body comes to stand
_SIDES, _FEET = np.array([-0.4, -0.2, 0.0, 0.2, 0.4]), np.array([-0.2, 0.0, 0.2])  # of a climber
FARTHEST_M = 12.0  # that a place to stand is looked for
_ANGLES = np.arange(24) * (2.0 * np.pi / 24)
_AROUND = np.stack([np.sin(_ANGLES), np.cos(_ANGLES)], axis=-1)
_SHARES = np.repeat([0.4, 0.7, 1.0, 1.2, HAND_M / REACH_M], len(_AROUND))
_UNIT = np.tile(_AROUND, (5, 1))
_RING = REACH_M * _SHARES[:, None] * _UNIT
_WALL = np.where(_SHARES > 1.0, HAND_RISE_M, RISE_M)  # rises of the ring's places,
_LEADS = np.where(_SHARES > 1.0, HAND_TOWARDS, TOWARDS)  # and their cosines
_NEAR = STEEP_RUN_M * _AROUND
_BODY = BODY_M * np.concatenate([0.5 * _AROUND, _AROUND])


def has_walls(terrain: Terrain) -> bool:
    """Whether this ground rises anywhere so steeply that a body may lack room."""
    return terrain.steepest * REACH_M > RISE_M


def _rises(terrain: Terrain, place: Array, offsets: Array) -> Array:
    points = place + offsets
    here = terrain.height(place[..., 0], place[..., 1]).astype(np.float64)
    return terrain.height(points[..., 0], points[..., 1]).astype(np.float64) - here


def kept_off(terrain: Terrain, place: Array, velocity: Array) -> Array:
    """The velocity `(2,)` (m/s) of a root at `place` (XZ), zero where it leads towards ground that the body would be in."""
    speed = float(np.hypot(*velocity))
    if speed < 1e-6:
        return velocity
    walls = _rises(terrain, place, _RING) > _WALL
    return np.zeros(2) if (walls & (_UNIT @ (velocity / speed) > _LEADS)).any() else velocity


def led_clear(terrain: Terrain, place: Array, velocity: Array) -> Array:
    """The velocity `(2,)` (m/s) of a root at `place` (XZ): away from walls that the body is in, else as `kept_off` leaves it.

    Ground that comes in place of another, a jump's flight and a turn beside a wall can leave a body where it has no room.
    """
    if _free(terrain, place):
        return kept_off(terrain, place, velocity)
    open_ways = np.full(len(_AROUND), True)
    for distance in np.arange(0.05, DRIFT_M, 0.05):
        steps = distance * _AROUND
        open_ways &= _rises(terrain, place, steps) <= DRIFT_RISE_M
        ways = _AROUND[open_ways & _free(terrain, place + steps)]
        if len(ways):
            away: Array = DRIFT_SPEED * ways[int(np.argmax(ways @ velocity))]
            return away
    return np.zeros(2)


def _free(terrain: Terrain, places: Array) -> NDArray[np.bool_]:
    """Whether no wall is so near to places `(..., 2)` that trunk and legs would be in it, and none of them a cliff's face."""
    around = _rises(terrain, places[..., None, :], _BODY).max(-1) <= RISE_M
    return np.asarray(around & (np.abs(_rises(terrain, places[..., None, :], _NEAR)).max(-1) <= STEEP_M))


def can_land(
    terrain: Terrain, place: Array, way: Array, edge_m: float, rise_m: float, flight_m: float, over_m: float
) -> bool:
    """Whether feet have room behind an edge `edge_m` from `place` on the `way`, on ground `rise_m` over that at `place`.

    The `flight_m` before the edge are flown over: there nothing may be higher than `over_m` on either side, as far as arms
    reach.
    """
    across = np.array([way[1], -way[0]])
    points = [(edge_m + far) * way + side * across for far in LANDING_M for side in (-0.15, 0.0, 0.15)]
    if _rises(terrain, place, np.array(points)).max() > rise_m + LANDING_RISE_M:
        return False
    beyond = [(edge_m + far) * way + side * across for far in RUN_OUT_M for side in (-0.15, 0.0, 0.15)]
    if _rises(terrain, place, np.array(beyond)).max() > rise_m + RUN_OUT_RISE_M:
        return False
    flight = np.arange(edge_m - flight_m, edge_m, 0.1) if flight_m > 0.0 else ()
    beside = [far * way + side * across for far in flight for side in _SIDES]
    return not beside or bool(_rises(terrain, place, np.array(beside)).max() <= over_m)


def can_climb(terrain: Terrain, place: Array, way: Array, edge_m: float, rise_m: float) -> bool:
    """Whether a body has room to climb from `place` on the `way` over an edge `edge_m` away, onto level ground `rise_m` higher (negative is lower)."""
    across = np.array([way[1], -way[0]])

    def rises(along: Array, sides: Array) -> Array:
        points = along[:, None, None] * way + sides[None, :, None] * across
        return _rises(terrain, place, points.reshape(-1, 2))

    before, behind = np.arange(0.0, edge_m - 0.05, 0.1), edge_m + np.arange(0.15, CLIMB_LENGTH_M, 0.1)
    top = rises(behind, _FEET)
    return bool(
        rises(before, _SIDES).max(initial=0.0) <= LANDING_RISE_M
        and rises(behind, _SIDES).max() <= max(rise_m, 0.0) + LANDING_RISE_M
        and np.abs(top - rise_m).max() <= LANDING_RISE_M
    )


def can_stand(terrain: Terrain, place: Array) -> bool:
    """Whether a body has room at `place` (XZ), on ground that is not a needle or a cliff's face."""
    if not has_walls(terrain):
        return True
    free = (_rises(terrain, place, _RING) <= _WALL).all()
    return bool(free and np.abs(_rises(terrain, place, _NEAR)).max() <= STEEP_M)


def nearest_place(terrain: Terrain, x: float, z: float) -> tuple[float, float]:
    """The nearest place to x, z where a body has room; x, z itself where there is none within `FARTHEST_M`."""
    place = np.array([x, z])
    if can_stand(terrain, place):
        return x, z
    for distance in np.arange(0.1, FARTHEST_M, 0.1):
        for way in _AROUND:
            if can_stand(terrain, place + distance * way):
                return float(x + distance * way[0]), float(z + distance * way[1])
    return x, z
