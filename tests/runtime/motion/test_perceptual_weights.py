"""Blends whose change is even: shares of a pair of styles are measured, kept, and used by sliders and commands."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from runtime.motion import perceptual_weights
from runtime.motion.style import LINEAR, StyleMix, even_weights, turned_round
from runtime.prompts.blend import BlendedPrompt
from runtime.prompts.prompter import Prompter
from runtime.session.prompt_blend import Side
from tests.helpers.app_driver import run
from tests.helpers.shipped import shipped_model, shipped_prompter
from viewer.app import App

ONE = st.floats(0.0, 1.0)
RISING = st.lists(ONE, min_size=1, max_size=11).map(lambda inner: (0.0, *sorted(inner), 1.0))


@given(RISING, ONE, ONE)
def test_weights_keep_their_order_and_ends(shares: tuple[float, ...], low: float, high: float) -> None:
    low, high = sorted((low, high))
    first, below, above, last = even_weights(shares, (0.0, low, high, 1.0))
    assert (first, last) == (0.0, 1.0)
    assert 0.0 <= below <= above <= 1.0
    np.testing.assert_allclose(even_weights(LINEAR, (low, high)), (low, high))


@given(RISING, ONE)
def test_the_other_way_round_is_the_same_mix(shares: tuple[float, ...], weight: float) -> None:
    (there,) = even_weights(shares, (weight,))
    (back,) = even_weights(turned_round(shares), (1.0 - weight,))
    assert there + back == pytest.approx(1.0, abs=1e-9) or len(set(shares)) < len(shares)


def test_six_steps_of_a_measured_blend_are_nearly_equal(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(perceptual_weights, "LEAD_IN_FRAMES", 30)
    monkeypatch.setattr(perceptual_weights, "FRAMES", 60)
    walked, walks = [], perceptual_weights.walks
    monkeypatch.setattr(perceptual_weights, "walks", lambda *given: walked.append(walks(*given)) or walked[0])
    model = shipped_model()
    to_style = shipped_prompter()
    ends = to_style("a person walking normally"), to_style("an old man")
    shares = perceptual_weights.perceptual_weights(model, *ends)
    assert len(shares) == perceptual_weights.WALKERS

    def largest(walks: np.ndarray) -> float:
        steps = np.linalg.norm(np.diff(walks, axis=0), axis=1)
        return float(steps.max() / steps.sum())

    even = even_weights(shares, [k / 6 for k in range(7)])
    measured = largest(walks(model, [StyleMix((1.0 - w, w), ends) for w in even]))  # a sixth is even
    assert measured < 0.25
    assert measured < 0.8 * largest(walked[0][::2])  # sixths as they are


def test_a_prompter_measures_a_pair_once(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[int] = []

    def measured(*_: object) -> tuple[float, ...]:
        asked.append(1)
        return (0.0, 0.9, 1.0)

    monkeypatch.setattr("runtime.prompts.prompter.perceptual_weights", measured)
    to_style = Prompter(shipped_model())
    blend = BlendedPrompt("a zombie", "an old man", (0.5,) * 6)
    assert to_style(blend).weights == pytest.approx((0.9, 0.1))
    to_style(dataclasses.replace(blend, weights=(0.25,) * 6))
    assert len(asked) == 1
    to_style(BlendedPrompt("a zombie", "a proud king", (1.0, 0.0, 0.0, 0.0, 0.0, 0.0)))
    assert len(asked) == 1  # no part is of both


def test_a_slider_becomes_even_while_the_character_walks(app: App) -> None:
    asked: list[tuple[object, object]] = []

    def measure(a: object, b: object) -> tuple[float, ...]:
        asked.append((a, b))
        return (0.0, 0.8, 1.0)

    app.prompting.measure_blends(measure)
    app.prompting.submit_prompt("a zombie")
    run(app, 2)
    app.prompting.submit_prompt("a king", Side.B)
    run(app, 4)
    edit = app.editor.session.live.prompt
    assert edit.shares == (0.0, 0.8, 1.0)
    style = edit.style()
    assert isinstance(style, StyleMix)
    assert style.weights == pytest.approx((0.8, 0.2))
    app.prompting.swap()
    assert app.editor.session.live.prompt.shares == pytest.approx((0.0, 0.2, 1.0))
    app.editor.undo()
    assert app.editor.session.live.prompt.shares == (0.0, 0.8, 1.0)
    run(app, 4)
    assert len(asked) == 1
