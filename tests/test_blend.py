"""Two prompts mixed by body part: ends are exact, parts independent, and what a take keeps comes back as it was."""

import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from runtime.errors import PromptError
from runtime.prompts.blend import (
    ALL_A,
    ALL_B,
    BlendedPrompt,
    blend_parts,
    check_weights,
    parse_weights,
    read_words,
    write_words,
)
from runtime.prompts.parts import PartDescriptions
from runtime.skeleton import PART_NAMES

settings.register_profile("blend", max_examples=40, deadline=None, derandomize=True)
settings.load_profile("blend")
codes = st.integers(0, 2**32).map(
    lambda seed: 3.0 * np.random.default_rng(seed).standard_normal((6, 64), np.float32)
)
shares = st.sampled_from([0.0, 1.0]) | st.floats(0.0, 1.0)
weights = st.tuples(*[shares] * 6)
PARTS = PartDescriptions(*(f"{part} moves" for part in PART_NAMES))


@given(codes, codes)
def test_the_ends_are_the_prompts_themselves(a, b):
    assert blend_parts(a, b, ALL_A).tobytes() == a.tobytes()
    assert blend_parts(a, b, ALL_B).tobytes() == b.tobytes()


@given(codes, codes, weights, st.integers(0, 5), shares)
def test_a_weight_moves_its_own_part_only(a, b, before, part, share):
    after = (*before[:part], share, *before[part + 1 :])
    old, new = blend_parts(a, b, before), blend_parts(a, b, after)
    others = np.arange(6) != part
    assert np.array_equal(old[others], new[others])
    assert np.allclose(new[part], a[part] + share * (b[part] - a[part]), atol=1e-4)


@given(codes, codes, weights)
def test_a_mix_lies_between_and_its_mirror_is_the_mix_of_the_swapped(a, b, share):
    mixed = blend_parts(a, b, share)
    assert mixed.shape == (6, 64)
    assert mixed.dtype == np.float32
    assert np.all(mixed >= np.minimum(a, b) - 1e-4)
    assert np.all(mixed <= np.maximum(a, b) + 1e-4)
    assert np.allclose(mixed, blend_parts(b, a, tuple(1 - w for w in share)), atol=1e-4)


def test_codes_of_different_models_are_refused():
    with pytest.raises(PromptError, match="shape"):
        blend_parts(np.zeros((6, 64)), np.zeros((6, 32)), ALL_A)
    with pytest.raises(PromptError, match="shape"):
        blend_parts(np.zeros((5, 64)), np.zeros((5, 64)), ALL_A)


def test_weights_are_read_by_part_or_for_all():
    assert parse_weights("left_arm=1, torso = 0.5") == (1.0, 0.0, 0.0, 0.0, 0.5, 0.0)
    assert parse_weights("0.25") == (0.25,) * 6


@pytest.mark.parametrize("text", ["", "tail=1", "torso", "torso=", "torso=2", "torso=-0.1", "torso=nan", "x"])
def test_weights_that_cannot_be_used_show_the_form(text):
    with pytest.raises(PromptError, match=r"Blend weight") as error:
        parse_weights(text)
    assert "left_arm=1,torso=0.5" in error.value.remedy


@pytest.mark.parametrize("value", [True, "1", None, float("inf")])
def test_a_weight_is_a_number(value):
    with pytest.raises(PromptError, match="torso"):
        check_weights({"torso": value})


@given(weights)
def test_what_a_take_keeps_comes_back(share):
    for words in ("a proud king", PARTS, BlendedPrompt("drunk", PARTS, share)):
        assert read_words(write_words(words)) == words


@pytest.mark.parametrize("prompt", ["[1]", "7", '"proud"', "{a brace", "[" * 20_000])
def test_a_prompt_that_looks_like_json_stays_a_prompt(prompt):
    assert read_words(prompt) == prompt


@pytest.mark.parametrize(
    "value",
    [{"a": "x"}, {"a": "x", "b": 1, "weights": {}}, {"a": "x", "b": "y", "weights": [1]},
     {"a": "x", "b": "y", "weights": {"torso": 3}}],
)  # fmt: skip
def test_a_damaged_event_is_named(value):
    with pytest.raises(PromptError):
        read_words(json.dumps(value))
