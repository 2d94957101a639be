"""The real application without a display: the timeline of a take, its edits, and going on from a frame of it."""

import threading
from pathlib import Path

import numpy as np
import pytest

from runtime.controls import Controls, Gait
from runtime.pose import Pose
from runtime.session.frames import HIPS_STEP_M
from runtime.session.session import Take
from runtime.takes.clip import Clip
from tests.helpers.app_driver import (
    Start,
    controller,
    do,
    drawn,
    export_bvh,
    frame,
    message,
    place,
    point,
    press,
    prompt,
    record_standing,
    run,
    run_until,
    seek,
    type_prompt,
)
from tests.helpers.viewer_fakes import FakeController
from viewer.app import App
from viewer.gl_bindings import imgui
from viewer.services import Services
from viewer.session.opening import open_file


def record(app: App, frames: int = 40) -> Take:
    """Two prompts, each for so many frames of walking; then the take plays, paused at its start."""
    do(app, "run 2; prompt a proud king; run 2")
    app.takes.toggle_recording()
    app.window.inject_key("w", True)
    run(app, frames)
    app.prompting.submit_prompt("an old king")
    run(app, frames)
    app.window.inject_key("w", False)
    app.takes.toggle_recording()
    do(app, "play 1; seek 0")
    return take(app)


def take(app: App) -> Take:
    return app.editor.session.takes[0]


def drag(app: App, label: str, first: float, last: float, down: float = 0.5) -> None:
    """Drag on a track from one share of its width to another, at a share of its height."""
    left, y = place(app, label, share=first)
    right, _ = place(app, label, share=last)
    y = place(app, label)[1] + (down - 0.5) * 26.0
    point(app, left, y)
    point(app, left, y, 0, True)
    for share in (0.5, 1.0):
        point(app, left + (right - left) * share, y)
    point(app, right, y, 0, False)


def same(a: Clip, b: Clip, first: int = 0, last: int | None = None) -> bool:
    """Whether frames are those of another clip, as finely as a file keeps them."""
    hips, turns = a.hips_positions - b.hips_positions, a.local_rotations - b.local_rotations
    return bool(np.abs(hips[first:last]).max() < HIPS_STEP_M and np.abs(turns[first:last]).max() < 1e-4)


def prompts(app: App) -> list[tuple[str, int]]:
    return [(event.prompt, round(event.seconds * 60)) for event in take(app).clip.prompts]


def test_the_keys_of_a_take(app: App) -> None:
    record(app)
    playback = app.takes.playback
    assert playback is not None
    look = app.scene.camera.current.yaw
    for key, shown in (("right", 1), ("right", 2), ("left", 1), ("end", 79), ("home", 0)):
        press(app, key)
        assert frame(app) == shown, key
    assert app.scene.camera.current.yaw == look  # the arrows are the take's
    press(app, "space")
    assert playback.playing
    press(app, "space")
    assert not playback.playing
    do(app, "key escape; key space")
    assert controller(app).steps > 0
    assert app.takes.playback is None


def test_the_words_shown_are_those_of_the_take_that_plays(app: App) -> None:
    record(app)
    do(app, "prompt proud peacock; seek 5")
    assert app.editing.prompt == "a proud king"
    seek(app, 60)
    assert app.editing.prompt == "an old king"
    assert app.editing.parts["torso"] == "torso of an old king"
    press(app, "escape")
    assert prompt(app) == "proud peacock"  # live again


def test_trim_handles_are_dragged(app: App) -> None:
    record(app)
    drag(app, "##timeline", 0.0, 0.25, down=0.8)
    playback = app.takes.playback
    assert 18 <= playback.first <= 22
    drag(app, "##timeline", 0.995, 0.5, down=0.8)
    assert 37 <= playback.last <= 42
    drag(app, "##timeline", 0.6, 0.3, down=0.2)  # the upper half scrubs
    assert 21 <= playback.frame <= 26


def test_another_prompt_is_inserted_by_mouse_and_keys_and_undone(app: App) -> None:
    before = record(app)
    do(app, "seek 20; click + Prompt; type a zombie; key enter")
    assert prompts(app) == [("a proud king", 0), ("a zombie", 20), ("an old king", 40)]
    assert "a zombie" in message(app)
    assert app.editing.prompt == "a zombie"
    press(app, "ctrl", "z")
    assert take(app) == before
    press(app, "ctrl", "y")
    assert len(take(app).clip.prompts) == 3


