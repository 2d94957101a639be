"""The real application without a display: takes, playback, export and pictures."""

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest

from runtime.errors import FileError
from runtime.formats.bvh import read_bvh
from runtime.formats.bvh_clip import load_clip_bvh
from runtime.motion.controller import TEMPERATURE
from runtime.session.frames import HIPS_STEP_M
from runtime.session.session_file import SessionFile
from tests.helpers.app_driver import Start, click_on, do, export_bvh, message, run
from viewer.app import App
from viewer.session.opening import open_file


def record(app: App, frames: int = 30) -> None:
    app.window.inject_key("w", True)
    app.window.inject_key("r", True)
    app.window.inject_key("r", False)
    run(app, frames)
    app.window.inject_key("r", True)
    app.window.inject_key("r", False)
    run(app)
    app.window.inject_key("w", False)
    run(app)


def test_record_play_trim_export(app: App, tmp_path: Path) -> None:
    record(app)
    assert [take.title for take in app.editor.session.takes] == ["Take 1"]
    take = app.editor.session.takes[0].clip
    shown = [pose.hips_position for pose in app.scene.renderer.poses]
    there = [np.allclose(place, take.hips_positions[0], atol=HIPS_STEP_M) for place in shown]
    begin = there.index(True)  # what the screen showed is what the take holds, as finely as a file keeps it
    assert np.allclose(shown[begin : begin + len(take)], take.hips_positions, atol=HIPS_STEP_M)

    app.takes.play(1)
    app.takes.playback.seek(5)
    click_on(app, "[ In")
    app.takes.playback.seek(20)
    click_on(app, "Out ]")
    export_bvh(app, tmp_path / "new folder" / "walk")
    assert app.bvh_export.saved(app.editor.session.takes[0]) == tmp_path / "new folder" / "walk.bvh"
    motion = read_bvh(tmp_path / "new folder" / "walk.bvh")
    assert len(motion.positions) == 16
    assert motion.fps == pytest.approx(60.0, abs=1e-3)
    assert motion.positions[0, 0] == pytest.approx(100 * take.hips_positions[5], abs=0.01)


def test_an_exported_take_tells_its_styles_with_their_transitions_and_what_was_asked_for(
    start: Start, tmp_path: Path
) -> None:
    app = start(terrain="hills")
    app.settings.blend_seconds = 0.4
    do(app, "run 2; prompt a proud king; run 2")
    app.takes.toggle_recording()
    app.window.inject_key("w", True)
    do(app, "run 12; prompt an old king; run 20")
    app.takes.toggle_recording()
    app.window.inject_key("w", False)
    export_bvh(app, tmp_path / "walk.bvh")
    back = load_clip_bvh(tmp_path / "walk.bvh")
    assert [event.prompt for event in back.prompts] == ["a proud king", "an old king"]
    changed = back.prompts[1]
    assert changed.transition_seconds == pytest.approx(0.4)
    assert json.loads(changed.words)["torso"] == "torso of an old king"
    assert changed.seconds == pytest.approx(12 / 60, abs=2 / 60)
    assert dict(back.gait_seconds)["walk"] > 0.4
    assert (back.terrain, back.origin.terrain_seed, back.origin.temperature) == ("hills", 0, TEMPERATURE)
    open_file(app.takes, tmp_path / "walk.bvh")
    run(app, 2)
    assert "an old king" in app.editor.session.takes[-1].made.header.describe()


def test_a_failing_export_keeps_the_clip(app: App, tmp_path: Path) -> None:
    record(app)
    blocked = tmp_path / "file"
    blocked.write_text("", encoding="utf-8")
    export_bvh(app, blocked / "walk.bvh")
    assert str(blocked) in message(app)
    assert len(app.editor.session.takes) == 1
    assert app.bvh_export.saved(app.editor.session.takes[0]) is None
    app.bvh_export.path = ""
    app.bvh_export.export()
    assert "path is empty" in message(app)


