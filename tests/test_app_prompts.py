"""The real application without a display: prompts typed, suggested, recalled, edited, locked and undone."""

from __future__ import annotations

import json
import threading
from pathlib import Path

import numpy as np
import pytest
from app_driver import (
    Start,
    click,
    click_prompt_box,
    controller,
    message,
    press,
    run,
    run_until,
    type_prompt,
    typing,
)
from viewer_fakes import FakeEncoder, FakeLibrary

from runtime.prompts.blend import read_words
from runtime.prompts.parts import PartDescriptions
from runtime.skeleton import PART_NAMES
from viewer.app import App
from viewer.settings import load_settings, save_settings


def words(app: App) -> dict[str, str]:
    """The descriptions the character moves by."""
    answer = app.state.prompt.edit.a
    assert answer is not None
    return answer.words.to_mapping()


def prompt(app: App) -> str:
    answer = app.state.prompt.edit.a
    return "" if answer is None else answer.prompt


def style(app: App) -> np.ndarray:
    return controller(app).styles[-1][0]


# typing


def test_typing_fills_the_prompt_and_never_drives(start: Start) -> None:
    app = start()
    run(app, 2)
    click_prompt_box(app)
    app.window.inject_key("w", True)
    app.window.inject_text("w")
    app.window.inject_key("w", False)
    app.window.inject_text("addling duck ")
    run(app, 3)
    assert controller(app).z == 0.0
    assert "waddling duck" in app.state.prompt.box.text
    press(app, "enter")
    run(app, 2)
    assert "waddling duck" in prompt(app)
    assert "waddling duck" in app.state.prompt.parts["head"]
    assert app.state.prompt.edit.a.source == "library"
    assert controller(app).styles[-1][1] == app.state.settings.blend_seconds
    assert "waddling duck" in message(app)  # the status line says who answered
    assert "90%" in message(app)
    app.window.inject_key("w", True)  # Enter left the field
    run(app, 2)
    assert controller(app).z > 0.0


def test_a_prompt_that_cannot_be_used_keeps_the_style(start: Start) -> None:
    app = start(prompt="a proud king")
    run(app)
    styles = len(controller(app).styles)
    app.prompting.submit_prompt("   ")
    run(app)
    assert "empty" in message(app)
    assert prompt(app) == "a proud king"
    assert len(controller(app).styles) == styles


def test_enter_changes_the_style_at_the_next_simulated_frame(start: Start) -> None:
    app = start()
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


# suggestions


def test_suggestions_show_while_typing_and_are_taken_by_keys(start: Start) -> None:
    app = start()
    run(app, 2)
    styles = len(controller(app).styles)
    type_prompt(app, "prou")
    box = app.state.prompt.box
    assert box.suggesting
    found = [s.text for s in app.suggester.suggestions(box)]
    # begins so, has a word that begins so, means the like
    assert found == ["proud peacock", "a proud king", "waddling duck", "goose step"]
    press(app, "down")
    press(app, "down")
    press(app, "up")
    assert box.picked == 0
    press(app, "tab")
    assert (box.text, box.suggesting, typing(app)) == ("proud peacock", False, True)
    assert len(controller(app).styles) == styles  # taken into the field, not yet asked
    app.window.inject_text(", head down")
    run(app, 2)
    assert box.text == "proud peacock, head down"
    press(app, "enter")
    assert prompt(app) == "proud peacock, head down"


def test_enter_on_a_suggestion_asks_for_it(start: Start) -> None:
    app = start()
    run(app, 2)
    type_prompt(app, "king")
    press(app, "down")
    press(app, "down")
    press(app, "enter")
    run(app)
    assert prompt(app) == "an old king"
    assert app.state.prompt.box.text == "an old king"
    assert not typing(app)


def test_escape_closes_the_list_and_then_leaves_the_field(start: Start) -> None:
    app = start(prompt="a proud king")
    run(app, 2)
    type_prompt(app, "limp")
    press(app, "escape")
    assert (app.state.prompt.box.suggesting, app.state.prompt.box.text) == (False, "limp")
    assert typing(app)
    press(app, "escape")
    run(app)
    assert not typing(app)
    assert app.state.prompt.box.text == "a proud king"  # as before it was entered


def test_a_suggestion_is_taken_by_the_mouse(start: Start) -> None:
    app = start()
    run(app, 2)
    type_prompt(app, "prou")
    box_bottom = 96  # of the field, pixels
    click(app, 160, box_bottom + 5 + 23 + 12)  # the second line
    assert prompt(app) == "a proud king"
    assert not app.state.prompt.box.suggesting


