"""Climbing up a wall and jumping down: begins and ends in the given pose, hands hold the edge, nothing is in the wall."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sport.runtime import rotations
from sport.runtime.crossing.climb import Climb, Descend
from sport.runtime.crossing.keyed_pose import Curve, leaned, reaching
from sport.runtime.feet.skating import SOLE_HEIGHTS, SOLE_POINTS
from sport.runtime.motion.features import FPS
from sport.runtime.skeleton import SPORT_SKELETON
from sport.runtime.terrain.courses import Obstacle, raise_obstacles
from sport.runtime.terrain.height_map import Terrain
from sport.training.evaluation.metrics import crossing
from sport.training.evaluation.metrics.obstacle_depth import depth_inside, limb_depths


def standing() -> np.ndarray:
    """Local rotations of somebody who stands with hanging arms and slightly bent knees."""
    local = rotations.identity((31,))
    for name, sign in (("LeftArm", -1.0), ("RightArm", 1.0)):
        turn = rotations.from_axis_angle(np.array([0.0, 0.0, 1.0]), np.array(sign * 1.35))
        local[SPORT_SKELETON.index(name)] = turn
    for side in ("Left", "Right"):
        for bone, angle in (("UpLeg", -0.1), ("Leg", 0.15), ("Foot", -0.05)):
            turn = rotations.from_axis_angle(np.array([1.0, 0.0, 0.0]), np.array(angle))
            local[SPORT_SKELETON.index(side + bone)] = turn
    return local


LOCAL = standing()
SOLES = SPORT_SKELETON.forward_kinematics(np.zeros(3), LOCAL)[0][list(SOLE_POINTS), 1] - np.array(
    SOLE_HEIGHTS
)
HIPS = np.array([0.0, -float(SOLES.min()), 0.0])  # the soles on the ground


def positions(hips: np.ndarray, local: np.ndarray) -> np.ndarray:
    return SPORT_SKELETON.forward_kinematics(hips, local)[0].astype(np.float64)


def shown(motion: Climb | Descend) -> np.ndarray:
    """Positions `(T, 31, 3)` from the first to the last moment."""
    result = []
    for frame in range(round(motion.seconds * FPS) + 1):
        t = min(frame / FPS, motion.seconds)
        pose = motion.pose(t, HIPS + np.array([0.0, 0.0, motion.root_z(t)]), LOCAL)
        result.append(positions(pose.hips, pose.local))
    return np.array(result)


def ground(rise: float) -> tuple[Terrain, Obstacle]:
    wall = Obstacle(0.0, 1.0, rise, 3.0) if rise > 0.0 else Obstacle(-1.5, 0.0, -rise, 3.0)
    x, z = np.meshgrid(np.arange(-2.0, 2.01, 0.05), np.arange(-2.0, 2.01, 0.05), indexing="ij")
    heights = raise_obstacles(x, z, [wall]) + min(rise, 0.0)
    return Terrain("test", heights.astype(np.float32), 0.05, (-2.0, -2.0)), wall


@given(
    rise=st.one_of(st.floats(0.55, 1.5), st.floats(-1.5, -0.55)),
    start=st.floats(-0.55, -0.3),
    tempo=st.floats(0.7, 1.2),
)
@settings(max_examples=25, deadline=None)
def test_it_begins_and_ends_in_the_given_pose_and_nothing_jumps(
    rise: float, start: float, tempo: float
) -> None:
    motion = (Climb if rise > 0.0 else Descend)(rise, start, 1.0, tempo)
    path = shown(motion)
    first = positions(HIPS + np.array([0.0, 0.0, start]), LOCAL)
    last = positions(HIPS + np.array([0.0, rise, motion.end_z]), LOCAL)
    assert np.abs(path[0] - first).max() < 0.01
    assert np.abs(path[-1] - last).max() < 0.01
    assert np.linalg.norm(np.diff(path, axis=0), axis=-1).max() * FPS < 12.0  # m/s


@pytest.mark.parametrize("rise", [0.6, 0.8, 1.0, 1.2, 1.4])
def test_a_climb_holds_the_edge_and_stays_out_of_the_wall(rise: float) -> None:
    path = shown(Climb(rise, -0.42, 1.0))
    terrain, wall = ground(rise)
    assert crossing.hands_on_edge(path, [wall])[0] >= 0.3
    assert (depth_inside(path, terrain) > 0.03).mean(0).max() <= 0.01
    for depth in limb_depths(path, terrain).values():
        assert (depth > 0.05).mean() <= 0.02


@pytest.mark.parametrize("rise", [-0.6, -1.0, -1.4])
def test_a_jump_down_clears_the_edge_and_lands_on_bent_knees(rise: float) -> None:
    motion = Descend(rise, -0.42, 1.0)
    path = shown(motion)
    terrain, _ = ground(rise)
    assert (depth_inside(path, terrain) > 0.03).mean(0).max() <= 0.01
    lowest = int(path[:, 0, 1].argmin())
    assert path[lowest, 0, 1] < rise + HIPS[1] - 0.25
    assert lowest < len(path) - 10
    fall = np.diff(path[:, 0, 1]) * FPS
    assert fall.min() > -1.3 * np.sqrt(2.0 * 9.81 * (0.1 - rise))  # not faster than things fall


def test_a_narrow_top_is_stood_on_in_its_middle() -> None:
    assert Climb(1.0, -0.4, 0.4).end_z == pytest.approx(0.2)
    assert Climb(1.0, -0.4, 10.0).end_z < 0.4


def test_a_style_is_kept_beneath_the_keys() -> None:
    """What the spine does in the given pose, it does in the climb."""
    spine = SPORT_SKELETON.index("Spine1")
    bowed = LOCAL.copy()
    bowed[spine] = rotations.from_axis_angle(np.array([0.0, 0.0, 1.0]), np.array(0.4))
    motion = Climb(1.0, -0.4, 1.0)
    for t in (0.3, 1.0, 1.8):
        hips = HIPS + np.array([0.0, 0.0, motion.root_z(t)])
        plain, other = (motion.pose(t, hips, local).local[spine] for local in (LOCAL, bowed))
        assert rotations.angle_between(plain, other) == pytest.approx(0.4, abs=1e-3)


@given(st.lists(st.floats(-5.0, 5.0), min_size=2, max_size=8))
@settings(max_examples=50, deadline=None)
def test_a_curve_goes_through_its_keys_and_not_beyond(values: list[float]) -> None:
    curve = Curve([(float(k), value) for k, value in enumerate(values)])
    for k, value in enumerate(values):
        assert curve.at(float(k))[0] == pytest.approx(value, abs=1e-9)
    for k in range(len(values) - 1):
        low, high = sorted(values[k : k + 2])
        for t in np.linspace(k, k + 1, 7):
            assert low - 1e-9 <= curve.at(float(t))[0] <= high + 1e-9


def test_hands_reach_what_is_near_enough() -> None:
    body = leaned(LOCAL, 0.5)
    wrists = np.array([[0.2, 1.1, 0.4], [-0.2, 1.1, 0.4]])
    poles = np.array([[0.6, -0.3, -0.8], [-0.6, -0.3, -0.8]])
    hands = rotations.identity((2,))
    reached = reaching(HIPS, body, wrists, hands, 1.0, poles)
    made = SPORT_SKELETON.forward_kinematics(HIPS, reached)
    joints = [SPORT_SKELETON.index("LeftHand"), SPORT_SKELETON.index("RightHand")]
    assert np.abs(made[0][joints] - wrists).max() < 0.01
    assert rotations.angle_between(made[1][joints].astype(float), hands) == pytest.approx(
        [0.0, 0.0], abs=1e-3
    )
    assert reaching(HIPS, body, wrists, hands, 0.0, poles) is body
