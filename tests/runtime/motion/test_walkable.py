"""Styles that a body cannot walk in are drawn towards neutral: what is wrong with a walk, and what is not."""

import numpy as np
import pytest

from runtime.motion.features import FPS
from runtime.motion.walkable import MIN_STYLE_WEIGHT, WalkableShare

BOTH, LEFT, RIGHT, NONE = (True, True), (True, False), (False, True), (False, False)


def _share(frames: list, height=lambda t: 0.95, walks: bool = True, steady: bool = True) -> float:
    """The share of its style with which a body is shown after frames of feet that stand."""
    state = WalkableShare()
    state.update(np.array([height(0.0)]), [BOTH], [walks], [False], [False])
    for frame, stands in enumerate(frames):
        state.update(np.array([height(frame / FPS)]), [stands], [walks], [steady], [False])
    return float(state.share[0])


def _walk(left: int, both: int, right: int, none: int, seconds: float) -> list:
    """Frames of a walk of so many frames on the left foot, on both, on the right one, on both, and in the air."""
    stride = [LEFT] * left + [BOTH] * both + [NONE] * none + [RIGHT] * right + [BOTH] * both + [NONE] * none
    return (stride * (round(seconds * FPS / len(stride)) + 1))[: round(seconds * FPS)]


@pytest.mark.parametrize(
    ("frames", "walks", "whole"),
    [
        (_walk(25, 6, 25, 0, 20.0), True, True),  # a walk
        (_walk(40, 6, 40, 0, 20.0), True, True),  # a slow one
        (_walk(25, 0, 25, 2, 20.0), True, True),  # feet that change over in a moment
        (_walk(20, 0, 20, 10, 20.0), True, False),  # a run, where a walk is asked for
        (_walk(20, 0, 20, 10, 20.0), False, True),  # and where a jog is
        (_walk(60, 6, 60, 0, 20.0), True, False),  # a foot that is in the air for a second
    ],
)
def test_what_is_no_walk(frames, walks, whole):
    assert (_share(frames, walks=walks) == 1.0) == whole


@pytest.mark.parametrize("walks", [True, False])
@pytest.mark.parametrize(("range_m", "whole"), [(0.05, True), (0.12, True), (0.26, False)])
def test_hips_that_leap(walks, range_m, whole):
    share = _share(_walk(25, 6, 25, 0, 20.0), lambda t: 0.9 + 0.5 * range_m * np.sin(12.0 * t), walks)
    assert (share == 1.0) == whole


def test_the_share_has_a_bound():
    assert _share([NONE] * 600) == MIN_STYLE_WEIGHT


def test_who_starts_stops_or_turns_may_do_as_he_likes():
    assert _share([NONE] * 600, steady=False) == 1.0


def test_another_style_is_shown_whole():
    state = WalkableShare()
    one = np.full(1, 0.95)
    for _ in range(300):
        state.update(one, [NONE], [True], [True], [False])
    for _ in range(60):
        state.update(one, [BOTH], [True], [True], [True])
    assert state.share[0] == 1.0
