"""Room for a body: whether it can stand, land and climb at a position, and how the root keeps away from walls.

Points around the root are checked in all directions, so that no limb touches a wall on a diagonal or a spike.
"""

import numpy as np
from numpy.typing import NDArray

from runtime.arrays import Array
from runtime.terrain.height_map import Terrain

# distances from the root, chosen so that no limb of a walking body meets the ground
REACH_M, RISE_M = 0.45, 0.8  # knees and elbows: higher ground within this distance is a wall for them
HAND_REACH_M, HAND_RISE_M = 0.65, 1.3  # hands: likewise
STEEP_M, STEEP_RUN_M = 0.8, 0.15  # nobody stands where the ground drops this much within this distance
# between a velocity and the wall that it leads into
TOWARDS_COSINE, HAND_TOWARDS_COSINE = 0.5, 0.7
LANDING_DISTANCES_M = (0.2, 0.35, 0.5)  # behind an edge that is leapt over: where feet land,
RUN_OUT_DISTANCES_M, RUN_OUT_RISE_M = (0.75, 1.0, 1.25), 0.6  # where the body slows down; maximum rise
LANDING_RISE_M = 0.3  # maximum above the edge: more is a slope too steep to land on
LANDING_WIDTHS_M = np.array([-0.15, 0.0, 0.15])  # of landing feet
BODY_RADIUS_M = 0.35  # trunk and legs: the root drifts away from a wall this near
DRIFT_M, DRIFT_M_PER_S = 2.0, 1.2  # limits of the drift's distance and speed,
DRIFT_RISE_M = 0.4  # and of the ground's rise on its way
DRIFT_SPACING_M = 0.05
CLIMB_LENGTH_M = 0.9  # behind a climbed edge, where a body can stand
CLIMB_SPACING_M = 0.1
CLIMB_EDGE_M = 0.05  # before the edge, occupied by the wall itself,
CLIMB_FOOT_M = 0.15  # and behind it, where the first foot lands
CLIMBER_WIDTHS_M = np.array([-0.4, -0.2, 0.0, 0.2, 0.4])  # to the sides of the path: elbow to elbow,
CLIMBER_FEET_M = np.array([-0.2, 0.0, 0.2])  # and foot to foot
MAX_PLACE_DISTANCE_M = 12.0  # range of the search for a place to stand
PLACE_SPACING_M = 0.1
MIN_SPEED_M_PER_S = 1e-6  # slower, a velocity has no direction
DIRECTIONS = 24  # around a body
_ANGLES = np.arange(DIRECTIONS) * (2.0 * np.pi / DIRECTIONS)
_AROUND = np.stack([np.sin(_ANGLES), np.cos(_ANGLES)], axis=-1)
_RING_FRACTIONS = np.repeat([0.4, 0.7, 1.0, 1.2, HAND_REACH_M / REACH_M], DIRECTIONS)  # of REACH_M
_RING_DIRECTIONS = np.tile(_AROUND, (5, 1))
_RING = REACH_M * _RING_FRACTIONS[:, None] * _RING_DIRECTIONS
_RING_RISE = np.where(_RING_FRACTIONS > 1.0, HAND_RISE_M, RISE_M)  # rise from which each point is a wall
_RING_COSINE = np.where(_RING_FRACTIONS > 1.0, HAND_TOWARDS_COSINE, TOWARDS_COSINE)
_STEEP_RING = STEEP_RUN_M * _AROUND
_BODY_RINGS = BODY_RADIUS_M * np.concatenate([0.5 * _AROUND, _AROUND])


def has_walls(terrain: Terrain) -> bool:
    """Return whether the ground is steep enough somewhere to obstruct a body."""
    return terrain.steepest * REACH_M > RISE_M


def _rises(terrain: Terrain, place: Array, offsets: Array) -> Array:
    points = place + offsets
    here = terrain.height(place[..., 0], place[..., 1]).astype(np.float64)
    return terrain.height(points[..., 0], points[..., 1]).astype(np.float64) - here


def blocked_by_walls(terrain: Terrain, place: Array, velocity: Array) -> Array:
    """Return the root's velocity `(2,)` (m/s) at `place` (XZ), or zero if it leads the body into a wall."""
    speed = float(np.hypot(*velocity))
    if speed < MIN_SPEED_M_PER_S:
        return velocity
    walls = _rises(terrain, place, _RING) > _RING_RISE
    return np.zeros(2) if (walls & (_RING_DIRECTIONS @ (velocity / speed) > _RING_COSINE)).any() else velocity


