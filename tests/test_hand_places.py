"""Where hands are that words put somewhere: what counts as missed."""

import numpy as np
import pytest

from runtime import rotations
from runtime.skeleton import SPORT_SKELETON
from training.evaluation.text.hand_places import PLACES, Missed, asked_for, hands_table, missed
from training.layering.catalog import EDITS
from training.layering.measured_edits import Summary, summarise

NEUTRAL = {
    part: f"{part} as ever" for part in ("left_arm", "right_arm", "left_leg", "right_leg", "torso", "head")
}


def standing(elbow: float) -> Summary:
    """A body that stands, its left elbow bent by degrees."""
    local = np.tile(np.array([1.0, 0.0, 0.0, 0.0]), (90, len(SPORT_SKELETON.parents), 1))
    local[:, SPORT_SKELETON.index("LeftForeArm")] = rotations.from_axis_angle(
        np.array([0.0, 1.0, 0.0]), np.radians(-elbow)
    )
    return summarise(np.tile(np.array([0.0, 0.95, 0.0]), (90, 1)), local, np.ones((90, 4)))


def test_nothing_is_missed_by_the_edit_itself() -> None:
    found = missed("left", standing(40.0), standing(40.0))
    assert found.hand == pytest.approx(0.0)
    assert found.elbow == pytest.approx(0.0)
    assert found.near


def test_an_elbow_that_is_bent_otherwise_is_seen_at_the_elbow_and_the_hand() -> None:
    found = missed("left", standing(100.0), standing(20.0))
    assert found.elbow == pytest.approx(80.0, abs=1.0)
    assert found.hand > 15.0
    assert not found.near
    assert missed("right", standing(100.0), standing(20.0)).near


@pytest.mark.parametrize("sides", [("left",), ("right",), ("left", "right")])
def test_only_the_hands_that_are_asked_for_have_other_words(sides: tuple[str, ...]) -> None:
    from runtime.prompts.parts import PartDescriptions

    words = asked_for("on_hip", sides, PartDescriptions.from_mapping(NEUTRAL)).to_mapping()
    changed = {part for part in words if words[part] != NEUTRAL[part]}
    assert changed == {f"{side}_arm" for side in sides}
    assert words[f"{sides[0]}_arm"] == EDITS[f"{sides[0]}_arm.on_hip"].phrases[f"{sides[0]}_arm"][0]


def test_the_table_counts_who_is_there_and_marks_what_was_never_trained() -> None:
    there, away = vars(Missed(5.0, 10.0)), vars(Missed(40.0, -50.0))
    columns = {"left": away, "right": there, "left of both": there, "right of both": there}
    text = hands_table({"ours": {"behind_back": columns, "on_hip": dict.fromkeys(columns, there)}})
    assert "| behind back (left never trained) | **40 cm, -50°** | 5 cm, +10° |" in text
    assert text.splitlines()[4].endswith("| 1 of 2 | 2 of 2 | 2 of 2 | 2 of 2 |")


def test_places_are_edits_of_both_arms() -> None:
    assert {f"{side}_arm.{place}" for place in PLACES for side in ("left", "right")} <= set(EDITS)
    assert "waving" not in PLACES