def test_meaning_is_looked_up_on_a_worker_only(start: Start) -> None:
    app = start()
    app.jobs.blocking = False
    run(app, 2)
    library = app.expanders.library
    assert isinstance(library, FakeLibrary)
    type_prompt(app, "quack")
    run_until(app, lambda: app.state.prompt.box.near_to == "quack")
    assert {text for text, _ in library.looked_up} <= {"qu", "qua", "quac", "quack"}
    assert threading.main_thread().name not in {thread for _, thread in library.looked_up}
    similar = [(s.text, s.similarity) for s in app.suggester.suggestions(app.state.prompt.box)]
    assert similar == list(FakeLibrary.near)


# history


def test_the_history_is_recalled_remembered_and_has_no_doubles(start: Start) -> None:
    app = start()
    run(app, 2)
    for text in ("one", "two", "One ", "three"):
        app.prompting.submit_prompt(text)
    assert app.state.settings.prompt_history == ["three", "One", "two"]
    type_prompt(app, "x")
    press(app, "backspace")
    box = app.state.prompt.box
    assert [s.text for s in app.suggester.suggestions(box)] == ["three", "One", "two"]
    seen = []
    for key in ("up", "up", "up", "up", "down", "down", "down"):
        press(app, key)
        seen.append(box.text)
    assert seen == ["three", "One", "two", "two", "One", "three", ""]
    save_settings(app.state.settings, app.config)
    assert load_settings(app.config)[0].prompt_history == ["three", "One", "two"]


def test_the_prompt_that_the_program_begins_with_is_no_history(start: Start) -> None:
    app = start()
    run(app)
    assert app.state.settings.prompt_history == []
    app.prompting.submit_prompt("  ")  # nor is one that had no answer
    assert app.state.settings.prompt_history == []


# the six fields


def test_an_edited_part_is_encoded_again(start: Start) -> None:
    app = start()
    run(app)
    styles = len(controller(app).styles)
    app.state.prompt.parts["left_arm"] = "left arm raised"
    app.prompting.submit_part("left_arm")
    run(app)
    assert len(controller(app).styles) == styles + 1
    assert style(app)[0] == pytest.approx(FakeEncoder.code("left arm raised"))
    assert app.state.prompt.edit.a.edited == ("left_arm",)
    assert app.state.prompt.edit.a.source == "library"  # the other five are still its
    app.state.prompt.parts["left_arm"] = "x" * 400
    app.prompting.submit_part("left_arm")
    assert "left_arm" in message(app)
    assert len(controller(app).styles) == styles + 1


def test_a_field_goes_back_to_what_was_said_when_it_is_reset_or_emptied(start: Start) -> None:
    app = start()
    run(app)
    said = words(app)["torso"]
    for empty in (False, True):
        app.state.prompt.parts["torso"] = "torso twisting"
        app.prompting.submit_part("torso")
        assert words(app)["torso"] == "torso twisting"
        if empty:
            app.state.prompt.parts["torso"] = "  "
            app.prompting.submit_part("torso")
        else:
            app.prompting.reset_part("torso")
        assert words(app)["torso"] == app.state.prompt.parts["torso"] == said
        assert app.state.prompt.edit.a.edited == ()


def test_a_field_is_applied_when_it_is_left(start: Start) -> None:
    app = start()
    run(app, 3)
    click(app, 160, 640)  # the last field
    app.window.inject_text(" slowly")
    run(app, 3)
    assert words(app)["head"] != app.state.prompt.parts["head"]
    click(app, 640, 400)  # the scene
    run(app)
    assert "slowly" in words(app)["head"]


def test_locked_fields_survive_the_next_prompt(start: Start, tmp_path: Path) -> None:
    app = start()
    run(app)
    app.state.prompt.parts["head"] = "head shaking"
    app.prompting.submit_part("head")
    app.prompting.toggle_lock("head")
    app.prompting.submit_prompt("a proud king")
    assert words(app)["head"] == app.state.prompt.parts["head"] == "head shaking"
    assert words(app)["torso"] == "torso of a proud king"
    assert style(app)[5] == pytest.approx(FakeEncoder.code("head shaking"))
    app.prompting.reset_part("head")
    assert words(app)["head"] == "head of a proud king"
    app.prompting.toggle_lock("head")
    app.prompting.submit_prompt("a duck")
    assert words(app)["head"] == "head of a duck"


