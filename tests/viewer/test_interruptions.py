"""The real application: what a user does while something else is under way, a drag or a job, and what comes of both."""

import threading
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from runtime.takes.camera_keys import CameraKey
from runtime.takes.pins import Pin, Pinned
from tests.helpers.app_driver import (
    do,
    export_bvh,
    message,
    place,
    point,
    press,
    record,
    run,
    run_until,
    save_and_leave,
    screen_point,
    titles,
)
from viewer.app import App
from viewer.session import opening, takes


class Gate:
    """Holds the workers that call a function until it is opened; from then on jobs are those of a window."""

    def __init__(self, app: App, patch: pytest.MonkeyPatch, owner: Any, name: str) -> None:
        self.app, self.is_open, held = app, threading.Event(), getattr(owner, name)

        def gated(*about: Any) -> Any:
            assert self.is_open.wait(20)
            return held(*about)

        patch.setattr(owner, name, gated)
        app.jobs.blocking = False

    def open(self) -> None:
        self.is_open.set()
        run_until(self.app, lambda: not self.app.jobs._jobs)


def two_prompts(app: App) -> None:
    """A take of two prompts, 40 frames each, which plays, paused at its start."""
    do(app, "run 2; prompt a proud king; run 2")
    app.takes.toggle_recording()
    do(app, "run 40; prompt an old king; run 40")
    app.takes.toggle_recording()
    do(app, "play 1; seek 0")


def blocks(app: App) -> list[tuple[int, int]]:
    return [(item.start, item.end) for item in app.transport.selection.all(["prompts"])]


# --- drags
@pytest.mark.parametrize("keys", [("ctrl", "z"), ("delete",)])
def test_a_path_whose_first_point_is_taken_back_while_it_is_drawn(app: App, keys: tuple[str, ...]) -> None:
    app.scene.camera.current.yaw = 0.0
    do(app, "run 5; click Draw a path")
    point(app, *screen_point(app, -1.0, 2.0))
    point(app, *screen_point(app, -1.0, 2.0), 0, True)
    assert len(app.path.points) == 1
    press(app, *keys)
    assert not app.path.points
    for x in (-0.5, 0.0, 1.0):
        point(app, *screen_point(app, x, 2.0))
    point(app, *screen_point(app, 1.0, 2.0), 0, False)
    assert not app.path.points


@pytest.mark.parametrize("track", ["##pins 0", "##camera keys"])
@pytest.mark.parametrize("undos", [1, 2])
def test_undo_ends_a_drag_on_a_track(app: App, track: str, undos: int) -> None:
    record(app, 60)
    do(app, "play 1; seek 0")
    pins = (Pin(Pinned.LEFT_HAND, (0.3, 1.2, 0.3), 0.1, 0.5),)
    poses, key = replace(app.takes.played.poses, pins=pins), CameraKey(0.5, 0.0, 0.0, 3.0, 0.0, 0.0, 0.0)
    app.editor.put("pins", 1, poses=poses, cameras=(key,))
    run(app, 3)
    x, y = place(app, track)
    before = app.editor.session
    for by, down in ((0, False), (0, True), (20, True)):
        point(app, x + by, y, 0, down)
    assert app.editor.session != before
    for _ in range(undos):
        press(app, "ctrl", "z")
    after = app.editor.session
    for by, down in ((40, True), (60, True), (60, False)):
        point(app, x + by, y, 0, down)
    assert app.editor.session == after


def test_a_prompt_that_is_dragged_is_shown_where_it_would_be(app: App) -> None:
    two_prompts(app)
    x, y = place(app, "##prompts")
    for by, down in ((1, False), (1, True), (-100, True)):
        point(app, x + by, y, 0, down)
    run(app, 3)
    timeline = app.transport.timeline
    track = next(row.track for row in timeline._kept["tracks"][1].rows if row.track.key == "prompts")
    assert track.marks[1].start == 40
    assert timeline._moved(track)[1].start < 35
    press(app, "ctrl", "z")
    point(app, x - 100, y, 0, False)
    assert app.transport.selection.preview is None


@pytest.mark.parametrize(("index", "by", "left"), [(0, -60, [(0, 1), (1, 80)]), (1, 60, [(0, 79), (79, 80)])])
def test_a_block_is_not_moved_out_of_its_take(
    app: App, index: int, by: int, left: list[tuple[int, int]]
) -> None:
    two_prompts(app)
    selection = app.transport.selection
    selection.pick([selection.all(["prompts"])[index]])
    selection.nudge(by)
    run(app, 3)
    assert blocks(app) == left


