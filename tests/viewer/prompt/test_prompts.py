"""The real application without a display: prompts typed, answered, edited, locked and undone."""

import time

import numpy as np

from runtime.session.prompt_blend import Side
from runtime.skeleton import PART_NAMES
from tests.helpers import hand
from tests.helpers.app_driver import (
    Start,
    click,
    click_on,
    click_prompt_box,
    controller,
    do,
    message,
    press,
    prompt,
    run,
    run_until,
    type_in,
    type_prompt,
    typing,
    words,
)
from viewer.app import App


# --- typing
def test_typing_fills_the_prompt_and_never_drives(app: App) -> None:
    click_prompt_box(app)
    app.window.inject_key("w", True)
    hand.text(app.window, "w")
    app.window.inject_key("w", False)
    type_in(app, "addling duck ")
    assert controller(app).z == 0.0
    assert "waddling duck" in app.prompting.boxes[Side.A].text
    press(app, "enter")
    assert "waddling duck" in prompt(app)
    assert "waddling duck" in app.prompting.parts["head"]
    assert app.editor.session.live.prompt.a.source == "library"
    assert controller(app).styles[-1][1] == app.settings.blend_seconds
    assert "waddling duck" in message(app)  # the status line says who answered
    assert "90%" in message(app)
    app.window.inject_key("w", True)  # Enter left the field
    run(app, 2)
    assert controller(app).z > 0.0


def test_a_prompt_that_cannot_be_used_keeps_the_style(start: Start) -> None:
    app = start(prompt="a proud king")
    run(app)
    styles = len(controller(app).styles)
    do(app, "prompt    ; run 1")
    assert "empty" in message(app)
    assert prompt(app) == "a proud king"
    assert len(controller(app).styles) == styles


def test_enter_changes_the_style_at_the_next_simulated_frame(app: App) -> None:
    app.prompting.blocking = False  # as on a screen
    run(app, 3)
    type_prompt(app, "proud")
    steps, styles = controller(app).steps, len(controller(app).styles)
    app.window.inject_key("enter", True)
    run(app)  # Enter is seen when the panels of this frame are drawn, after its step
    assert (controller(app).steps, len(controller(app).styles)) == (steps + 1, styles)
    run(app)  # the answer is there: this frame takes it before its step
    assert (controller(app).steps, len(controller(app).styles)) == (steps + 2, styles + 1)
    assert controller(app).styled_at_step == steps + 1
    assert prompt(app) == "proud"


def test_enter_changes_the_shipped_models_style_at_the_next_frame_after_the_answer(start: Start) -> None:
    """The real networks and the real worker thread: the frame that finds the answer steps in the new style."""
    from runtime.motion.controller import Controller
    from viewer.services import load_model

    app = start(services={"load_model": load_model}, prompt="a person walking normally")
    app.prompting.blocking = app.jobs.blocking = False
    run_until(app, lambda: app.editor.session.live.prompt.a is not None)
    run(app, 90)  # the first style has come in
    walker, worker = app.scene.simulation.controller, app.prompting.workers[Side.A]
    assert isinstance(walker, Controller)
    before = walker.style.z.copy()
    type_prompt(app, "a drunk person stumbling home")
    app.window.inject_key("enter", True)
    run(app)
    assert app.prompting.pending == {Side.A}
    assert np.array_equal(walker.style.z, before)
    while worker.busy:
        time.sleep(0.001)
    run(app)
    assert not np.array_equal(walker.style.z, before)
    answer = app.editor.session.live.prompt.a
    assert answer.prompt == "a drunk person stumbling home"
    assert answer.milliseconds > 0.0


# --- the six fields
def test_a_field_goes_back_to_what_was_said_when_it_is_reset_or_emptied(app: App) -> None:
    said = words(app)["torso"]
    for empty in (False, True):
        app.prompting.parts["torso"] = "torso twisting"
        app.prompting.submit_part("torso")
        assert words(app)["torso"] == "torso twisting"
        if empty:
            app.prompting.parts["torso"] = "  "
            app.prompting.submit_part("torso")
        else:
            app.prompting.reset_part("torso")
        assert words(app)["torso"] == app.prompting.parts["torso"] == said
        assert app.editor.session.live.prompt.a.edited == ()


def test_a_field_is_applied_when_it_is_left(app: App) -> None:
    click_on(app, "##words", len(PART_NAMES) - 1)
    type_in(app, " slowly")
    assert words(app)["head"] != app.prompting.parts["head"]
    click(app, app.window.size[0] / 2, app.window.size[1] / 2)  # the scene
    run(app)
    assert "slowly" in words(app)["head"]


# --- undo
def test_undo_in_a_field_takes_typing_back_first(start: Start) -> None:
    app = start(prompt="a proud king")
    do(app, "run 1; prompt a duck")
    type_prompt(app, "goose")
    press(app, "ctrl", "z")
    assert prompt(app) == "a duck"  # the field's own undo
    assert typing(app)
    do(app, "key escape; key escape")
    click_prompt_box(app)
    press(app, "ctrl", "z")  # nothing was typed
    run(app)
    assert prompt(app) == app.prompting.boxes[Side.A].text == "a proud king"


def test_words_typed_since_survive_an_undo(start: Start) -> None:
    app = start(prompt="a proud king")
    do(app, "run 1; prompt a duck")
    app.prompting.boxes[Side.A].text = "a duck that"
    app.editor.undo()
    assert (prompt(app), app.prompting.boxes[Side.A].text) == ("a proud king", "a duck that")
