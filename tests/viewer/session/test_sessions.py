"""The real application without a display: a session is new, opened, saved, copied, reverted, and outlives every bad moment."""

import os
import re
import shutil
import sqlite3
import tempfile
import threading
import time
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from runtime.character.writer import write_character
from runtime.errors import FileError
from runtime.formats.bvh_clip import save_bvh
from runtime.session import edits, sqlite_file
from runtime.session.database import Database
from runtime.session.library import find, new_path
from runtime.session.motion import Motion
from runtime.session.session import ModelName, Reference, Session, Take
from runtime.session.session_file import SessionFile
from tests.helpers.app_driver import (
    Start,
    click_on,
    do,
    drawn,
    message,
    prompt,
    record,
    run,
    run_until,
    texts,
    titles,
    type_in,
)
from tests.helpers.full_session import history_of, still, text_of, written
from tests.helpers.gltf_characters import user_character
from tests.helpers.height_maps import write_height_png
from viewer.app import App
from viewer.edit.item_kinds import CAMERA_KEYS
from viewer.jobs import Slot


def said(app: App) -> str:
    """The last message, also when a slow machine has let it fade."""
    return app.messages.recent[-1].text


def in_file(path: Path, cache: Path) -> Session:
    """The session of a file that nobody has open."""
    file, history = SessionFile.open(path, cache)
    file.close()
    return history.present.session


def untitled(tmp_path: Path) -> Path:
    return tmp_path / "config" / "sessions"


def labels(app: App) -> list[str]:
    return [label.partition("##")[0] for label, _ in drawn(app)]


def make_named(path: Path) -> Path:
    """A session of one take in a file."""
    session = edits.with_new_take(Session(), Take(motion=Motion.of(still(30, "named"))))
    return written(path, history_of(session), path.parent)


# --- everything is there again
def test_everything_is_there_again_and_takes_can_still_be_edited(start: Start, tmp_path: Path) -> None:
    write_height_png(tmp_path / "dunes.png", np.random.default_rng(1).random((40, 40)))
    write_character(tmp_path / "me.glb", user_character())
    app = start()
    app.open_files([tmp_path / "dunes.png", tmp_path / "me.glb"])
    do(app, "prompt a proud king; run 2; record; record 40")
    app.takes.rename(2, "long walk")
    app.takes.play(2)
    app.takes.playback.seek(20)  # type: ignore[union-attr]
    app.editing.insert_prompt("an old king")
    app.takes.trim(5, 30)
    app.camera_keys.add()
    do(app, "close; mirror 1; close; undo")
    app.sessions.save_as(tmp_path / "walks")
    assert said(app) == f"Saved {tmp_path / 'walks.sport'}."
    assert app.sessions.name == "walks"
    clip, before = app.editor.session.takes[1].made.clip, text_of(app.editor.session)
    undo, redo = app.editor.undo_label, app.editor.redo_label
    app.close()
    shutil.rmtree(tmp_path / "config" / "characters")
    for name in ("dunes.png", "me.glb"):
        (tmp_path / name).unlink()  # the session needs neither

    again = start(session=str(tmp_path / "walks.sport"))
    run(again, 5)
    assert text_of(again.editor.session) == before
    assert (again.editor.undo_label, again.editor.redo_label) == (undo, redo)
    assert titles(again) == ["Take 1", "long walk"]
    turns = again.editor.session.takes[1].made.clip.local_rotations
    assert np.allclose(turns, clip.local_rotations, atol=4e-5)
    assert Path(again.scene.terrain_spec).name == "dunes.png"
    assert again.scene.character_path.name == "me.glb"
    assert prompt(again) == "a proud king"
    again.editor.redo()
    assert titles(again) == ["Take 1", "long walk", "Take 1, mirrored"]
    for _ in range(6):
        again.editor.undo()  # camera, trim, words, name: every step came along
    assert titles(again) == ["Take 1"] or titles(again) == ["Take 1", "Take 2"]
    again.takes.play(1)
    again.editing.reword(0, "proud peacock")
    run(again, 2)
    assert again.editor.session.takes[0].made.clip.prompts[0].prompt == "proud peacock"


