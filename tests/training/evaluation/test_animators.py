"""Lists of prompts: each has an answer; expectations of animators against measures, and their table."""

from pathlib import Path

import pytest

from runtime.errors import FileError
from tests.helpers.shipped import shipped_prompter
from training.evaluation.text.animators import PROMPTS, animators_table, outcome, sections
from training.evaluation.text.untuned_prompts import LISTS, read, read_prompts

SHIPPED = [PROMPTS.with_name(f"{name}_prompts.txt") for name in ("animator", "forty", "many_parts")]

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


@pytest.mark.parametrize("path", [*LISTS, *SHIPPED], ids=lambda path: path.stem)
def test_prompts_of_the_shipped_lists_are_read(path: Path) -> None:
    """Every tenth: each has six descriptions, and expectations where the list is of these."""
    if path in SHIPPED:
        lines = [line for section in sections(path).values() for line in section]
        assert lines
        assert all(" | " in line for line in lines)
    else:
        library = shipped_prompter().library
        found = {prompt: read(prompt, library)[1] for prompt in read_prompts(path)[::10]}
        assert {prompt: problem for prompt, problem in found.items() if problem} == {}


def test_a_list_without_prompts_is_an_error(tmp_path: Path) -> None:
    (tmp_path / "empty.txt").write_text("# nothing\n", encoding="utf-8")
    with pytest.raises(FileError, match="no prompt"):
        read_prompts(tmp_path / "empty.txt")


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
