"""The real application without a display: suggestions while a prompt is typed, and the history of prompts."""

import threading

from runtime.session.prompt_blend import Side
from tests.helpers.app_driver import (
    Start,
    click_on,
    controller,
    do,
    press,
    prompt,
    run,
    run_until,
    type_in,
    type_prompt,
    typing,
)
from tests.helpers.shipped import shipped_library
from tests.helpers.viewer_fakes import FakeLibrary
from viewer.app import App
from viewer.settings import load_settings, save_settings


def test_suggestions_show_while_typing_and_are_taken_by_keys(app: App) -> None:
    styles = len(controller(app).styles)
    type_prompt(app, "prou")
    box = app.prompting.boxes[Side.A]
    assert box.suggesting
    found = [s.text for s in app.prompt.suggester.suggestions(box)]
    # begins so, has a word that begins so, means the like
    assert found == ["proud peacock", "a proud king", "waddling duck", "goose step"]
    do(app, "key down; key down; key up")
    assert box.picked == 0
    press(app, "tab")
    assert (box.text, box.suggesting, typing(app)) == ("proud peacock", False, True)
    assert len(controller(app).styles) == styles  # taken into the field, not yet asked
    type_in(app, ", head down")
    assert box.text == "proud peacock, head down"
    press(app, "enter")
    assert prompt(app) == "proud peacock, head down"


def test_enter_on_a_suggestion_asks_for_it(app: App) -> None:
    type_prompt(app, "king")
    do(app, "key down; key down; key enter")
    assert prompt(app) == "an old king"
    assert app.prompting.boxes[Side.A].text == "an old king"
    assert not typing(app)


def test_escape_closes_the_list_and_then_leaves_the_field(start: Start) -> None:
    app = start(prompt="a proud king")
    run(app, 2)
    type_prompt(app, "limp")
    press(app, "escape")
    assert (app.prompting.boxes[Side.A].suggesting, app.prompting.boxes[Side.A].text) == (False, "limp")
    assert typing(app)
    press(app, "escape")
    assert not typing(app)
    assert app.prompting.boxes[Side.A].text == "a proud king"  # as before it was entered


def test_a_suggestion_is_taken_by_the_mouse(app: App) -> None:
    type_prompt(app, "prou")
    click_on(app, "##1")  # the second line
    assert prompt(app) == "a proud king"
    assert not app.prompting.boxes[Side.A].suggesting


def test_the_button_stays_in_reach_while_the_list_is_open(app: App) -> None:
    type_prompt(app, "prou")
    assert app.prompting.boxes[Side.A].suggesting
    click_on(app, "Apply")
    assert prompt(app) == "prou"
    assert not app.prompting.boxes[Side.A].suggesting


def test_meaning_is_looked_up_on_a_worker_only(app: App) -> None:
    app.jobs.blocking = False
    run(app, 2)
    library = app.language_model.library
    assert isinstance(library, FakeLibrary)
    type_prompt(app, "quack")
    run_until(app, lambda: app.prompting.boxes[Side.A].near_to == "quack")
    assert {text for text, _ in library.looked_up} <= {"qu", "qua", "quac", "quack"}
    assert threading.main_thread().name not in {thread for _, thread in library.looked_up}
    similar = [(s.text, s.similarity) for s in app.prompt.suggester.suggestions(app.prompting.boxes[Side.A])]
    assert similar == list(FakeLibrary.near)


# --- history
def test_the_history_is_recalled_remembered_and_has_no_doubles(app: App) -> None:
    for text in ("one", "two", "One ", "three"):
        app.prompting.submit_prompt(text)
    assert app.settings.prompt_history == ["three", "One", "two"]
    type_prompt(app, "x")
    press(app, "backspace")
    box = app.prompting.boxes[Side.A]
    assert [s.text for s in app.prompt.suggester.suggestions(box)] == ["three", "One", "two"]
    seen = []
    for key in ("up", "up", "up", "up", "down", "down", "down"):
        press(app, key)
        seen.append(box.text)
    assert seen == ["three", "One", "two", "two", "One", "three", ""]
    save_settings(app.settings, app.config)
    assert load_settings(app.config)[0].prompt_history == ["three", "One", "two"]


def test_the_prompt_that_the_program_begins_with_is_no_history(app: App) -> None:
    assert app.settings.prompt_history == []
    app.prompting.submit_prompt("  ")  # nor is one that had no answer
    assert app.settings.prompt_history == []


def test_the_shipped_library_is_what_is_suggested() -> None:
    from viewer.services import library_prompts

    ready, prompts = library_prompts()
    assert {text.casefold() for text in ready} <= {text.casefold() for text in prompts}
    assert len(prompts) > 200
    assert len({prompt.casefold() for prompt in prompts}) == len(prompts)
    near = shipped_library().nearest("somebody tipsy")
    assert len(near) >= 3
    assert {text for text, _ in near} <= set(prompts)
    assert [similarity for _, similarity in near] == sorted((s for _, s in near), reverse=True)
    assert near[0][1] > 0.5
