"""Room for a body: nobody is led into a spike or wall, from no side, nor stands in ground that came in place of another."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from steep import spikes, walk
from walker import WalkerModel

from runtime.motion.controller import Controller
from runtime.terrain.height_map import Terrain
from runtime.terrain.room import HAND_M, can_land, can_stand, has_walls, kept_off, nearest_place

RISE = np.where(np.arange(201) < 100, 0.0, 3.0).astype(np.float32)  # a cliff at x = 0
CLIFF = Terrain("cliff", RISE[:, None].repeat(201, 1), 0.1, (-10.0, -10.0))
angles = st.floats(-np.pi, np.pi)


@settings(max_examples=40, deadline=None)
@given(angle=angles, away=st.floats(0.12, 2.0), z=st.floats(-5, 5))
def test_a_root_leaves_a_cliff_and_never_goes_into_it(angle: float, away: float, z: float) -> None:
    velocity = np.array([np.cos(angle), np.sin(angle)])
    kept = kept_off(CLIFF, np.array([-away, z]), velocity)
    assert (kept == velocity).all() or (kept == 0.0).all()
    if velocity[0] < -0.87 or away > HAND_M + 0.1:
        assert (kept == velocity).all()
    if velocity[0] > 0.5 and away < 0.4:
        assert (kept == 0.0).all()


@settings(max_examples=30, deadline=None)
@given(x=st.floats(-3, 3), z=st.floats(-3, 3))
def test_the_nearest_place_has_room(x: float, z: float) -> None:
    place = nearest_place(CLIFF, x, z)
    assert can_stand(CLIFF, np.array(place))
    assert np.hypot(place[0] - x, place[1] - z) < 1.0


def test_level_ground_has_no_walls_and_slopes_no_landing() -> None:
    assert not has_walls(Terrain.flat())
    assert nearest_place(Terrain.flat(), 1.0, 2.0) == (1.0, 2.0)
    slope = Terrain("slope", np.arange(201, dtype=np.float32)[:, None].repeat(2, 1) * 0.2, 0.1, (-10, -10))
    ahead = np.array([1.0, 0.0])
    assert not can_land(slope, np.zeros(2), ahead, 0.5, 0.3)
    assert can_land(CLIFF, np.array([-1.0, 0.0]), ahead, 1.0, 3.0)


def test_no_gap_is_leapt_beside_what_stands_in_it() -> None:
    heights = np.zeros((41, 41), np.float32)
    heights[22, 20] = 4.0  # 0.4 m beside the way and 1 m ahead
    terrain = Terrain("spike", heights, 0.2, (-4.0, -4.0))
    place, ahead = np.array([0.0, -1.0]), np.array([0.0, 1.0])
    assert can_land(terrain, place, ahead, 1.4, 0.0)
    assert not can_land(terrain, place, ahead, 1.4, 0.0, gap_m=0.6)
    assert can_land(terrain, place, ahead, 1.4, 0.0, gap_m=0.1)


def test_a_character_stands_beside_a_spike_that_rises_under_it() -> None:
    controller = Controller(WalkerModel(), Terrain.flat())
    heights = np.zeros((41, 41), np.float32)
    heights[20, 20] = 4.0
    spike = Terrain("spike", heights, 0.2, (-4.0, -4.0))
    controller.set_terrain(spike)
    x, y, z = controller.pose.root_position.tolist()
    assert 0.2 < np.hypot(x, z) < 1.5
    assert abs(y) < 0.3


def test_a_while_among_spikes_is_never_under_the_ground() -> None:
    count = walk(Controller(WalkerModel(), Terrain.flat()), 0.05, seed=3, grounds=(spikes,))
    assert count.failures == 0, count.first[:3]
