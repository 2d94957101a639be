"""A body at rest: its time runs so slowly that no limb is faster than one at rest, and it wakes at once."""

import numpy as np
import pytest

from runtime.controls import Controls
from runtime.motion.controller import Controller
from runtime.motion.features import FPS
from runtime.motion.pose_smoothing import REST_M_PER_S, WATCHED, Settling
from runtime.rotations import identity
from runtime.skeleton import SPORT_SKELETON
from runtime.terrain.height_map import Terrain
from tests.helpers.shipped import shipped_model, shipped_prompter

ONE, NONE = [True], [False]
LOCAL = identity((1, len(SPORT_SKELETON))).astype(np.float64)
BODY = SPORT_SKELETON.forward_kinematics(np.zeros((1, 3)), LOCAL)[0]


def speeds(
    settling: Settling, frames: int, free: list[bool], grounded: list[bool], step: float = 0.02
) -> list[float]:
    """m/s of a left hand that the network moves on by `step` metres a frame, as it is shown."""
    result = []
    for _ in range(frames):
        wanted = BODY.copy()
        wanted[:, WATCHED[0], 2] += step
        result.append(float(settling.slow(wanted, BODY, free, free, grounded)[0]) * step * FPS)
    return result


def test_a_hand_comes_to_rest_within_a_second_and_wakes_in_a_tenth() -> None:
    settling = Settling.awake(LOCAL)
    assert speeds(settling, 60, NONE, ONE) == pytest.approx([1.2] * 60)
    going = speeds(settling, 90, ONE, ONE)
    assert going[0] == pytest.approx(1.2)
    assert going[59] < 0.25
    assert going[-1] == pytest.approx(REST_M_PER_S[0], rel=0.01)
    assert np.diff(going).max() < 1e-9
    assert speeds(settling, 9, NONE, ONE)[-1] > 0.8


def test_a_foot_in_the_air_comes_down_first() -> None:
    settling = Settling.awake(LOCAL)
    speeds(settling, 60, NONE, NONE)
    assert speeds(settling, 120, ONE, NONE)[-1] == pytest.approx(0.6 * 1.2, rel=0.05)


def test_what_is_slower_than_the_limit_is_shown_as_it_is() -> None:
    assert speeds(Settling.awake(LOCAL), 120, ONE, ONE, 0.001) == pytest.approx([0.06] * 120)


def test_an_exhausted_body_stands_still_after_a_walk() -> None:
    controller = Controller(shipped_model(), Terrain.flat(), seed=1)
    controller.set_style(shipped_prompter()("an exhausted soldier, left arm hanging"), 0.0)
    for _ in range(60):
        controller.step(Controls((0.0, 1.0)))
    poses = [controller.step(Controls()) for _ in range(190)][130:]
    hands = np.array([p.positions[[20, 27]] - p.positions[:1] for p in poses])
    feet = np.array([p.positions[[4, 9]] for p in poses])
    for points, most in ((hands, 0.15), (feet, 0.06)):
        assert np.linalg.norm(np.diff(points, axis=0), axis=-1).max() * FPS < most
