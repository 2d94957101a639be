"""The file of a session: everything comes back, nothing that was committed is lost, and what nothing uses goes."""

import sqlite3
import time
from contextlib import closing
from dataclasses import replace
from functools import partial, reduce
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from runtime.controls import Controls
from runtime.errors import UsageError
from runtime.session import edits
from runtime.session.database import Database
from runtime.session.frames import packed_frames, unpacked_frames
from runtime.session.history import MAX_STEPS, History
from runtime.session.motion import Motion, MotionHeader
from runtime.session.prompt_blend import PromptBlend
from runtime.session.recording import PIECE_FRAMES
from runtime.session.session import Session, Take
from runtime.session.session_file import DROPPED_STEPS, SessionFile
from runtime.takes import input_edits
from runtime.takes.camera_keys import MAX_KEYS, CameraKey, with_key
from runtime.takes.clip import Clip
from runtime.takes.footplants import FootplantEdit
from runtime.takes.input_recording import InputRecording, StyleChange, resimulated_take
from runtime.takes.metadata import PromptEvent
from runtime.takes.pins import MAX_PINS, Pin, Pinned
from runtime.takes.pose_edits import PoseEdits
from runtime.takes.take_path import path_of
from tests.helpers.counting import python_calls
from tests.helpers.full_session import (
    answer,
    controller,
    driven_take,
    full_session,
    history_of,
    still,
    text_of,
    written,
)
from viewer.editor import Editor
from viewer.messages import Messages
from viewer.options import ViewOptions


def reopened(path: Path, cache: Path) -> tuple[SessionFile, History]:
    return SessionFile.open(path, cache)


def rows(path: Path, table: str) -> int:
    with closing(sqlite3.connect(path)) as connection:
        return int(connection.execute(f"SELECT count(*) FROM {table}").fetchone()[0])


def close(a: Clip, b: Clip) -> bool:
    """Whether frames are the same within what `runtime.session.frames` promises: 0.05 mm and 0.005 degrees."""
    apart = np.linalg.norm(a.local_rotations - b.local_rotations, axis=-1)
    return bool(
        np.abs(a.hips_positions - b.hips_positions).max() < 0.05e-3
        and np.degrees(4.0 * np.arcsin(apart / 2.0)).max() < 0.005
        and np.abs(a.contacts - b.contacts).max() <= 1 / 256 + 1e-6
        and (a.gaits is None) == (b.gaits is None)
        and (a.gaits is None or np.array_equal(a.gaits, b.gaits))
    )


# --- everything comes back
def test_a_session_with_one_of_everything_comes_back(tmp_path: Path) -> None:
    session = full_session(tmp_path / "cache", tmp_path)
    clips = [take.made.clip for take in session.takes]
    history = history_of(session)
    path, before = written(tmp_path / "a.sport", history, tmp_path / "cache"), text_of(session)
    (tmp_path / "me.glb").unlink()
    elsewhere = tmp_path / "another cache"
    file, found = reopened(path, elsewhere)
    now = found.present.session
    assert text_of(now) == before
    # their answers have forgotten how long they took
    assert now == replace(session, live=now.live, variants=now.variants)
    for take, clip in zip(now.takes, clips, strict=True):
        assert close(take.made.clip, clip)
        made = take.made.clip
        assert (made.name, made.prompts, made.origin) == (clip.name, clip.prompts, clip.origin)
    assert file.character_path(now.character).is_relative_to(elsewhere)
    other = tmp_path / "b.sport"
    written(other, history_of(now), elsewhere)
    assert file.close()
    again, history = reopened(other, elsewhere)  # what came from a file goes into another one
    assert text_of(history.present.session) == before
    again.close()


def test_a_take_is_resimulated_after_opening_as_before_bit_by_bit(tmp_path: Path) -> None:
    clip, inputs = driven_take()
    session = edits.with_new_take(Session(), Take(motion=Motion.of(clip, inputs)))
    written(tmp_path / "a.sport", history_of(session), tmp_path)
    file, found = reopened(tmp_path / "a.sport", tmp_path)
    motion = found.present.session.takes[0].made
    kept = motion.inputs
    assert kept is not None
    event = PromptEvent(0.0, "other", 0.2, typed="typed")
    change = StyleChange(45, np.zeros((6, 64), np.float32), 0.2, event)
    edit, again = (input_edits.with_prompt(d, change) for d in (inputs, kept))
    wanted, _ = resimulated_take(clip, edit.inputs, controller(), edit.first)
    made, _ = resimulated_take(motion.clip, again.inputs, controller(), again.first)
    assert close(made, wanted)
    for name in ("hips_positions", "local_rotations", "contacts"):
        assert getattr(made, name)[edit.first :].tobytes() == getattr(wanted, name)[edit.first :].tobytes()
    assert not np.array_equal(made.local_rotations[edit.first :], clip.local_rotations[edit.first :])
    assert made.prompts[-1].typed == "typed"
    file.close()


