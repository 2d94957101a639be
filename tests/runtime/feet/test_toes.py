"""Toes that bend at push-off stay on the ground and do not flip."""

from itertools import pairwise

import numpy as np
import pytest

from runtime import rotations
from runtime.feet.leg import TOE_LENGTH_M, bent
from runtime.scalar_math import rotate
from runtime.skeleton import TOE_HEIGHT
from runtime.terrain.height_map import PointHeights
from runtime.terrain.library import load_terrain

GROUND = PointHeights(load_terrain("flat"))
NO_TURN = (1.0, 0.0, 0.0, 0.0)


def turned(x: float, y: float = 0.0, z: float = 0.0) -> tuple[float, float, float, float]:
    """Of degrees about X, then about Z, then about Y."""
    parts = [rotations.from_axis_angle(np.eye(3)[a], np.radians(v)) for a, v in ((1, y), (2, z), (0, x))]
    w, i, j, k = rotations.multiply(rotations.multiply(parts[0], parts[1]), parts[2]).tolist()
    return w, i, j, k


def tip_height(foot: tuple[float, ...], toe: tuple[float, ...], joint: float) -> float:
    world = rotations.multiply(np.array(foot), np.array(toe))
    return joint + rotate(tuple(world.tolist()), (0.0, 0.0, TOE_LENGTH_M))[1]


@pytest.mark.parametrize("pitch", [10.0, 40.0, 75.0, 89.0, 90.0, 91.0, 100.0])
def test_the_tip_stays_on_the_ground_however_steep_the_foot(pitch: float) -> None:
    foot, joint = turned(pitch, 30.0, 5.0), (0.2, TOE_HEIGHT + 0.005, 0.1)
    toe = bent(NO_TURN, foot, joint, GROUND, 0.0)
    assert tip_height(foot, toe, joint[1]) == pytest.approx(TOE_HEIGHT, abs=1e-6)


def test_toes_that_point_straight_down_do_not_flip() -> None:
    """A foot that tips through the vertical, wobbling a little to the sides: no frame turns its toes by more than the foot does."""
    rng = np.random.default_rng(0)
    feet = [turned(85.0 + k, 30.0 + rng.normal(0, 1.0), rng.normal(0, 1.0)) for k in range(11)]
    toes = [np.array(bent(NO_TURN, foot, (0.0, TOE_HEIGHT, 0.0), GROUND, 0.0)) for foot in feet]
    turns = [float(rotations.angle_between(a, b)) for a, b in pairwise(toes)]
    assert np.degrees(max(turns)) < 5.0


def test_toes_above_the_ground_are_left_alone() -> None:
    assert bent(NO_TURN, turned(10.0), (0.0, 0.2, 0.0), GROUND, 0.0) == NO_TURN
