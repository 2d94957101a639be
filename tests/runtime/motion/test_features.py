"""Layout sizes are the paper's; root-relative features do not change when the world is turned and moved."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from runtime import rotations
from runtime.motion import features
from runtime.skeleton import SPORT_SKELETON
from runtime.terrain.height_map import Terrain


@given(st.floats(-3.0, 3.0))
def test_turning_the_rest_pose_turns_the_facing(yaw):
    turned = rotations.rotate(rotations.from_yaw(yaw), SPORT_SKELETON.rest_positions)
    assert np.isclose(features.facing_yaw(turned), yaw, atol=1e-5)
    back = features.to_root(turned, np.full(31, yaw))
    assert np.allclose(back, SPORT_SKELETON.rest_positions, atol=1e-5)


def _parts(seed: int) -> features.InputParts:
    rng = np.random.default_rng(seed)
    yaw = rng.uniform(-3, 3)
    angle = rng.uniform(-3, 3, 12)
    return features.InputParts(
        root_position=rng.normal(size=2),
        root_yaw=np.array(yaw),
        trajectory_positions=rng.normal(size=(12, 2)),
        trajectory_directions=np.stack([np.sin(angle), np.cos(angle)], -1),
        heights=rng.normal(size=(12, 3)),
        gait=rng.random((12, 6)),
        phase=rng.normal(size=(13, 5, 2)),
        joint_positions=rng.normal(size=(31, 3)),
        joint_velocities=rng.normal(size=(31, 3)),
    )


@given(st.integers(0, 1000), st.floats(-3.0, 3.0), st.floats(-5.0, 5.0))
def test_input_is_invariant_to_turning_and_moving_the_world(seed, turn, shift):
    parts = _parts(seed)
    x = features.build_input(parts)
    assert x.shape == (472,)
    moved = dataclasses.replace(
        parts, root_yaw=parts.root_yaw + turn, heights=parts.heights + shift,
        root_position=features.to_world(parts.root_position, turn) + shift,
        trajectory_positions=features.to_world(parts.trajectory_positions, turn) + shift,
        trajectory_directions=features.to_world(parts.trajectory_directions, turn),
    )  # fmt: skip
    assert np.allclose(features.build_input(moved), x, atol=1e-3)


def test_output_round_trip():
    y = np.random.default_rng(0).normal(size=(4, 473)).astype(np.float32)
    assert np.array_equal(features.build_output(features.split_output(y)), y)


def test_height_points_lie_right_centre_left():
    points = features.height_points(np.zeros((12, 2)), np.tile([0.0, 1.0], (12, 1)))
    assert np.allclose(points[0, :, 0], [-0.25, 0.0, 0.25])  # facing +Z, left is +X


def _over_bar(place: float, spacing: float) -> np.ndarray:
    """Centre heights that samples `spacing` apart see of a bar of 30 cm that is 10 cm thick."""
    row = np.where(np.abs(np.arange(-4.0, 4.01, 0.05) - place) < 0.051, 0.3, 0.0)
    terrain = Terrain("bar", np.repeat(row[None], 61, axis=0).astype(np.float32), 0.05, (-1.5, -4.0))
    positions = np.stack([np.zeros(12), spacing * (np.arange(12) - 6)], -1)
    points, heights = features.sampled_heights(terrain, positions, np.tile([0.0, 1.0], (12, 1)))
    assert points.shape == (12, 3, 2)
    assert np.array_equal(heights[:, 0], heights[:, 2])
    return heights[:, 1]


@given(st.integers(-28, 28), st.floats(0.15, 0.42))
def test_a_bar_between_two_samples_is_told_by_the_nearer(cell, spacing):
    place = 0.05 * cell  # on the grid, so that it is 10 cm thick
    seen = _over_bar(place, spacing)
    told = np.flatnonzero(seen > 0.0)
    if abs(place) > 5 * spacing:  # it may lie outside of the window
        return
    assert seen.max() == pytest.approx(0.3, abs=features.MIN_NARROW_RISE_M)
    assert np.abs(spacing * (told - 6) - place).max() <= 0.5 * spacing + 0.1


def test_steps_and_slopes_are_seen_where_the_samples_lie():
    """Nothing there stands higher than the samples on both sides of it."""
    z = np.arange(-4.0, 4.01, 0.05)
    positions = np.stack([np.zeros(12), 0.31 * (np.arange(12) - 6)], -1)
    ahead = np.tile([0.0, 1.0], (12, 1))
    for row in (0.3 * z, np.where(z > 0.4, 0.4, 0.0), -0.5 * (z > 0.1), 0.02 * np.sin(30.0 * z)):
        terrain = Terrain("ground", np.repeat(row[None], 61, axis=0).astype(np.float32), 0.05, (-1.5, -4.0))
        points, heights = features.sampled_heights(terrain, positions, ahead)
        assert np.array_equal(heights, terrain.height(points[..., 0], points[..., 1]))


def test_stairs_are_seen_as_a_gentle_slope_through_the_ground_of_the_body():
    row = 0.16 * np.floor(np.arange(-4.0, 4.01, 0.04) / 0.32 + 1e-6)
    stairs = Terrain("stairs", np.repeat(row[None], 61, axis=0).astype(np.float32), 0.04, (-1.2, -4.0))
    positions = np.stack([np.zeros(12), 0.2 * (np.arange(12) - 6)], -1)
    seen = features.softened(features.mean_heights(stairs, positions))
    slopes = np.diff(seen) / 0.2
    assert slopes.min() >= 0.0
    assert slopes.max() < 2.0 * features.SEEN_RISE_FRACTION * 0.5
    assert seen[6] == pytest.approx(-0.08, abs=0.05)  # half a step under the tread that begins there
    assert np.array_equal(features.softened(np.full(12, 0.3)), np.full(12, 0.3))
