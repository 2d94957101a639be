"""The real application without a display: the view panned, orbited, zoomed and framed by mouse and keys."""

import numpy as np
import pytest

from runtime.takes.pins import Pinned
from tests.helpers.app_driver import Start, click_on, do, point, press, run, wheel
from viewer.app import App
from viewer.edit.handles import on_screen
from viewer.gl_bindings import imgui

SIZES = ((1280, 720), (1920, 1080), (800, 500))
LEFT, RIGHT, MIDDLE = range(3)


def drag(app: App, button: int, *held: str, dx: float = 40.0, dy: float = 0.0) -> None:
    """A drag from the middle of the view under modifiers."""
    size = imgui.get_io().display_size
    x, y = 0.55 * size.x, 0.4 * size.y
    for key in held:
        app.window.inject_key(key, True)
    point(app, x, y)
    point(app, x, y, button, True)
    point(app, x + dx, y + dy)
    point(app, x + dx, y + dy, button, False)
    for key in held:
        app.window.inject_key(key, False)
    run(app)


def view(app: App) -> np.ndarray:
    camera = app.scene.camera.current
    return np.array([camera.yaw, camera.distance, *camera.target])


@pytest.mark.parametrize("size", SIZES)
def test_middle_pans_shift_middle_orbits(start: Start, size: tuple[int, int]) -> None:
    app = start(width=size[0], height=size[1], camera="orbit")
    run(app, 3)
    before = view(app)
    drag(app, MIDDLE)
    panned = view(app)
    assert panned[:2] == pytest.approx(before[:2])
    assert np.linalg.norm(panned[2:] - before[2:]) > 0.1
    drag(app, MIDDLE, "shift")
    assert view(app)[0] != pytest.approx(panned[0])
    assert view(app)[2:] == pytest.approx(panned[2:], abs=1e-3)


def test_a_pan_leaves_the_follow_camera(start: Start) -> None:
    app = start(panels=False)
    run(app, 3)
    drag(app, MIDDLE)
    assert app.scene.camera.mode == "orbit"
    press(app, "o")
    assert app.scene.camera.mode == "follow"


@pytest.mark.parametrize(
    ("program", "orbit", "pan", "zoom"),
    [
        ("Blender", (MIDDLE,), (MIDDLE, "shift"), (MIDDLE, "ctrl")),
        ("Maya", (LEFT, "alt"), (MIDDLE, "alt"), (RIGHT, "alt")),
    ],
)
def test_the_habits_of_other_programs(
    start: Start, program: str, orbit: tuple, pan: tuple, zoom: tuple
) -> None:
    app = start(camera="orbit")
    app.settings_window.toggle()
    run(app, 2)
    click_on(app, program)
    press(app, "escape")
    assert not app.settings_window.shown
    before = view(app)
    drag(app, *orbit)
    turned = view(app)
    assert turned[0] != pytest.approx(before[0])
    drag(app, *pan)
    panned = view(app)
    assert panned[:2] == pytest.approx(turned[:2])
    assert np.linalg.norm(panned[2:] - turned[2:]) > 0.1
    drag(app, *zoom, dx=0.0, dy=-60.0)
    assert view(app)[1] < panned[1]


@pytest.mark.parametrize("steps", [3.0, -3.0])
def test_the_wheel_zooms_at_the_pointer(start: Start, steps: float) -> None:
    app = start(camera="orbit", panels=False)
    run(app, 60)
    size = imgui.get_io().display_size
    joint = app.scene.simulation.current.positions[-1]
    camera = app.scene.camera.current
    depth = camera.view_matrix().astype(float) @ np.append(joint, 1.0)
    target = camera.view_matrix().astype(float) @ np.append(camera.target, 1.0)
    joint = joint + (depth[2] - target[2]) * -camera.view_matrix()[2, :3]  # as far away as the target
    at = on_screen(camera, joint, size)
    assert at is not None
    point(app, *at)
    before = camera.distance
    wheel(app, steps)
    assert (camera.distance < before) == (steps > 0)
    assert on_screen(camera, joint, size) == pytest.approx(at, abs=3.0)


def test_f_frames_the_selected_pin_and_0_the_character(app: App) -> None:
    do(app, "stand 30; play 1")
    app.pins.add(Pinned.LEFT_HAND)
    do(app, "run 2; key f")
    assert app.scene.camera.mode == "orbit"
    assert app.scene.camera.current.target == pytest.approx(app.pins.place, abs=0.02)
    press(app, "0")
    assert app.scene.camera.current.distance > 2.0
    app.pins.delete()
    press(app, "f")
    assert app.scene.camera.current.distance > 2.0


@pytest.mark.parametrize(("key", "turn"), [("kp_1", "front"), ("kp_3", "side"), ("kp_7", "top")])
def test_the_numpad_views(start: Start, key: str, turn: str) -> None:
    app = start(panels=False)
    run(app, 2)
    press(app, key)
    camera = app.scene.camera.current
    assert app.scene.camera.mode == "orbit"
    assert (camera.pitch > 1.5) == (turn == "top")
