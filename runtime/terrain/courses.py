"""Obstacle courses along +Z, starting at the origin: hurdles, a beam, platforms with gaps, walls.

Heights and distances are defined only here, for the ground itself, the controller and the evaluation.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from runtime.arrays import Array

CELL_M = 0.05  # a riser is one cell wide
ROUNDING_M = 1e-6  # of the grid's coordinates


@dataclass(frozen=True)
class Obstacle:
    """Raised ground between `begin` and `end` (z, metres), `half_width` to each side of the path."""

    begin: float
    end: float
    top: float
    half_width: float

    def raised(self, x: Array, z: Array) -> NDArray[np.bool_]:
        """Return which grid points x, z lie on the obstacle."""
        within = (z >= self.begin - ROUNDING_M) & (z <= self.end + ROUNDING_M)
        return within & (np.abs(x) <= self.half_width + ROUNDING_M)


BAR_M, WALL_M, HALF_WIDTH_M = 0.1, 1.0, 3.0  # thickness, and half of their extent across the path
PLATFORM_M, PLATFORM_HALF_WIDTH_M, FIRST_PLATFORM_M = 1.8, 1.5, 3.0
HURDLES_M = ((4.0, 0.2), (7.5, 0.3), (11.0, 0.4), (14.5, 0.5), (18.0, 0.6))  # place and height
WALLS_M = ((5.0, 0.6), (10.0, 1.0), (15.0, 1.4))
# height, and the gap behind
PLATFORMS_M = ((0.2, 0.4), (0.35, 0.5), (0.5, 0.6), (0.5, 0.7), (0.5, 0.8), (0.5, 0.0))


def _across(places: Sequence[tuple[float, float]], thick: float) -> tuple[Obstacle, ...]:
    """Bars to step over, or walls to climb or to walk around."""
    return tuple(Obstacle(z - 0.5 * thick, z + 0.5 * thick, top, HALF_WIDTH_M) for z, top in places)


def _platforms_with_gaps() -> tuple[Obstacle, ...]:
    """Blocks behind gaps that reach down to the floor."""
    result, z = [], FIRST_PLATFORM_M
    for top, gap in PLATFORMS_M:
        result.append(Obstacle(z, z + PLATFORM_M, top, PLATFORM_HALF_WIDTH_M))
        z = round(z + PLATFORM_M + gap, 2)
    return tuple(result)


HURDLES, GAPS, WALLS = _across(HURDLES_M, BAR_M), _platforms_with_gaps(), _across(WALLS_M, WALL_M)
BEAM = Obstacle(3.0, 15.0, 0.4, 0.1)
BEAM_RAMP_M = 1.2  # at both of its ends


def raise_obstacles(x: Array, z: Array, obstacles: Sequence[Obstacle]) -> Array:
    """Return the heights (metres) of obstacles at grid points x, z, 0 beside them."""
    heights = np.zeros_like(x)
    for obstacle in obstacles:
        heights = np.where(obstacle.raised(x, z), np.maximum(heights, obstacle.top), heights)
    return heights


def raise_beam(x: Array, z: Array) -> Array:
    """Return the heights (metres) of the beam and its ramps at grid points x, z, 0 beside them."""
    ramp = np.clip(np.minimum(z - BEAM.begin, BEAM.end - z) / BEAM_RAMP_M, 0.0, 1.0)
    return np.where(np.abs(x) <= BEAM.half_width + ROUNDING_M, BEAM.top * ramp, 0.0)
