"""What says nothing about a body is answered with neutral walking and says so; what is only odd is not."""

from __future__ import annotations

from functools import cache

import pytest

from runtime.prompts.english.library import LibraryExpander
from runtime.prompts.text_encoder import TextEncoder
from tests.prompt_lists import BODILY, NOTHING, UNSEEN_BODILY, UNSEEN_NOTHING


@cache
def expander() -> LibraryExpander:
    return LibraryExpander(TextEncoder())


def is_neutral(prompt: str) -> bool:
    expansion = expander().expand(prompt)
    return expansion.descriptions == expander().expand("a person walking normally").descriptions


def is_far_from_all(prompt: str) -> bool:
    """Whether the library leaves it at neutral walking because its nearest prompt would be a guess."""
    return "like the nearest prompt, “" in expander().expand(prompt).note


@pytest.mark.parametrize(("prompts", "most"), [(BODILY, 0), (UNSEEN_BODILY, 4)])
def test_few_bodily_prompts_are_taken_for_nothing(prompts: tuple[str, ...], most: int) -> None:
    missed = [prompt for prompt in prompts if is_neutral(prompt) and not is_far_from_all(prompt)]
    assert len(missed) <= most, missed


@pytest.mark.parametrize(("prompts", "most"), [(BODILY, 3), (UNSEEN_BODILY, 7)])
def test_few_bodily_prompts_are_too_far_to_guess(prompts: tuple[str, ...], most: int) -> None:
    far = [prompt for prompt in prompts if is_far_from_all(prompt)]
    assert 0 < len(far) <= most, far


@pytest.mark.parametrize(("prompts", "most"), [(NOTHING, 4), (UNSEEN_NOTHING, 4)])
def test_few_prompts_about_nothing_are_taken_for_a_walk(prompts: tuple[str, ...], most: int) -> None:
    missed = [prompt for prompt in prompts if not is_neutral(prompt)]
    assert len(missed) <= most, missed


@pytest.mark.parametrize(
    "prompt",
    [
        "the stock market fell",
        "blue",
        "42",
        "asdf qwer",
        "quarterly report",
        "invoice number 4711",
        "🙂",
        "SELECT * FROM users",
        "what time is it?",
    ],
)
def test_nothing_bodily_is_neutral_and_says_so(prompt: str) -> None:
    assert is_neutral(prompt)
    assert "neutral" in expander().expand(prompt).note


@pytest.mark.parametrize(
    "prompt",
    [
        "疲れた兵士",
        "пьяный матрос",
        "راقصة باليه",
        "un soldat épuisé",
        "ein müder alter Mann",
        "un hombre cansado",
        "una donna molto stanca",
        "een oude man met een stok",
        "gammal trött man",
        "bardzo stary człowiek",
        "orang tua yang lelah",
    ],
)
def test_other_languages_are_neutral_and_named(prompt: str) -> None:
    assert is_neutral(prompt)
    assert "not English" in expander().expand(prompt).note


@pytest.mark.parametrize(
    "prompt", ["a café waiter", "la la land dancer", "a den mother", "en garde", "a man from El Paso"]
)
def test_foreign_words_in_english_do_not_matter(prompt: str) -> None:
    assert "not English" not in expander().expand(prompt).note


def test_whoever_is_named_is_somebody_whatever_else_is_said() -> None:
    report = expander().expand("a soldier reading the quarterly report")
    assert "soldier" in report.nearest[0][0]
    assert not is_neutral("a soldier reading the quarterly report")
    assert is_neutral("reading of the quarterly report")
