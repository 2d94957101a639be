"""Starts, stops and turns take the time that a body takes."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from runtime.controls import Gait
from runtime.motion import trajectory

SPEEDS = st.floats(-3.0, 3.0)


@given(SPEEDS, SPEEDS, SPEEDS, SPEEDS, st.floats(0.4, 2.2), st.floats(0.0, 1.0))
def test_a_velocity_comes_nearer_to_the_wish_and_no_faster_than_a_body(
    x: float, z: float, to_x: float, to_z: float, walk: float, response: float
) -> None:
    now, wish, reach = np.array([[x, z]]), np.array([[to_x, to_z]]), np.array([walk])
    seconds = np.array([trajectory.change_seconds(walk, response)])
    path = trajectory.planned_velocities(now, wish, reach, seconds)
    assert path[:, 0] == pytest.approx(now)
    missing = np.linalg.norm(path - wish[:, None], axis=-1)
    assert (np.diff(missing) <= 1e-9).all()
    fastest = max(walk, float(missing[0, 0])) / seconds[0]
    assert np.abs(np.diff(path, axis=1)).max() * 60 <= fastest + 1e-6


@given(st.floats(-10.0, 10.0), st.floats(-10.0, 10.0))
def test_a_body_turns_the_shorter_way(now: float, wish: float) -> None:
    yaws = trajectory.facings(np.array([now]), np.array([wish]), np.array([trajectory.TO_TURN_S[0]]))[0]
    assert yaws[0] == pytest.approx(now)
    assert abs(yaws[-1] - now) <= np.pi + 1e-9


def test_labels_follow_the_planned_speed() -> None:
    speeds = np.linspace(0.0, 3.0, 61)[None]
    now = np.eye(trajectory.GAITS)[[Gait.STAND]]
    weights = trajectory.labels(speeds, now, [Gait.JOG], [1.8], [0.0])
    assert weights.sum(-1) == pytest.approx(1.0)
    assert np.argmax(weights[0, [0, 20, 60]], -1).tolist() == [Gait.STAND, Gait.WALK, Gait.JOG]
    slow, game = (trajectory.labels(speeds, now, [Gait.CROUCH], [1.8], [response]) for response in (0.0, 1.0))
    assert game[0, -1, Gait.CROUCH] == pytest.approx(1.0, abs=1e-3)
    assert slow[0, 1, Gait.CROUCH] < 0.1  # nobody snaps into it
    assert 0.8 < slow[0, -1, Gait.CROUCH] < 1.0


def test_labels_of_a_jump_without_a_stick_are_finite() -> None:
    now = np.eye(trajectory.GAITS)[[Gait.STAND]]
    weights = trajectory.labels(np.zeros((1, 61)), now, [Gait.JOG], [0.0], [0.0])
    assert weights.sum(-1) == pytest.approx(1.0)
