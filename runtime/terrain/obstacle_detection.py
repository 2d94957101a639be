"""What obstructs a walker: bars, gaps, walls and drops on a path, steps too high for anyone, and ground that leaves no room.

A path ahead is examined along a strip. Room is what lies around the root on all sides, so that no body grazes a wall on a
diagonal, turns into a spike or stands in the ground that came in place of another.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from runtime.arrays import Array
from runtime.terrain.height_map import Terrain

SPACING_M = 0.025
RUN_M = 0.125  # an edge rises or falls within this
SIDES_M = (0.0, 0.15, -0.15)  # the middle of the way, left and right of it
EDGE_M = 0.12  # a lower edge is ground for the feet, not an obstacle
STEP_M = 0.25  # a lower step up or down is a stair's
THICKEST_BAR_M = 0.45  # a longer one is stood on
WIDEST_GAP_M = 1.3
LEVEL_M = 0.35  # that the ground behind a bar may differ from that before it
BEHIND_M = 1.6  # that is looked beyond an edge


class ObstacleKind(Enum):
    """What a traversal has to do."""

    BAR = "bar"
    GAP = "gap"
    UP = "up"
    DOWN = "down"


@dataclass(frozen=True)
class ObstacleAhead:
    """Distances (m) along the way from where it was looked from; heights over the ground just before it."""

    kind: ObstacleKind
    near: float  # its first edge
    far: float  # its last edge: behind a bar or gap; of a wall, where its top ends
    top: float  # of a bar; of a wall or drop the step itself (negative is down); 0 of a gap
    beyond: float  # height of the ground behind it
    skew: float  # radians that the way turns left to meet the edge at a right angle
    ground: float = 0.0  # height just before it, metres

    @property
    def size(self) -> float:
        """Metres: the length of a gap, the height of all else."""
        return self.far - self.near if self.kind is ObstacleKind.GAP else abs(self.top)


def obstacle_ahead(
    terrain: Terrain, x: float, z: float, direction: Array, reach_m: float
) -> ObstacleAhead | None:
    """The first obstacle whose near edge lies within `reach_m` on the way from x, z; None where there is none.

    `direction` `(2,)` is a unit vector in XZ. Steps and gaps under `STEP_M`, slopes, and bars under `EDGE_M` are none,
    and neither is the far side of a bar that is being stepped over.
    """
    along = np.arange(0.0, reach_m + BEHIND_M, SPACING_M)
    across = np.array(SIDES_M)[:, None]  # to the left is (z, -x) of the direction
    heights = terrain.height(
        x + along * direction[0] + across * direction[1], z + along * direction[1] - across * direction[0]
    ).astype(np.float64)
    run = round(RUN_M / SPACING_M)
    rises = heights[0, run:] - heights[0, :-run]
    steep = np.abs(rises) > EDGE_M
    if not steep.any():
        return None
    first = int(np.argmax(steep))
    near = _edge(heights[0], along, first, run)
    if near > reach_m:
        return None
    found = _classified(heights[0], along, first, run, near)
    if found is None or (found.kind is ObstacleKind.DOWN and _on_a_bar(terrain, x, z, direction, found)):
        return None
    edges = [
        _edge_beside(row, along, near, found.top < 0.0 or found.kind is ObstacleKind.GAP)
        for row in heights[1:]
    ]
    left, right = (near if e is None else e for e in edges)
    skew = float(np.arctan2(right - left, SIDES_M[1] - SIDES_M[2]))
    slant = 0.5 * abs(left - right)
    return replace(found, near=near - slant, far=found.far + slant, skew=skew)


def _on_a_bar(terrain: Terrain, x: float, z: float, direction: Array, drop: ObstacleAhead) -> bool:
    """Whether the ground before a drop is as low again within the thickness of a bar: behind the observer."""
    behind = drop.near - np.arange(0.0, THICKEST_BAR_M + RUN_M, SPACING_M)
    heights = terrain.height(x + behind * direction[0], z + behind * direction[1])
    low = drop.ground + drop.top
    return bool((np.abs(heights - low) <= min(LEVEL_M, 0.5 * abs(drop.top))).any())


def _edge(row: Array, along: Array, first: int, run: int) -> float:
    """Where the ground begins to rise or fall, of the window of `run` cells that begins at `first`."""
    level = np.abs(row[first : first + run + 1] - row[first]) < 0.03
    return float(along[first + int(np.argmin(level)) - 1])


def _classified(row: Array, along: Array, first: int, run: int, near: float) -> ObstacleAhead | None:
    base = float(row[first])
    here = round(near / SPACING_M)
    after = row[here : here + run + 3]
    peak = after[int(np.argmax(np.abs(after - base)))]
    step = float(peak - base)
    rest = row[here + run :] - base
    back = np.abs(rest) < 0.5 * abs(step) if step > 0.0 else rest > max(-0.5, 0.4 * step)
    ends = int(np.argmax(back)) if back.any() else None
    far = float("inf") if ends is None else float(along[here + run + ends])
    if step > 0.0 and far - near <= THICKEST_BAR_M:
        beyond = _level_after(row, far) - base
        if abs(beyond) <= LEVEL_M:
            return ObstacleAhead(ObstacleKind.BAR, near, far, step, beyond, 0.0, base)
    if step < 0.0 and far - near <= WIDEST_GAP_M:
        if base - float(row[here : round(far / SPACING_M) + 1].min()) < STEP_M:
            return None  # stairs down and up again
        return ObstacleAhead(ObstacleKind.GAP, near, far, 0.0, _level_after(row, far) - base, 0.0, base)
    if abs(step) < STEP_M:
        return None
    kind = ObstacleKind.UP if step > 0.0 else ObstacleKind.DOWN
    return ObstacleAhead(kind, near, far, step, step, 0.0, base)


def _level_after(row: Array, far: float) -> float:
    """Height of the ground a foot's length behind `far`."""
    return float(row[min(round((far + 0.15) / SPACING_M), len(row) - 1)])


