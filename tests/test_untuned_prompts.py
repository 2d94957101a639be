"""`python -m training.evaluation prompts`: its figures, its table, and that it says so when an answer is missing."""

from __future__ import annotations

import csv
import json
from hashlib import sha256
from pathlib import Path

import numpy as np
import pytest

from runtime.errors import PromptError, SportError
from runtime.motion.model import load_model
from runtime.prompts.expander import Expansion
from runtime.prompts.parts import PartDescriptions
from runtime.skeleton import PART_NAMES
from training.evaluation.experiment import run
from training.evaluation.text import untuned_prompts as prompts

PROMPTS = "an old man\n\nRight arm raised, head down!\n???\n"


@pytest.fixture
def three(tmp_path: Path) -> Path:
    path = tmp_path / "three.txt"
    path.write_text(PROMPTS, encoding="utf-8")
    return path


class FakeExpander:
    """Says `words` of each part, and knows no prompt with "refused" or "broken" in it."""

    def __init__(self, words: str = "held still") -> None:
        self.words = words

    def expand(self, prompt: str) -> Expansion:
        if "refused" in prompt:
            raise PromptError("no such prompt")
        if "broken" in prompt:
            raise ValueError("defect")
        return Expansion(
            PartDescriptions(*[self.words] * 6), "library", (("a | b", 0.5),), f"like “{prompt}” 0.5"
        )


class FakeEncoder:
    def __init__(self, value: float = 1.0) -> None:
        self.value = value

    def encode(self, descriptions: PartDescriptions) -> np.ndarray:
        return np.full((6, 64), self.value, np.float32)


def answer(prompt: str, words: str = "held still", value: float = 1.0) -> prompts.PromptOutcome:
    return prompts.ask(prompt, FakeExpander(words), FakeEncoder(value))  # type: ignore[arg-type]


def test_the_command_answers_every_prompt(
    three: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    figures, document = tmp_path / "figures.json", tmp_path / "prompts.md"
    document.write_text(
        "before\n<!-- untuned prompts: begin -->\nold\n<!-- untuned prompts: end -->\nafter\n",
        encoding="utf-8",
    )
    code = run(
        prompts.PROMPTS,
        ["--file", str(three), "--json", str(figures), "--markdown", str(document)],
        "prompts",
    )
    report = json.loads(figures.read_text(encoding="utf-8"))
    assert report["prompts"] == 3
    assert report["problems"] == {}
    assert code == (1 if report["missed"] else 0)
    assert [a["prompt"] for a in report["answers"]] == ["an old man", "Right arm raised, head down!", "???"]
    for one in report["answers"]:
        assert list(one["descriptions"]) == list(PART_NAMES)
        assert all(one["descriptions"].values())
    assert report["answers"][1]["explicit_parts"] == ["right_arm", "head"]
    assert report["answers"][0]["descriptions"] != report["answers"][2]["descriptions"]
    assert "3 prompts, 0 without an answer" in capsys.readouterr().out
    text = document.read_text(encoding="utf-8")
    assert text.startswith("before\n<!-- untuned prompts: begin -->\n- 3 prompts")
    assert text.endswith("<!-- untuned prompts: end -->\nafter\n")
    assert "old\n" not in text
    assert "| an old man |" in text


def test_what_is_missing_fails_the_bar() -> None:
    answers = [
        answer("fine"),
        answer("refused"),
        answer("broken"),
        answer("wordless", "—"),
        answer("dead", value=0.0),
    ]
    report = prompts.summarise(answers, 1.0)
    assert list(report["problems"]) == ["refused", "broken", "wordless", "dead"]
    assert report["missed"] == ["every prompt is answered, no part of it empty"]
    assert prompts.summarise(answers[:1], 1.0)["missed"] == []


def test_a_slow_answer_fails_the_bar() -> None:
    slow = prompts.PromptOutcome("slow", cpu_ms=prompts.MAX_MS, wall_ms=60.0)
    report = prompts.summarise([answer("fine"), slow], 1.0)
    assert report["slowest"] == "slow"
    assert report["missed"] == ["each in less than 50 ms warm (1 took longer)"]


def test_notes_are_counted_by_kind() -> None:
    report = prompts.summarise([answer("one"), answer("two")], 1.0)
    assert report["notes"] == {"like “…” N": 2}
    assert report["different_answers"] == 1
    assert report["most_common_answer"] == 2


def test_the_sample_is_chosen_by_position() -> None:
    answers = [prompts.PromptOutcome(str(i), 1.0, 1.0) for i in range(200)]
    assert [int(a.prompt) for a in prompts.sample(answers)[:4]] == [0, 6, 13, 20]
    assert len(prompts.sample(answers)) == 30
    assert prompts.sample(answers[:3]) == answers[:3]


def test_a_cell_keeps_the_table_whole() -> None:
    lines = prompts.table([answer("this | that *and* more")])
    assert r"| this \| that \*and\* more |" in lines[2]
    assert r"a \| b (0.50)" in lines[2]
    assert all(line.replace(r"\|", "").count("|") == 10 for line in lines)


def test_the_two_hundred_prompts_are_different() -> None:
    found = prompts.read_prompts(prompts.UNTUNED_PROMPTS)
    assert len(found) == len({prompt.lower() for prompt in found}) == 200


def test_a_file_without_prompts_is_refused(tmp_path: Path) -> None:
    empty = tmp_path / "empty.txt"
    empty.write_text("\n \n", encoding="utf-8")
    for path in (empty, tmp_path / "missing.txt"):
        with pytest.raises(SportError, match=path.name):
            prompts.read_prompts(path)


def test_the_shipped_model_is_measured_warm() -> None:
    answers, first_ms = prompts.measure(["an old man"], load_model())
    assert answers[0].problem == ""
    assert first_ms > answers[0].cpu_ms > 0.0


def test_comments_are_no_prompts(tmp_path: Path) -> None:
    path = tmp_path / "commented.txt"
    path.write_text("# when and how\na queen\n # another\nwalk on #1\n", encoding="utf-8")
    assert prompts.read_prompts(path) == ["a queen", "walk on #1"]


@pytest.mark.parametrize(
    ("prompts_file", "grades_file", "count", "digest"),
    [
        (prompts.BLIND_PROMPTS, prompts.BLIND_GRADES, 200, "64bcef4402cf7fa7"),
        (prompts.CLASS_PROMPTS, prompts.CLASS_GRADES, 60, "c343aa74b397914a"),
    ],
)
def test_prompts_kept_for_judging_are_unchanged_and_graded(
    prompts_file: Path, grades_file: Path, count: int, digest: str
) -> None:
    found = prompts.read_prompts(prompts_file)
    assert len(found) == len({prompt.lower() for prompt in found}) == count
    assert sha256("\n".join(found).encode()).hexdigest()[:16] == digest
    with grades_file.open(encoding="utf-8", newline="") as file:
        grades = list(csv.DictReader(file))
    assert [grade["prompt"] for grade in grades] == found
    known = {"right", "partly", "wrong", "neutral, missed", "neutral, rightly"}
    assert {grade[when] for grade in grades for when in ("before", "after")} <= known
