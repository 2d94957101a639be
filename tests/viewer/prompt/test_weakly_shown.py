"""Words that a model was measured to show next to nothing of are marked at their part."""

import numpy as np

from runtime.prompts.expander import DEFAULT_PROMPT
from runtime.prompts.parts import PartDescriptions
from runtime.prompts.phrasing import PromptAdherence
from runtime.session.prompt_blend import Answer, PromptBlend
from viewer.prompt import prompt_panel
from viewer.prompt.prompt_panel import weakly_shown

WORDS = PartDescriptions(*["hanging"] * 6)


def _measured(monkeypatch, table: dict[tuple[str, str], float]) -> None:
    known = {"compact": PromptAdherence(table)}
    monkeypatch.setattr(prompt_panel, "adherence_of", lambda name: known.get(name, PromptAdherence()))


def _blend(prompt: str, words: PartDescriptions = WORDS) -> PromptBlend:
    return PromptBlend((Answer(prompt, WORDS, words, np.zeros((6, 64), np.float32)), None))


def test_only_weak_words_of_the_loaded_model_are_marked(monkeypatch) -> None:
    _measured(monkeypatch, {("arm", "hanging"): 0.1, ("leg", "hanging"): 0.3})
    blend = _blend("")
    assert weakly_shown(blend, "left_arm", "compact") == 0.1
    assert weakly_shown(blend, "right_arm", "compact") == 0.1  # limbs share what was measured
    assert weakly_shown(blend, "left_leg", "compact") is None
    assert weakly_shown(blend, "head", "compact") is None  # never measured
    assert weakly_shown(blend, "left_arm", "another") is None
    assert weakly_shown(PromptBlend(), "left_arm", "compact") is None  # nothing answered yet


def test_the_walk_that_the_program_begins_with_has_no_marks_until_its_words_are_changed(monkeypatch) -> None:
    _measured(monkeypatch, {("arm", "hanging"): 0.1, ("arm", "waving"): 0.2})
    edited = WORDS.replace("left_arm", "waving")
    for words, share in ((WORDS, None), (edited, 0.2)):
        blend = _blend(DEFAULT_PROMPT, words)
        assert weakly_shown(blend, "left_arm", "compact") == share
        assert weakly_shown(blend, "right_arm", "compact") is None