def _edge_beside(row: Array, along: Array, near: float, falls: bool) -> float | None:
    """The same edge on a parallel path: where it crosses a fifth of its step, within half a metre."""
    begin = max(round((near - 0.5) / SPACING_M), 0)
    part = row[begin : round((near + 0.5) / SPACING_M)]
    if len(part) < 2:
        return None
    jumps = np.diff(part) * (-1.0 if falls else 1.0)
    at = int(np.argmax(jumps))
    return float(along[begin + at]) if jumps[at] > 0.05 else None


HIGHEST_STEP_M = 1.5  # up or down; a wall of 1.1 m can be climbed
STEP_RUN_M = 0.5  # within which such a rise is a step and not a slope
STEP_SPACING_M = 0.1
FINEST_M = 0.025
HALF_WIDTH_M = 0.15  # of a walker's way
_SURELY_NO_STEP_M = 0.99 * HIGHEST_STEP_M
FARTHEST_LOOK_M = 10.0  # that is looked ahead, however fast a damaged network makes the root


def step_ahead(terrain: Terrain, x: float, z: float, direction: Array, reach_m: float) -> tuple[float, float]:
    """Distance (m) to the first step over `HIGHEST_STEP_M` on the way from x, z, and its rise (m, negative is down).

    `direction` `(2,)` is a unit vector in XZ. Infinity and 0 where there is none within `reach_m`.
    """
    reach_m = min(reach_m, FARTHEST_LOOK_M)
    along = np.arange(0.0, reach_m + STEP_RUN_M + STEP_SPACING_M, STEP_SPACING_M)
    across = np.array([-HALF_WIDTH_M, 0.0, HALF_WIDTH_M])[:, None]
    heights = terrain.height(
        x + along * direction[0] - across * direction[1], z + along * direction[1] + across * direction[0]
    ).astype(np.float64)
    run = round(STEP_RUN_M / STEP_SPACING_M)
    ahead = np.lib.stride_tricks.sliding_window_view(heights, run + 1, axis=1)
    rises = ahead - ahead[..., :1]  # (3, N, run + 1)
    too_high = np.abs(rises) > HIGHEST_STEP_M
    if not too_high.any():
        return float("inf"), 0.0
    begin = int(np.argmax(too_high.any(axis=(0, 2))))
    distance = float(along[begin + int(np.argmax(too_high[:, begin].any(axis=0)))])
    if distance > reach_m:
        return float("inf"), 0.0
    rise = rises[:, begin].ravel()
    return distance, float(rise[np.argmax(np.abs(rise))])


