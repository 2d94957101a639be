"""The real application without a display: who has the keys, the view or a panel, and panels that keep still."""

from pathlib import Path

import pytest

from runtime.session.library import SessionSummary
from tests.helpers import hand
from tests.helpers.app_driver import (
    Start,
    click,
    click_on,
    controller,
    do,
    drawn,
    message,
    place,
    press,
    record,
    run,
    type_key,
    typing,
)
from viewer.app import App
from viewer.gl_bindings import imgui
from viewer.gui.defects import Defect
from viewer.gui.layout import Layout, Rect

LETTERS = "abcdefghijklmnopqrstuvwxyz0123456789"


def panels_of(layout: Layout) -> set[str]:
    return {name for name, rect in vars(layout).items() if rect is not None}


@pytest.mark.parametrize(("size", "scale"), [((1280, 720), 1.0), ((1920, 1080), 1.25), ((800, 500), 0.75)])
def test_panels_keep_still_when_sections_are_unfolded(
    start: Start, size: tuple[int, int], scale: float
) -> None:
    app = start(width=size[0], height=size[1], ui_scale=scale)
    run(app, 3)
    if "Scene" in {label for label, _ in drawn(app)}:  # tabs
        click_on(app, "Scene")
    ground = place(app, "##terrain")
    click(app, ground[0] - 40.0 * scale, ground[1] + 28.0 * scale)  # "Open a file"
    run(app, 2)
    assert "##path" in {label for label, _ in drawn(app)}
    app.path.active = True
    run(app, 3)
    seen = []
    for _ in range(6):
        layout = app.shell._layout
        seen.append((panels_of(layout), [r for r in vars(layout).values() if isinstance(r, Rect)]))
        run(app)
    assert all(now == seen[0] for now in seen)


def type_everything(app: App) -> None:
    """Every letter and digit in one frame."""
    for letter in LETTERS:
        type_key(app, letter)


def test_words_that_miss_a_field_do_nothing(app: App) -> None:
    run(app, 30)
    x, y = place(app, "##terrain")
    click(app, x, y - 56.0)  # the title of the panel
    before = app.scene.camera.mode
    type_everything(app)
    run(app, 3)
    assert not app.takes.recording
    assert not app.editor.session.takes
    assert not app.compare.open
    assert app.scene.camera.mode == before
    assert "has keyboard focus" in message(app)
    press(app, "escape")
    app.window.inject_key("w", True)
    run(app, 3)
    assert controller(app).z > 0.0  # the view has them again


@pytest.mark.parametrize("label", ["##path", "##prompt A", "##search"])
def test_a_field_that_was_clicked_has_the_keys_within_the_frame(app: App, label: str) -> None:
    if label == "##path":
        ground = place(app, "##terrain")
        click(app, ground[0] - 40.0, ground[1] + 28.0)
    elif label == "##search":
        click_on(app, "Ready prompts")
    x, y = place(app, label)
    hand.mouse(app.window, x, y)
    run(app)
    hand.mouse(app.window, x, y, 0, True)  # all of it in one slow frame
    hand.mouse(app.window, x, y, 0, False)
    type_everything(app)
    run(app, 3)
    assert typing(app)
    texts = {"##path": app.scene.file_path, "##prompt A": app.prompting.boxes[0].text}
    typed = (texts | {"##search": app.prompt.search})[label]
    assert LETTERS in typed
    assert not app.takes.recording
    assert not app.editor.session.takes


@pytest.mark.parametrize("frames", [0, 1])  # in one slow frame, and in two
def test_what_a_held_key_repeats_is_no_text_of_the_prompt(app: App, frames: int) -> None:
    app.window.inject_key("w", True)
    hand.text(app.window, "w")
    run(app, frames)
    for _ in range(20):  # the keyboard repeats it
        hand.repeat(app.window, "w")
        hand.text(app.window, "w")
    run(app, frames)
    app.window.inject_key("w", False)
    app.window.inject_key("enter", True)
    app.window.inject_key("enter", False)
    for letter in "tired waiter":
        type_key(app, letter)
    run(app, 6)
    assert app.prompting.boxes[0].text == "tired waiter"
    assert not app.takes.recording, "R is a letter after Enter"
    assert not app.editor.session.takes


def test_a_button_gives_the_keys_back_and_a_held_key_goes_on(app: App) -> None:
    app.window.inject_key("w", True)
    do(app, "run 2; click Grid")
    at = controller(app).z
    run(app, 3)
    assert controller(app).z > at
    app.window.inject_key("w", False)
    press(app, "r")
    assert app.takes.recording


def test_every_panel_is_reached_and_used_by_keys(app: App) -> None:
    seen = []
    for _ in range(5):
        press(app, "f6")
        window = imgui.get_current_context().nav_window
        seen.append(None if window is None else window.root_window.name)
    assert seen == ["Prompt", "Scene", "Takes", "Session", None]
    press(app, "f6")
    press(app, "f6")  # Scene: its list of grounds comes first
    do(app, "run 2; key space")
    assert len(imgui.get_current_context().open_popup_stack) == 1
    do(app, "key down; key space")
    assert app.scene.terrain.name != "flat"
    assert controller(app).z == 0.0  # no key reached the character


def test_tab_goes_through_a_panel_and_its_fields(app: App) -> None:
    do(app, "stand 40; play 1; run 3")
    for _ in range(4):
        press(app, "f6")
    reached = set()
    for _ in range(24):  # past the field of the speed
        press(app, "tab")
        context = imgui.get_current_context()
        assert context.nav_window.root_window.name == "Transport"
        reached.add(context.nav_id)
    assert len(reached) >= 12, "every button"
    assert app.takes.playback is not None


MODAL = ("help", "path dialog", "defect", "last session")


@pytest.mark.parametrize("what", MODAL)
def test_no_key_reaches_what_lies_behind_a_modal_window(app: App, what: str) -> None:
    do(app, "record; run 2")
    app.sessions.dialogs.available = lambda: False

    def show() -> None:
        if what == "help":
            app.state.help_open = True
        elif what == "path dialog":
            app.sessions.ask_open()
        elif what == "defect":
            app.defects.shown = Defect("drawing", "report", None)
        else:
            app.cut_off.left = SessionSummary(Path("a.sport"), "a", False, 0.0, 1, 1.0, b"")
        run(app, 3)

    show()
    assert app.shell.modal
    before = app.editor.session, app.settings.show_trajectory, app.scene.camera.mode
    for keys in ("f6", "space", "ctrl tab", "space", "f6", "f6", "ctrl z", "f2", "v"):
        keys = keys.split(" ")
        press(app, *keys)
        if keys == ["space"]:  # presses a button of the window itself
            show()
        assert app.shell.focus.holder in app.shell.focus.windows
    assert before == (app.editor.session, app.settings.show_trajectory, app.scene.camera.mode)
    assert app.shell.modal
    click(app, *place(app, "##terrain"))
    assert not len(imgui.get_current_context().open_popup_stack), "the list behind it does not open"


def test_f6_stays_among_the_windows_over_everything(app: App) -> None:
    record(app)
    app.settings_window.toggle()
    run(app, 3)
    for _ in range(4):
        press(app, "f6")
        assert app.shell.focus.holder == "Settings##overlay"