# --- from one session to the other
def test_each_take_is_in_the_session_in_which_it_was_recorded(start: Start, tmp_path: Path) -> None:
    cache, paths = tmp_path / "cache", [tmp_path / "a.sport", tmp_path / "b.sport"]
    for path in paths:
        SessionFile.create(path, cache).close()
    app = start()
    app.sessions.open(paths[0])
    record(app)
    app.takes.rename(1, "of a")
    app.sessions.open(paths[1])
    assert titles(app) == []
    record(app, stop=False)  # it is being recorded when another one begins
    app.sessions.new()
    assert titles(app) == []
    record(app)
    assert [[take.title for take in in_file(path, cache).takes] for path in paths] == [["of a"], ["Take 1"]]
    app.sessions.open(paths[0])
    assert titles(app) == ["of a"]
    (left,) = app.sessions.earlier  # the untitled one
    assert (left.name, left.takes, left.ended) == ("Untitled", 1, True)
    assert left.picture.startswith(b"\x89PNG")
    app.sessions.open(left.path)
    assert titles(app) == ["Take 1"]
    assert app.sessions.path is None
    assert app.sessions.earlier == []


def test_a_camera_key_is_dragged_past_another_one_and_never_onto_it(app: App) -> None:
    do(app, "record 60; play 1")
    playback = app.takes.playback
    assert playback is not None
    for frame in (10, 20, 30):
        playback.seek(frame)
        app.camera_keys.add()
    selection = app.transport.selection
    held = selection.all([CAMERA_KEYS])[0]
    for frame in (12, 20, 24, 30, 40):
        selection.replace("move", [held], [held.at(frame, frame)], held=True)
    app.editor.finish_drag()
    assert [round(key.seconds * 60) for key in app.camera_keys.keys] == [20, 30, 40]


def test_save_as_of_an_untitled_session_removes_the_untitled_file(app: App, tmp_path: Path) -> None:
    record(app)
    assert app.editor.file.flush(60.0)
    assert len(list(untitled(tmp_path).glob("*.sport"))) == 1
    app.sessions.save_as(tmp_path / "named.sport")
    assert list(untitled(tmp_path).glob("*")) == []
    record(app)
    app.sessions.save_as(tmp_path / "other.sport")  # of a named one: it stays
    record(app)
    app.close()
    assert [len(in_file(tmp_path / f"{name}.sport", tmp_path).takes) for name in ("named", "other")] == [2, 3]


def test_two_windows_on_one_session_the_second_has_a_copy(start: Start, tmp_path: Path) -> None:
    other, history = SessionFile.open(make_named(tmp_path / "a.sport"), tmp_path)
    app = start()
    app.sessions.open(tmp_path / "a.sport")
    assert said(app) == "a.sport is open in another window: this is an untitled copy of it."
    assert app.sessions.path is None
    assert titles(app) == ["named"]
    app.takes.rename(1, "of the second")
    record(app)
    history.push("name", edits.renamed(history.present.session, 1, "of the first"))
    other.write(history)
    copy = app.editor.file.path
    app.interrupt()
    assert app.end() == 0
    assert other.close()
    assert [t.title for t in in_file(tmp_path / "a.sport", tmp_path).takes] == ["of the first"]
    assert [t.title for t in in_file(copy, tmp_path).takes] == ["of the second", "Take 1"]


def test_the_session_that_is_open_is_not_opened_again(app: App, tmp_path: Path) -> None:
    record(app)
    app.sessions.save_as(tmp_path / "a.sport")
    (tmp_path / "link.sport").symlink_to(tmp_path / "a.sport")
    for name in ("a.sport", "link.sport"):
        app.sessions.open(tmp_path / name)
        assert said(app) == f"{name} is open already."
    assert titles(app) == ["Take 1"]


