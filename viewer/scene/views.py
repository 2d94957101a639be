"""Views of the character by name, and where a character looks at the start of a ground."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from runtime.terrain.height_map import Terrain

OPENING_TURN = -0.62  # radians from the walker's back, on the side that the sun lights
NEAR_M, FAR_M, STEP_M = 1.0, 15.0, 0.25  # where obstacles are looked for
DIRECTIONS = 16
CLIMB_M = 0.15  # up and down along the way; less is level


@dataclass(frozen=True)
class StageView:
    """A place to look from: `turn` radians from the facing, and what is looked at, `height` metres over the ground (0: the body)."""

    turn: float
    pitch: float
    distance: float
    height: float = 0.0


VIEWS = {
    "front": StageView(math.pi, 0.10, 4.0),
    "side": StageView(-0.5 * math.pi, 0.10, 4.0),
    "three_quarters": StageView(math.pi - 0.65, 0.20, 4.0),
    "feet": StageView(-0.5 * math.pi - 0.55, 0.16, 1.7, 0.20),
    "top": StageView(0.0, math.radians(88.0), 5.0),
}


def start_yaw(terrain: Terrain) -> float:
    """Where a character at the origin looks, in radians: along +Z, or where the first obstacles are if none are there."""
    yaws = math.tau * np.arange(DIRECTIONS) / DIRECTIONS
    along = np.arange(NEAR_M, FAR_M, STEP_M)
    heights = terrain.height(np.outer(np.sin(yaws), along), np.outer(np.cos(yaws), along))
    climbs = np.abs(np.diff(heights, axis=1)).sum(axis=1)
    best = int(np.argmax(climbs))
    ahead = climbs[0] >= CLIMB_M or climbs[best] < CLIMB_M
    return 0.0 if ahead else math.remainder(float(yaws[best]), math.tau)
