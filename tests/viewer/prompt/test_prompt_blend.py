"""What the viewer knows of prompts without a window: suggestions, blends as plain data, and the end of the history."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from runtime.prompts.blend import ALL_A
from runtime.prompts.parts import PartDescriptions
from runtime.session.prompt_blend import Answer, PromptBlend
from runtime.skeleton import PART_NAMES
from viewer.prompt.suggestions import MAX_HISTORY, MAX_SUGGESTIONS, matching, remember, suggest

SAID = PartDescriptions(*(f"{part} swinging" for part in PART_NAMES))
PROMPTS = ("a proud king", "proud peacock", "an old king", "someone limping on the right leg")


def answer(prompt: str = "a proud king", value: float = 1.0, **changes: object) -> Answer:
    z = np.full((6, 64), value, np.float32)
    return dataclasses.replace(Answer(prompt, SAID, SAID, z, "library"), **changes)  # type: ignore[arg-type]


# --- suggestions
def test_prompts_that_begin_so_come_before_those_with_the_words() -> None:
    assert matching("pro", PROMPTS) == ["proud peacock", "a proud king"]
    assert matching("Right  LEG", PROMPTS) == ["someone limping on the right leg"]
    assert matching("leg right", PROMPTS) == ["someone limping on the right leg"]  # in any order
    assert matching("ing", PROMPTS) == []  # words are matched from their beginning
    assert matching("xyz", PROMPTS) == []


def test_suggestions_are_own_then_matching_then_alike_without_doubles() -> None:
    near = (("goose step", 0.31), ("Proud  Peacock", 0.9), ("a duck", 0.7), ("far away", 0.1))
    found = suggest("pro", PROMPTS, ("proud of it", "other"), near)
    assert [(s.text, s.recent, s.similarity) for s in found] == [
        ("proud of it", True, None),
        ("proud peacock", False, None),
        ("a proud king", False, None),
        ("a duck", False, 0.7),
        ("goose step", False, 0.31),
    ]
    assert "a proud king" not in [s.text for s in suggest("A proud king", PROMPTS)]
    crowded = suggest("walk", [f"walk {i}" for i in range(30)], (), near)
    assert len(crowded) == MAX_SUGGESTIONS
    assert crowded[-1].similarity is not None  # what means the like keeps a place


def test_nothing_typed_suggests_the_last_prompts() -> None:
    history = [f"prompt {i}" for i in range(20)]
    found = suggest("  ", PROMPTS, history)
    assert [s.text for s in found] == history[:MAX_SUGGESTIONS]
    assert all(s.recent for s in found)


@given(st.lists(st.sampled_from(["a", "b", "B", " c  d ", "C D", ""]) | st.text(max_size=4)))
def test_the_history_has_no_doubles_and_an_end(prompts: list[str]) -> None:
    history: list[str] = []
    for text in prompts * 12:
        history = remember(history, text)
        assert len(history) <= MAX_HISTORY
        assert len({" ".join(h.casefold().split()) for h in history}) == len(history)
        if text.split():
            assert history[0] == " ".join(text.split())


# --- edits
def test_the_master_weight_moves_what_is_not_locked() -> None:
    edit = PromptBlend((answer(), answer("b", 3.0)), ALL_A, frozenset({"head"}))
    moved = edit.with_all_weights(0.5).with_weight("torso", 1.0)
    assert moved.weights == (0.5, 0.5, 0.5, 0.5, 1.0, 0.0)
    assert moved.master_weight == pytest.approx(0.6)
    mix = moved.style()
    parts = sum(share * z[:, 0] for share, z in zip(mix.weights, mix.codes, strict=True))
    assert np.allclose(parts, [2.0, 2.0, 2.0, 2.0, 3.0, 1.0])
    everything = dataclasses.replace(edit, locked=frozenset(PART_NAMES))
    assert everything.with_all_weights(1.0).weights == ALL_A
    assert everything.master_weight == 0.0


def test_kept_parts_go_on_with_their_words_and_codes() -> None:
    other = PartDescriptions(*(f"{part} hanging" for part in PART_NAMES))
    before, new = answer(), answer("drunk", 2.0, words=other, said=other)
    kept = new.keeping({"left_arm", "head"}, before)
    assert kept.words == other.replace("left_arm", SAID.left_arm).replace("head", SAID.head)
    assert kept.z[:, 0].tolist() == [1.0, 2.0, 2.0, 2.0, 2.0, 1.0]
    assert kept.z.dtype == np.float32
    assert (kept.prompt, kept.said, kept.edited) == ("drunk", other, ("left_arm", "head"))
    assert new.keeping((), before) is new