@settings(max_examples=10, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 350), st.floats(0.0, 3.0))
def test_packed_frames_are_within_their_bound_and_stay_the_same_when_packed_again(
    seed: int, count: int, speed: float
) -> None:
    rng = np.random.default_rng(seed)
    rotations = np.cumsum(rng.normal(size=(count, 31, 4)) * speed, axis=0) + rng.normal(size=(31, 4))
    rotations = (rotations / np.linalg.norm(rotations, axis=-1, keepdims=True)).astype(np.float32)
    hips = (rng.normal(size=(count, 3)) * 10.0 ** rng.uniform(-3, 2)).astype(np.float32)
    gaits = rng.integers(-1, 5, count, np.int8)
    clip = Clip("x", 60.0, hips, rotations, rng.random((count, 4), np.float32), gaits=gaits)

    def repacked(clip: Clip) -> Clip:
        data = packed_frames(clip.hips_positions, clip.local_rotations, clip.contacts, clip.gaits)
        hips, rotations, contacts, gaits = unpacked_frames(data, len(clip))
        return replace(clip, hips_positions=hips, local_rotations=rotations, contacts=contacts, gaits=gaits)

    back = repacked(clip)
    assert close(back, clip)
    again = repacked(back)
    assert np.array_equal(again.hips_positions, back.hips_positions)
    assert close(again, clip)


def test_names_and_words_of_any_kind_are_kept_or_made_so_that_they_can_be(tmp_path: Path) -> None:
    odd = "a\ud800\0\u2028 \U0001f600 " + "x" * 10_000
    session = edits.with_new_take(Session(), Take(motion=Motion.of(still(3, odd)), name=odd))
    session = session.with_take(0, prompt=PromptBlend((answer("ü" * 200), None)))
    written(tmp_path / "a.sport", history_of(session), tmp_path)
    file, found = reopened(tmp_path / "a.sport", tmp_path)
    assert found.present.session.takes[0].name.startswith("a")
    assert found.present.session.live.prompt == session.live.prompt
    file.close()


# --- recordings
def record(
    file: SessionFile, clip: Clip, inputs: InputRecording | None, parts: int = 15
) -> tuple[object, np.ndarray]:
    """A recording of a clip that is not finished."""
    turns = clip.local_rotations.reshape(len(clip), -1)
    table = np.concatenate([clip.hips_positions, turns, clip.contacts, clip.gaits[:, None]], axis=1)
    table = table.astype(np.float32)
    header = replace(MotionHeader.of(clip, inputs), frames=0, prompts=())
    recording = file.begin_recording(header)
    for at in range(0, len(clip), parts):
        sticks = None if inputs is None else inputs.frames.rows[-inputs.start :][at : at + parts]
        recording.add(table[at : at + parts], sticks, clip.prompts, inputs if at == 0 else None)
    return recording, table


def abandoned(file: SessionFile, to: Path) -> Path:
    """The file as a process that is killed leaves it: with its log, under another name."""
    assert file.flush(60.0), file.problem
    SessionFile.copy(file.path, to)
    return to


def test_a_recording_that_was_cut_off_is_a_take_that_can_be_resimulated(tmp_path: Path) -> None:
    clip, inputs = driven_take()
    file = SessionFile.create(tmp_path / "a.sport", tmp_path)
    file.write(history_of(Session()))
    record(file, clip, inputs)
    path = abandoned(file, tmp_path / "b.sport")
    other, found = reopened(path, tmp_path)
    assert found.undo_label == "recovery of Take 1"
    (take,) = found.present.session.takes
    assert take.title == "Take 1"
    assert close(take.made.clip, clip)
    assert take.made.clip.prompts == clip.prompts
    assert take.made.header.resimulable
    assert take.made.inputs is not None
    made, _ = resimulated_take(take.made.clip, take.made.inputs, controller(), 0)
    wanted, _ = resimulated_take(clip, inputs, controller(), 0)
    assert made.local_rotations.tobytes() == wanted.local_rotations.tobytes()
    other.close()
    third, found = reopened(path, tmp_path)  # it is recovered once
    assert [step.label for step in found.steps].count("recovery of Take 1") == 1
    assert len(found.present.session.takes) == 1
    third.close()
    file.close()


