"""Drives the application in tests: runs frames, presses keys, types, clicks, and reads its state."""

import re
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from runtime.motion.style import StyleMix
from tests.helpers import hand
from tests.helpers.viewer_fakes import FakeController
from viewer.app import App
from viewer.edit.handles import on_screen
from viewer.gl_bindings import imgui
from viewer.input.gamepad import GamepadState

Start = Callable[..., App]
WIDGETS = (
    "button",
    "small_button",
    "invisible_button",
    "input_text_multiline",
    "input_text_with_hint",
    "slider_float",
    "drag_float",
    "selectable",
    "begin_combo",
    "begin_tab_item",
    "drag_int",
    "input_int",
    "menu_item",
    "begin_menu",
    "tree_node_ex",
)


class InjectedPads:
    """A gamepad source whose state the test sets."""

    def __init__(self) -> None:
        self.state: GamepadState | None = None

    def poll(self) -> GamepadState | None:
        return self.state


def run(app: App, frames: int = 1) -> None:
    for _ in range(frames):
        app.frame()


def run_until(app: App, condition: Callable[[], bool], seconds: float = 60.0) -> None:
    """Run frames at a display's rate until a condition holds."""
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "it never came"
        run(app)
        time.sleep(0.002)


def controller(app: App) -> FakeController:
    found = app.scene.simulation.controller
    assert isinstance(found, FakeController)
    return found


def drawn(app: App) -> list[tuple[str, tuple[float, float, float, float]]]:
    """Return all widgets of one frame in order: ImGui label, and left, top, right, bottom on the screen."""
    found = []

    def watched(draw: Callable[..., Any]) -> Callable[..., Any]:
        def draw_and_note(label: str, *rest: Any) -> Any:
            result = draw(label, *rest)
            low, high = imgui.get_item_rect_min(), imgui.get_item_rect_max()
            found.append((label, (low.x, low.y, high.x, high.y)))
            return result

        return draw_and_note

    with pytest.MonkeyPatch.context() as patch:
        for name in WIDGETS:
            patch.setattr(imgui, name, watched(getattr(imgui, name)))
        run(app)
    return found


def texts(app: App) -> list[str]:
    """Return all texts of one frame that are not part of widgets."""
    found = []

    def watched(draw: Callable[..., Any]) -> Callable[..., Any]:
        return lambda text: (found.append(text), draw(text))

    with pytest.MonkeyPatch.context() as patch:
        for name in ("text_unformatted", "text_wrapped"):
            patch.setattr(imgui, name, watched(getattr(imgui, name)))
        run(app)
    return found


def place(app: App, label: str, index: int = 0, share: float = 0.5) -> tuple[float, float]:
    """Return where to click on a widget, at fraction `share` of its width; found by the words or ##id of its label."""

    def names(full: str) -> tuple[str, ...]:
        words, _, key = full.partition("##")
        return words, re.sub(r"[^\x00-\x7f]", "", words).strip(), f"##{key.lstrip('#')}"

    widgets = drawn(app)
    rects = [rect for full, rect in widgets if label in names(full)]
    assert rects, f"no widget {label!r} among {sorted({full for full, _ in widgets})}"
    left, top, right, bottom = rects[index]
    return left + (right - left) * share, (top + bottom) / 2


def click_on(app: App, label: str, index: int = 0) -> None:
    """Click a widget at its position once the pointer is there: text that was just loaded may move its neighbours."""
    spot = place(app, label, index)
    for _ in range(5):
        point(app, *spot, 0 if app.frames_shown else None, False)
        before, spot = spot, place(app, label, index)
        if spot == before:
            break
    click(app, *spot)


def click(app: App, x: float, y: float) -> None:
    for down in (False, True, False):
        point(app, x, y, 0 if down or app.frames_shown else None, down)
    run(app, 2)


def point(app: App, x: float, y: float, button: int | None = None, down: bool = False) -> None:
    """Move the mouse, optionally change a button there, and let the panels react."""
    hand.mouse(app.window, x, y, button, down)
    run(app, 2)


def screen_point(app: App, x: float, z: float) -> tuple[float, float]:
    """Pixel at which a place on the ground is seen."""
    ground = np.array([x, float(app.scene.terrain.height(x, z)), z])
    found = on_screen(app.scene.camera.current, ground, imgui.get_io().display_size)
    assert found is not None
    return found


def wheel(app: App, steps: float) -> None:
    hand.wheel(app.window, steps)
    run(app, 2)


def type_in(app: App, text: str) -> None:
    """Type into the field that has the keyboard."""
    hand.text(app.window, text)
    run(app, 3)


def right_click(app: App, x: float, y: float) -> None:
    for down in (None, True, False):
        point(app, x, y, None if down is None else 1, bool(down))


def click_prompt_box(app: App) -> None:
    click_on(app, "##prompt A")


