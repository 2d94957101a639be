"""Unclimbable steps up and down: found on the path ahead, and hidden from the heights that the network sees."""

import numpy as np
from numpy.typing import NDArray

from runtime.arrays import Array
from runtime.terrain.height_map import Terrain

HIGHEST_STEP_M = 1.5  # up or down; a wall of 1.1 m can be climbed
STEP_RUN_M = 0.5  # a rise within this length is a step, not a slope
STEP_SPACING_M = 0.1
FINEST_SPACING_M = 0.025
HALF_WIDTH_M = 0.15  # of the strip on which a body walks
_SURELY_NO_STEP_M = 0.99 * HIGHEST_STEP_M
FARTHEST_LOOK_M = 10.0  # also if a damaged network makes the root very fast


def step_ahead(terrain: Terrain, x: float, z: float, direction: Array, reach_m: float) -> tuple[float, float]:
    """Return the distance (m) to the first step over `HIGHEST_STEP_M` from x, z, and its rise (m, negative: down).

    `direction` `(2,)` is a unit vector in XZ. Returns infinity and 0 if there is none within `reach_m`.
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
    """Return, for each of N characters, whether the heights of the strip ahead differ by less than `rise_m`.

    `places` and `directions` `(N, 2)` in XZ, `reach_m` `(N,)` metres. One call for all is much faster than `step_ahead` for each.
    """
    farthest = min(float(reach_m.max()), FARTHEST_LOOK_M) + STEP_RUN_M + STEP_SPACING_M
    along = np.arange(0.0, farthest, min(max(terrain.cell_m, FINEST_SPACING_M), STEP_SPACING_M))
    across = np.array([-HALF_WIDTH_M, 0.0, HALF_WIDTH_M])[:, None]
    (x, z), (dx, dz) = (np.moveaxis(pairs, -1, 0)[..., None, None] for pairs in (places, directions))
    heights = terrain.height(x + along * dx - across * dz, z + along * dz + across * dx)
    return np.asarray(np.ptp(heights, axis=(1, 2)) < rise_m)


def within_steps(heights: Array, present: int) -> Array:
    """Return heights `(N, 12, 3)` of trajectory samples with steps over `HIGHEST_STEP_M` removed.

    Ground behind such a step, seen from sample `present`, gets the height before it, so that the network does not raise
    its knees. No height differs from the present one by more than `HIGHEST_STEP_M`.
    """
    seen = np.array(heights, np.float64)
    for each, rise in zip(seen, (seen.max((1, 2)) - seen.min((1, 2))).tolist(), strict=True):
        if rise > HIGHEST_STEP_M:
            _hide_steps(each, present)
    return seen


def _hide_steps(seen: Array, present: int) -> None:
    heights, here = seen.copy(), float(seen[present, 1])
    seen[present] = np.where(np.abs(seen[present] - here) > HIGHEST_STEP_M, here, seen[present])
    for side in (range(present + 1, len(seen)), range(present - 1, -1, -1)):
        step = side.step
        for sample in side:
            rise = heights[sample] - heights[sample - step]
            seen[sample] = seen[sample - step] + np.where(np.abs(rise) > HIGHEST_STEP_M, 0.0, rise)
    np.clip(seen, here - HIGHEST_STEP_M, here + HIGHEST_STEP_M, out=seen)


def blocked_message(rise_m: float) -> str:
    """Return the status line for a character that stopped before a step of `rise_m` (metres)."""
    kind = "step up" if rise_m > 0.0 else "drop"
    return f"The way ahead is blocked: a {kind} of {abs(rise_m):.1f} m."