def test_a_prompt_is_moved_reworded_and_one_part_of_it_changed(app: App) -> None:
    record(app)
    drag(app, "##prompts", 0.505, 0.25)  # by its beginning
    assert [p for p, _ in prompts(app)] == ["a proud king", "an old king"]
    assert 17 <= prompts(app)[1][1] <= 22
    do(app, "seek 60; key enter")
    assert imgui.get_io().want_text_input
    do(app, "key ctrl+a; type a goose; key enter")
    assert [p for p, _ in prompts(app)] == ["a proud king", "a goose"]
    app.editing.reword_part(1, "head", "looking up")
    run(app, 2)
    assert app.editing.parts["head"] == "looking up"
    assert app.editing.parts["torso"] == "torso of a goose"
    for _ in range(3):
        press(app, "ctrl", "z")
    assert prompts(app) == [("a proud king", 0), ("an old king", 40)]


def test_a_long_prompt_of_a_take_is_in_its_field_as_it_was_typed(app: App) -> None:
    record(app)
    seek(app, 60)
    text = "an old king who has lost his crown and looks for it in the grass, step by step"
    app.editing.insert_prompt(text)
    run(app, 3)
    assert app.editing.prompt == text


def test_a_gait_is_inserted_and_the_stick_goes_on(app: App) -> None:
    before = record(app)
    do(app, "seek 30; click + Gait; click Jog")
    assert same(take(app).clip, before.clip, 0, 30)
    assert take(app).clip.gaits is not None
    assert set(take(app).clip.gaits[30:]) == {Gait.JOG}
    ways = [c.hips_positions[-1] - c.hips_positions[30] for c in (before.clip, take(app).clip)]
    ends = [float(np.linalg.norm(way)) for way in ways]
    assert ends[1] > 1.8 * ends[0]  # it jogs as far as the stick says
    assert take(app).frames == before.frames


def test_driving_goes_on_from_a_frame_of_a_take(app: App) -> None:
    record(app)
    do(app, "prompt proud peacock; ground stairs; run 3")
    app.takes.play(1)  # which the choice of the ground has ended
    do(app, "seek 25; click ##go on")
    assert app.takes.playback is None
    assert prompt(app) == "a proud king"
    assert app.scene.terrain.name == "flat"  # the take's ground
    at = app.scene.simulation.current.hips_position
    assert np.linalg.norm(at - take(app).clip.hips_positions[25]) < 0.1
    record_standing(app, 10)
    again = app.editor.session.takes[-1]
    assert [event.prompt for event in again.clip.prompts] == ["a proud king"]
    assert again.made.inputs is not None


def test_a_take_from_a_file_says_why_it_cannot_be_edited(app: App, tmp_path: Path) -> None:
    record(app)
    export_bvh(app, f"{tmp_path}/walk.bvh")
    open_file(app.takes, tmp_path / "walk.bvh")
    seek(app, 10)
    assert [bar.text for bar in app.editing.tracks.prompts] == ["a proud king", "an old king"]  # type: ignore[union-attr]
    assert "comes from a file" in app.editing.fixed
    app.editing.insert_prompt("a zombie")
    assert "comes from a file" in message(app)
    assert app.editor.undo_label == "opening of walk.bvh"


@pytest.mark.parametrize("size", [(1280, 720), (800, 500)])
def test_the_feet_stand_above_the_bar(start: Start, size: tuple[int, int]) -> None:
    app = start(width=size[0], height=size[1])
    record(app, 20)
    app.editing.part_tracks = True
    run(app, 60)  # the camera glides
    camera = app.scene.camera.current
    matrix = camera.projection_matrix(size[0] / size[1]) @ camera.view_matrix()
    points = take(app).clip.pose(frame(app)).positions
    clip = np.concatenate([points, np.ones((len(points), 1))], axis=1) @ matrix.T
    bottom = size[1] * (0.5 - 0.5 * float((clip[:, 1] / clip[:, 3]).min()))
    assert bottom < place(app, "##timeline")[1] - 90.0  # buttons stand between


@pytest.mark.usefixtures("loaded_once")
def test_a_new_prompt_leaves_the_frames_before_it_as_they_were(start: Start) -> None:
    """With the shipped model."""
    app = start(services={"load_model": Services().load_model})
    before = record(app, 25)
    do(app, "seek 35; insert a zombie; run 2")
    assert same(take(app).clip, before.clip, 0, 35)
    assert not same(take(app).clip, before.clip, 37)
    press(app, "ctrl", "z")
    assert take(app) == before
    app.editing.reword(1, "an old king")  # the same words again
    run(app, 2)
    assert take(app).motion != before.motion
    assert same(take(app).clip, before.clip)
    type_prompt(app, "x")
    assert imgui.get_io().want_text_input


