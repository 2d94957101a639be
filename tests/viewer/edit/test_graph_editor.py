"""The real application without a display: curves of keys are chosen, dragged, eased and removed in the graph editor."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from runtime.takes.camera_keys import CameraKey
from runtime.takes.key_curves import Channel, Curve, CurveKey, KeyedCurves
from runtime.takes.pose_layer import PoseKey, PoseLayer, Tangent
from tests.helpers import hand
from tests.helpers.app_driver import Start, click, do, point, press, run
from tests.viewer.edit.test_timeline import record, seek
from viewer.app import App
from viewer.edit.graph_editor import GraphEditor
from viewer.gl_bindings import implot

HEAD, HIPS = 16, 0
HEAD_YAW, HIPS_UP = Channel(Curve.TURN, HEAD, 1), Channel(Curve.MOVE, HIPS, 1)
YAW = Channel(Curve.CAMERA, -1, 0)


@pytest.fixture
def app(start: Start) -> App:
    """A take of two seconds with keys of the head, the hips and the camera, and the window open."""
    app = start()
    record(app, 120)
    seek(app, 5)
    playback = app.takes.playback
    keys = (
        PoseKey(20 / 60).with_value(Curve.TURN, HEAD, np.array([0.0, 0.4, 0.0])),
        PoseKey(60 / 60)
        .with_value(Curve.TURN, HEAD, np.array([0.0, -0.4, 0.0]))
        .with_value(Curve.MOVE, HIPS, np.array([0.0, -0.1, 0.0])),
    )
    poses = replace(playback.take.poses, layer=PoseLayer(keys))
    cameras = (CameraKey(10 / 60, 0.2, 0.2, 3.0), CameraKey(80 / 60, 1.2, 0.3, 2.0))
    app.editor.put("keys", playback.number, poses=poses, cameras=cameras)
    do(app, "click Curves; run 4")
    return app


def graph(app: App) -> GraphEditor:
    return app.transport.graph


def curves(app: App) -> KeyedCurves:
    return graph(app).curves


def on_plot(app: App, frame: float, value: float) -> tuple[float, float]:
    """Where a point of the plot lies on the screen."""
    found: list[tuple[float, float]] = []
    draw = GraphEditor._overlay

    def noted(self: GraphEditor, playback: Any) -> None:
        draw(self, playback)
        at = implot.plot_to_pixels(frame, value)
        found.append((at.x, at.y))

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(GraphEditor, "_overlay", noted)
        run(app, 2)
    return found[-1]


def key_place(app: App, channel: Channel, frame: int) -> tuple[float, float]:
    return on_plot(app, frame, curves(app).keys(channel)[frame])


def drag(app: App, start: tuple[float, float], end: tuple[float, float]) -> None:
    point(app, *start)
    point(app, *start, 0, True)
    for step in range(1, 5):
        point(app, *[a + (b - a) * step / 4 for a, b in zip(start, end, strict=True)])
    point(app, *end, 0, False)


def test_a_key_is_chosen_dragged_and_undone(app: App) -> None:
    before = curves(app)
    drag(app, key_place(app, HEAD_YAW, 20), on_plot(app, 30, 40.0))
    moved = curves(app).keys(HEAD_YAW)
    (frame,) = set(moved) - {60}
    assert frame == pytest.approx(30, abs=1)
    assert moved[frame] == pytest.approx(40.0, abs=3.0)
    assert curves(app).keys(HIPS_UP) == before.keys(HIPS_UP)
    assert graph(app).chosen == {CurveKey(HEAD_YAW, frame)}
    press(app, "ctrl", "z")
    assert curves(app) == before
    press(app, "ctrl", "y")
    assert curves(app).keys(HEAD_YAW) == moved


def test_keys_in_a_box_are_chosen_and_removed_by_one_step(app: App) -> None:
    before = curves(app)
    places = [key_place(app, HEAD_YAW, 60), key_place(app, HIPS_UP, 60)]
    low = (min(p[0] for p in places) - 14, min(p[1] for p in places) - 14)
    drag(app, low, (max(p[0] for p in places) + 14, max(p[1] for p in places) + 14))
    assert {CurveKey(HEAD_YAW, 60), CurveKey(HIPS_UP, 60)} <= graph(app).chosen
    press(app, "delete")
    assert 60 not in curves(app).keys(HEAD_YAW)
    assert curves(app).moved([], 0, lambda _: 0.0).channels() != before.channels()
    press(app, "ctrl", "z")
    assert curves(app) == before


def test_all_are_chosen_by_a_key_and_let_go_by_escape(app: App) -> None:
    click(app, *on_plot(app, 40, 55.0))
    press(app, "ctrl", "a")
    assert len(graph(app).chosen) == sum(len(curves(app).keys(each)) for each in curves(app).channels())
    do(app, "key escape; key escape")
    assert not graph(app).chosen


def test_a_tangent_of_the_chosen_key_is_another(app: App) -> None:
    click(app, *key_place(app, HEAD_YAW, 20))
    do(app, "click ##curve tangent; click Step")
    assert curves(app).tangent(CurveKey(HEAD_YAW, 20)) is Tangent.STEP


def test_a_hidden_curve_is_not_chosen(app: App) -> None:
    graph(app).hidden.add((Curve.CAMERA, -1))
    run(app, 2)
    click(app, *on_plot(app, 40, 55.0))
    press(app, "ctrl", "a")
    assert graph(app).chosen
    assert not any(key.channel.curve is Curve.CAMERA for key in graph(app).chosen)


def test_the_camera_is_keyed_where_its_curve_is_double_clicked(app: App) -> None:
    view = curves(app)
    where = on_plot(app, 45, float(view.values(YAW, np.array([45 / 60]))[0]))
    for _ in range(2):
        hand.mouse(app.window, *where, 0, True)
        run(app, 1)
        hand.mouse(app.window, *where, 0, False)
        run(app, 1)
    run(app, 2)
    assert any(abs(frame - 45) <= 1 for frame in curves(app).keys(YAW))
