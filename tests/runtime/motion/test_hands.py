"""Hands in a stop: no faster than in the steady movement before it, and free afterwards."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from runtime import rotations
from runtime.arrays import Array
from runtime.motion.features import DT, FPS
from runtime.motion.hands import HANDS, MIN_LIMIT_M_PER_S, STOP_RATIO, STOP_S, HandSpeed, share_within
from runtime.skeleton import SPORT_SKELETON, J

HIPS = np.array([0.0, 0.95, 0.0])
SHOULDERS = [SPORT_SKELETON.index("LeftArm"), SPORT_SKELETON.index("RightArm")]
USUAL_M_PER_S = 0.6
LATE_S = 0.5  # of the throw, after the release of the stick


def raised(radians: float) -> Array:
    """Local rotations `(31, 4)` with both arms raised from the sides."""
    local = rotations.identity((J,)).astype(np.float64)
    for joint, side in zip(SHOULDERS, (1.0, -1.0), strict=True):
        local[joint] = rotations.from_rotation_vector(np.array([0.0, 0.0, side * radians]))
    return local


class Body:
    """A body whose arms follow `HandSpeed`."""

    def __init__(self) -> None:
        self.hands, self.last = HandSpeed(), raised(0.0)
        self.at = self._at()

    def _at(self) -> Array:
        return SPORT_SKELETON.forward_kinematics(HIPS, self.last)[0]

    def show(self, radians: float, stops: bool) -> float:
        """Show a frame with arms raised by so much, and return the speed of the faster hand, m/s."""
        local = raised(radians)[None]
        self.hands.apply(HIPS[None], local, self.at[None], self.last[None], [stops])
        before, self.last = self.at, local[0]
        self.at = self._at()
        return float(np.linalg.norm(self.at[HANDS] - before[HANDS], axis=-1).max()) / DT

    def swing(self, seconds: float) -> float:
        """Swing the arms steadily, and return how far they are raised at the end, radians."""
        reach = float(np.linalg.norm(self.at[HANDS[0]] - self.at[SHOULDERS[0]]))
        angle = 0.0
        for frame in range(round(seconds * FPS)):
            way = 1.0 if frame // 20 % 2 == 0 else -1.0
            angle += way * USUAL_M_PER_S * DT / reach
            self.show(angle, stops=False)
        return angle


def test_a_throw_in_a_stop_is_slowed_to_the_usual_speed_and_arrives() -> None:
    body = Body()
    angle = body.swing(4.0)
    speeds = [body.show(angle + 0.8 * (second > LATE_S), stops=True) for second in np.arange(0.0, 2.4, DT)]
    assert max(speeds) == pytest.approx(STOP_RATIO * USUAL_M_PER_S, rel=0.1)
    assert speeds[-1] == pytest.approx(0.0, abs=1e-6)
    goal = SPORT_SKELETON.forward_kinematics(HIPS, raised(angle + 0.8))[0]
    assert body.at == pytest.approx(goal, abs=1e-6)


def test_a_walking_body_and_one_at_rest_move_their_hands_freely() -> None:
    body = Body()
    angle = body.swing(2.0)
    assert body.show(angle + 0.5, stops=False) > 10.0 * USUAL_M_PER_S
    for _ in range(round((STOP_S + 3.0) * FPS)):
        body.show(angle, stops=True)
    assert body.show(angle + 0.5, stops=True) > 10.0 * USUAL_M_PER_S


def test_a_body_that_walks_on_lets_its_hands_catch_up_without_a_jump() -> None:
    body = Body()
    angle = body.swing(4.0)
    for _ in range(6):
        body.show(angle + 1.0, stops=True)
    speeds = [body.show(angle + 1.0, stops=False) for _ in range(FPS)]
    assert np.diff(speeds).max() < 0.3  # m/s a frame
    assert speeds[-1] == pytest.approx(0.0, abs=1e-6)


def test_hands_that_hardly_moved_may_still_come_to_rest() -> None:
    body = Body()
    for _ in range(FPS):
        body.show(0.0, stops=False)
    speeds = [body.show(0.2, stops=True) for _ in range(2 * FPS)]
    assert max(speeds) == pytest.approx(MIN_LIMIT_M_PER_S, rel=0.1)


@given(st.lists(st.floats(-0.1, 0.1), min_size=6, max_size=6), st.floats(0.001, 0.05))
def test_the_share_is_the_largest_within_the_limit_or_the_nearest(numbers: list[float], most: float) -> None:
    start, way = np.array(numbers[:3]), np.array(numbers[3:])
    share = share_within(start, way, most)
    assert 0.0 <= share <= 1.0
    ends = np.linalg.norm(start + np.linspace(0.0, 1.0, 201)[:, None] * way, axis=-1)
    end = float(np.linalg.norm(start + share * way))
    if end <= most + 1e-9:
        beyond = ends[np.linspace(0.0, 1.0, 201) > share + 1e-6]
        assert (beyond >= most - 1e-6).all() or share > 1.0 - 1e-9
    else:
        assert end <= ends.min() + 1e-6