def test_a_take_keeps_what_replays_it(start: Start) -> None:
    app = start(prompt="a proud king")
    run(app, 2)
    app.takes.toggle_recording()
    run(app, 2)
    app.state.prompt.parts["head"] = "head shaking"
    app.prompting.submit_part("head")
    run(app, 2)
    app.prompting.submit_prompt("a duck")
    run(app, 2)
    app.takes.toggle_recording()
    run(app)
    events = app.state.clips.items[0].clip.prompts
    king = FakeLibrary().expand("a proud king").descriptions
    kept = [read_words(event.prompt) for event in events]
    assert kept == ["a proud king", king.replace("head", "head shaking"), "a duck"]
    assert [round(event.seconds * 60) for event in events] == [0, 2, 4]


# undo


def test_undo_and_redo_of_prompts_edits_and_locks(start: Start) -> None:
    app = start(prompt="a proud king")
    run(app)
    states = [(words(app), frozenset(), style(app))]
    app.prompting.submit_prompt("a duck")
    states.append((words(app), frozenset(), style(app)))
    app.state.prompt.parts["torso"] = "torso twisting"
    app.prompting.submit_part("torso")
    states.append((words(app), frozenset(), style(app)))
    app.prompting.toggle_lock("head")
    states.append((words(app), frozenset({"head"}), style(app)))

    def check(index: int) -> None:
        run(app)
        expected, locked, z = states[index]
        assert words(app) == app.state.prompt.parts == expected
        assert app.state.prompt.edit.locked == locked
        assert np.array_equal(style(app), z)
        assert app.state.prompt.box.text == ("a proud king" if index == 0 else "a duck")

    check(3)
    for index in (2, 1, 0, 0):
        press(app, "ctrl", "z")
        check(index)
    for keys, index in ((("ctrl", "y"), 1), (("ctrl", "shift", "z"), 2), (("ctrl", "y"), 3)):
        press(app, *keys)
        check(index)
    press(app, "ctrl", "z")
    app.prompting.submit_prompt("a goose")
    press(app, "ctrl", "y")  # a new step forgets what was undone
    assert prompt(app) == "a goose"


def test_undo_in_a_field_takes_typing_back_first(start: Start) -> None:
    app = start(prompt="a proud king")
    run(app)
    app.prompting.submit_prompt("a duck")
    type_prompt(app, "goose")
    press(app, "ctrl", "z")
    assert prompt(app) == "a duck"  # the field's own undo
    assert typing(app)
    press(app, "escape")
    press(app, "escape")
    run(app)
    click_prompt_box(app)
    press(app, "ctrl", "z")  # nothing was typed
    run(app)
    assert prompt(app) == app.state.prompt.box.text == "a proud king"


def test_undo_withdraws_a_prompt_without_an_answer(start: Start) -> None:
    app = start(prompt="a proud king")
    app.prompting.blocking = False
    run(app, 2)
    worker = app.prompting._questions["a"].worker
    worker.held = True
    app.prompting.submit_prompt("a duck")
    run(app, 2)
    assert app.state.prompt.asked == {"a"}
    press(app, "ctrl", "z")
    assert "Withdrawn" in message(app)
    worker.held = False
    run(app, 3)
    assert prompt(app) == app.state.prompt.box.text == "a proud king"
    assert not app.state.prompt.asked


def test_words_typed_since_survive_an_undo(start: Start) -> None:
    app = start(prompt="a proud king")
    run(app)
    app.prompting.submit_prompt("a duck")
    app.state.prompt.box.text = "a duck that"
    app.prompting.undo()
    assert (prompt(app), app.state.prompt.box.text) == ("a proud king", "a duck that")


# blending


def test_a_blend_moves_each_part_by_its_share(start: Start) -> None:
    app = start(prompt="a proud king")
    run(app)
    king, duck = style(app), FakeEncoder().encode(FakeLibrary().expand("a duck").descriptions)
    app.prompting.submit_prompt("a duck", "b")
    assert np.allclose(style(app), (king + duck) / 2)  # half at first, so that it shows
    app.prompting.set_all_weights(0.0)
    app.prompting.set_weight("torso", 1.0)
    app.prompting.set_weight("head", 0.25)
    styles = len(controller(app).styles)
    run(app)
    assert len(controller(app).styles) == styles + 1  # three changes, one fold
    assert np.array_equal(style(app)[:4], king[:4])
    assert np.array_equal(style(app)[4], duck[4])
    assert np.allclose(style(app)[5], 0.75 * king[5] + 0.25 * duck[5])
    run(app, 3)
    assert len(controller(app).styles) == styles + 1  # and none without a change


