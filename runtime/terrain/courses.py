"""Obstacle courses: hurdles, a beam, platforms with gaps, walls. All lie along +Z, before a start at the origin.

Heights and distances are written down once here: for the ground itself, for the controller and for the evaluation.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from runtime.arrays import Array

CELL_M = 0.05  # a riser is one cell wide


@dataclass(frozen=True)
class Obstacle:
    """Raised ground between `begin` and `end` (z, metres), `half_width` to each side of the way."""

    begin: float
    end: float
    top: float
    half_width: float

    def raised(self, x: Array, z: Array) -> NDArray[np.bool_]:
        """Return which of the grid points x, z lie on the obstacle."""
        slack = 1e-6  # of the grid's own rounding
        within = (z >= self.begin - slack) & (z <= self.end + slack)
        return within & (np.abs(x) <= self.half_width + slack)


def _hurdles() -> tuple[Obstacle, ...]:
    """Bars of 20 to 60 cm, 10 cm thick."""
    places = zip((4.0, 7.5, 11.0, 14.5, 18.0), (0.2, 0.3, 0.4, 0.5, 0.6), strict=True)
    return tuple(Obstacle(z - 0.05, z + 0.05, top, 3.0) for z, top in places)


def _platforms_with_gaps() -> tuple[Obstacle, ...]:
    """Blocks of 1.8 m, up to 50 cm high, behind gaps of 0.4 to 0.8 m that reach down to the floor."""
    result, z = [], 3.0
    for top, gap in ((0.2, 0.4), (0.35, 0.5), (0.5, 0.6), (0.5, 0.7), (0.5, 0.8), (0.5, 0.0)):
        result.append(Obstacle(z, z + 1.8, top, 1.5))
        z = round(z + 1.8 + gap, 2)
    return tuple(result)


def _walls() -> tuple[Obstacle, ...]:
    """Walls of 0.6, 1.0 and 1.4 m, a metre thick, to climb or to walk around."""
    return tuple(Obstacle(z - 0.5, z + 0.5, top, 3.0) for z, top in ((5.0, 0.6), (10.0, 1.0), (15.0, 1.4)))


HURDLES, GAPS, WALLS = _hurdles(), _platforms_with_gaps(), _walls()
BEAM = Obstacle(3.0, 15.0, 0.4, 0.1)
BEAM_RAMP_M = 1.2  # at both of its ends


def raise_obstacles(x: Array, z: Array, obstacles: Sequence[Obstacle]) -> Array:
    """Heights of the grid points x, z."""
    heights = np.zeros_like(x)
    for obstacle in obstacles:
        heights = np.where(obstacle.raised(x, z), np.maximum(heights, obstacle.top), heights)
    return heights


def raise_beam(x: Array, z: Array) -> Array:
    """Heights of the grid points x, z of the beam and its ramps."""
    ramp = np.clip(np.minimum(z - BEAM.begin, BEAM.end - z) / BEAM_RAMP_M, 0.0, 1.0)
    return np.where(np.abs(x) <= BEAM.half_width + 1e-6, BEAM.top * ramp, 0.0)
