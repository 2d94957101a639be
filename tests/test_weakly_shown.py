"""Words that a model was measured to show next to nothing of are marked beside their part."""

import numpy as np

from runtime.prompts import shares
from runtime.prompts.expander import DEFAULT_PROMPT
from runtime.prompts.parts import PartDescriptions
from runtime.session.prompt_blend import Answer, PromptBlend
from viewer.prompt.state import PromptState

WORDS = PartDescriptions(*["hanging"] * 6)


def _state(monkeypatch, table: dict[tuple[str, str], float], model: str = "compact") -> PromptState:
    known = shares.PhraseShares(table)
    monkeypatch.setattr(
        shares, "shares_of", lambda name: known if name == "compact" else shares.PhraseShares()
    )
    return PromptState(
        model=model, edit=PromptBlend((Answer("", WORDS, WORDS, np.zeros((6, 64), np.float32)), None))
    )


def test_only_weak_words_of_the_loaded_model_are_marked(monkeypatch) -> None:
    table = {("arm", "hanging"): 0.1, ("leg", "hanging"): 0.3}
    state = _state(monkeypatch, table)
    assert state.weakly_shown("left_arm") == 0.1
    assert state.weakly_shown("right_arm") == 0.1  # limbs share what was measured
    assert state.weakly_shown("left_leg") is None
    assert state.weakly_shown("head") is None  # never measured
    assert _state(monkeypatch, table, model="another").weakly_shown("left_arm") is None
    assert PromptState(model="compact").weakly_shown("left_arm") is None  # nothing answered yet


def test_the_walk_that_the_program_begins_with_has_no_marks_until_its_words_are_changed(monkeypatch) -> None:
    state = _state(monkeypatch, {("arm", "hanging"): 0.1, ("arm", "waving"): 0.2})
    edited = WORDS.replace("left_arm", "waving")
    for words, share in ((WORDS, None), (edited, 0.2)):
        answer = Answer(DEFAULT_PROMPT, WORDS, words, np.zeros((6, 64), np.float32))
        state.edit = PromptBlend((answer, None))
        assert state.weakly_shown("left_arm") == share
        assert state.weakly_shown("right_arm") is None