# --- jobs
def test_a_file_that_is_opened_twice_is_one_step(
    app: App, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    record(app)
    export_bvh(app, tmp_path / "a.bvh")
    gate = Gate(app, monkeypatch, opening, "read_take")
    for _ in range(2):
        opening.open_file(app.takes, tmp_path / "a.bvh")
        run(app)
    gate.open()
    assert titles(app) == ["Take 1", "a"]
    do(app, "undo")
    assert app.editor.undo_label == "recording of Take 1"


def another_session(app: App, path: Path) -> None:
    app.sessions.open(path)
    run_until(app, lambda: app.sessions.name == path.stem)


@pytest.mark.parametrize("then", ["recording", "session"])
def test_a_take_that_is_loaded_when_it_is_wanted_no_more_does_not_play(
    app: App, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, then: str
) -> None:
    record(app)
    save_and_leave(app, tmp_path / "a.sport")
    record(app, 30)
    gate = Gate(app, monkeypatch, takes, "_loaded")
    app.takes.play(1)
    if then == "recording":
        app.takes.toggle_recording()
    else:
        another_session(app, tmp_path / "a.sport")
    gate.open()
    assert app.takes.playback is None
    assert app.takes.recording == (then == "recording")


def test_a_file_that_opens_ends_the_recording(app: App, tmp_path: Path) -> None:
    record(app)
    export_bvh(app, tmp_path / "a.bvh")
    record(app, 30, stop=False)
    opening.open_file(app.takes, tmp_path / "a.bvh")
    run(app, 2)
    assert not app.takes.recording
    assert app.takes.playback is not None
    assert sorted(take.frames for take in app.editor.session.takes) == [20, 20, 31]


def test_a_ground_that_loads_while_another_session_opens_is_not_that_ones(
    app: App, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    record(app)
    save_and_leave(app, tmp_path / "a.sport")
    gate = Gate(app, monkeypatch, app.scene, "read_ground")
    app.scene.load_terrain("hills")
    another_session(app, tmp_path / "a.sport")
    gate.open()
    assert app.editor.session.ground.spec == "flat"
    assert app.scene.loading == ""


def test_lost_takes_come_back_whatever_is_looked_at(app: App, monkeypatch: pytest.MonkeyPatch) -> None:
    record(app)
    app.takes.remove(1)
    for number in range(205):
        app.editor.do("edit", lambda session, n=number: replace(session, counter=10 + n))  # type: ignore[misc]
    assert app.editor.file.flush(20.0)
    app.sessions.find_lost()
    (lost,) = app.sessions.lost
    gate = Gate(app, monkeypatch, type(app.editor.file), "found_takes")
    app.sessions.recover(lost)
    app.sessions.find_lost()  # as the session's menu does when it opens
    app.sessions.recover(lost)
    assert message(app).startswith("Other takes are being recovered")
    gate.open()
    assert titles(app) == ["Take 1"]


def test_an_answer_to_a_variant_is_not_for_another_session(
    app: App, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    record(app)
    do(app, "prompt a proud king; run 3; key v")
    app.sessions.save_as(tmp_path / "a.sport")
    run(app, 2)
    app.sessions.save_copy(tmp_path / "b.sport")
    run(app, 2)
    gate = Gate(app, monkeypatch, app.prompting, "answer")
    app.compare.ask(1, "someone limping")
    another_session(app, tmp_path / "b.sport")
    variants = app.editor.session.variants
    assert len(variants) == 3
    assert not app.compare.pending
    gate.open()
    assert app.editor.session.variants == variants


def test_a_session_whose_opening_was_stopped_opens_again_and_not_as_a_copy(
    app: App, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    record(app)
    save_and_leave(app, tmp_path / "a.sport")
    gate = Gate(app, monkeypatch, app.sessions, "_read")
    app.sessions.open(tmp_path / "a.sport")
    app.jobs.cancel_reading()
    gate.open()
    run_until(app, lambda: not any(thread.name == "sport reading" for thread in threading.enumerate()))
    another_session(app, tmp_path / "a.sport")
    assert app.sessions.path == tmp_path / "a.sport"


# --- the start
def test_a_session_that_was_moved_away_does_not_stop_the_start(app: App, tmp_path: Path) -> None:
    app.settings.recent_sessions = [str(tmp_path / "gone.sport")]
    app.cut_off.begin()
    assert app.cut_off.left is None


def test_a_character_that_cannot_be_read_leaves_the_mannequin(app: App, tmp_path: Path) -> None:
    shown: list[Any] = []
    app.scene._character, app.scene.renderer.set_character = None, shown.append  # as before the first one
    app.jobs.blocking = False
    (tmp_path / "a.glb").write_bytes(b"no character")
    load = app.scene.services.load_character

    def damaged(path: Path | None, *about: Any) -> Any:
        if path is not None and path.name == "a.glb":
            raise ValueError("damaged")
        return load(path, *about)

    app.scene.services = replace(app.scene.services, load_character=damaged)
    app.scene.open_character(tmp_path / "a.glb", step=False)
    run_until(app, lambda: bool(shown))
