"""Balance over a stride: what an inverted pendulum lacks is learnt by phase, and where it is not steady nothing moves."""

import numpy as np
import pytest

from runtime.motion.balance import (
    GRAVITY_M_PER_S2,
    HEAD_SEGMENT,
    MASS_SHIFT,
    MAX_SHIFT_M,
    SIDE_SEGMENTS,
    StrideBalance,
)
from runtime.motion.features import FPS
from runtime.records import joined, part
from runtime.skeleton import SPORT_SKELETON

REST = SPORT_SKELETON.rest_positions.astype(np.float64)
ANKLES = [SPORT_SKELETON.index("LeftFoot"), SPORT_SKELETON.index("RightFoot")]
TOES = [SPORT_SKELETON.index("LeftToeBase"), SPORT_SKELETON.index("RightToeBase")]
STEPS_PER_S, SPEED_M_PER_S, HIPS_HEIGHT_M = 1.8, 1.2, 0.92


def _glider(seconds: float, sway: float = 0.0) -> list[tuple[np.ndarray, tuple[bool, bool]]]:
    """Frames of a body that glides on at one speed, or sways aside too, over feet that step."""
    frames = []
    for frame in range(round(seconds * FPS)):
        t = frame / FPS
        joints = REST.copy()
        joints[:, 1] += HIPS_HEIGHT_M
        joints[:, 2] += SPEED_M_PER_S * t
        joints[:, 0] += sway * np.sin(np.pi * STEPS_PER_S * t)
        steps = STEPS_PER_S * t
        for k in (0, 1):
            own = 0.5 * (steps + k)
            whole, of_stride = divmod(own, 1.0)
            swing = max(2.0 * of_stride - 1.0, 0.0)
            done = 2.0 * (whole + 0.5 * (1 - np.cos(np.pi * swing)) + 0.25) - k
            place = done * SPEED_M_PER_S / STEPS_PER_S
            side = 0.09 * (1 - 2 * k)
            joints[ANKLES[k]] = side, 0.08, place - 0.06
            joints[TOES[k]] = side, 0.04, place + 0.06
        frames.append((joints, ((0.5 * steps) % 1.0 < 0.5, (0.5 * (steps + 1)) % 1.0 < 0.5)))
    return frames


def _driven(
    frames: list, steady: bool | int = True, composed: float = 1.0
) -> tuple[StrideBalance, np.ndarray]:
    """The state after frames that are shown with their shifts, and the shifts; a number of frames that are `steady`."""
    balance, shifts, shift = StrideBalance(), [], np.zeros(2)
    legs = np.ones(len(REST))
    for k in (0, 1):
        legs[ANKLES[k]] = legs[TOES[k]] = 0.0
        legs[ANKLES[k] - 1] = 0.5
    for number, (joints, stands) in enumerate(frames):
        shown = joints.copy()
        shown[:, [0, 2]] += legs[:, None] * shift
        way = np.array([[0.0, SPEED_M_PER_S]])
        goes = steady if isinstance(steady, bool) else number < steady
        posed = shown[None].astype(np.float32)
        shift = balance.update(posed, np.zeros(1), way, [stands], [goes], [composed])[0]
        shifts.append(shift)
    return balance, np.array(shifts)


def test_masses_are_those_of_a_whole_body():
    total = HEAD_SEGMENT.mass + 2.0 * sum(segment.mass for segment in SIDE_SEGMENTS.values())
    assert total == pytest.approx(1.0, abs=1e-3)
    assert 0.8 < MASS_SHIFT < 1.0  # feet and half of the shanks stay


def test_a_body_that_glides_is_moved_over_the_foot_that_stands():
    """Its feet are 9 cm to each side: over a step of 0.56 s the pendulum falls half as far aside, or less."""
    frames = _glider(14.0)
    _, shifts = _driven(frames)
    late = slice(round(8 * FPS), None)
    side = np.array([joints[ANKLES[0], 0] if left and not right else joints[ANKLES[1], 0] if right and not left else 0.0 for joints, (left, right) in frames])  # fmt: skip
    across = shifts[late, 0]
    assert np.corrcoef(across, side[late])[0, 1] > 0.7
    assert 0.008 < across.max() < 0.09
    wide = np.pi * STEPS_PER_S
    expected = (4.0 / np.pi) * 0.07 / (1.0 + HIPS_HEIGHT_M / GRAVITY_M_PER_S2 * wide**2)
    assert across.max() == pytest.approx(expected, rel=0.35)


def test_it_is_measured_without_the_correction():
    """A minute later the shifts are those of ten seconds before: nothing swings up."""
    _, shifts = _driven(_glider(40.0))
    early, late = shifts[10 * FPS : 15 * FPS], shifts[35 * FPS : 40 * FPS]
    assert late.std(0) == pytest.approx(early.std(0), rel=0.1, abs=1e-4)


def test_who_is_not_steady_stays_where_he_is():
    _, shifts = _driven(_glider(5.0), steady=False)
    assert not shifts.any()


def test_it_fades_out_without_a_jump():
    x = _driven(_glider(9.0), steady=8 * FPS)[1][8 * FPS :]
    assert np.abs(np.diff(x, n=2, axis=0)).max() * FPS**2 < 3.0
    assert np.abs(x[-1]).max() < 0.25 * np.abs(x[0]).max() + 1e-3


def test_shifts_are_bounded():
    """Whatever a body does: hips that fly a metre aside."""
    _, shifts = _driven(_glider(6.0, sway=1.0))
    assert np.abs(shifts).max() <= MAX_SHIFT_M * 1.5


def test_the_same_bytes_alone_and_in_a_crowd():
    first, second = _glider(2.0), _glider(2.0, sway=0.05)
    _, alone = _driven(second)
    crowd = joined([StrideBalance(), StrideBalance()])
    way = np.array([[0.0, SPEED_M_PER_S], [0.0, SPEED_M_PER_S]])
    apart = StrideBalance()
    for (a, left), (b, right) in zip(first, second, strict=True):
        both = np.stack([a, b]).astype(np.float32)
        together = crowd.update(both, np.zeros(2), way, [left, right], [True, True], [1.0, 1.0])
        one = apart.update(both[1:], np.zeros(1), way[1:], [right], [True], [1.0])
        assert together[1].tobytes() == one[0].tobytes()
    assert part(crowd, 1).window.tobytes() == apart.window.tobytes()
    assert alone.shape == (2 * FPS, 2)


def test_what_shakes_a_composed_body_is_taken_up_and_a_captured_one_is_left_alone():
    """At 4.3 Hz, which no stride of 0.9 Hz has, the centre of mass goes on more evenly."""
    frames = _glider(12.0)
    shaken = 0.002 * np.sin(2.0 * np.pi * 4.3 * np.arange(len(frames)) / FPS)
    for (joints, _), ahead in zip(frames, shaken, strict=True):
        joints[:, 2] += ahead
    balance, shifts = _driven(frames)
    late = slice(6 * FPS, None)
    tone = np.exp(2j * np.pi * 4.3 * np.arange(len(frames)) / FPS)[late]
    assert balance.smoothing.any()
    assert abs((shaken + MASS_SHIFT * shifts[:, 1])[late] @ tone) < 0.6 * abs(shaken[late] @ tone)
    captured, _ = _driven(frames, composed=0.0)
    assert not captured.smoothing.any()
