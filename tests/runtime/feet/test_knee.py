"""Knees that follow their feet as fast as a knee speeds up, and toes that bend on the ground."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from runtime.feet.leg import Knee, leg_bones, leg_forward

BONES = leg_bones(0)
STANDING = leg_forward(BONES, (0.0, 0.95, 0.0), np.tile([1.0, 0.0, 0.0, 0.0], (31, 1)).tolist())
DT = 1.0 / 60.0


@given(st.lists(st.floats(0.6, 0.999), min_size=5, max_size=40))
def test_no_demand_snaps_a_knee(shares: list[float]) -> None:
    knee, flexions = Knee(), []
    for share in shares:
        target = (STANDING.hip[0], STANDING.hip[1] - share * BONES.length, STANDING.hip[2])
        reach = knee.follow(STANDING, STANDING.hip, target, BONES, DT)
        assert reach <= BONES.length + 1e-9
        flexions.append(np.degrees(knee.flexion))
    assert np.abs(np.diff(flexions, n=2)).max(initial=0.0) < 6.0


def test_a_demand_that_stays_is_met() -> None:
    knee = Knee()
    for share in [0.995] * 3 + [0.9] * 40:
        target = (STANDING.hip[0], STANDING.hip[1] - share * BONES.length, STANDING.hip[2])
        reach = knee.follow(STANDING, STANDING.hip, target, BONES, DT)
    assert reach == pytest.approx(0.9 * BONES.length, abs=1e-3)
