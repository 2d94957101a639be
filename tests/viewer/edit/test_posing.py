"""The real application without a display: a joint is picked and dragged in the view, and the take's pose layer is keyed."""

import numpy as np
import pytest

from runtime.feet.ik import LEG_FEET
from runtime.takes.pose_layer import Curve, PoseLayer, Tangent
from tests.helpers import hand
from tests.helpers.app_driver import Start, click, click_on, do, place, point, press, right_click, run
from tests.viewer.edit.test_timeline import record, seek
from viewer.app import App
from viewer.edit.handles import on_screen
from viewer.gl_bindings import imgui

SIZES = ((1920, 1080), (800, 500))
HIPS, HEAD = 0, 16


def at(app: App, joint: int) -> tuple[float, float]:
    playback = app.takes.playback
    where = on_screen(app.scene.camera.current, playback.pose().positions[joint], imgui.get_io().display_size)
    assert where is not None
    return where


def drag(app: App, start: tuple[float, float], by: tuple[float, float]) -> None:
    places = [(start[0] + by[0] * step / 6, start[1] + by[1] * step / 6) for step in range(7)]
    point(app, *start)
    hand.mouse(app.window, *start, 0, True)
    for where in places:
        run(app, 1)
        hand.mouse(app.window, *where)
    run(app, 1)
    hand.mouse(app.window, *places[-1], 0, False)
    run(app, 4)


def layer(app: App) -> PoseLayer:
    return app.takes.played.poses.layer


@pytest.mark.parametrize("size", SIZES)
def test_the_hips_are_dragged_down_and_the_feet_stay(start: Start, size: tuple[int, int]) -> None:
    app = start(width=size[0], height=size[1])
    record(app)
    seek(app, 30)
    do(app, "click Pose; click Move")
    click(app, *at(app, HIPS))
    run(app, 8)
    playback = app.takes.playback
    before = playback.pose().positions
    drag(app, at(app, HIPS), (0.0, 0.04 * size[1]))
    after = playback.pose().positions
    assert after[HIPS, 1] < before[HIPS, 1] - 0.04
    assert np.abs(after[LEG_FEET] - before[LEG_FEET]).max() < 0.01
    (key,) = layer(app).keys
    assert key.seconds == pytest.approx(30 / 60)
    assert np.allclose(playback.clip.pose(30).positions, after, atol=1e-4)  # its frames are made
    untouched = playback.take.base_clip
    assert np.array_equal(playback.clip.hips_positions[60:], untouched.hips_positions[60:])
    press(app, "ctrl", "z")
    assert not layer(app)
    press(app, "ctrl", "y")
    assert layer(app).keys == (key,)


def test_a_joint_is_turned_released_copied_and_mirrored(app: App) -> None:
    record(app)
    seek(app, 20)
    click_on(app, "Pose")
    click(app, *at(app, HEAD))
    run(app, 8)
    x, y = at(app, HEAD)
    rings = [radius for radius in range(66, 84, 2) if _turned(app, x, y, radius)]
    assert rings  # the outer ring is taken at some distance
    assert layer(app).joints(Curve.TURN) == [HEAD]
    click_on(app, "Copy")
    seek(app, 50)
    do(app, "click Mirror; run 4")
    assert [round(key.seconds * 60) for key in layer(app).keys] == [20, 50]
    assert set(layer(app).joints(Curve.TURN)) == set(range(31))
    seek(app, 65)
    do(app, "click Free; run 4")
    assert np.allclose(layer(app).values(Curve.TURN, HEAD, np.array([65 / 60])), 0.0)
    do(app, "click Del; run 4")
    assert len(layer(app).keys) == 2
    seek(app, 50)
    do(app, "click ##tangent; click Step")
    assert layer(app).keys[-1].tangent is Tangent.STEP
    click_on(app, "Hold last")
    assert layer(app).keeps
    do(app, "key escape; key escape")
    assert not app.posing.open
    assert app.takes.playback is not None


def _turned(app: App, x: float, y: float, radius: float) -> bool:
    if layer(app):
        return False
    drag(app, (x + 0.7 * radius, y - 0.7 * radius), (0.3 * radius, 0.7 * radius))
    return bool(layer(app))


def test_keys_are_dragged_and_removed_on_their_track(app: App) -> None:
    record(app)
    seek(app, 30)
    click_on(app, "Pose")
    click(app, *at(app, HIPS))
    do(app, "click Key; run 4")
    left, y = place(app, "##pose keys", share=0.0)
    right, _ = place(app, "##pose keys", share=1.0)
    per_frame = (right - left - 8) / 79
    drag(app, (left + 4 + 30 * per_frame, y), (20 * per_frame, 0.0))
    (key,) = layer(app).keys
    assert 47 <= key.seconds * 60 <= 53
    x = left + 4 + key.seconds * 60 * per_frame
    right_click(app, x, y)
    click_on(app, "Delete")
    assert not layer(app)


def test_the_head_turns_as_far_as_the_mouse_goes_along_a_ring_seen_from_its_edge(app: App) -> None:
    record(app)
    seek(app, 20)
    do(app, "click Pose; key 1")
    app.scene.camera.current.pitch = 0.0
    run(app, 20)
    click(app, *at(app, HEAD))
    run(app, 8)
    x, y = at(app, HEAD)
    for below in range(-20, 21, 4):
        point(app, x - 40, y + below)
        if app.posing.rings.over == 1:
            drag(app, (x - 40, y + below), (60.0, 0.0))
            break
    (key,) = layer(app).keys
    (turn,) = key.turns
    assert turn.joint == HEAD
    degrees = np.degrees(layer(app).values(Curve.TURN, HEAD, np.array([20 / 60]))[0])
    assert 20.0 < abs(degrees[1]) < 70.0
    assert np.abs(degrees[[0, 2]]).max() < 15.0
