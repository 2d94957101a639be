"""The real application without a display: cameras that keep the character in view."""

import math

import numpy as np
import pytest

from runtime.terrain.height_map import Terrain
from runtime.terrain.library import TERRAIN_NAMES, make_terrain
from tests.helpers import hand
from tests.helpers.app_driver import Start, click_on, controller, do, point, press, run
from viewer.app import App
from viewer.scene.camera_control import VIEWS, CameraControl, start_yaw


def shown_at(app: App, point: np.ndarray) -> np.ndarray:
    """Where a point of the world shows, -1..1."""
    camera = app.scene.camera.current
    clip = camera.projection_matrix(16 / 9) @ camera.view_matrix() @ np.append(point, 1.0)
    return np.array(clip[:2] / clip[3])


def hips(app: App) -> np.ndarray:
    return app.scene.simulation.current.hips_position


def turned(app: App) -> float:
    """Of the view from the character's facing."""
    return math.remainder(app.scene.camera.current.yaw - app.scene.simulation.current.root_yaw, math.tau)


@pytest.mark.parametrize(
    ("ground", "least", "most"), [("flat", 2.2, 2.7), ("hills", 2.2, 2.7), ("wall", 0.4, 0.9)]
)
def test_the_first_view_is_from_beside_and_walking_goes_straight_on(
    start: Start, ground: str, least: float, most: float
) -> None:
    app = start(panels=False, keys="w 4", terrain=ground)
    run(app)
    assert least < abs(turned(app)) < most  # from the front, or from behind where there is something ahead
    run(app, 230)
    assert abs(turned(app)) < 0.05  # by now from behind
    assert controller(app).x == pytest.approx(0.0, abs=1e-6)
    assert controller(app).z > 3.0


def test_a_drag_ends_the_first_view_and_forward_is_where_the_camera_looks(app: App) -> None:
    app.scene.camera.drag(10.0, 0.0, False, 720)
    camera = app.scene.camera.current
    assert camera.heading == camera.yaw


def test_a_click_far_from_where_the_mouse_was_does_not_turn_the_view(start: Start) -> None:
    app = start(panels=False)
    point(app, 100, 100)
    before = app.scene.camera.current.yaw, app.scene.camera.current.pitch
    hand.mouse(app.window, 500, 400, 0, True)  # both between two frames: few are drawn on a slow machine
    run(app, 2)
    assert (app.scene.camera.current.yaw, app.scene.camera.current.pitch) == before
    point(app, 540, 400, 0, True)
    assert app.scene.camera.current.yaw != before[0]


@pytest.mark.parametrize("controls", ["w 4", "w+shift 4"])
def test_the_orbit_camera_goes_with_the_walker(start: Start, controls: str) -> None:
    app = start(panels=False, camera="orbit", keys=controls)
    run(app, 2)
    app.scene.camera.drag(60.0, 20.0, True, 720)  # what was shifted stays shifted
    before = shown_at(app, hips(app))
    run(app, 200)
    assert np.linalg.norm(hips(app)) > 4.0
    assert np.linalg.norm(shown_at(app, hips(app)) - before) < 0.35
    run(app, 120)  # standing again
    assert shown_at(app, hips(app)) == pytest.approx(before, abs=0.02)


@pytest.mark.parametrize(("key", "name"), enumerate(VIEWS, 1))
def test_a_key_looks_from_each_place(start: Start, key: int, name: str) -> None:
    app = start(panels=False)
    run(app, 2)
    controller(app).yaw = 1.0
    run(app)
    press(app, str(key))
    assert app.scene.camera.mode == "orbit"
    assert math.remainder(turned(app) - VIEWS[name].turn, math.tau) == pytest.approx(0.0, abs=1e-6)
    pose = app.scene.simulation.current
    looked = pose.root_position if name == "feet" else np.array(CameraControl.target(pose))
    assert np.abs(shown_at(app, looked)).max() < 0.4


def test_views_are_buttons_and_an_option_too(start: Start) -> None:
    app = start(camera="side")
    run(app, 2)
    assert turned(app) == pytest.approx(VIEWS["side"].turn, abs=1e-6)
    click_on(app, "##view front")
    assert abs(turned(app)) == pytest.approx(math.pi, abs=1e-6)


def test_a_key_brings_the_character_back_into_view(start: Start) -> None:
    app = start(panels=False, camera="orbit")
    run(app, 2)
    app.scene.camera.drag(4000.0, 900.0, True, 720)
    app.scene.camera.orbit.zoom(-9)
    assert np.abs(shown_at(app, hips(app))).max() > 1.0
    press(app, "0")
    assert np.abs(shown_at(app, hips(app))).max() < 0.2
    head, root = (getattr(app.scene.simulation.current, n) for n in ("positions", "root_position"))
    assert 0.8 < shown_at(app, head[:, :].max(axis=0))[1] - shown_at(app, root)[1] < 1.9  # whole, and large


def test_home_turns_character_and_camera_to_the_obstacles(start: Start) -> None:
    app = start(panels=False, terrain="beam")
    run(app, 2)
    app.scene.camera.drag(400.0, 0.0, False, 720)
    controller(app).yaw = 2.0
    do(app, "run 1; key home")
    assert app.scene.simulation.current.root_yaw == pytest.approx(0.0)
    assert app.scene.camera.current.heading == pytest.approx(0.0)
    assert np.abs(shown_at(app, np.array([0.0, 0.4, 6.0]))).max() < 1.0  # the beam


def test_a_ground_with_obstacles_elsewhere_is_looked_at() -> None:
    heights = np.zeros((201, 201), np.float32)
    heights[20:60, 90:110] = 0.5  # at -X
    assert start_yaw(Terrain("box", heights, 0.1, (-10.0, -10.0))) == pytest.approx(-math.pi / 2, abs=0.4)
    assert all(start_yaw(make_terrain(name)) == 0.0 for name in TERRAIN_NAMES)
