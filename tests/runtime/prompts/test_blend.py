"""Two prompts mixed by body part: ends are exact, parts independent, and what a take keeps comes back as it was."""

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import runtime.generate as generate_module
from runtime.errors import PromptError
from runtime.motion.style import Style, StyleFolder
from runtime.prompts.blend import (
    ALL_A,
    BlendedPrompt,
    check_weights,
    mix_of_parts,
    parse_weights,
    read_words,
    write_words,
)
from runtime.prompts.parts import PartDescriptions
from runtime.prompts.prompter import Prompter
from runtime.skeleton import PART_NAMES
from runtime.takes.metadata import PromptEvent
from sport import cli
from tests.helpers.walker import WalkerModel, generate_by_walker

seeds = st.integers(0, 2**32)
codes = seeds.map(lambda seed: 3.0 * np.random.default_rng(seed).standard_normal((6, 64), np.float32))
shares = st.sampled_from([0.0, 1.0]) | st.floats(0.0, 1.0)
weights = st.tuples(*[shares] * 6)
PARTS = PartDescriptions(*(f"{part} moves" for part in PART_NAMES))


def code_of(mix):
    """Mean code of a mix: what it stands for, part by part."""
    return sum(np.float32(share) * z for share, z in zip(mix.weights, mix.codes, strict=True))


@given(codes, codes)
def test_the_ends_are_the_prompts_themselves(a, b):
    for weights, z in ((ALL_A, a), ((1.0,) * 6, b)):
        mix = mix_of_parts(a, b, weights)
        assert mix.weights == (1.0,)
        assert mix.codes[0].tobytes() == z.tobytes()


@given(codes, codes, weights)
def test_each_part_has_its_own_share_of_b(a, b, share):
    mix = mix_of_parts(a, b, share)
    assert sum(mix.weights) == pytest.approx(1.0)
    assert min(mix.weights) > 0.0
    assert len(mix.weights) <= 7
    w = np.array(share, np.float32)[:, None]
    assert np.allclose(code_of(mix), (1 - w) * a + w * b, atol=1e-4)
    for z in mix.codes:  # whole parts only
        assert np.all(np.all(z == a, axis=1) | np.all(z == b, axis=1))


def test_equal_weights_are_the_straight_line_between_the_folded_styles():
    a, b = np.zeros((6, 64), np.float32), np.ones((6, 64), np.float32)

    def fold(z, strength):  # a switch, as the network's own gating is
        weight = np.full((2, 2), float(z.mean() > 0.5), np.float32)
        return Style(z, weight, weight, weight, 1.0 + z.mean(), 3.0)

    folder = StyleFolder(fold, 1.0)
    for share in (0.0, 0.25, 0.5, 0.75, 1.0):
        style = folder.fold(mix_of_parts(a, b, (share,) * 6))
        assert np.allclose(style.content_weight, share)
        assert style.walk_speed == pytest.approx(1.0 + share)


def test_codes_of_different_models_are_refused():
    with pytest.raises(PromptError, match="shape"):
        mix_of_parts(np.zeros((6, 64)), np.zeros((6, 32)), ALL_A)
    with pytest.raises(PromptError, match="shape"):
        mix_of_parts(np.zeros((5, 64)), np.zeros((5, 64)), ALL_A)


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


# --- the command
def style_of(words):
    """A stand-in for the prompt encoder: other words, another Z^t."""
    return np.full((6, 64), (sum(map(ord, write_words(words))) % 100) / 200.0, np.float32)


class StandIn(Prompter):
    """A prompter whose codes are those of `style_of`, and whose blends nobody measured."""

    def __init__(self, *_):
        pass

    def _blend(self, a, b, weights):
        return mix_of_parts(a, b, weights)

    def _read(self, words, exact_legs=False):
        return PARTS, style_of(words)


@pytest.fixture
def walker(monkeypatch):
    generate_by_walker(monkeypatch, StandIn)


def test_generate_blends(walker, tmp_path):
    def written(*arguments):
        out = tmp_path / "clip.bvh"
        assert cli.main(["generate", *arguments, "--seconds", "0.3", "--out", str(out)]) == 0
        return out.read_bytes()

    proud, drunk = written("--prompt", "proud"), written("--prompt", "drunkard")
    both = ("--prompt", "proud", "--blend", "drunkard")
    assert proud != drunk
    assert written(*both, "--blend-weights", "0") == proud
    assert written(*both, "--blend-weights", "1") == drunk
    even = written(*both)
    assert even not in (proud, drunk)
    assert written(*both, "--blend-weights", "torso=1") not in (proud, drunk, even)


def test_the_events_of_a_take_make_its_style_again(walker):
    """What the viewer kept of a prompt, of edited words and of a blend is what `generate` is given."""
    blended = BlendedPrompt("proud", PARTS, (0.0, 0.0, 0.0, 0.0, 1.0, 0.25))
    kept = (PromptEvent(0.0, write_words(blended)),)
    mix = mix_of_parts(style_of("proud"), style_of(PARTS), blended.weights)
    made = StandIn()(read_words(kept[0].prompt))
    assert made.weights == mix.weights
    assert np.array_equal(made.codes, mix.codes)
    assert generate_module.generate_clip(blended, seconds=0.1).prompts == kept


@pytest.mark.parametrize(
    ("arguments", "told"),
    [(["--blend-weights", "1"], "--blend"), (["--blend", "drunk", "--blend-weights", "tail=1"], "tail"),
     (["--blend", " "], "empty"), (["--prompts", "0:a", "--blend", "drunk"], "--blend")],
)  # fmt: skip
def test_a_blend_that_cannot_be_made_is_one_sentence(walker, tmp_path, capsys, arguments, told):
    out = tmp_path / "clip.bvh"
    assert cli.main(["generate", *arguments, "--out", str(out)]) == 2
    assert told in capsys.readouterr().err
    assert not out.exists()


# --- the controller
def test_a_style_that_changes_each_frame_is_folded_once_a_frame():
    """As while a slider is dragged."""
    from runtime.controls import Controls
    from runtime.motion.controller import Controller
    from runtime.terrain.height_map import Terrain

    model = WalkerModel()
    folded, fold = [], model.fold_style
    model.fold_style = lambda z, strength: folded.append(z) or fold(z, strength)
    controller = Controller(model, Terrain.flat())
    folded.clear()  # the neutral style
    for i in range(30):
        controller.set_style(np.full((6, 64), 1.0 + i / 30.0), 0.1)
        controller.step(Controls())
        assert len(folded) == i + 1
    for _ in range(10):
        controller.step(Controls())
    assert controller.style.z[0, 0] == pytest.approx(1.0 + 29 / 30)
    assert len(folded) == 30  # a transition folds nothing more