def level_ahead(
    terrain: Terrain, places: Array, directions: Array, reach_m: Array, rise_m: float = _SURELY_NO_STEP_M
) -> NDArray[np.bool_]:
    """Whether nothing rises or falls by `rise_m` from places `(N, 2)` (XZ) on the ways `(N, 2)`, within `reach_m` `(N,)`.

    The whole strip differs by less than a step, which is known at a fraction of the time for many walkers at once.
    """
    farthest = min(float(reach_m.max()), FARTHEST_LOOK_M) + STEP_RUN_M + STEP_SPACING_M
    along = np.arange(0.0, farthest, min(max(terrain.cell_m, FINEST_M), STEP_SPACING_M))
    across = np.array([-HALF_WIDTH_M, 0.0, HALF_WIDTH_M])[:, None]
    (x, z), (dx, dz) = (np.moveaxis(pairs, -1, 0)[..., None, None] for pairs in (places, directions))
    heights = terrain.height(x + along * dx - across * dz, z + along * dz + across * dx)
    return np.asarray(np.ptp(heights, axis=(1, 2)) < rise_m)


def within_steps(heights: Array, present: int) -> Array:
    """Heights `(N, 12, 3)` of trajectory samples, as far as a walker goes from that under sample `present`.

    Ground behind a step over `HIGHEST_STEP_M` lies as high as that before it: no walker lifts a knee for it. No ground is
    farther than `HIGHEST_STEP_M` from the present one.
    """
    seen = np.array(heights, np.float64)
    for each, rise in zip(seen, (seen.max((1, 2)) - seen.min((1, 2))).tolist(), strict=True):
        if rise > HIGHEST_STEP_M:
            _hide_steps(each, present)
    return seen


def _hide_steps(seen: Array, present: int) -> None:
    heights, here = seen.copy(), float(seen[present, 1])
    seen[present] = np.where(np.abs(seen[present] - here) > HIGHEST_STEP_M, here, seen[present])
    for way in (range(present + 1, len(seen)), range(present - 1, -1, -1)):
        step = 1 if way.step > 0 else -1
        for sample in way:
            rise = heights[sample] - heights[sample - step]
            seen[sample] = seen[sample - step] + np.where(np.abs(rise) > HIGHEST_STEP_M, 0.0, rise)
    np.clip(seen, here - HIGHEST_STEP_M, here + HIGHEST_STEP_M, out=seen)


def blocked_message(rise_m: float) -> str:
    """What the status line says where a walker has stopped."""
    kind = "step up" if rise_m > 0.0 else "drop"
    return f"The way ahead is blocked: a {kind} of {abs(rise_m):.1f} m."


REACH_M, RISE_M = 0.45, 0.8  # of knees and elbows: higher ground within that is a wall for them,
HAND_M, HAND_RISE_M = 0.65, 1.3  # and for hands
STEEP_M, STEEP_RUN_M = 0.8, 0.15  # no body stands where the ground falls so far within so little
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

    Ground that comes in place of another, a jump's flight and a turn near a wall can leave a body where it has no room.
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
    feet, edge = np.array([-0.15, 0.0, 0.15]), edge_m
    landing = _strip_rises(terrain, place, way, edge + np.array(LANDING_M), feet)
    run_out = _strip_rises(terrain, place, way, edge + np.array(RUN_OUT_M), feet)
    if landing.max() > rise_m + LANDING_RISE_M or run_out.max() > rise_m + RUN_OUT_RISE_M:
        return False
    flight = np.arange(edge - flight_m, edge, 0.1) if flight_m > 0.0 else np.zeros(0)
    return bool(_strip_rises(terrain, place, way, flight, _SIDES).max(initial=-np.inf) <= over_m)


def _strip_rises(terrain: Terrain, place: Array, way: Array, along: Array, sides: Array) -> Array:
    """Rises over the ground at `place` of the points `along` and to the `sides` of a path, metres."""
    across = np.array([way[1], -way[0]])
    points = along[:, None, None] * way + sides[None, :, None] * across
    return _rises(terrain, place, points.reshape(-1, 2))


def can_climb(terrain: Terrain, place: Array, way: Array, edge_m: float, rise_m: float) -> bool:
    """Whether a body has room to climb from `place` on the `way` over an edge `edge_m` away, onto level ground `rise_m` higher (negative is lower)."""
    before, behind = np.arange(0.0, edge_m - 0.05, 0.1), edge_m + np.arange(0.15, CLIMB_LENGTH_M, 0.1)
    top = _strip_rises(terrain, place, way, behind, _FEET)
    return bool(
        _strip_rises(terrain, place, way, before, _SIDES).max(initial=0.0) <= LANDING_RISE_M
        and _strip_rises(terrain, place, way, behind, _SIDES).max() <= max(rise_m, 0.0) + LANDING_RISE_M
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
