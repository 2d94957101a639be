"""Prompts that the library was never tuned to: each has an answer, and no part of it is empty."""

from __future__ import annotations

from pathlib import Path

import pytest

from runtime.errors import FileError
from tests.helpers.shipped import shipped_prompter
from training.evaluation.text.untuned_prompts import LISTS, read, read_prompts


@pytest.fixture(scope="module")
def library() -> object:
    return shipped_prompter().library


@pytest.mark.parametrize("path", LISTS, ids=lambda path: path.stem)
def test_every_prompt_has_six_descriptions(path: Path, library: object) -> None:
    prompts = read_prompts(path)
    assert len(prompts) >= 50
    wrong = {prompt: problem for prompt in prompts if (problem := read(prompt, library)[1])}  # type: ignore[arg-type]
    assert wrong == {}


def test_a_list_without_prompts_is_said(tmp_path: Path) -> None:
    (tmp_path / "empty.txt").write_text("# nothing\n", encoding="utf-8")
    with pytest.raises(FileError, match="no prompt"):
        read_prompts(tmp_path / "empty.txt")