@pytest.mark.parametrize("kind", ["sticks that are missing", "input that is missing", "no input"])
def test_a_recording_whose_input_is_not_whole_is_still_a_take(tmp_path: Path, kind: str) -> None:
    clip, inputs = driven_take()
    file = SessionFile.create(tmp_path / "a.sport", tmp_path)
    record(file, clip, None if kind == "no input" else inputs)
    path = abandoned(file, tmp_path / "b.sport")
    file.close()
    if kind == "input that is missing":
        with closing(sqlite3.connect(path)) as connection, connection:
            connection.execute("DELETE FROM motions WHERE key LIKE '%.input'")
    if kind == "sticks that are missing":
        file = SessionFile.create(tmp_path / "c.sport", tmp_path)
        recording, table = record(file, clip, inputs)
        recording.add(table[:15], None)  # type: ignore[attr-defined]  # a model was loaded
        path = abandoned(file, tmp_path / "d.sport")
        file.close()
    other, found = reopened(path, tmp_path)
    (take,) = found.present.session.takes
    assert len(take.made.clip) == len(clip) + 15 * (kind == "sticks that are missing")
    assert not take.made.header.resimulable
    assert take.made.inputs is None
    other.close()


def test_a_recording_that_ends_is_the_same_motion_and_packed_in_large_pieces(tmp_path: Path) -> None:
    clip, inputs = driven_take(PIECE_FRAMES + 30)
    file = SessionFile.create(tmp_path / "a.sport", tmp_path)
    recording, _ = record(file, clip, inputs)
    motion = recording.finish(clip, inputs)  # type: ignore[attr-defined]
    file.write(history_of(edits.with_new_take(Session(), Take(motion=motion))))
    assert file.close()
    assert rows(tmp_path / "a.sport", "frames") == 1 + 2
    again, found = reopened(tmp_path / "a.sport", tmp_path)
    (take,) = found.present.session.takes
    assert take.made.key == motion.key
    assert close(take.made.clip, clip)
    assert np.array_equal(take.made.inputs.frames.rows, inputs.frames.rows, equal_nan=True)
    again.close()


def test_a_recording_of_which_memory_kept_the_last_part_only_is_stored_as_that(tmp_path: Path) -> None:
    clip, inputs = driven_take()
    file = SessionFile.create(tmp_path / "a.sport", tmp_path)
    recording, _ = record(file, clip, inputs)
    motion = recording.finish(clip.trim(30, 89), None)  # type: ignore[attr-defined]
    file.write(history_of(edits.with_new_take(Session(), Take(motion=motion))))
    assert file.close()
    again, found = reopened(tmp_path / "a.sport", tmp_path)
    (take,) = found.present.session.takes
    assert close(take.made.clip, clip.trim(30, 89))
    again.close()


# --- what is not used goes
def resimulated(session: Session, number: int) -> Session:
    return edits.resimulated(session, 1, Motion.of(still(60, f"motion {number}", number), None))


def later(monkeypatch: pytest.MonkeyPatch, days: float) -> None:
    """Set the clock of the program ahead."""
    now = time.time() + 86400.0 * days
    monkeypatch.setattr(time, "time", lambda: now)


