"""Room for a body: nobody is led into a spike or wall, from no side, nor stands in ground that came in place of another."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchmarks.random_play import play, spikes
from runtime import rotations
from runtime.motion.controller import Controller
from runtime.motion.limbs import resolve_penetration
from runtime.motion.state import standing
from runtime.skeleton import SPORT_SKELETON
from runtime.terrain.height_map import Terrain
from runtime.terrain.room import (
    HAND_REACH_M,
    blocked_by_walls,
    can_climb,
    can_land,
    can_stand,
    drift_from_walls,
    has_walls,
    nearest_place,
)
from tests.helpers.walker import WalkerModel

RISE = np.where(np.arange(201) < 100, 0.0, 3.0).astype(np.float32)  # a cliff at x = 0
CLIFF = Terrain("cliff", RISE[:, None].repeat(201, 1), 0.1, (-10.0, -10.0))
angles = st.floats(-np.pi, np.pi)


@given(angle=angles, away=st.floats(0.12, 2.0), z=st.floats(-5, 5))
def test_a_root_leaves_a_cliff_and_never_goes_into_it(angle: float, away: float, z: float) -> None:
    velocity = np.array([np.cos(angle), np.sin(angle)])
    kept = blocked_by_walls(CLIFF, np.array([-away, z]), velocity)
    assert (kept == velocity).all() or (kept == 0.0).all()
    if velocity[0] < -0.87 or away > HAND_REACH_M + 0.1:
        assert (kept == velocity).all()
    if velocity[0] > 0.5 and away < 0.4:
        assert (kept == 0.0).all()


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
    assert not can_land(slope, np.zeros(2), ahead, 0.5, 0.3, 0.0, 0.0)
    assert can_land(CLIFF, np.array([-1.0, 0.0]), ahead, 1.0, 3.0, 0.0, 0.0)


def test_no_gap_is_leapt_beside_what_stands_in_it() -> None:
    heights = np.zeros((41, 41), np.float32)
    heights[22, 20] = 4.0  # 0.4 m beside the way and 1 m ahead
    terrain = Terrain("spike", heights, 0.2, (-4.0, -4.0))
    place, ahead = np.array([0.0, -1.0]), np.array([0.0, 1.0])
    assert can_land(terrain, place, ahead, 1.4, 0.0, 0.0, 0.3)
    assert not can_land(terrain, place, ahead, 1.4, 0.0, 0.6, 0.3)
    assert can_land(terrain, place, ahead, 1.4, 0.0, 0.1, 0.3)


def test_a_root_in_a_wall_drifts_out_of_it_and_up_no_step() -> None:
    for away in (0.05, 0.2, 0.3):
        assert drift_from_walls(CLIFF, np.array([-away, 0.0]), np.array([0.3, 1.0]))[0] < -0.3
    assert (drift_from_walls(CLIFF, np.array([-0.8, 0.0]), np.array([0.0, 1.0])) == [0.0, 1.0]).all()


def test_a_wall_is_climbed_only_where_a_body_has_room() -> None:
    heights = np.zeros((81, 81), np.float32)
    heights[:, 40:60] = 1.0  # a wall from z = 0 on
    heights[60:, :] = 3.0  # and a higher one beside it, from x = 2 on
    terrain = Terrain("corner", heights, 0.1, (-4.0, -4.0))
    ahead = np.array([0.0, 1.0])
    assert can_climb(terrain, np.array([0.0, -0.5]), ahead, 0.45, 1.0)
    assert not can_climb(terrain, np.array([1.7, -0.5]), ahead, 0.45, 1.0)
    assert not can_climb(terrain, np.array([0.0, -0.5]), ahead, 0.45, 1.5)


def test_an_arm_in_a_wall_hangs_and_one_beside_level_ground_stays() -> None:
    state = standing(WalkerModel(), CLIFF, None, 0, -0.45, 0.0, 0.0)  # type: ignore[arg-type]
    hips, before = state.poses.hips[0], state.poses.local[0]
    stretched = before.copy()
    stretched[[18, 25]] = (1.0, 0.0, 0.0, 0.0)  # arms to both sides
    for _ in range(4):
        before = resolve_penetration(hips, stretched, before, CLIFF)
    places = SPORT_SKELETON.forward_kinematics(hips, before)[0]
    depth = CLIFF.height(places[:, 0], places[:, 2]) - places[:, 1]
    assert depth.max() < 0.2
    assert (resolve_penetration(hips, stretched, stretched, Terrain.flat()) == stretched).all()


def test_an_arm_that_can_only_hang_in_a_low_wall_is_folded_above_it() -> None:
    low = Terrain("low wall", RISE[:, None].repeat(201, 1) * 0.38, 0.1, (-10.0, -10.0))
    state = standing(WalkerModel(), Terrain.flat(), None, 0, 0.0, 0.0, 0.0)  # type: ignore[arg-type]
    hips, local = state.poses.hips[0], state.poses.local[0].copy()
    local[18] = rotations.from_axis_angle(np.eye(3)[2], np.asarray(-1.5))
    before = local
    for _ in range(12):
        before = resolve_penetration(hips, local, before, low)
    places = SPORT_SKELETON.forward_kinematics(hips, before)[0][18:24]
    assert (low.height(places[:, 0], places[:, 2]) - places[:, 1]).max() < 0.2


def test_an_arm_that_leaves_a_wall_comes_back_without_a_jerk() -> None:
    state = standing(WalkerModel(), CLIFF, None, 0, -0.45, 0.0, 0.0)  # type: ignore[arg-type]
    hips, before = state.poses.hips[0].copy(), state.poses.local[0]
    stretched = before.copy()
    stretched[[18, 25]] = (1.0, 0.0, 0.0, 0.0)  # arms to both sides
    turns = []
    for frame in range(120):
        hips[0] = -0.45 - 0.6 * max(frame - 20, 0) / 100
        shown = resolve_penetration(hips, stretched, before, CLIFF)
        turns.append(rotations.angle_between(before[[18, 25]], shown[[18, 25]]).max())
        before = shown
    assert max(turns[20:]) < 0.16
    assert rotations.angle_between(before[[18, 25]], stretched[[18, 25]]).max() < 0.01


@pytest.mark.parametrize("seed", [28, 51])
def test_legs_of_any_pose_are_never_in_a_wall_whose_end_is_passed(seed: int) -> None:
    rng, heights = np.random.default_rng(seed), np.zeros((81, 81), np.float32)
    heights[:43, 43:46] = rng.uniform(0.4, 1.2)
    wall = Terrain("wall", heights, 0.1, (-4.0, -4.0))
    state = standing(WalkerModel(), Terrain.flat(), None, 0, 0.0, 0.0, 0.0)  # type: ignore[arg-type]
    rest, deepest = state.poses.local[0], []
    poses = np.tile(rest, (4, 1, 1))
    for pose in poses:
        for hip in (2, 7):
            turn = rng.normal(size=3)
            turn *= rng.uniform(0.0, 1.6) / np.linalg.norm(turn)
            pose[hip] = rotations.multiply(rotations.from_rotation_vector(turn), rest[hip])
            pose[hip + 1] = rotations.from_rotation_vector(np.array([rng.uniform(0.0, 2.0), 0.0, 0.0]))
    before, z, speed = rest, rng.uniform(-0.1, 0.22), rng.uniform(0.005, 0.03)
    for frame in range(60):
        hips = np.array([0.6 - speed * frame, state.poses.hips[0, 1] + 0.05 * np.sin(frame / 5), z])
        wanted = rotations.slerp(poses[frame // 20], poses[frame // 20 + 1], frame % 20 / 20)
        before = resolve_penetration(hips, wanted, before, wall)
        legs = SPORT_SKELETON.forward_kinematics(hips, before)[0][[3, 4, 5, 8, 9, 10]]
        deepest.append((wall.height(legs[:, 0], legs[:, 2]) - legs[:, 1]).max())
    assert max(deepest) < 0.3


def test_a_character_stands_beside_a_spike_that_rises_under_it() -> None:
    controller = Controller(WalkerModel(), Terrain.flat())
    heights = np.zeros((41, 41), np.float32)
    heights[20, 20] = 4.0
    controller.set_terrain(Terrain("spike", heights, 0.2, (-4.0, -4.0)))
    x, y, z = controller.pose.root_position.tolist()
    assert 0.2 < np.hypot(x, z) < 1.5
    assert abs(y) < 0.3


def test_a_while_among_spikes_is_never_under_the_ground() -> None:
    count = play(Controller(WalkerModel(), Terrain.flat()), 0.05, seed=3, grounds=(spikes,))
    assert count.failures == 0, count.first[:3]
