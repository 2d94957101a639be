"""One rule for keys: what was clicked last has them, what closes gives them back, Esc closes the innermost thing only."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.helpers import app_driver as driver
from tests.helpers import hand
from tests.helpers.app_driver import click, controller, message, place, point, press, run
from viewer.app import App
from viewer.gl_bindings import imgui
from viewer.gui.focus import Use, window_at

PATH = "Path##overlay"  # the dialog is its field


def things(app: App) -> list[str]:
    """What is open, and what has taken the keys from the view: each is one press of Esc."""
    context, focus = imgui.get_current_context(), app.shell.focus
    found = [f"popup {depth}" for depth in range(len(context.open_popup_stack))]
    found += focus.windows
    typed = imgui.internal.get_input_text_state(context.active_id) is not None
    if typed and context.active_id_window.root_window.name != PATH:
        found.append("field")
    found += [w.name for w in context.windows if w.name.startswith("suggestions") and w.active]
    if focus.holder and focus.holder not in focus.windows and focus.use is Use.NONE:
        found.append(f"panel {focus.holder}")
    found += ["selection"] * bool(app.transport.selection.keys)
    return found + ["take"] * (app.takes.playback is not None) + ["compare"] * app.compare.open


def walks(app: App) -> bool:
    """Whether W moves the character, and nothing says that it does not."""
    before = controller(app).x, controller(app).z
    app.window.inject_key("w", True)
    run(app, 4)
    held = "w" in app.devices.keyboard.held
    app.window.inject_key("w", False)
    run(app, 2)
    moved = (controller(app).x, controller(app).z) != before
    return held and (moved or app.compare.open) and "has keyboard focus" not in message(app)


def view_spot() -> tuple[float, float] | None:
    """A place where nothing lies over the view."""
    places = ((float(x), float(y)) for x in range(400, 900, 40) for y in range(60, 680, 40))
    return next((p for p in places if window_at(*p) == ""), None)


def escape(app: App) -> None:
    """Press Esc: it closes exactly one thing."""
    before = things(app)
    press(app, "escape")
    after = things(app)
    assert len(after) == max(len(before) - 1, 0), (before, after)
    assert after or app.shell.focus.in_view


@pytest.fixture
def app(desk: App, tmp_path: Path) -> Iterator[App]:
    """The application with one take and nothing open."""
    desk.settings.export_folder = str(tmp_path)
    desk.sessions.dialogs.available = lambda: False
    if not desk.editor.session.takes:
        run(desk, 30)
        desk.takes.save_last()
    yield desk
    if desk.takes.recording:
        desk.takes.toggle_recording()
    while things(desk):
        escape(desk)


def double_click(app: App, label: str) -> None:
    x, y = place(app, label)
    for down in (False, True, False, True, False):
        hand.mouse(app.window, x, y, 0 if down or app.frames_shown else None, down)
        run(app)
    run(app, 2)


def ctrl_click(app: App, label: str) -> None:
    """As the window does it; its backend would look for Ctrl on a real keyboard."""
    x, y = place(app, label)
    point(app, x, y)
    app.shell.focus.press(x, y)
    for down in (True, False):
        imgui.get_io().add_key_event(imgui.Key.mod_ctrl, True)
        imgui.get_io().add_mouse_button_event(0, down)
        run(app, 2)
    imgui.get_io().add_key_event(imgui.Key.mod_ctrl, False)
    assert "field" in things(app)


STEPS = {"double": double_click, "ctrl-click": ctrl_click}


def do(app: App, steps: str) -> None:
    for step in steps.split("; "):
        verb, _, what = step.partition(" ")
        STEPS[verb](app, what) if verb in STEPS else driver.do(app, step)
        run(app, 3)


USED = {
    "settings, cross": "click ##settings; click ##close Settings",
    "settings, button": "click ##settings; click ##settings",
    "settings, Esc": "click ##settings; key escape",
    "settings, list chosen": "click ##settings; click ##text size; click Normal; key escape",
    "ground chosen": "click ##terrain; click Stairs",
    "ground chosen by keys": "click ##terrain; key down; key enter",
    "ground left": "click ##terrain; key escape",
    "ground opened by keys": "key f6; key f6; key space; key down; key space",
    "quality": "click ##quality; click Fast",
    "record by Enter": "key f6; key f6; key f6; key enter",
    "toggle by Space": "key f6; key f6; key tab; key space",
    "menu left": "click ##session; key escape",
    "menu of a menu left": "click ##session; click Settings…; key escape",
    "export": "key ctrl+e; click ##export format; click GIF: animation; key escape",
    "rename": "click ##take menu; click Rename; type walk; key enter",
    "rename left": "click ##take menu; click Rename; type walk; key escape",
    "slider typed": "ctrl-click ##temperature; type 0.4; key enter",
    "slider left": "ctrl-click ##temperature; type 0.4; key escape",
    "slider by mouse": "click ##response",
    "prompt": "click ##prompt A; type a king; key enter",
    "prompt left": "click ##prompt A; key escape; key escape",
    "dialog left": "key ctrl+o; key escape",
    "help": "key f1; key f1",
    "help left": "key f1; key escape",
    "language model": "click ##who; key escape",
    "new prompt left": "play; click + Prompt; type a king; key escape; key escape",
    "new gait": "play; click + Gait; click Jog",
    "new pin left": "play; click + Pin; key escape",
    "beside": "play; click Compare…; key escape",
    "play": "play; click ##play",
}


@pytest.mark.parametrize("name", USED)
def test_what_was_used_or_closed_gives_the_keys_to_the_view(name: str, app: App) -> None:
    do(app, USED[name])
    assert set(things(app)) <= {"take", "selection"}
    assert app.shell.focus.in_view
    assert walks(app)


OPENED = {
    "click ##settings; click ##text size": 2,
    "click ##settings; click Gamepad buttons; click ##pad_buttons jump": 2,
    "key ctrl+e; click ##export format": 2,
    "click ##take menu; click Color": 3,
    "click ##settings; key f1": 2,
    "click ##settings; click ##browse folder": 2,
    "click ##settings; ctrl-click ##dead_zone": 2,
    "click ##settings; key ctrl+e; click ##export format": 3,
    "play; click + Prompt": 3,
    "play; click + Pin": 2,
    "click ##prompt A; type w": 2,
    "key f6; key f6; key space": 1,
    "key f6; key f6": 1,
    "play; key f6; key f6": 2,
    "click ##session; click Open…": 1,
}


@pytest.mark.parametrize("steps", OPENED)
def test_escape_closes_the_innermost_thing_and_ends_in_the_view(steps: str, app: App) -> None:
    do(app, steps)
    assert len(things(app)) == OPENED[steps], things(app)
    for left in reversed(range(OPENED[steps])):
        escape(app)
        assert len(things(app)) == left
    assert walks(app)


def test_two_presses_of_escape_in_one_slow_frame_close_two_things(app: App) -> None:
    do(app, "click ##settings; click ##text size")
    for down in (True, False, True, False):
        app.window.inject_key("escape", down)
    run(app, 4)
    assert things(app) == []


def test_a_window_keeps_the_keys_while_the_view_can_be_clicked_to_have_them(app: App) -> None:
    do(app, "click ##settings; click ##text size; click Normal")
    assert app.shell.focus.holder == "Settings##overlay"
    press(app, "r")
    assert "Settings has keyboard focus" in message(app)
    assert not app.takes.recording
    spot = view_spot()
    assert spot is not None
    click(app, *spot)
    assert walks(app)
    assert things(app) == ["Settings##overlay"]
    escape(app)
    assert walks(app)


def test_what_is_said_of_the_keys_goes_when_it_is_so_no_longer(app: App) -> None:
    x, y = place(app, "##terrain")
    click(app, x, y - 56.0)  # the title of the panel
    press(app, "r")
    assert "A panel has keyboard focus" in message(app)
    escape(app)
    assert "has keyboard focus" not in message(app)


@pytest.mark.parametrize("label", ["Grid", "##temperature"])
def test_a_key_pressed_in_the_slow_frame_of_a_click_acts(label: str, app: App) -> None:
    x, y = place(app, label)
    hand.mouse(app.window, x, y)
    run(app)
    before = controller(app).z
    hand.mouse(app.window, x, y, 0, True)
    hand.mouse(app.window, x, y, 0, False)
    app.window.inject_key("w", True)
    run(app, 6)
    assert controller(app).z > before
    assert "has keyboard focus" not in message(app)
    app.window.inject_key("w", False)
    run(app, 2)


@pytest.mark.parametrize(
    "steps",
    ["click ##terrain", "click ##settings; click ##text size", "click ##settings; ctrl-click ##dead_zone"],
)
def test_a_click_on_the_view_leaves_a_list_or_field_and_has_the_keys(steps: str, app: App) -> None:
    do(app, steps)
    spot = view_spot()
    assert spot is not None
    click(app, *spot)
    assert things(app) in ([], ["Settings##overlay"])
    assert app.shell.focus.in_view
    assert walks(app)