# --- of others
@pytest.mark.parametrize("where", ["elsewhere", "a link", "http:", "beside it", "chosen before"])
def test_a_film_of_a_session_is_read_where_it_lies_with_it_or_was_chosen_here(
    where: str, start: Start, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    foreign, home = tmp_path / "foreign", tmp_path / "home"
    films = {name: str(home / path) for name, path in (("beside it", "films/a.mp4"), ("a link", "link.mp4"))}
    films["http:"] = "http://127.0.0.1:9/a.mp4"
    film, read = films.get(where, str(foreign / "a.mp4")), list[Path]()
    session = replace(Session(), reference=Reference(video=film))
    written(home / "a.sport", history_of(session), tmp_path)
    foreign.mkdir()
    (foreign / "a.mp4").write_bytes(b"film")
    (home / "link.mp4").symlink_to(foreign / "a.mp4")
    app = start()
    if where == "chosen before":
        app.settings.known_films = [film]
    monkeypatch.setattr("viewer.edit.reference.read_video", read.append)
    app.sessions.open(home / "a.sport")
    run(app, 2)
    assert read == ([Path(film)] if where in ("beside it", "chosen before") else [])
    told = any("is not opened by itself" in message.text for message in app.messages.recent)
    assert told == (not read)


def test_of_a_session_a_network_is_loaded_from_known_folders_only(start: Start, tmp_path: Path) -> None:
    for name in ("known", "foreign"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "metadata.json").write_text('{"sha256": {"step": "%s"}}' % (name[0] * 64))
    app, loaded = start(), list[Path | None]()
    app.sessions.load_model = lambda folder, seed: loaded.append(folder)
    app.settings.known_models = [str(tmp_path / "known")]
    for folder, sha256 in (("foreign", "f"), ("foreign", "k"), ("known", "k")):
        model = ModelName(str(tmp_path / folder), "mine", sha256 * 64)
        path = tmp_path / f"{folder} {sha256}.sport"
        app.sessions.open(written(path, history_of(replace(Session(), model=model)), tmp_path))
        run(app, 2)
    assert loaded == [tmp_path / "known"] * 2


@pytest.mark.parametrize("end", ["program", "session"])
def test_what_the_end_cuts_short_is_said_then_and_at_the_next_opening(
    start: Start, tmp_path: Path, end: str
) -> None:
    app = start()
    record(app)
    app.sessions.save_as(tmp_path / "a.sport")
    app.jobs.blocking = False
    waits, slot = threading.Event().wait, Slot("resimulation of a take", 1)
    app.editor.run(app.jobs, "path of Take 1", slot, waits, lambda _, session: session)
    if end == "program":
        app.interrupt()
        app.end()
    else:
        app.sessions.new()
    assert any("was not finished" in message.text for message in app.messages.recent)
    app.close()
    again = start(session=str(tmp_path / "a.sport"))
    assert "Path of Take 1 was not finished: do that again." in said(again)
    again.close()
    assert "not finished" not in said(start(session=str(tmp_path / "a.sport")))


# --- cut off
@pytest.mark.parametrize("button", ["Reopen", "Discard"])
def test_a_session_that_was_cut_off_while_recording_is_one_offer(
    start: Start, tmp_path: Path, button: str
) -> None:
    killed = start()
    record(killed)
    record(killed, 40, stop=False)
    killed.close()  # without its end
    app = start()
    app.sessions.begin(None, looking=True)
    assert "Cut off: Untitled, 1 take, " in said(app)
    run(app, 2)
    assert labels(app).count("Reopen") == 1
    click_on(app, button) if button == "Discard" else app.sessions.open_last()  # also without a name
    run(app, 3)
    if button == "Discard":
        assert titles(app) == []
        assert len(list(untitled(tmp_path).glob("*.sport"))) == 1  # its own
    else:
        assert titles(app) == ["Take 1", "Take 2"]
        assert said(app) == "Untitled: 2 takes. Recovered: 1 take."
        assert app.editor.undo_label == "recovery of Take 2"
        assert 30 <= app.editor.session.takes[1].frames <= 41
        assert app.editor.session.takes[1].made.header.resimulable
        do(app, "play 2; insert an old king; run 2")
        assert app.editor.session.takes[1].made.clip.prompts[-1].prompt == "an old king"
        do(app, "undo; undo")
        assert titles(app) == ["Take 1"]
    assert not {"Reopen", "Discard"} & set(labels(app))


def test_a_named_session_that_was_cut_off_has_it_all_when_it_is_opened(start: Start, tmp_path: Path) -> None:
    killed = start()
    record(killed)
    killed.sessions.save_as(tmp_path / "a.sport")
    killed.takes.rename(1, "after it was saved")
    record(killed, 40, stop=False)
    killed.close()
    app = start()
    app.sessions.begin(None, looking=True)
    assert app.sessions.cut_off is None  # no file but its own
    app.sessions.open_last()
    app.settings.recent_sessions = [str(tmp_path / "a.sport")]
    app.sessions.open_last()
    assert titles(app) == ["after it was saved", "Take 2"]
    assert said(app) == "a: 2 takes. Recovered: 1 take."


def test_what_is_offered_may_go_later_and_of_many_sessions_ten_stay(start: Start, tmp_path: Path) -> None:
    folder = untitled(tmp_path)
    paths = [make_named(new_path(folder)) for _ in range(12)]
    empty = written(new_path(folder), history_of(Session()), tmp_path / "cache")
    app = start()
    for kept in (paths, paths[2:]):
        app.sessions.look()
        assert [summary.path for summary in app.sessions.earlier] == kept[::-1]
        left = sorted(path for path in folder.glob("*.sport") if path != app.editor.file.path)
        assert left == kept
    assert not empty.exists()


def test_a_take_that_left_the_history_can_be_had_back_with_its_edits(app: App) -> None:
    record(app)
    app.takes.rename(1, "gone ##1")
    app.takes.remove(1)
    for number in range(205):
        app.editor.do("edit", lambda session, n=number: replace(session, counter=10 + n))  # type: ignore[misc]
    assert app.editor.file.flush(20.0)
    click_on(app, "##session")
    run(app, 2)
    click_on(app, "##lost")
    run(app, 2)
    (label,) = [label for label, _ in drawn(app) if label.startswith("gone # #1, ")]
    click_on(app, label.partition("##")[0])
    run(app, 2)
    assert titles(app) == ["gone ##1"]
    assert said(app) == "Recovered: gone ##1."
    assert app.editor.file.flush(20.0)
    app.sessions.find_lost()
    run(app, 2)
    assert app.sessions.lost == []
    app.takes.play(app.editor.session.takes[0].number)
    assert app.takes.playback is not None


# --- the disk
def full(monkeypatch: pytest.MonkeyPatch) -> list[bool]:
    """Whether the disk has no room, to be changed."""
    is_full, real = [True], Database._keep_there

    def keep_there(self: Database) -> None:
        if is_full[0]:
            raise OSError(28, "No space left on device")
        real(self)

    monkeypatch.setattr(Database, "_keep_there", keep_there)
    return is_full


def test_a_full_disk_is_said_with_a_remedy_and_nothing_is_lost_once_there_is_room(
    app: App, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    record(app)
    assert app.editor.file.flush(60.0)
    is_full = full(monkeypatch)
    record(app)
    run_until(app, lambda: app.editor.file.problem != "")
    app.messages.clock = lambda: time.monotonic() + 60.0  # what was said since has faded
    run(app, 2)
    text = app.messages.current.text  # the error holds, whatever was said after it
    assert "No space left" in text
    assert sqlite_file.ROOM_REMEDY in text
    assert "in memory only" in text
    app.takes.play(2)  # it still plays and is edited
    run(app, 2)
    app.takes.rename(2, "meanwhile")
    is_full[0] = False
    run_until(app, lambda: app.editor.file.problem == "")
    run(app, 2)
    app.interrupt()
    assert app.end() == 0
    (left,) = find(untitled(tmp_path))
    assert [t.title for t in in_file(left.path, tmp_path).takes] == ["Take 1", "meanwhile"]


def test_a_folder_that_cannot_be_made_puts_the_session_into_the_temporary_folder(
    start: Start, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "temporary").mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "temporary"))
    (tmp_path / "config").mkdir()
    (tmp_path / "config" / "sessions").write_text("in the way", encoding="utf-8")
    app = start()
    path = app.editor.file.path
    assert path.is_relative_to(tmp_path / "temporary")
    assert any(str(path) in message.text for message in app.messages.recent)
    record(app)
    app.interrupt()
    assert app.end() == 1
    app.close()
    assert len(in_file(path, tmp_path).takes) == 1


