"""Elbows of the shown pose: a jump of the network is spread over frames, and all else is shown as it comes."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from runtime import rotations
from runtime.arrays import Array
from runtime.motion.elbows import FOREARMS, MAX_BEND_RAD_PER_FRAME2, Elbows
from runtime.skeleton import J

SETTLED_FRAMES = 60


def bent(degrees: float, twist: float = 0.4) -> Array:
    """Local rotations `(1, 31, 4)` with both elbows bent, and forearms that are twisted (radians)."""
    local = rotations.identity((1, J)).astype(np.float64)
    for joint, side in zip(FOREARMS, (-1.0, 1.0), strict=True):
        bend = rotations.from_yaw(side * np.radians(degrees))
        local[0, joint] = rotations.multiply(
            bend, rotations.from_rotation_vector(np.array([twist, 0.0, 0.0]))
        )
    return local


def flexions(local: Array) -> Array:
    """Degrees `(2,)` between upper arms and forearms."""
    along = rotations.rotate(local[0, FOREARMS], np.array([1.0, 0.0, 0.0]))
    return np.degrees(np.arccos(np.clip(along[:, 0], -1.0, 1.0)))


def shown(degrees: Array, free: bool = True) -> Array:
    """Degrees `(T, 2)` that are shown for incoming ones `(T,)`."""
    elbows, rows = Elbows(), []
    for each in degrees:
        local = bent(float(each))
        elbows.apply(local, [free])
        rows.append(flexions(local))
    return np.array(rows)


@given(st.lists(st.floats(10.0, 130.0), min_size=4, max_size=12))
def test_no_jump_pops_an_elbow(degrees: list[float]) -> None:
    """As long as the elbow is not stretched, at which it ends."""
    found = shown(np.repeat(degrees, 10))
    within = (found > 4.0).all() and (found < 170.0).all()
    bends = np.abs(np.diff(found, n=2, axis=0)).max()
    assert not within or bends <= np.degrees(MAX_BEND_RAD_PER_FRAME2) + 1e-3


def test_a_swing_is_shown_bit_for_bit() -> None:
    elbows = Elbows()
    for frame in range(120):
        local = bent(60.0 + 30.0 * np.sin(frame / 8.0))
        before = local.copy()
        elbows.apply(local, [True])
        assert np.array_equal(local, before)


def test_a_jump_arrives_and_is_then_followed_exactly() -> None:
    degrees = np.concatenate([np.full(5, 40.0), np.full(SETTLED_FRAMES, 80.0)])
    found = shown(degrees)
    assert found[5].max() < 50.0
    assert found[-1] == pytest.approx(np.full(2, 80.0), abs=1e-3)


def test_who_holds_on_to_something_is_left_alone() -> None:
    degrees = np.array([40.0, 40.0, 80.0, 80.0])
    assert shown(degrees, free=False) == pytest.approx(np.repeat(degrees[:, None], 2, 1), abs=1e-3)
