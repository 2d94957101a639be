"""The prompts of animators: lists, expectations against measures, and the table."""

from __future__ import annotations

import pytest

from training.evaluation.text.animators import PROMPTS, animators_table, outcome, sections

NEUTRAL = {"head.pitch": 2.0, "torso.twist": 0.0, "left_leg.knee_bend": 20.0}


@pytest.mark.parametrize(
    ("expectation", "holds"),
    [
        ("head.pitch > 10", True),
        ("head.pitch < 10", False),
        ("head.pitch > n+15", False),
        ("head.pitch > n*5", True),
    ],
)
def test_expectations_are_absolute_or_of_the_neutral_walk(expectation: str, holds: bool) -> None:
    found = outcome(f"head down | {expectation}", {**NEUTRAL, "head.pitch": 12.0}, NEUTRAL)
    assert (found["prompt"], found["expected"], not found["failed"]) == ("head down", 1, holds)


def test_a_line_that_is_no_expectation_is_named() -> None:
    with pytest.raises(ValueError, match="very low"):
        outcome("head down | very low", NEUTRAL, NEUTRAL)


@pytest.mark.parametrize("name", ["animator_prompts.txt", "forty_prompts.txt", "many_parts_prompts.txt"])
def test_every_shipped_list_has_lines_with_expectations(name: str) -> None:
    found = sections(PROMPTS.with_name(name))
    lines = [line for section in found.values() for line in section]
    assert len(lines) >= 40
    assert all(" | " in line for line in lines)


def test_the_table_counts_expectations_and_whole_prompts() -> None:
    good = {"prompt": "a", "expected": 2, "failed": []}
    bad = {"prompt": "b", "expected": 1, "failed": ["head.pitch > 10 (measured 1.00, neutral 2.00)"]}
    lines = animators_table({"one part": [good], "two parts": [bad]}).splitlines()
    assert lines[2:5] == [
        "| one part | 2 of 2 | 1 of 1 |",
        "| two parts | 0 of 1 | 0 of 1 |",
        "| all | 2 of 3 | 1 of 2 |",
    ]
    assert lines[-1].startswith("- b: head.pitch > 10")