def test_without_room_for_a_new_session_the_old_one_stays(
    app: App, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    record(app)
    before = app.editor.file
    monkeypatch.setattr(Database, "create", _no_room)
    app.sessions.new()
    assert "No space left" in message(app)
    monkeypatch.setattr(tempfile, "mkdtemp", _no_room)
    app.sessions.new()
    assert message(app).endswith("Make room on the disk, or save a copy elsewhere.")
    assert (app.editor.file, titles(app)) == (before, ["Take 1"])


def _no_room(path: Path | None = None, prefix: str = "") -> None:
    if path is None:
        raise OSError(28, "No space left on device")
    raise FileError(f"{path}: No space left on device.", "Make room.")


def test_a_name_that_cannot_be_written_leaves_the_session_where_it_is(app: App, tmp_path: Path) -> None:
    record(app)
    path = app.editor.file.path
    (tmp_path / "file").write_text("", encoding="utf-8")
    for target in (tmp_path / "file" / "a.sport", tmp_path / ("n" * 300 + ".sport")):
        app.sessions.save_as(target)
        assert target.name[:20] in said(app)
        app.sessions.save_copy(target)
        assert target.name[:20] in said(app)
    record(app)
    assert app.editor.file.path == path
    app.close()
    assert len(in_file(path, tmp_path).takes) == 2


def test_damaged_frames_are_said_when_the_take_is_played_and_the_rest_goes_on(
    start: Start, tmp_path: Path
) -> None:
    path = tmp_path / "a.sport"
    app = start()
    do(app, "record; record")
    app.sessions.save_as(path)
    app.close()
    with closing(sqlite3.connect(path)) as connection, connection:
        keys = "SELECT key FROM motions WHERE key NOT LIKE '%.input' ORDER BY number"
        key = connection.execute(keys).fetchone()[0]
        connection.execute("UPDATE frames SET content = zeroblob(9) WHERE motion LIKE ?", (f"{key}%",))
    app = start(session=str(path))
    run(app, 2)
    for use in (
        lambda: app.takes.play(1),
        lambda: app.takes.mirror(1),
        lambda: app.references.show(1),
        lambda: app.bvh_export.export(),
        lambda: app.bvh_export.export_all(),
        lambda: app.exporting.open(),
    ):
        app.takes.select(1)
        use()
        run(app, 3)
    assert any("a.sport: " in message.text for message in app.messages.recent)
    do(app, "play 2; run 3")
    assert app.takes.playback.number == 2
    app.references.show(1)
    run(app, 3)
    app.editing.go_on()
    app.takes.rename(1, "damaged")
    run(app, 2)
    assert app.editor.file.flush(60.0)


# --- dialogs
def test_without_a_dialog_program_the_path_is_typed(app: App, tmp_path: Path) -> None:
    app.sessions.dialogs.available = lambda: False
    do(app, "record; key ctrl+s")
    type_in(app, str(tmp_path / "typed"))
    click_on(app, "##dialog ok")
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


# --- other things of a session
def test_a_take_plays_on_the_ground_that_it_was_made_on(app: App) -> None:
    record(app)
    flat = app.scene.terrain
    do(app, "ground stairs; record; run 2; play 1; run 1")
    assert np.array_equal(app.scene.renderer.terrain.heights, flat.heights)
    do(app, "play 2; run 1")
    assert app.scene.renderer.terrain.name == "stairs"
    do(app, "play 1; close; run 1")
    assert app.scene.renderer.terrain is app.scene.terrain


@pytest.mark.skipif(os.name != "posix", reason="names of POSIX are bytes")
def test_a_name_that_is_no_text_kills_nothing(app: App, tmp_path: Path) -> None:
    record(app)
    folder = tmp_path / os.fsdecode(b"clips-\xff")
    try:
        folder.mkdir()
    except OSError:
        pytest.skip("this file system takes UTF-8 only")
    strange = save_bvh(still(30), folder / os.fsdecode(b"walk-\xfe.bvh"))
    app.open_files([strange, folder / os.fsdecode(b"\xfe.png"), folder / os.fsdecode(b"\xfe.xyz")])
    run(app, 3)
    assert titles(app)[-1] in ("walk-\ufffd", "still")
    app.scene.load_terrain(str(folder / os.fsdecode(b"\xfe.npy")))
    run(app, 2)
    app.sessions.save_as(folder / os.fsdecode(b"\xfd.sport"))
    do(app, "run 2; record")
    wanted = titles(app)
    path = app.editor.file.path
    assert path.parent == folder
    app.interrupt()
    assert app.end() == 0
    app.close()
    assert [take.title for take in in_file(path, tmp_path).takes] == wanted


@pytest.mark.parametrize("named", [False, True], ids=["untitled", "named"])
@pytest.mark.parametrize("button", ["Reopen", "Later", "Discard"])
def test_the_start_after_a_crash_offers_the_work(
    start: Start, tmp_path: Path, button: str, named: bool
) -> None:
    killed, path = start(), tmp_path / "a.sport"
    record(killed, 60)
    if named:
        killed.sessions.save_as(path)
    killed.takes.rename(1, "a walk")
    killed.sessions.finish(keep=True, until=time.monotonic() + 20.0, ended=False)  # as after a defect
    killed.close()
    app = start()
    app.settings.recent_sessions = [str(path)] if named else []
    app.sessions.begin(None, looking=True)
    app.cut_off.begin()
    run(app, 3)
    offer = " ".join(texts(app))
    assert re.search(rf"{'a' if named else 'Untitled'}, 1 take, 0:01\.0, \d\d \w+ \d\d:\d\d", offer)
    buttons = [text for text, _ in drawn(app) if text.endswith("##cut off")]
    assert len(buttons) == 3
    enabled = not (named and button == "Discard")  # a file that the user named stays
    click_on(app, button, -1)
    run(app, 4)
    assert titles(app) == (["a walk"] if button == "Reopen" else [])
    assert (app.cut_off.left is None) == enabled
    kept = [path] if named else [p for p in untitled(tmp_path).glob("*.sport") if p != app.editor.file.path]
    assert [p.exists() for p in kept] == ([] if button == "Discard" and not named else [True] * len(kept))


def test_no_work_is_offered_after_a_planned_end(start: Start, tmp_path: Path) -> None:
    before = start()
    record(before)
    before.sessions.save_as(tmp_path / "a.sport")
    before.sessions.finish(keep=True, until=time.monotonic() + 20.0)
    before.close()
    app = start()
    app.settings.recent_sessions = [str(tmp_path / "a.sport")]
    app.sessions.begin(None, looking=True)
    app.cut_off.begin()
    assert app.cut_off.left is None
