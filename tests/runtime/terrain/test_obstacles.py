"""Nobody walks up or down a cliff, and the character stays whole before it."""

import numpy as np
import pytest

from runtime.controls import Controls, Gait
from runtime.feet.foot_lock import FootLock
from runtime.motion.controller import Controller
from runtime.rotations import identity
from runtime.skeleton import J
from runtime.terrain.height_map import Terrain
from runtime.terrain.steps import step_ahead, within_steps
from tests.helpers.shipped import shipped_model

NORTH = np.array([0.0, 1.0])


def cliff(height, z=4.0, slope=0.1):
    """Level ground that rises (or falls) by `height` between `z` and `z + slope` metres."""
    axis = np.arange(-200, 201) * 0.1
    heights = height * np.clip((axis - z) / slope, 0.0, 1.0)
    return Terrain("cliff", np.repeat(heights[None], 401, axis=0).astype(np.float32), 0.1, (-20.0, -20.0))


@pytest.mark.parametrize("height", [-8.0, -2.0, 2.0, 20.0])
def test_a_step_ahead_is_seen_with_its_rise(height):
    distance, rise = step_ahead(cliff(height), 0.0, 3.0, NORTH, 2.0)
    assert distance == pytest.approx(1.1, abs=0.11)
    assert np.sign(rise) == np.sign(height)
    assert step_ahead(cliff(height), 0.0, 3.0, NORTH, 0.5)[0] == np.inf  # too far
    assert step_ahead(cliff(height), 0.0, 3.0, -NORTH, 2.0)[0] == np.inf  # behind


def test_what_one_can_climb_is_no_obstacle():
    assert step_ahead(cliff(1.1), 0.0, 3.0, NORTH, 2.0)[0] == np.inf
    assert step_ahead(cliff(8.0, slope=8.0), 0.0, 3.0, NORTH, 9.0)[0] == np.inf  # 45 degrees


def test_heights_of_the_way_end_at_what_one_can_climb():
    heights = np.zeros((12, 3))
    heights[8:] = 8.0
    heights[2, 2] = 0.4
    seen = within_steps(heights[None], 6)[0]
    assert seen.max() == 0.4  # nobody gets behind a cliff: it is level there
    assert seen[2, 2] == 0.4
    slope = np.repeat(np.maximum(np.arange(12.0) - 6.0, 0.0)[:, None], 3, axis=1)  # 1 m a sample
    assert within_steps(slope[None], 6)[0].tolist() == np.minimum(slope, 1.5).tolist()


@pytest.mark.parametrize(("height", "gait"), [(-8.0, Gait.WALK), (6.0, Gait.JOG)])
def test_a_cliff_stops_the_walker_who_says_so_and_goes_back(height, gait):
    controller = Controller(shipped_model(), cliff(height, z=2.5))
    hips, said = [], set()
    for frame in range(290):
        pose = controller.step(Controls((0.0, 1.0 if frame < 200 else -1.0), gait=gait))
        hips.append(pose.positions[0])
        if frame == 199:
            said.add(controller.blocked.split(" of ")[0].split()[-1])
            assert 1.5 < pose.root_position[2] < 2.5
    assert said == {"up" if height > 0 else "drop"}
    assert controller.blocked is None
    assert pose.root_position[2] < 1.5
    hips = np.array(hips)
    assert np.abs(np.diff(hips, axis=0)).max() < 0.08
    assert hips[:, 1].min() > 0.5
    assert hips[:, 1].max() < 1.3


@pytest.mark.parametrize("height", [8.0, 1e4, -1e4])
def test_a_foot_lock_over_any_step_stays_finite(height):
    lock, ground = FootLock(), cliff(height, z=0.0)
    local, contacts = identity((J,)), np.ones(4)
    for frame in range(60):
        hips = np.array([0.0, 0.98, -0.5 + frame / 60])
        result = lock.apply(hips, local, contacts, ground, 1 / 60)
        assert np.isfinite(result.local_rotations).all()
        assert abs(result.hips_position[1] - 0.98) < 0.4