def press(app: App, *names: str) -> None:
    """Press keys together, in order, and release them; then run a few frames for the panels to react."""
    for name in names:
        app.window.inject_key(name, True)
        run(app)
    for name in reversed(names):
        app.window.inject_key(name, False)
        run(app)
    run(app, 2)


def hold(app: App, key: str, frames: int) -> None:
    app.window.inject_key(key, True)
    run(app, frames)
    app.window.inject_key(key, False)


def type_prompt(app: App, text: str) -> None:
    """Focus the prompt field, which selects its text, and type."""
    app.shell.focus_prompt()
    run(app, 3)
    type_in(app, text)


def type_key(app: App, letter: str) -> None:
    """Send the events of a typed letter within one frame: key down, character, key up."""
    name = "space" if letter == " " else letter
    app.window.inject_key(name, True)
    hand.text(app.window, letter)
    app.window.inject_key(name, False)


def typing(app: App) -> bool:
    """Return whether a text field has the keyboard focus."""
    return bool(imgui.get_io().want_text_input)


def message(app: App) -> str:
    """Return the newest message, even if it waits behind a more important one."""
    recent = app.messages.recent
    return recent[-1].text if recent and recent[-1].ends_s >= app.messages.clock() else ""


def words(app: App) -> dict[str, str]:
    """Return the current descriptions of the character."""
    return app.editor.session.live.prompt.a.words.to_mapping()


def prompt(app: App) -> str:
    answer = app.editor.session.live.prompt.a
    return "" if answer is None else answer.prompt


def style(app: App) -> np.ndarray:
    """Return the controller's Z^t; for a mix the mean of its codes."""
    last = controller(app).styles[-1][0]
    if isinstance(last, StyleMix):
        return np.sum([share * code for share, code in zip(last.weights, last.codes, strict=True)], axis=0)
    return last


def drag(app: App, start: tuple[float, float], end: tuple[float, float]) -> None:
    for at, down in ((start, None), (start, True), (end, True), (end, False)):
        point(app, *at, None if down is None else 0, bool(down))
    run(app, 2)


def record(app: App, frames: int = 20, stop: bool = True) -> None:
    """Record a straight walk; without `stop` the recording continues."""
    app.takes.toggle_recording()
    hold(app, "w", frames)
    if stop:
        app.takes.toggle_recording()
    run(app)


def record_standing(app: App, frames: int) -> None:
    app.takes.toggle_recording()
    run(app, frames)
    app.takes.toggle_recording()


def export_bvh(app: App, path: Path | str | None = None) -> None:
    """Export the playing or newest take, to `path` or the proposed one."""
    if path is not None:
        app.bvh_export.path = str(path)
    app.bvh_export.export()
    run(app, 2)


def save_and_leave(app: App, path: Path) -> None:
    """Save the session, and start a new one."""
    app.sessions.save_as(path)
    run(app, 2)
    app.sessions.new()
    run(app, 2)


def seek(app: App, frame: int) -> None:
    """Show a frame of the playing take, and pause there."""
    app.takes.playback.seek(frame)
    run(app, 2)


def frame(app: App) -> int:
    """Return the displayed frame of the playing take."""
    return app.takes.playback.frame


def titles(app: App) -> list[str]:
    return [take.title for take in app.editor.session.takes]


def _click(app: App, what: str) -> None:
    label, _, index = what.partition(" @")
    click_on(app, label, int(index or 0))


STEPS: dict[str, Callable[[App, str], object]] = {
    "click": _click,
    "key": lambda app, keys: press(app, *keys.split("+")),
    "hold": lambda app, what: hold(app, what.split(" ")[0], int(what.split(" ")[1])),
    "type": type_in,
    "run": lambda app, frames: run(app, int(frames)),
    "record": lambda app, frames: record(app, int(frames or 20)),
    "stand": lambda app, frames: record_standing(app, int(frames)),
    "play": lambda app, number: app.takes.play(int(number or 1)),
    "close": lambda app, _: app.takes.close_playback(),
    "seek": lambda app, number: seek(app, int(number)),
    "remove": lambda app, number: app.takes.remove(int(number)),
    "mirror": lambda app, number: app.takes.mirror(int(number)),
    "prompt": lambda app, text: app.prompting.submit_prompt(text),
    "insert": lambda app, text: app.editing.insert_prompt(text),
    "ground": lambda app, spec: app.scene.load_terrain(spec),
    "undo": lambda app, _: app.editor.undo(),
    "redo": lambda app, _: app.editor.redo(),
}


def do(app: App, steps: str) -> None:
    """Perform steps of `STEPS`: "click ##terrain; key down; type abc"; "click Keep @1" is the second widget of that name."""
    for step in steps.split("; "):
        verb, _, what = step.partition(" ")
        STEPS[verb](app, what)
