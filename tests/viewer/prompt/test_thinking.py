"""The real application without a display: what is changed while a language model on loopback still thinks."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from runtime.prompts.parts import PartDescriptions
from runtime.session.prompt_blend import Side
from tests.helpers.app_driver import run, run_until, style, words
from tests.helpers.slow_model import ANSWER, Model, source
from tests.helpers.viewer_fakes import FakeEncoder, FakeLibrary
from viewer.app import App

KING, DUCK = (FakeLibrary().expand(prompt).descriptions for prompt in ("a proud king", "a duck"))

# a blend


def blending(asking: Callable[[], App], model: Model) -> App:
    """The library has answered prompt B and its slider was moved, the language model has been asked."""
    app = asking()
    app.prompting.submit_prompt("a duck", Side.B)
    run_until(app, lambda: app.editor.session.live.prompt.b is not None and bool(model.asked))
    app.prompting.set_all_weights(0.8)
    return app


def test_a_blend_moved_while_the_language_model_thinks_is_a_step_of_its_own(
    asking: Callable[[], App], model: Model
) -> None:
    app = blending(asking, model)
    run(app)
    app.prompting.set_all_weights(0.0)
    assert app.editor.dragging
    model.released.set()
    run_until(app, lambda: not app.prompting.pending)

    def check(weight: float) -> None:
        edit = app.editor.session.live.prompt
        assert edit.weights == (weight,) * 6
        assert edit.b is not None
        assert (edit.b.source, edit.b.words) == ("gpt", ANSWER)
        assert np.array_equal(edit.b.z, FakeEncoder().encode(ANSWER))

    check(0.0)
    assert app.editor.undo_label == "blend of all parts"
    for weight in (0.8, 0.5):
        app.editor.undo()
        check(weight)
    app.editor.undo()
    assert app.editor.session.live.prompt.b is None
    for weight in (0.5, 0.8, 0.0):
        app.editor.redo()
        check(weight)


# a lock set or released meanwhile


def thinking(asking: Callable[[], App], model: Model, locked: str = "") -> App:
    """The library has answered "a duck", the language model has been asked."""
    app = asking()
    if locked:
        app.prompting.toggle_lock(locked)
    app.prompting.submit_prompt("a duck")
    run_until(app, lambda: source(app) == ("a duck", "library") and bool(model.asked))
    return app


def finish(app: App, model: Model) -> None:
    model.released.set()
    run_until(app, lambda: not app.prompting.pending)


def check_words(app: App, expected: PartDescriptions, *locked: str) -> None:
    """What holds, in all the places where it shows."""
    run(app)
    assert PartDescriptions.from_mapping(words(app)) == expected
    assert app.prompting.parts == expected.to_mapping()
    assert app.editor.session.live.prompt.locked == set(locked)
    assert np.array_equal(style(app), FakeEncoder().encode(expected))


def test_a_part_locked_while_the_language_model_thinks_keeps_its_words(
    asking: Callable[[], App], model: Model
) -> None:
    app = thinking(asking, model)
    app.prompting.toggle_lock("left_arm")
    finish(app, model)
    kept = ANSWER.replace("left_arm", DUCK.left_arm)
    check_words(app, kept, "left_arm")
    assert source(app) == ("a duck", "gpt")
    app.prompting.reset_part("left_arm")  # what the language model said is known
    run_until(app, lambda: not app.prompting.pending)
    check_words(app, ANSWER)
    app.editor.undo()
    check_words(app, kept, "left_arm")
    app.editor.undo()
    check_words(app, ANSWER)
    app.editor.undo()
    check_words(app, KING)
    for expected, locked in ((ANSWER, ()), (kept, ("left_arm",))):
        app.editor.redo()
        check_words(app, expected, *locked)


def test_undo_of_a_prompt_gives_up_the_language_model(asking: Callable[[], App], model: Model) -> None:
    app = thinking(asking, model)
    app.prompting.toggle_lock("left_arm")
    app.editor.undo()
    app.editor.undo()
    check_words(app, KING)
    assert not app.prompting.pending
    model.released.set()
    run(app, 20)
    check_words(app, KING)
