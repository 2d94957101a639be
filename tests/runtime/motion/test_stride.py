"""The share of the root's speed that planted feet carry."""

import numpy as np
import pytest

from runtime.motion.features import FPS
from runtime.motion.stride import POINTS, RANGE, StrideState

SPEED = 1.2
PLANTED = np.array([[1.0, 1.0, 0.0, 0.0]])
STANDING = np.zeros((1, 31, 3))


def walk(stride: StrideState, carried: float, seconds: float = 3.0, contacts: np.ndarray = PLANTED) -> float:
    """The share after a left foot went back at `carried` of the root's speed, and the right one ahead."""
    joints = STANDING
    for _ in range(round(seconds * FPS)):
        joints = joints.copy()
        joints[:, POINTS[:2], 2] -= carried * SPEED / FPS
        joints[:, POINTS[2:], 2] += SPEED / FPS
        stride.update(joints, contacts, np.array([SPEED]))
    return float(stride.share[0])


@pytest.mark.parametrize("carried", [0.6, 0.8, 1.0, 1.2])
def test_a_planted_foot_tells_the_speed_of_the_steps(carried):
    assert walk(StrideState.at_rest(STANDING), carried) == pytest.approx(carried, abs=0.01)


def test_it_says_nothing_in_flight_at_rest_and_beyond_its_range():
    assert walk(StrideState.at_rest(STANDING), 0.6, contacts=np.zeros((1, 4))) == 1.0
    assert walk(StrideState.at_rest(STANDING), 0.0) == pytest.approx(RANGE[0], abs=0.01)
    stride = StrideState.at_rest(STANDING)
    walk(stride, 0.6)
    for _ in range(3 * FPS):
        stride.update(STANDING, PLANTED, np.zeros(1))
    assert stride.share[0] == pytest.approx(1.0, abs=0.01)
