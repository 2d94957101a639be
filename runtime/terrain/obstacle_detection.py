"""Bars, gaps, walls and drops on a path: `obstacle_ahead` finds the first one along a strip of ground."""

from dataclasses import dataclass, replace
from enum import Enum

import numpy as np

from runtime.arrays import Array
from runtime.terrain.height_map import Terrain

SPACING_M = 0.025
RUN_M = 0.125  # an edge rises or falls within this distance
SIDES_M = (0.0, 0.15, -0.15)  # centre of the path, left and right of it
EDGE_M = 0.12  # a lower edge is ground for the feet, not an obstacle
STEP_M = 0.25  # a lower step up or down is a stair
THICKEST_BAR_M = 0.45  # on a thicker one feet are put
WIDEST_GAP_M = 1.3
LEVEL_M = 0.35  # maximum height difference of the ground before and behind a bar
BEHIND_M = 1.6  # length of ground that is examined beyond an edge
EDGE_BEGINS_M = 0.03  # rise at which an edge has begun
EDGE_BESIDE_RISE_M = 0.05  # rise between two samples that counts as the same edge on a parallel path
EDGE_BESIDE_M = 0.5  # distance along the path within which that edge is looked for
FOOT_LENGTH_M = 0.15  # behind an edge, where the ground is measured for the landing foot
RETURN_FRACTION = 0.5  # of a rise: below it the ground is back at its height
GAP_RETURN_FRACTION = 0.4  # of a drop: likewise,
GAP_RETURN_M = 0.5  # and no lower than this


class ObstacleKind(Enum):
    """The kind of an obstacle."""

    BAR = "bar"
    GAP = "gap"
    UP = "up"
    DOWN = "down"


@dataclass(frozen=True)
class ObstacleAhead:
    """An obstacle on a path: distances (m) along the path, heights (m) relative to the ground just before it."""

    kind: ObstacleKind
    near: float  # its first edge
    far: float  # its last edge: behind a bar or gap; of a wall, the end of its top
    top: float  # of a bar; of a wall or drop the signed step; 0 for a gap
    beyond: float  # height of the ground behind it
    skew: float  # radians that the path must turn left to be perpendicular to the edge
    ground: float = 0.0  # height just before it, metres

    @property
    def size(self) -> float:
        """Size in metres: the length of a gap, the height of any other obstacle."""
        return self.far - self.near if self.kind is ObstacleKind.GAP else abs(self.top)


def obstacle_ahead(
    terrain: Terrain, x: float, z: float, direction: Array, reach_m: float
) -> ObstacleAhead | None:
    """Return the first obstacle whose near edge lies within `reach_m` of x, z, or None.

    `direction` `(2,)` is a unit vector in XZ. Ignored are steps and gaps under `STEP_M`, slopes, bars under `EDGE_M`,
    and the far side of a bar that is being stepped over.
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
    level = np.abs(heights[0][first : first + run + 1] - heights[0][first]) < EDGE_BEGINS_M
    near = float(along[first + int(np.argmin(level)) - 1])
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
    """Return whether the drop is the far side of a bar: the ground behind the observer is as low again."""
    behind = drop.near - np.arange(0.0, THICKEST_BAR_M + RUN_M, SPACING_M)
    heights = terrain.height(x + behind * direction[0], z + behind * direction[1])
    low = drop.ground + drop.top
    return bool((np.abs(heights - low) <= min(LEVEL_M, RETURN_FRACTION * abs(drop.top))).any())


def _classified(row: Array, along: Array, first: int, run: int, near: float) -> ObstacleAhead | None:
    """The obstacle whose edge lies at `near`, or None for a low step."""
    base = float(row[first])
    here = round(near / SPACING_M)
    after = row[here : here + run + 3]
    peak = after[int(np.argmax(np.abs(after - base)))]
    step = float(peak - base)
    far = _far_edge(row[here + run :] - base, along[here + run :], step)
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


def _far_edge(rises: Array, along: Array, step: float) -> float:
    """Distance (m) at which the ground returns to its height before the `step` (m), or infinity."""
    if step > 0.0:
        returns = np.abs(rises) < RETURN_FRACTION * step
    else:
        returns = rises > max(-GAP_RETURN_M, GAP_RETURN_FRACTION * step)
    return float(along[int(np.argmax(returns))]) if returns.any() else float("inf")


def _level_after(row: Array, far: float) -> float:
    """Height of the ground a foot's length behind `far`."""
    return float(row[min(round((far + FOOT_LENGTH_M) / SPACING_M), len(row) - 1)])


def _edge_beside(row: Array, along: Array, near: float, falls: bool) -> float | None:
    """Distance (m) of the same edge on a parallel path, or None where that path has no such edge."""
    begin = max(round((near - EDGE_BESIDE_M) / SPACING_M), 0)
    part = row[begin : round((near + EDGE_BESIDE_M) / SPACING_M)]
    if len(part) < 2:
        return None
    jumps = np.diff(part) * (-1.0 if falls else 1.0)
    at = int(np.argmax(jumps))
    return float(along[begin + at]) if jumps[at] > EDGE_BESIDE_RISE_M else None