def test_an_earlier_file_is_overwritten_only_when_its_path_was_typed(start: Start, tmp_path: Path) -> None:
    earlier = tmp_path / "take-1.bvh"  # of another session
    earlier.write_text("earlier", encoding="utf-8")
    app = start()
    app.settings.export_folder = str(tmp_path)
    run(app, 2)
    record(app)
    own = tmp_path / "take-1-2.bvh"
    assert app.bvh_export.path == str(own)
    own.write_text("of a viewer beside this one", encoding="utf-8")  # the name is no longer free
    export_bvh(app)
    assert (earlier.read_text("utf-8"), own.read_text("utf-8")) == ("earlier", "of a viewer beside this one")
    own = tmp_path / "take-1-3.bvh"
    assert app.bvh_export.saved(app.editor.session.takes[0]) == own
    again = tmp_path / "take-1-4.bvh"
    assert app.bvh_export.path == str(again)  # its own file of this session is not replaced either
    app.takes.play(1)
    app.takes.trim(first=5)
    export_bvh(app)
    assert len(load_clip_bvh(own)) == len(load_clip_bvh(again)) + 5
    assert sorted(tmp_path.glob("*.bvh")) == [tmp_path / "take-1-2.bvh", own, again, earlier]
    export_bvh(app, earlier)
    assert earlier.read_text("utf-8").startswith("HIERARCHY")
    app.bvh_export.path = str(own)  # typed: once proposed, but not what is proposed now
    export_bvh(app)
    assert app.bvh_export.saved(app.editor.session.takes[0]) == own


def test_a_trimmed_file_is_not_written_over_the_one_it_was_opened_from(app: App, tmp_path: Path) -> None:
    record(app)
    original = tmp_path / "take-1.bvh"
    app.bvh_export.path = str(original)
    app.bvh_export.export()
    app.takes.remove(1)
    before = original.read_bytes()
    open_file(app.takes, original)
    run(app)
    app.takes.playback.seek(10)
    click_on(app, "Out ]")
    export_bvh(app)
    assert original.read_bytes() == before
    assert len(load_clip_bvh(tmp_path / "take-1-2.bvh")) == 11


def test_the_last_seconds_are_always_in_memory(app: App) -> None:
    app.settings.keep_seconds = 0.25
    run(app, 40)
    app.window.inject_key("t", True)
    run(app)
    assert len(app.editor.session.takes[0].clip) == 15
    assert not app.takes.recording


def test_moving_leaves_the_playback_and_nothing_else_does(app: App) -> None:
    record(app)
    do(app, "play 1; run 3")
    assert app.takes.playback is not None
    app.window.inject_key("w", True)
    run(app)
    assert app.takes.playback is None
    app.takes.play(1)  # with the key still held the clip plays on
    run(app, 3)
    assert app.takes.playback is not None


def kept(folder: Path) -> list[str]:
    """Titles of the takes in the one untitled session of a folder."""
    (path,) = (folder / "sessions").glob("*.sport")
    file, history = SessionFile.open(path, folder / "characters")
    file.close()
    return [take.title for take in history.present.session.takes]


def test_a_screenshot_that_fails_costs_neither_takes_nor_settings(app: App, tmp_path: Path) -> None:
    blocked = tmp_path / "file"
    blocked.write_text("", encoding="utf-8")
    app.options = dataclasses.replace(app.options, offscreen=False, screenshot=blocked / "shot.png")
    app.kept.active = True
    run(app, 2)
    record(app)
    with pytest.raises(FileError, match=r"shot\.png"):
        app.end()
    assert kept(tmp_path / "config") == ["Take 1"]
    assert (tmp_path / "config" / "settings.json").is_file()


def test_screenshot_and_frames_are_written(start: Start, tmp_path: Path) -> None:
    from PIL import Image

    files = {"screenshot": tmp_path / "a" / "out.png", "frames_directory": tmp_path / "film"}
    app = start(drawn=True, width=128, height=96, frames=2, **files)
    while not app.finished:
        app.frame()
    assert app.end() == 0
    with Image.open(tmp_path / "a" / "out.png") as image:
        assert image.size == (128, 96)
    assert sorted(p.name for p in (tmp_path / "film").iterdir()) == ["frame_00000.png", "frame_00001.png"]
