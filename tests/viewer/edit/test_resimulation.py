"""The real application without a display: the way of a take edited and resimulated, a reference beside a take, keys of its camera."""

from pathlib import Path

import numpy as np
import pytest

from runtime.controls import Gait
from runtime.motion.control_scripts import Waypoint
from runtime.session import edits
from runtime.session.session import LIVE
from runtime.session.session_file import SessionFile
from runtime.takes.camera_keys import CameraKey
from runtime.takes.clip import Clip
from runtime.terrain.height_map import Terrain
from tests.helpers.app_driver import click_on, do, place, point, press, record, run
from viewer.app import App
from viewer.exports.exporting import ExportForm
from viewer.filming.shots import FilmOptions, camera_path


@pytest.fixture
def app(desk: App) -> App:
    """The window as it was at its start, with a take of two seconds straight ahead that plays."""
    desk.sessions.new()
    desk.scene.reset_character()
    run(desk, 2)
    record(desk, 70)
    desk.takes.play(1)
    run(desk, 3)
    return desk


def shown(app: App) -> Clip:
    return app.editor.session.takes[0].clip


def keys(app: App) -> tuple[CameraKey, ...]:
    return app.editor.session.takes[0].cameras


def test_the_way_of_a_take_is_bent_slowed_ended_and_undone(app: App) -> None:
    tool, before = app.path, app.editor.session.takes[0]
    drawn = (Waypoint(9.0, 9.0),)
    app.editor.do("path", lambda session: session.with_take(LIVE, path=drawn))
    click_on(app, "Edit its path")
    end = (*shown(app).hips_positions[-1][[0, 2]], Gait.WALK)
    assert [(p.x, p.z, p.gait) for p in tool.points] == [pytest.approx(end, abs=0.01)]
    tool.change(x=1.0, z=1.0, speed=0.5)
    click_on(app, "##drive path")
    made = shown(app)
    end = made.hips_positions[-1]
    assert np.hypot(end[0] - 1.0, end[2] - 1.0) < 0.65  # it stops within reach of its end
    assert len(made) != before.frames
    speeds = np.linalg.norm(np.diff(made.hips_positions[:, [0, 2]], axis=0), axis=1) * 60.0
    assert speeds.max() == pytest.approx(0.7, abs=0.02)  # half of 1.4 m/s
    assert app.takes.playback.last == len(made) - 1
    assert app.editor.undo_label == "path of Take 1"
    assert app.editor.session.takes[0].path == tool.points
    press(app, "ctrl", "z")
    assert app.editor.session.takes[0].motion == before.motion
    do(app, "close; run 2")
    assert tool.points == drawn
    assert not tool.active


def test_a_reference_stands_beside_the_take_in_sync_and_over_it(app: App) -> None:
    playback = app.takes.playback
    app.editor.do("mirror image", lambda session: edits.selected(edits.mirrored_copy(session, 1), 1))
    references = app.references
    references.show(2)
    playback.seek(30)
    run(app, 2)
    pose, beside = playback.pose(), references.pose(playback)
    assert beside.hips_position - pose.hips_position == pytest.approx([-1.0, 0.0, 0.0], abs=0.01)
    assert len(app.overlays(None, []).extra_poses) == 1
    click_on(app, "Over it")
    assert len(app.overlays(None, []).ghosts) == 1
    x, y = place(app, "##reference offset")
    for at, down in ((x, None), (x, True), (x + 40.0, True), (x + 40.0, False)):
        point(app, at, y, None if down is None else 0, bool(down))
    assert references.reference.offset_s > 0.1
    later = float(references.pose(playback).hips_position[2] - pose.hips_position[2])
    assert later == pytest.approx(1.4 * references.reference.offset_s, abs=0.03)
    app.takes.remove(2)
    assert not references.shown
    press(app, "ctrl", "z")
    assert references.shown


def test_keys_of_the_camera_are_set_dragged_looked_through_and_kept(app: App, tmp_path: Path) -> None:
    camera, playback = app.scene.camera, app.takes.playback
    assert playback is not None
    for frame, yaw in ((10, 0.0), (50, 1.0)):
        playback.seek(frame)
        camera.current.yaw = yaw
        do(app, "click + Pin; click Camera key")
    assert [round(key.seconds * 60) for key in keys(app)] == [10, 50]
    (x, y), (to, _) = (place(app, "##camera keys", share=share) for share in (50 / 69, 60 / 69))
    for at, down in ((x, None), (x, True), (to, True), (to, False)):
        point(app, at, y, None if down is None else 0, bool(down))
    assert round(keys(app)[1].seconds * 60) == pytest.approx(60, abs=1)
    playback.seek(34)
    playback.playing = True
    run(app, 2)
    assert 0.3 < camera.current.yaw < 0.7  # on the way from one to the other
    playback.playing = False
    playback.seek(16)
    run(app, 2)
    assert 0.0 < camera.current.yaw < 0.2, "also when it is sought"
    x, y = 400, 60  # of the view, which the user turns
    for at, down in ((x, None), (x, True), (x + 60, True), (x + 60, False)):
        point(app, at, y, None if down is None else 1, bool(down))
    turned = camera.current.yaw
    playback.seek(34)
    run(app, 2)
    assert camera.current.yaw == turned
    click_on(app, "Keyed")
    assert 0.3 < camera.current.yaw < 0.7
    film = app.exporting._film_options(ExportForm(camera="keyed"), app.editor.session.takes[0], 0.5)
    assert [key.seconds for key in film.keys] == [0.0, pytest.approx(keys(app)[1].seconds - 0.5)]
    see = camera_path(FilmOptions(fps=60.0, camera="keyed", keys=keys(app)), shown(app), Terrain.flat())
    yaws = [see(shown(app).pose(i)).yaw for i in range(70)]
    assert yaws[:11] == pytest.approx([0.0] * 11, abs=0.05)
    assert np.abs(np.diff(yaws)).max() < 0.04
    app.sessions.save_copy(tmp_path / "a.sport")
    run(app, 2)
    file, history = SessionFile.open(tmp_path / "a.sport", tmp_path)
    file.close()
    assert history.present.session.takes[0].cameras == keys(app)
    point(app, *place(app, "##camera keys", share=10 / 69), 1, True)
    point(app, *place(app, "##camera keys", share=10 / 69), 1, False)
    click_on(app, "Delete")
    assert len(keys(app)) == 1
