"""The real application without a display: projects are saved, opened, autosaved, and outlive a killed process."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from app_driver import Start, click_on, drawn, press, prompt, run
from gltf_characters import user_character

from runtime.character.writer import write_character
from runtime.file_lock import open_locked
from runtime.projects.project import load_project
from runtime.terrain.files import write_height_png
from viewer.app import App
from viewer.projects.autosave import find_sessions
from viewer.projects.notes import StyleNotes

KILLED = Path(__file__).with_name("faults") / "project.py"


def said(app: App) -> str:
    """The last message, also when a slow machine has let it fade."""
    return app.messages.recent[-1].text


def record(app: App, frames: int = 30) -> None:
    app.takes.toggle_recording()
    app.window.inject_key("w", True)
    run(app, frames)
    app.window.inject_key("w", False)
    app.takes.toggle_recording()


def filled(app: App, tmp_path: Path) -> None:
    """Own ground, own character, a prompt, and two takes, the second renamed and edited."""
    write_height_png(tmp_path / "dunes.png", np.random.default_rng(1).random((40, 40)))
    write_character(tmp_path / "me.glb", user_character())
    app.open_files([tmp_path / "dunes.png", tmp_path / "me.glb"])
    app.prompting.submit_prompt("a proud king")
    run(app, 2)
    record(app)
    record(app, 40)
    app.takes.rename(1, "long walk")
    app.takes.play(1)
    app.takes.playback.seek(20)  # type: ignore[union-attr]
    app.editing.insert_prompt("an old king")
    app.takes.close_playback()
    run(app, 2)


def test_everything_is_there_again_and_takes_can_still_be_edited(start: Start, tmp_path: Path) -> None:
    app = start()
    filled(app, tmp_path)
    project = tmp_path / "walks.sport"
    app.sessions.save_as(tmp_path / "walks")
    run(app, 2)
    assert project.is_file()
    assert "Saved" in said(app)
    assert "2 takes" in said(app)
    assert not app.sessions.changed
    clip, heights = app.editor.session.takes[1].clip, app.scene.terrain.heights
    app.close()
    (tmp_path / "dunes.png").unlink()  # the project needs neither
    (tmp_path / "me.glb").unlink()

    again = start(project=str(project))
    run(again, 10)
    items = again.state.takes.items
    assert [item.name for item in items] == ["Take 1", "long walk"]
    assert np.allclose(items[1].clip.local_rotations, clip.local_rotations, atol=4e-5)
    assert Path(again.scene.terrain_spec).name == "dunes.png"
    assert np.array_equal(again.scene.terrain.heights, heights)
    assert again.stage.character_path is not None
    assert again.stage.character_path.name == "me.glb"
    assert prompt(again) == "a proud king"
    assert not again.sessions.changed
    again.takes.play(1)
    again.editing.undo()  # the version before the edit came along
    assert [event.prompt for event in items[1].clip.prompts] == ["a proud king"]
    again.editing.reword(0, "proud peacock")
    run(again, 2)
    assert items[1].clip.prompts[0].prompt == "proud peacock"
    assert again.sessions.changed


def test_an_autosaved_session_is_at_most_ten_seconds_old_and_offered(start: Start, tmp_path: Path) -> None:
    app = start()
    projects, now = app.sessions, [0.0]
    projects.autosaving, projects.clock = True, lambda: now[0]
    folder = projects.folder
    record(app)
    run(app)
    assert app.editor.session.takes[0].journal is None  # the session holds it
    now[0] = 5.0
    app.takes.rename(0, "kept")
    run(app)
    (path,) = folder.glob("*.sport")
    assert load_project(path).takes[0].name == ""
    now[0] = 9.0
    run(app)
    assert load_project(path).takes[0].name == "kept"
    assert find_sessions(folder) == []  # this process holds it
    projects._file.leave(keep=True)  # as if it had been killed
    app.close()

    other = start()
    other.desk.begin(None, autosaving=True)
    assert "Cut off: untitled, 1 take" in said(other)
    run(other, 3)
    click_on(other, "##project")
    click_on(other, "Reopen", 1)  # of the menu; the other one is under Clips
    run(other, 3)
    assert [item.name for item in other.state.takes.items] == ["kept"]


def killed_while_recording(start: Start, tmp_path: Path) -> tuple[Path, Path]:
    """What a run leaves that had one take and was recording a second one: its session and the journal, elsewhere."""
    app = start()
    projects = app.sessions
    projects.autosaving = True
    record(app)
    run(app, 2)
    app.takes.toggle_recording()
    run(app, 30)
    app.takes.journals.close()
    (journal,) = (tmp_path / "config" / "journals").glob("*.take")
    (session,) = projects.folder.glob("*.sport")
    projects._file.leave(keep=True)  # as if it had been killed
    moved = tmp_path / session.name, tmp_path / journal.name
    shutil.move(session, moved[0])
    shutil.move(journal, moved[1])
    app.close()
    return moved


@pytest.mark.parametrize("button", ["Reopen", "Discard"])
@pytest.mark.parametrize("late", [False, True])
def test_a_killed_run_is_one_offer(start: Start, tmp_path: Path, button: str, late: bool) -> None:
    session, journal = killed_while_recording(start, tmp_path)
    app, now = start(), [0.0]
    projects = app.sessions
    projects.clock = lambda: now[0]
    places = (projects.folder / session.name, tmp_path / "config" / "journals" / journal.name)
    shutil.copy(session, places[0])
    shutil.copy(journal, places[1])
    locks: list[int] = []
    if late:  # the system has not ended the killed process yet
        lock = places[0].with_name(places[0].name + ".lock")
        locks = [handle for path in (lock, places[1]) if (handle := open_locked(path, create=True))]
        assert len(locks) == 2
    app.takes.journals.look()
    app.desk.begin(None, autosaving=True)
    run(app, 2)
    if late:
        assert not any("Reopen" in label for label, _ in drawn(app))
        for lock in locks:
            os.close(lock)
        now[0] = 3.0
        run(app, 2)
    assert "Cut off: untitled, 2 takes" in said(app)
    labels = [label.partition("##")[0] for label, _ in drawn(app)]
    assert labels.count("Reopen") == 1
    assert "Recover" not in labels
    click_on(app, button)
    run(app, 5)
    assert len(app.editor.session.takes) == (2 if button == "Reopen" else 0)
    assert app.state.takes.cut_off == []
    assert app.sessions.offer is None
    labels = [label.partition("##")[0] for label, _ in drawn(app)]
    assert not {"Reopen", "Recover"} & set(labels)
    if button == "Discard":
        assert not any(path.exists() for path in places)
    now[0] = 60.0
    run(app, 5)
    assert app.sessions.offer is None


def test_a_new_project_puts_aside_what_was_not_saved(start: Start, tmp_path: Path) -> None:
    app = start()
    app.sessions.autosaving = True
    record(app)
    run(app)
    app.sessions.new()
    assert app.editor.session.takes == []
    assert "Reopen the last session" in said(app)
    (left,) = app.sessions.left
    assert left.ended
    app.sessions.reopen(left)
    run(app, 3)
    assert len(app.editor.session.takes) == 1


@pytest.mark.parametrize("content", [b"", b"PK\x05\x06" + bytes(18), b"no project"])
def test_a_damaged_project_is_one_sentence_and_costs_nothing(
    content: bytes, start: Start, tmp_path: Path
) -> None:
    app = start()
    record(app)
    (tmp_path / "bad.sport").write_bytes(content)
    app.open_files([tmp_path / "bad.sport"])
    run(app, 2)
    assert "bad.sport: not a project" in said(app)
    assert len(app.editor.session.takes) == 1


def test_without_a_dialog_program_the_path_is_typed(start: Start, tmp_path: Path) -> None:
    app = start()
    app.sessions.dialogs.available = lambda: False
    record(app)
    press(app, "ctrl", "s")
    assert "No program for dialogs" in said(app)
    run(app, 3)
    app.window.inject_text(str(tmp_path / "typed"))
    run(app, 2)
    click_on(app, "##dialog ok")
    run(app, 2)
    assert (tmp_path / "typed.sport").is_file()
    assert app.sessions.name == "typed"


def test_a_systems_dialog_hands_over_its_answer(start: Start, tmp_path: Path) -> None:
    class Native:
        def ready(self, _: int) -> bool:
            return True

        def result(self) -> str:
            return str(tmp_path / "native.sport")

    app = start()
    app.sessions.dialogs.available, app.sessions.dialogs.native = lambda: True, lambda _: Native()
    app.sessions.ask_save()
    run(app, 2)
    assert (tmp_path / "native.sport").is_file()
    assert not any("dialog ok" in label for label, _ in drawn(app))


def test_a_killed_process_leaves_its_project_whole_and_an_autosave(tmp_path: Path) -> None:
    """A real process saves a project, goes on, and is killed."""
    command = [sys.executable, str(KILLED), str(tmp_path)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env={**os.environ})
    assert process.stdout is not None
    try:
        told = process.stdout.readline().strip()
        while told and told != "autosaved":
            told = process.stdout.readline().strip()
    finally:
        process.send_signal(signal.SIGKILL)
        process.wait(20)
    assert told == "autosaved"
    assert len(load_project(tmp_path / "walks.sport", StyleNotes()).takes) == 2
    (left,) = find_sessions(tmp_path / "config" / "sessions")
    assert (left.takes, left.ended) == (3, False)
    assert Path(left.origin) == tmp_path / "walks.sport"


def test_a_take_plays_on_the_ground_that_it_was_made_on(start: Start, tmp_path: Path) -> None:
    app = start()
    record(app)
    flat = app.scene.terrain
    app.scene.load_terrain("stairs")
    record(app)
    run(app, 2)
    app.takes.play(0)
    run(app)
    assert app.scene.renderer.terrain is flat
    app.takes.play(1)
    run(app)
    assert app.scene.renderer.terrain.name == "stairs"
    app.takes.play(0)
    app.takes.close_playback()
    run(app)
    assert app.scene.renderer.terrain is app.scene.terrain
    app.takes.play(0)
    app.scene.load_terrain("hills")  # chosen while it plays: to see it there
    run(app)
    assert app.scene.renderer.terrain.name == "hills"
