"""What tests of the application do to it: run frames, press, type and click, and look at its state."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
from sport.viewer.app import App
from sport.viewer.gl_bindings import imgui
from sport.viewer.input.gamepad import GamepadState
from viewer_fakes import FakeController

Start = Callable[..., App]


class InjectedPads:
    """A source whose pad the test sets."""

    def __init__(self) -> None:
        self.state: GamepadState | None = None

    def poll(self) -> GamepadState | None:
        return self.state


def run(app: App, frames: int = 1) -> None:
    for _ in range(frames):
        app.frame()


def run_until(app: App, condition: Callable[[], bool], seconds: float = 20.0) -> None:
    """Frames at the pace of a display until something holds."""
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "it never came"
        run(app)
        time.sleep(0.002)


def controller(app: App) -> FakeController:
    found = app.state.stage.simulation.controller
    assert isinstance(found, FakeController)
    return found


def click(app: App, x: float, y: float) -> None:
    for down in (False, True, False):
        app.window.inject_mouse(x, y, 0 if down or app.frames_shown else None, down)
        run(app, 2)


def click_prompt_box(app: App) -> None:
    click(app, 160, 70)


def press(app: App, *names: str) -> None:
    """Press keys together, the last ones last, and let them go."""
    for name in names:
        app.window.inject_key(name, True)
        run(app)
    for name in reversed(names):
        app.window.inject_key(name, False)
        run(app)


def type_prompt(app: App, text: str) -> None:
    """Go to the prompt's field, where everything is selected, and type."""
    app.shell.focus_prompt()
    run(app, 3)
    app.window.inject_text(text)
    run(app, 3)


def typing(app: App) -> bool:
    """Whether a text field has the keyboard."""
    return bool(imgui.get_io().want_text_input)


def message(app: App) -> str:
    current = app.state.messages.current
    return "" if current is None else current.text


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