def test_what_three_hundred_resimulations_replaced_stays_for_thirty_days(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    file = SessionFile.create(tmp_path / "a.sport", tmp_path)
    clip, inputs = driven_take()
    history = History()
    history.push("first", edits.with_new_take(Session(), Take(motion=Motion.of(clip, inputs))))
    for number in range(300):
        history.push(f"edit {number}", resimulated(history.present.session, number))
        file.write(history)
        assert number % 10 or file.flush(60.0)  # what waits to be written is held
    assert file.flush(60.0)
    assert rows(tmp_path / "a.sport", "steps") == len(history.steps) == MAX_STEPS + 1
    assert rows(tmp_path / "a.sport", "motions") == 302  # with the first one's input
    wanted = [text_of(step.session) for step in history.steps]
    for _ in range(MAX_STEPS):  # all the way back, with every motion of it
        history.go(-1)
    file.write(history)
    for step in history.steps:
        (take,) = step.session.takes
        assert take.made.clip.name == take.made.header.name
    assert file.close()
    again, found = reopened(tmp_path / "a.sport", tmp_path)
    assert [text_of(step.session) for step in found.steps] == wanted
    for _ in range(5):
        assert found.go(1)
    assert again.flush(60.0)
    size = (tmp_path / "a.sport").stat().st_size
    found.push("other", resimulated(found.present.session, 1000))  # what was undone is no step any more
    again.write(found)
    assert again.close()
    later(monkeypatch, 29.0)
    last, found = reopened(tmp_path / "a.sport", tmp_path)
    assert last.flush(60.0)
    assert last.recovered == 0
    names = [lost.name for lost in last.lost_takes]
    assert len(names) == 302 - 1 - 7 + 1  # but those of the seven steps
    back = next(lost for lost in last.lost_takes if lost.name == "motion 250")
    found.push("recovery", edits.with_new_take(found.present.session, *last.found_takes([back])))
    last.write(found)
    assert last.close()
    later(monkeypatch, 2.0)
    caplog.set_level("INFO")
    last, found = reopened(tmp_path / "a.sport", tmp_path)
    assert last.flush(60.0)
    assert found.present.session.takes[-1].made.clip.name == "motion 250"
    assert last.lost_takes == []
    assert rows(tmp_path / "a.sport", "motions") == 8
    assert '"name": "motion 299"' in caplog.text
    assert last.close()
    reopened(tmp_path / "a.sport", tmp_path)[0].close()
    assert (tmp_path / "a.sport").stat().st_size < size / 4  # the room is given back when it is opened


def test_what_a_session_that_was_reverted_to_refers_to_is_still_there(tmp_path: Path) -> None:
    """Something here holds a session that no step of the history has any more, and goes back to it."""
    cache = tmp_path / "cache"
    opened = full_session(cache, tmp_path)
    written(tmp_path / "a.sport", history_of(opened), cache)
    file, history = reopened(tmp_path / "a.sport", cache)
    opened, wanted = history.present.session, text_of(opened)
    for number in range(MAX_STEPS + 2 * DROPPED_STEPS):
        history.push(f"edit {number}", replace(Session(), counter=number))
        file.write(history)
    assert file.flush(30.0)
    assert text_of(opened) == wanted
    history.push("revert", opened)
    file.write(history)
    assert file.close()
    again, found = reopened(tmp_path / "a.sport", tmp_path / "new cache")
    assert text_of(found.present.session) == wanted
    assert again.character_path(opened.character) is not None
    for take in found.present.session.takes:
        assert len(take.made.clip) == take.frames
        assert (take.made.inputs is not None) == take.made.header.resimulable
    again.close()


def test_a_recording_under_way_is_no_rubbish(tmp_path: Path) -> None:
    clip, inputs = driven_take()
    file = SessionFile.create(tmp_path / "a.sport", tmp_path)
    recording, _ = record(file, clip, inputs)
    history = History()
    for number in range(MAX_STEPS + DROPPED_STEPS + 1):
        history.push("edit", replace(Session(), counter=number))
        file.write(history)
    motion = recording.finish(clip, inputs)  # type: ignore[attr-defined]
    history.push("recording", edits.with_new_take(Session(), Take(motion=motion)))
    file.write(history)
    assert file.close()
    again, found = reopened(tmp_path / "a.sport", tmp_path)
    assert close(found.present.session.takes[0].made.clip, clip)
    assert found.present.session.takes[0].made.inputs is not None
    again.close()


# --- other files
def test_save_as_and_copies_have_all_of_it_also_what_is_not_written_yet(tmp_path: Path) -> None:
    session = full_session(tmp_path / "cache", tmp_path)
    file = SessionFile.create(tmp_path / "a.sport", tmp_path / "cache")
    wanted = text_of(session)
    file.write(history_of(session))
    file.save_copy(tmp_path / "copy.sport")
    file.save_as(tmp_path / "b.sport")
    assert file.path == tmp_path / "b.sport"
    history = history_of(session, edits.renamed(session, 1, "later"))
    file.write(history)
    assert file.close()
    for name, text in (("copy", wanted), ("a", wanted), ("b", text_of(history.present.session))):
        other, found = reopened(tmp_path / f"{name}.sport", tmp_path / "cache")
        assert text_of(found.present.session) == text, name
        for take in found.present.session.takes:
            assert len(take.made.clip) == take.frames
        other.close()


def test_a_transaction_that_is_rolled_back_is_written_again_whole(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    session = full_session(tmp_path / "cache", tmp_path)
    file = SessionFile.create(tmp_path / "a.sport", tmp_path / "cache")
    broken = [True]

    def keep_there(self: Database) -> None:
        real(self)
        if broken[0]:
            raise OSError(28, "No space left on device")

    def work(self: object, *about: object) -> None:
        original(self, *about)
        if broken[0]:
            raise OSError(28, "No space left on device")

    from runtime.session.stored_rows import Writer

    real, original = Database._keep_there, Writer.put_step
    monkeypatch.setattr(Writer, "put_step", work)
    file.write(history_of(session))
    assert not file.flush(5.0)
    assert "No space left" in file.problem
    assert all(take.made.clip for take in session.takes)  # from memory
    other = edits.renamed(session, 1, "meanwhile")
    file.write(history_of(session, other))
    broken[0] = False
    end = time.monotonic() + 60.0
    while file.problem and time.monotonic() < end:
        time.sleep(0.02)
    assert file.problem == ""
    assert file.close()
    again, found = reopened(tmp_path / "a.sport", tmp_path / "fresh")
    assert text_of(found.present.session) == text_of(other)
    assert again.character_path(other.character) is not None
    for take in found.present.session.takes:
        assert (take.made.inputs is not None) == take.made.header.resimulable
    again.close()


# --- memory and damage that is found late
def test_an_edit_of_five_hundred_takes_costs_the_frame_little_and_opening_reads_no_frames(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    takes = [Take(motion=Motion.of(still(3, f"{n}", n))) for n in range(500)]
    file = SessionFile.create(tmp_path / "a.sport", tmp_path)
    editor = Editor(Messages(), file)
    editor.do("takes", lambda session: reduce(edits.with_new_take, takes, session))
    assert file.flush(60.0)
    for number in range(50):
        edit = partial(edits.renamed, number=1 + number * 7, name=f"name {number}")
        assert python_calls(partial(editor.do, "name", edit)) < 3 * 500  # of them one for each take
    assert file.close()
    monkeypatch.setattr(Database, "frames", None)
    again, history = reopened(tmp_path / "a.sport", tmp_path)
    assert len(history.present.session.takes) == 500
    again.close()


@pytest.mark.parametrize("frames", [40, 61, 80, 120])
def test_a_trimmed_take_of_another_length_comes_back(frames: int, tmp_path: Path) -> None:
    session = edits.trimmed(edits.with_new_take(Session(), Take(motion=Motion.of(still(100)))), 1, 60, 99)
    session = edits.resimulated(session, 1, Motion.of(still(frames)))
    file, history = reopened(written(tmp_path / "a.sport", history_of(session), tmp_path), tmp_path)
    assert file.repaired == ""
    assert history.present.session.takes == session.takes
    assert session.takes[0].range == ((60, frames - 1) if frames > 61 else (0, frames - 1))
    file.close()


def test_what_no_file_takes_back_is_not_made() -> None:
    """A take with more than these is left out when its file is opened."""
    clip, stick = still(1000), SimpleNamespace(controls=Controls((0.0, 1.0)))
    way = replace(clip, hips_positions=np.cumsum(np.full((1000, 3), 0.6, np.float32), axis=0))
    pin, key = Pin(Pinned.LEFT_HAND), CameraKey(0.0, 0.0, 0.0, 3.0)
    keys = [replace(key, seconds=frame / 60.0) for frame in range(MAX_KEYS)]
    for make in (
        lambda: PoseEdits(pins=(pin,) * (MAX_PINS + 1)),
        lambda: PoseEdits(footplants=(FootplantEdit(0, None, (1, 5)),) * (MAX_PINS + 1)),
        lambda: with_key(keys, replace(key, seconds=MAX_KEYS / 60.0), 60.0),
        lambda: path_of(way, SimpleNamespace(frame=lambda _: stick)),  # type: ignore[arg-type]
        lambda: ViewOptions(seed=1 << 62).check(),
    ):
        with pytest.raises(UsageError):
            make()
    assert len(with_key(keys, replace(key, yaw=1.0), 60.0)) == MAX_KEYS
    ViewOptions(seed=(1 << 62) - 1).check()
