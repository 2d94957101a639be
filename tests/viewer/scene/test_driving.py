"""The real application without a display, driven by keys, pads and scripts."""

import itertools
import math
from dataclasses import replace
from types import SimpleNamespace

import pytest

from runtime.session.prompt_blend import Side
from runtime.traversal.traversal import KINDS
from tests.helpers import hand
from tests.helpers.app_driver import Start, controller, message, run, texts, type_key
from viewer.app import App
from viewer.input.gamepad import GamepadState
from viewer.scene.simulation import TRAVERSALS


def test_key_w_moves_the_character_at_once(app: App) -> None:
    app.window.inject_key("w", True)
    run(app, 1)
    assert controller(app).z > 0.0
    run(app, 29)
    app.window.inject_key("w", False)
    run(app, 1)
    distance = math.hypot(controller(app).x, controller(app).z)
    assert distance == pytest.approx(1.4 * 0.5, rel=0.05)
    run(app, 10)
    assert math.hypot(controller(app).x, controller(app).z) == pytest.approx(distance)


def test_scripted_controls_walk_then_jog(start: Start) -> None:
    app = start(keys="w 0.5; w+shift 0.5; idle 1", camera="orbit")
    run(app, 90)
    assert controller(app).z == pytest.approx(1.4 * 0.5 + 3.0 * 0.5, rel=0.05)


def test_the_stick_of_a_script_is_in_the_world_and_then_left_to_the_devices(start: Start) -> None:
    app = start(controls="stand 0.1; walk@90 0.5; jog 0.5", camera="orbit")
    run(app, 66)
    assert controller(app).x == pytest.approx(1.4 * 0.5, rel=0.05)
    assert controller(app).z == pytest.approx(3.0 * 0.5, rel=0.05)
    app.window.inject_key("w", True)
    run(app, 20)
    assert controller(app).z > 3.0 * 0.5 + 0.1


def test_stick_moves_relative_to_the_camera(start: Start) -> None:
    app = start(camera="orbit")
    run(app)
    app.scene.camera.orbit.yaw = math.pi / 2  # looks along +X
    app.devices.pads.state = GamepadState("pad", left=(0.0, 1.0))
    run(app, 10)
    assert controller(app).x > 0.1
    assert abs(controller(app).z) < 1e-6
    assert app.state.device == "pad"
    assert "pad connected" in message(app)
    app.devices.pads.state = None
    run(app)
    assert app.state.device == "keyboard"


def test_keys_that_follow_enter_at_once_are_words(app: App) -> None:
    """On a slow machine a whole word arrives within two frames."""
    app.window.inject_key("enter", True)
    app.window.inject_key("enter", False)
    run(app, 2)
    for letter in "drunk":
        type_key(app, letter)
        run(app)
    run(app, 3)
    assert not app.takes.recording
    assert controller(app).x == 0.0
    assert app.prompting.boxes[Side.A].text == "drunk"


def test_focus_loss_releases_keys(app: App) -> None:
    app.window.inject_key("w", True)
    run(app, 2)
    hand.focus(app.window, False)
    before = controller(app).z
    run(app, 5)
    assert controller(app).z == before > 0.0


def test_function_keys_toggle_what_is_shown(app: App) -> None:
    assert not app.settings.show_skeleton
    for key in ("f3", "f1", "f10"):
        app.window.inject_key(key, True)
    run(app, 2)
    assert app.settings.show_skeleton
    assert app.scene.renderer.overlays.show_skeleton
    assert app.state.help_open
    assert not app.state.panels_open
    app.window.inject_key("escape", True)
    run(app)
    assert not app.state.help_open


def test_the_status_line_says_what_is_keyed_over_an_obstacle(start: Start) -> None:
    assert set(TRAVERSALS) == set(KINDS) - {""}
    app = start()
    run(app, 2)
    controller(app).traversal = "gap"
    assert any("keyed: leap over a gap" in text for text in texts(app))
    controller(app).traversal = ""
    assert not any("keyed" in text for text in texts(app))


def test_the_status_line_says_why_the_character_does_not_go_on(app: App) -> None:
    controller(app).blocked = "The way ahead is blocked: a step up of 2.0 m."
    run(app, 3)
    assert message(app) == "The way ahead is blocked: a step up of 2.0 m."
    controller(app).blocked = None
    run(app, 3)
    current = app.messages.current
    assert current is None or current.settled


@pytest.mark.parametrize(
    ("pictures_s", "step_s"),
    [((0.4,), 0.004), ((0.03, 0.03, 0.7), 0.004), ((0.1,), 0.013)],
    ids=["slow pictures", "hitches", "slow pictures and a slow model"],
)
def test_where_the_processor_is_short_pictures_drop_and_a_recording_keeps_time(
    start: Start, monkeypatch: pytest.MonkeyPatch, pictures_s: tuple[float, ...], step_s: float
) -> None:
    app, now = start(), 100.0

    def passes(seconds: float) -> None:
        nonlocal now
        now += seconds

    clock = SimpleNamespace(perf_counter=lambda: now, monotonic=lambda: now, sleep=passes)
    run(app, 2)
    for module in ("viewer.app", "viewer.scene.simulation"):
        monkeypatch.setattr(f"{module}.time", clock)
    app.options, app._last_s = replace(app.options, offscreen=False), now
    durations, step = itertools.cycle(pictures_s), controller(app).step
    app.scene.renderer.render = lambda *_: passes(next(durations))
    monkeypatch.setattr(controller(app), "step", lambda controls: (passes(step_s), step(controls))[1])
    run(app, 3)
    app.window.inject_key("w", True)
    app.window.inject_key("r", True)
    begin = now
    while now < begin + 8.0:
        run(app)
    lasted = now - begin
    app.takes.toggle_recording()
    app.options = replace(app.options, offscreen=True)
    assert app.editor.session.takes[-1].clip.seconds == pytest.approx(lasted, abs=0.9)