def test_the_slider_for_all_leaves_locked_parts(start: Start) -> None:
    app = start(prompt="a proud king")
    run(app)
    app.prompting.submit_prompt("a duck", "b")
    app.prompting.toggle_lock("head")
    app.prompting.set_all_weights(1.0)
    assert app.state.prompt.edit.weights == (1.0,) * 5 + (0.5,)
    assert app.state.prompt.edit.master_weight == 1.0


def test_a_blend_is_undone_swapped_dropped_and_kept_in_takes(start: Start) -> None:
    app = start(prompt="a proud king")
    run(app, 2)
    marks: list[str] = []
    app.prompting.mark = marks.append
    app.prompting.submit_prompt("a duck", "b")
    for weight in (0.1, 0.2, 0.3):  # one drag
        app.prompting.set_weight("torso", weight)
        run(app)
    app.prompting.commit("blend of torso")
    blended = style(app)
    kept = read_words(marks[-1])
    assert (kept.a, kept.b, kept.weights) == ("a proud king", "a duck", (0.5, 0.5, 0.5, 0.5, 0.3, 0.5))
    app.prompting.swap()
    run(app)
    assert np.allclose(style(app), blended, atol=1e-4)
    assert (app.state.prompt.box.text, app.state.prompt.other.text) == ("a duck", "a proud king")
    assert words(app)["torso"] == app.state.prompt.parts["torso"] == "torso of a duck"
    press(app, "ctrl", "z")
    press(app, "ctrl", "z")
    assert app.state.prompt.edit.weights == (0.5,) * 6
    press(app, "ctrl", "z")
    run(app)
    assert (app.state.prompt.edit.b, app.state.prompt.other.text) == (None, "")
    press(app, "ctrl", "y")
    assert app.state.prompt.other.text == "a duck"
    app.prompting.drop_blend()
    run(app)
    assert marks[-1] == "a proud king"
    assert not app.state.prompt.edit.blended


def test_the_blend_panel_is_used_by_mouse_and_keys(start: Start) -> None:
    app = start(prompt="a proud king")
    run(app, 3)
    click(app, 135, 227)  # the tab
    click(app, 160, 280)  # prompt B
    app.window.inject_text("a duck")
    run(app, 3)
    press(app, "enter")
    run(app, 2)
    assert app.state.prompt.edit.b is not None
    assert app.state.prompt.edit.b.prompt == "a duck"
    steps = app.prompting.history.undo_label
    app.window.inject_mouse(200, 383, 0, True)  # the slider for all
    run(app, 2)
    for x in (220, 240, 290):
        app.window.inject_mouse(x, 383)
        run(app, 2)
    app.window.inject_mouse(290, 383, 0, False)
    run(app, 2)
    assert app.state.prompt.edit.master_weight > 0.8
    assert (steps, app.prompting.history.undo_label) == ("“a duck”", "blend of all parts")
    press(app, "ctrl", "z")  # the drag is one step
    assert app.state.prompt.edit.weights == (0.5,) * 6


def test_gone_words_do_not_come_back(start: Start) -> None:
    """An answer to an older request must not overwrite newer words."""
    app = start(prompt="a proud king")
    app.prompting.blocking = False
    run(app, 2)
    worker = app.prompting._questions["a"].worker
    worker.held = True
    app.prompting.submit_prompt("a duck")
    late = worker._result
    app.prompting.submit_prompt("a goose")
    worker._result, newest = late, worker._result
    worker.held = False
    run(app)
    assert prompt(app) == "a proud king"
    worker._result = newest
    run(app)
    assert prompt(app) == "a goose"


def test_the_words_in_force_survive_another_model(start: Start) -> None:
    from viewer_fakes import fake_services

    app = start(prompt="a proud king")
    run(app)
    app.state.prompt.parts["head"] = "head shaking"
    app.prompting.submit_part("head")
    loaded = fake_services().load_model(None, app.state.terrain, 0, None)
    app.scene._take_model(loaded)
    run(app)
    assert words(app)["head"] == "head shaking"
    assert loaded.prompts[0].asked == [PartDescriptions.from_mapping(words(app))]
    assert prompt(app) == "a proud king"
    assert style(app)[PART_NAMES.index("head")] == pytest.approx(FakeEncoder.code("head shaking"))
    assert json.loads(json.dumps(words(app))) == app.state.prompt.parts
