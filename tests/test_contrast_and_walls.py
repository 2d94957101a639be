"""Fig. 8 and 9: the figures that stand beside the pictures."""

import numpy as np
import pytest

from runtime import rotations
from runtime.skeleton import SPORT_SKELETON
from training.evaluation.contrast import Blend, contrast_table, part_alone, place_between
from training.evaluation.wall import jerk, walls_table
from training.layering.measured_edits import Summary, summarise

JOINTS = len(SPORT_SKELETON.parents)


def standing(**turned: float) -> Summary:
    """A body that stands, single joints turned about X by degrees."""
    frames = 90
    local = np.tile(np.array([1.0, 0.0, 0.0, 0.0]), (frames, JOINTS, 1))
    for joint, degrees in turned.items():
        local[:, SPORT_SKELETON.index(joint)] = rotations.from_axis_angle(
            np.array([1.0, 0.0, 0.0]), np.radians(degrees)
        )
    hips = np.tile(np.array([0.0, 0.95, 0.0]), (frames, 1))
    return summarise(hips, local, np.ones((frames, 4)))


ARMS = {"LeftArm": 60.0, "LeftForeArm": 40.0}
NEUTRAL, WHOLE = standing(), standing(**ARMS, Spine=30.0)


def test_a_part_alone_that_is_as_in_the_style_reaches_all_of_it_and_spills_nothing() -> None:
    found = part_alone("chicken", "left_arm", NEUTRAL, WHOLE, standing(**ARMS))
    assert found is not None
    assert found.reached == pytest.approx(1.0)
    assert found.spilt == pytest.approx(0.0)


def test_a_part_that_stays_reaches_nothing_and_the_wrong_way_is_less_than_nothing() -> None:
    stays = part_alone("chicken", "left_arm", NEUTRAL, WHOLE, standing(Spine=20.0))
    wrong = part_alone("chicken", "left_arm", NEUTRAL, WHOLE, standing(LeftArm=-60.0, LeftForeArm=-40.0))
    assert stays is not None
    assert wrong is not None
    assert stays.reached == pytest.approx(0.0)
    assert stays.spilt > 1.0
    assert wrong.reached == pytest.approx(-1.0)


def test_a_part_that_the_style_leaves_is_not_asked_for() -> None:
    assert part_alone("chicken", "head", NEUTRAL, WHOLE, WHOLE) is None


@pytest.mark.parametrize("share", [0.0, 0.25, 0.5, 1.0])
def test_a_blend_lies_between_its_ends(share: float) -> None:
    between = standing(**{k: share * v for k, v in ARMS.items()}, Spine=share * 30.0)
    assert place_between(NEUTRAL, WHOLE, between) == pytest.approx(share, abs=1e-6)


def test_the_table_of_contrasts_says_how_far_blends_are_from_a_line() -> None:
    parts = [{"reached": r, "spilt": 0.2} for r in (0.2, 0.6, 0.8)]
    blends = [vars(Blend("chicken", 0.5, 0.7)), vars(Blend("drunk", 0.25, 0.15))]
    row = contrast_table({"full": {"parts": parts, "blends": blends}}).splitlines()[2]
    assert [c.strip() for c in row.strip("| ").split("|")] == ["full", "3", "0.60", "67 %", "0.20", "0.15"]


def test_jerk_is_that_of_a_cubic() -> None:
    t = np.arange(30) / 60.0
    path = np.stack([t**3, 0 * t, 0 * t], axis=-1)[:, None]
    assert jerk(path) == pytest.approx(6.0 / 1000.0)  # d3/dt3 of t^3, m/s3


def test_the_table_of_walls_has_means_of_both_gaits() -> None:
    def row(inside: float, hands: list[float | None]) -> dict:
        after = {
            "joint_inside": inside,
            "thighs_p99": 1.0,
            "shins_p99": 2.0,
            "hands_p99": 0.0,
            "hands_s": hands,
        }
        shared = {"passed": 3, "obstacles": 3, "seconds_each": 3.0, "skating": 0.1, "jerk": 2.0}
        return {**shared, "before": {"joint_inside": 0.5}, "after": after}

    text = walls_table({"ours": [row(0.01, [1.0, None]), row(0.03, [2.0])]})
    cells = [c.strip() for c in text.splitlines()[2].strip("| ").split("|")]
    assert cells == ["ours", "6 of 6", "3.0", "50 % > 2 %", "1.0, 2.0, 0.0", "1.5", "0.10", "2.0"]
