"""A gait that stalls is noticed, one that steps or rests is not; phases are advanced as steps advance them."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from runtime.motion.features import FPS
from runtime.motion.pace import POINTS, STALLED_SECONDS, Stall, advance_by_cycles

REQUESTED_SPEED_M_PER_S = 1.4  # m/s


def _stalls(feet_speed: float, wanted: float, seconds: float = 1.0) -> int:
    """Frames of `seconds` that count as stalled, the feet swinging to and fro with a mean speed."""
    joints = np.zeros((1, 31, 3))
    stall = Stall.at_rest(joints)
    count = 0
    for frame in range(round(seconds * FPS)):
        forth = (frame // 15) % 2 == 0
        joints[:, POINTS, 2] += (1.0 if forth else -1.0) * feet_speed / FPS
        count += stall.update(joints.copy(), [wanted])[0]
    return count


def test_a_stepping_gait_does_not_stall():
    assert _stalls(REQUESTED_SPEED_M_PER_S, REQUESTED_SPEED_M_PER_S, 5.0) == 0
    assert _stalls(0.5 * REQUESTED_SPEED_M_PER_S, REQUESTED_SPEED_M_PER_S, 5.0) == 0


def test_feet_at_rest_under_a_travelling_root_do_after_a_while():
    assert 0 < _stalls(0.05, REQUESTED_SPEED_M_PER_S) <= FPS - STALLED_SECONDS * FPS


def test_it_ends_when_the_feet_move_again():
    joints = np.zeros((1, 31, 3))
    stall = Stall.at_rest(joints)
    for _ in range(60):
        stalled = stall.update(joints.copy(), [REQUESTED_SPEED_M_PER_S])[0]
    assert stalled
    for _ in range(12):
        joints[:, POINTS, 2] += 1.5 * REQUESTED_SPEED_M_PER_S / FPS
        stalled = stall.update(joints.copy(), [REQUESTED_SPEED_M_PER_S])[0]
    assert not stalled


@given(st.floats(-3.0, 3.0), st.floats(0.1, 2.0), st.floats(0.0, 1.0))
def test_advanced_phases_keep_their_amplitude_and_go_forward(start: float, amplitude: float, cycles: float):
    before = amplitude * np.array([np.sin(start), np.cos(start)])
    after = advance_by_cycles(before, cycles)
    angle = start + 2.0 * np.pi * cycles
    np.testing.assert_allclose(after, amplitude * np.array([np.sin(angle), np.cos(angle)]), atol=1e-9)