def drift_from_walls(terrain: Terrain, place: Array, velocity: Array) -> Array:
    """Return the root's velocity `(2,)` (m/s) at `place` (XZ): out of a wall if the body is in one, else `blocked_by_walls`.

    A change of terrain, a jump or a turn near a wall can leave a body inside one.
    """
    if _free(terrain, place):
        return blocked_by_walls(terrain, place, velocity)
    open_ways = np.full(len(_AROUND), True)
    for distance in np.arange(DRIFT_SPACING_M, DRIFT_M, DRIFT_SPACING_M):
        steps = distance * _AROUND
        open_ways &= _rises(terrain, place, steps) <= DRIFT_RISE_M
        ways = _AROUND[open_ways & _free(terrain, place + steps)]
        if len(ways):
            away: Array = DRIFT_M_PER_S * ways[int(np.argmax(ways @ velocity))]
            return away
    return np.zeros(2)


def _free(terrain: Terrain, places: Array) -> NDArray[np.bool_]:
    """Return whether trunk and legs have room at places `(..., 2)`, none of which is a cliff's face."""
    around = _rises(terrain, places[..., None, :], _BODY_RINGS).max(-1) <= RISE_M
    return np.asarray(
        around & (np.abs(_rises(terrain, places[..., None, :], _STEEP_RING)).max(-1) <= STEEP_M)
    )


def can_land(
    terrain: Terrain, place: Array, way: Array, edge_m: float, rise_m: float, flight_m: float, over_m: float
) -> bool:
    """Return whether a leap from `place` in the unit direction `way` has room to land behind the edge `edge_m` away.

    `rise_m` is the landing's height over `place`. The last `flight_m` before the edge are in flight: within arm's
    reach, nothing there may be higher than `over_m`.
    """
    feet, edge = LANDING_WIDTHS_M, edge_m
    landing = _strip_rises(terrain, place, way, edge + np.array(LANDING_DISTANCES_M), feet)
    run_out = _strip_rises(terrain, place, way, edge + np.array(RUN_OUT_DISTANCES_M), feet)
    if landing.max() > rise_m + LANDING_RISE_M or run_out.max() > rise_m + RUN_OUT_RISE_M:
        return False
    flight = np.arange(edge - flight_m, edge, CLIMB_SPACING_M) if flight_m > 0.0 else np.zeros(0)
    return bool(_strip_rises(terrain, place, way, flight, CLIMBER_WIDTHS_M).max(initial=-np.inf) <= over_m)


def _strip_rises(terrain: Terrain, place: Array, way: Array, along: Array, sides: Array) -> Array:
    """Return rises (m) above the ground at `place` of points `along` a path and `sides` of it."""
    across = np.array([way[1], -way[0]])
    points = along[:, None, None] * way + sides[None, :, None] * across
    return _rises(terrain, place, points.reshape(-1, 2))


def can_climb(terrain: Terrain, place: Array, way: Array, edge_m: float, rise_m: float) -> bool:
    """Return whether a body has room to climb from `place` in the direction `way` over the edge `edge_m` away.

    Behind it the ground must be level and `rise_m` higher (negative: lower).
    """
    before = np.arange(0.0, edge_m - CLIMB_EDGE_M, CLIMB_SPACING_M)
    behind = edge_m + np.arange(CLIMB_FOOT_M, CLIMB_LENGTH_M, CLIMB_SPACING_M)
    top = _strip_rises(terrain, place, way, behind, CLIMBER_FEET_M)
    return bool(
        _strip_rises(terrain, place, way, before, CLIMBER_WIDTHS_M).max(initial=0.0) <= LANDING_RISE_M
        and _strip_rises(terrain, place, way, behind, CLIMBER_WIDTHS_M).max()
        <= max(rise_m, 0.0) + LANDING_RISE_M
        and np.abs(top - rise_m).max() <= LANDING_RISE_M
    )


def can_stand(terrain: Terrain, place: Array) -> bool:
    """Return whether a body has room at `place` (XZ): no wall within reach, and no spike or cliff face underfoot."""
    if not has_walls(terrain):
        return True
    free = (_rises(terrain, place, _RING) <= _RING_RISE).all()
    return bool(free and np.abs(_rises(terrain, place, _STEEP_RING)).max() <= STEEP_M)


def nearest_place(terrain: Terrain, x: float, z: float) -> tuple[float, float]:
    """Return the nearest place to x, z with room for a body, or x, z itself if there is none within `MAX_PLACE_DISTANCE_M`."""
    place = np.array([x, z])
    if can_stand(terrain, place):
        return x, z
    for distance in np.arange(PLACE_SPACING_M, MAX_PLACE_DISTANCE_M, PLACE_SPACING_M):
        for way in _AROUND:
            if can_stand(terrain, place + distance * way):
                return float(x + distance * way[0]), float(z + distance * way[1])
    return x, z