@pytest.mark.parametrize("size", [(1280, 720), (800, 500), (1280, 300)])  # the last one scrolls
def test_the_ruler_lies_over_the_tracks(start: Start, size: tuple[int, int]) -> None:
    app = start(width=size[0], height=size[1])
    record(app)
    rows = {label: box for label, box in drawn(app) if label in ("##timeline", "##prompts", "##gaits")}
    assert len(rows) == 3
    assert len({(left, right) for left, _, right, _ in rows.values()}) == 1


class Gate:
    """Lets a worker that resimulates go on when it is opened."""

    def __init__(self, app: App, monkeypatch: pytest.MonkeyPatch) -> None:
        self.app, self.open = app, threading.Event()
        step = FakeController.step

        def gated(controller: FakeController, controls: Controls) -> Pose:
            if threading.current_thread() is not threading.main_thread():
                self.open.wait(20)
            return step(controller, controls)

        monkeypatch.setattr(FakeController, "step", gated)
        app.jobs.blocking = False

    def finish(self) -> None:
        self.open.set()
        run_until(self.app, lambda: not self.app.jobs._jobs)


@pytest.mark.parametrize("then", ["undo", "other take", "delete", "finish", "cancel"])
def test_what_is_done_while_a_prompt_is_moved(app: App, monkeypatch: pytest.MonkeyPatch, then: str) -> None:
    record(app)
    do(app, "stand 30; play 1; seek 0")
    before = app.editor.session
    gate = Gate(app, monkeypatch)
    drag(app, "##prompts", 0.505, 0.25)
    assert app.editing.busy
    assert app.editor.undo_label.startswith("move of a prompt")
    if then == "undo":
        press(app, "ctrl", "z")
        assert "before it had finished" in message(app)
    elif then == "other take":
        do(app, "play 2; run 5")
        drag(app, "##prompts", 0.2, 0.6)
    elif then == "delete":
        app.takes.remove(1)
    elif then == "cancel":
        monkeypatch.setattr("viewer.jobs.PATIENCE_S", -1.0)
        do(app, "run 2; click ##doing")
    gate.finish()
    run(app, 3)
    made = app.editor.session.take(1)
    if then in ("undo", "cancel"):
        assert app.editor.session == before
        assert not app.editing.busy
    elif then == "delete":
        assert made is None
        press(app, "ctrl", "z")
        assert prompts(app)[1][1] < 25
    else:
        assert made is not None
        assert prompts(app)[1][1] < 25
        assert app.editor.session.takes[1] == before.takes[1]


def test_undo_while_a_gait_is_made_takes_that_back_and_not_the_split(
    app: App, monkeypatch: pytest.MonkeyPatch
) -> None:
    record(app)
    seek(app, 40)
    app.cutting.split()
    run(app, 2)
    split = app.editor.session
    gate = Gate(app, monkeypatch)
    seek(app, 20)
    app.editing.insert_gait(Gait.JOG)
    press(app, "ctrl", "z")
    gate.finish()
    assert app.editor.session == split
    press(app, "ctrl", "z")
    assert len(app.editor.session.takes) == 1
    press(app, "ctrl", "y")
    assert app.editor.session == split


def test_the_keys_of_editors_trim_key_and_shuttle(app: App) -> None:
    record(app)
    playback = app.takes.playback
    assert playback is not None
    for key, at in (("i", 10), ("o", 60)):
        seek(app, at)
        press(app, key)
    assert take(app).range == (10, 60)
    do(app, "seek 30; key s")
    assert [round(key.seconds * 60) for key in take(app).cameras] == [30]
    press(app, "l")
    assert (playback.playing, playback.rate) == (True, 1)
    press(app, "l")
    assert playback.rate == 2
    press(app, "j")
    assert playback.rate == -1
    at = playback.time_s
    run(app, 2)
    assert playback.time_s < at
    press(app, "k")
    assert not playback.playing


def test_p_while_recording_ends_the_take_and_plays_it(app: App) -> None:
    record(app)
    app.takes.close_playback()
    app.takes.toggle_recording()
    do(app, "run 10; key p")
    assert not app.takes.recording
    assert app.takes.playback.number == 2


def test_versions_of_a_take_are_gone_back_to_and_compared_with(app: App) -> None:
    before = record(app)
    app.editing.reword(1, "a goose")
    run(app, 3)
    (_, first), (label, second) = app.takes.versions(1)
    assert first.motion == before.motion
    assert label.startswith("words of")
    assert second.motion == take(app).motion
    app.takes.go_back_to(first)
    run(app, 3)
    assert prompts(app) == [("a proud king", 0), ("an old king", 40)]
    app.takes.compare_with(second)
    run(app, 3)
    assert app.references.reference.take == 2
    assert [event.prompt for event in app.editor.session.takes[1].clip.prompts] == ["a proud king", "a goose"]
