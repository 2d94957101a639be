"""Ground that nobody can walk on: where a walker has to stop."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from runtime.arrays import Array
from runtime.terrain.height_map import Terrain

HIGHEST_STEP_M = 1.5  # up or down; a wall of 1.1 m can be climbed
STEP_RUN_M = 0.5  # within which such a rise is a step and not a slope
SPACING_M = 0.1
FINEST_M = 0.025
HALF_WIDTH_M = 0.15  # of a walker's way
_SURELY_NO_STEP_M = 0.99 * HIGHEST_STEP_M
FARTHEST_M = 10.0  # that is looked ahead, however fast a damaged network makes the root


def step_ahead(terrain: Terrain, x: float, z: float, direction: Array, reach_m: float) -> tuple[float, float]:
    """Distance (m) to the first step over `HIGHEST_STEP_M` on the way from x, z, and its rise (m, negative is down).

    `direction` `(2,)` is a unit vector in XZ. Infinity and 0 where there is none within `reach_m`.
    """
    reach_m = min(reach_m, FARTHEST_M)
    along = np.arange(0.0, reach_m + STEP_RUN_M + SPACING_M, SPACING_M)
    across = np.array([-HALF_WIDTH_M, 0.0, HALF_WIDTH_M])[:, None]
    heights = terrain.height(
        x + along * direction[0] - across * direction[1], z + along * direction[1] + across * direction[0]
    ).astype(np.float64)
    run = round(STEP_RUN_M / SPACING_M)
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
    farthest = min(float(reach_m.max()), FARTHEST_M) + STEP_RUN_M + SPACING_M
    along = np.arange(0.0, farthest, min(max(terrain.cell_m, FINEST_M), SPACING_M))
    across = np.array([-HALF_WIDTH_M, 0.0, HALF_WIDTH_M])[:, None]
    (x, z), (dx, dz) = (np.moveaxis(pairs, -1, 0)[..., None, None] for pairs in (places, directions))
    heights = terrain.height(x + along * dx - across * dz, z + along * dz + across * dx)
    return np.asarray(np.ptp(heights, axis=(1, 2)) < rise_m)


def within_steps(heights: Array, present: int) -> Array:
    """Heights `(N, 12, 3)` of trajectory samples, as far as a walker goes from that under sample `present`.

    Ground behind a step over `HIGHEST_STEP_M` lies as high as that before it: nobody lifts a knee for it. No ground is
    farther than `HIGHEST_STEP_M` from the present one.
    """
    seen = np.array(heights, np.float64)
    for place in np.flatnonzero(np.ptp(seen, axis=(1, 2)) > HIGHEST_STEP_M):
        _hide_steps(seen[place], present)
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
