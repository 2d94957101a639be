"""Knees that follow their feet as fast as a knee speeds up, and toes that bend on the ground."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from runtime.feet.leg import Knee, LegPose, leg_bones, leg_forward, toes_raised
from runtime.skeleton import ANKLE_HEIGHT, TOE_HEIGHT

BONES = leg_bones(0)
STANDING = leg_forward(BONES, (0.0, 0.95, 0.0), np.tile([1.0, 0.0, 0.0, 0.0], (31, 1)).tolist())
DT = 1.0 / 60.0


@given(st.lists(st.floats(0.6, 0.999), min_size=5, max_size=40))
def test_no_demand_snaps_a_knee(shares: list[float]) -> None:
    knee, flexions = Knee(), []
    for share in shares:
        target = (STANDING.hip[0], STANDING.hip[1] - share * BONES.length, STANDING.hip[2])
        assert knee.follow(STANDING, STANDING.hip, target, BONES, DT) <= BONES.length + 1e-9
        flexions.append(np.degrees(knee.flexion))
    assert np.abs(np.diff(flexions, n=2)).max(initial=0.0) < 6.0


def test_a_demand_that_stays_is_met() -> None:
    knee = Knee()
    for share in [0.995] * 3 + [0.9] * 40:
        target = (STANDING.hip[0], STANDING.hip[1] - share * BONES.length, STANDING.hip[2])
        reach = knee.follow(STANDING, STANDING.hip, target, BONES, DT)
    assert reach == pytest.approx(0.9 * BONES.length, abs=1e-3)


def bent_leg(degrees: float) -> LegPose:
    """A leg under its hip with this flexion."""
    local = np.tile([1.0, 0.0, 0.0, 0.0], (31, 1))
    half = np.radians(0.5 * degrees)
    for joint, angle in ((2, -half), (3, 2.0 * half)):
        local[joint] = [np.cos(0.5 * angle), np.sin(0.5 * angle), 0.0, 0.0]
    return leg_forward(BONES, (0.0, 0.95, 0.0), local.tolist())


@pytest.mark.parametrize(("level", "degrees"), [(True, 19.0), (False, 7.0)])
def test_over_level_ground_a_free_leg_does_not_reach_far_down(level: bool, degrees: float) -> None:
    """In strides with a knee of 5 to 25 degrees, of which it shows the straighter part on other ground."""
    knee = Knee()
    for k in range(600):
        leg = bent_leg(5.0 if k < 420 else min(25.0, 5.0 + 0.5 * (k - 420)))
        far = (leg.hip[0], leg.hip[1] - 0.9999 * BONES.length, leg.hip[2])
        knee.follow(leg, leg.hip, far, BONES, DT, free=True, level=level)
        if k == 480:
            assert np.degrees(knee.flexion) == pytest.approx(degrees, abs=2.5)


def test_a_landing_jog_bends_its_knee_before_the_least_flexion_ends() -> None:
    least, flexions, knee = np.radians(12.0), [], Knee()
    for degrees in [3.0] * 30 + [5.0, 8.0, 12.0, 17.0, 23.0]:
        leg = bent_leg(degrees)
        knee.follow(leg, leg.hip, leg.ankle, BONES, DT, True, least, True)
        flexions.append(np.degrees(knee.flexion))
    assert min(flexions[20:]) > 12.0
    assert np.diff(flexions, n=2)[20:].max() < 3.0


@pytest.mark.parametrize(("free", "degrees"), [(True, 25.0), (False, 5.0)])
def test_a_free_leg_is_no_straighter_than_the_incoming_one(free: bool, degrees: float) -> None:
    bent, knee = bent_leg(25.0), Knee()
    own = np.hypot(*np.subtract(bent.ankle, bent.hip)[1:])
    for k in range(720):
        span = own if k < 660 else 0.9999 * BONES.length
        knee.follow(bent, bent.hip, (bent.hip[0], bent.hip[1] - span, bent.hip[2]), BONES, DT, free)
    assert np.degrees(knee.flexion) == pytest.approx(degrees, abs=3.0)


@pytest.mark.parametrize("degrees", [-20.0, 0.0, 20.0])
def test_toes_that_are_up_are_raised_and_others_are_not(degrees: float) -> None:
    local = np.tile([1.0, 0.0, 0.0, 0.0], (31, 1))
    flat = TOE_HEIGHT - ANKLE_HEIGHT
    lying = leg_forward(BONES, (0.0, 0.95, 0.0), local.tolist())
    rest = np.arcsin(flat / BONES.foot_length)
    angle = np.arcsin((lying.toe[1] - lying.ankle[1]) / BONES.foot_length) - rest - np.radians(degrees)
    local[4] = [np.cos(0.5 * angle), np.sin(0.5 * angle), 0.0, 0.0]
    raised = toes_raised(leg_forward(BONES, (0.0, 0.95, 0.0), local.tolist()), 0.5)
    up = np.degrees(np.arcsin((raised.toe[1] - raised.ankle[1]) / BONES.foot_length) - rest)
    assert up == pytest.approx(1.5 * degrees if degrees > 0.0 else degrees, abs=1e-6)
