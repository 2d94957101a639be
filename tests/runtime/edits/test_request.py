"""Targets in files, and the phrases that they come from."""

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from runtime.edits.request import MAX_TARGET, SHAPE, Swing, checked_targets, written_targets
from runtime.prompts.edit_targets import phrases, read_phrases, targets_of

PART = {"leg": "left_leg", "torso": "torso", "arm": "left_arm"}


AT = st.tuples(st.integers(0, 2), st.integers(0, 4), st.integers(0, 30))


@given(st.lists(st.tuples(AT, st.floats(0.1, 1.0), st.floats(-0.3, 0.3), st.floats(0.3, 9.0))))
def test_targets_come_back_from_a_file(asked: list[tuple[tuple[int, int, int], float, float, float]]) -> None:
    targets = np.zeros(SHAPE)
    for at, *value in asked:
        targets[at] = value
    np.testing.assert_array_equal(checked_targets(json.loads(json.dumps(written_targets(targets)))), targets)
    np.testing.assert_array_equal(checked_targets(targets), targets)


@pytest.mark.parametrize("before", [np.full((3, 5, 2), 0.2), np.full((5, 34, 2), 0.2), [[0, 1, 1.0, 0.2]]])
def test_targets_of_files_without_ranges_ask_for_nothing(before: object) -> None:
    assert not checked_targets(before).any()


@pytest.mark.parametrize(
    "damaged",
    [[1.0], [[0, 0, 99, 1.0, 0.1, 0.1]], [[0, 9, 0, 1.0, 0.1, 0.1]], [[0, 0.5, 0, 1.0, 0.1, 0.1]],
     [[0, 0, 0, 2.0, 0.1, 0.1]], [[0, 2, 0, 1.0, 1e9, 1e9]], [[0, 2, 0, float("nan"), 1.0, 1.0]],
     np.full(SHAPE, np.nan), "legs"],
)  # fmt: skip
def test_targets_of_a_file_are_checked(damaged: object) -> None:
    with pytest.raises(ValueError, match=r"edits|could not|reshape"):
        checked_targets(damaged)


def test_a_phrase_asks_for_what_its_kind_says() -> None:
    for part, targets in phrases().items():
        for target, table in targets.items():
            for phrase, (_, values) in table.items():
                found = targets_of(PART[part], f"left side {phrase}, at rest").get(target, ())
                assert found == values, phrase


@pytest.mark.parametrize(
    "tree",
    [
        {"leg": {"odd": {"phrases": ["odd"], "height": [1.0, 2.0]}}},
        {"tail": {"odd": {"phrases": ["odd"], "lower": [1.0, 2.0]}}},
        {
            "leg": {
                "a": {"phrases": ["odd"], "lower": [0.1, 1.0]},
                "b": {"phrases": ["odd"], "lower": [0.2, 1.0]},
            }
        },
        {"arm": {"odd": {"phrases": ["odd"], "hand": {"place": [0, 0, 0]}}}},
    ],
)
def test_a_kind_that_is_none_is_named(tree: dict[str, dict[str, dict[str, object]]]) -> None:
    with pytest.raises(ValueError, match=r"odd|\[leg\.b\]|place"):
        read_phrases(tree)


def test_a_swing_knows_its_middle_and_its_ends() -> None:
    swing = Swing()
    for t in range(600):
        swing = swing.observed(2.0 + 0.3 * np.sin(2.0 * np.pi * t / 60.0), 0.4, 0.6)
    assert swing.middle == pytest.approx(2.0, abs=0.1)
    assert swing.range == pytest.approx(0.6, abs=0.12)
    assert swing.gain([1.0, 1.2, MAX_TARGET], 0.1, 5.0) == pytest.approx(1.0, abs=0.4)
    assert swing.gain([1.0, -MAX_TARGET, 0.3], 0.1, 5.0) == pytest.approx(-0.5, abs=0.15)
    assert swing.gain([1.0, 0.3, 1.0], 0.1, 5.0) == 0.0
