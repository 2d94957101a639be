"""The end of the program: in time, whatever runs, and with every take kept."""

import os
import signal
import tempfile
import threading
import time
from functools import partial
from pathlib import Path

import pytest

from runtime import interrupts
from runtime.errors import FileError, SportError
from runtime.session import database, library
from runtime.session.database import Database
from runtime.session.session_file import SessionFile
from runtime.session.sqlite_file import lock_of
from tests.helpers.app_driver import Start, record_standing, run
from tests.helpers.viewer_fakes import fake_services
from viewer import app as app_module
from viewer import process, workspace
from viewer.jobs import Jobs, Slot
from viewer.messages import Messages
from viewer.options import ViewOptions


@pytest.mark.parametrize(
    "what",
    [
        "measurements",
        "an export",
        "a film that ends when told",
        "a slow disk",
        "a disk that hangs",
        "no room",
    ],
)
def test_the_program_ends_in_time_and_the_next_start_has_the_take(
    what: str, start: Start, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tempfile, "gettempdir", lambda: str(tmp_path))
    app, never, given_up = start(), threading.Event(), threading.Event()
    path, keep_there = app.editor.file.path, Database._keep_there

    waited_out: list[float] = []

    def wait(event: threading.Event, seconds: float) -> None:
        if not event.wait(seconds):
            waited_out.append(seconds)

    def late(slow: Database) -> None:
        wait(never, 20.0 if what == "a slow disk" else 60.0)
        keep_there(slow)

    def full(_: Database) -> None:
        raise OSError(28, "No space left on device")

    disk = what in ("a slow disk", "a disk that hangs", "no room")
    # a busy machine must not decide: a disk that works has time, and so has what is handed over
    ends = [(database, "HAND_OVER_S", 30.0)] if disk else []
    for module, name, seconds in ends or [(app_module, "END_S", 30.0), (app_module, "SESSION_S", 29.8)]:
        monkeypatch.setattr(module, name, seconds)
    record_standing(app, 20)
    app.editor.file.flush(10.0)
    if disk:
        monkeypatch.setattr(Database, "_keep_there", full if what == "no room" else late)
    app.takes.toggle_recording()
    run(app, 20)
    app.interrupt()
    app.jobs.blocking = False
    if what == "measurements":
        for _ in range(11):
            app.jobs.submit(Slot("blend"), lambda: wait(never, 60.0), lambda _: None)
    elif what == "an export":
        work, slot = partial(wait, never, 60.0), Slot("export", "x")
        app.jobs.submit(slot, work, lambda _: None, writing="the export of x")
    elif what == "a film that ends when told":
        film = lambda: wait(given_up, 60.0)  # noqa: E731
        app.jobs.submit(Slot("export"), film, lambda _: None, writing="the film", cancel=given_up.set)
    code = app.end()
    said = [message.text for message in app.messages.recent]
    assert not waited_out, "it waited for what does not end"
    assert code == (disk or what == "an export")
    assert given_up.is_set() == (what == "a film that ends when told")
    waits = {"an export": "Waiting for the export", "a slow disk": "Waiting for the session Untitled"}
    assert any(waits.get(what, "") in text for text in said)
    if disk:
        assert any("The next start adds what is in" in text for text in said)
        monkeypatch.undo()
        monkeypatch.setattr(tempfile, "gettempdir", lambda: str(tmp_path))
        lock_of(path).unlink(missing_ok=True)  # as if this process had ended
    (left,) = library.find(path.parent)
    assert (left.path, left.takes, left.ended) == (path, 2, True)
    file, history = SessionFile.open(path, tmp_path)
    takes = history.present.session.takes
    assert [take.title for take in takes] == ["Take 1", "Take 2"]
    assert [len(take.made.clip) for take in takes] == [take.frames for take in takes]
    file.close()
    assert len(library.find(path.parent)) == 1
    never.set()


def test_two_seconds_are_enough_to_write_and_to_hand_over() -> None:
    writing = app_module.SESSION_S - app_module.SETTINGS_S - database.HAND_OVER_S
    assert writing > 0.45
    assert database.HAND_OVER_S >= 0.8
    assert app_module.END_S + app_module.PROMPT_PATIENCE_S < 2.0


def test_of_stale_jobs_only_the_newest_is_begun_and_what_is_written_keeps_its_order() -> None:
    jobs, gate, begun, written = Jobs(Messages()), threading.Event(), [], []
    for number in range(2):
        jobs.submit(Slot("slow", number), lambda: gate.wait(20), lambda _: None)
    for number in range(10):
        jobs.submit(Slot("blend"), lambda n=number: begun.append(n), lambda _: None)  # type: ignore[misc]
        jobs.submit(Slot("save"), lambda n=number: written.append(n), lambda _: None, writing="x")  # type: ignore[misc]
    assert jobs.finish("save")
    gate.set()
    end = time.monotonic() + 60.0
    while jobs.busy(Slot("blend")) and time.monotonic() < end:
        jobs.deliver()
        time.sleep(0.005)
    assert begun == [9]
    assert written == list(range(10))


def test_jobs_about_two_things_of_one_name_do_not_meet_and_are_named_in_words() -> None:
    messages, first, second = Messages(), object(), object()
    jobs = Jobs(messages)

    def fail() -> None:
        raise MemoryError

    done: list[object] = []
    jobs.submit(Slot("ground of a take", first), fail, done.append, reading="alps.png")
    jobs.submit(Slot("ground of a take", second), lambda: second, done.append)
    assert jobs.busy(Slot("ground of a take", first))
    assert not jobs.busy(Slot("ground of a take"))
    end = time.monotonic() + 60.0
    while jobs.busy(Slot("ground of a take", first)) or jobs.busy(Slot("ground of a take", second)):
        assert time.monotonic() < end
        jobs.deliver()
    assert done == [second]
    assert messages.current.text.startswith("alps.png: not enough memory.")
    assert not messages.current.settled  # what went well was about the other one
    jobs.submit(Slot("ground of a take", first), lambda: first, done.append)
    while jobs.busy(Slot("ground of a take", first)):
        jobs.deliver()
    assert messages.current.settled


def test_a_damaged_file_that_two_jobs_read_is_one_sentence() -> None:
    messages = Messages()
    jobs = Jobs(messages, blocking=True)

    def fail(what: str) -> None:
        raise FileError(f"{what}: damaged.")

    with jobs.together():
        for kind, file in (("character", "a.glb"), ("take", "a.glb"), ("take", "b.glb")):
            jobs.submit(Slot(kind, file), partial(fail, f"{file} as a {kind}"), lambda _: None, reading=file)
    wanted = ["a.glb as a character: damaged.", "b.glb as a take: damaged."]
    assert [message.text for message in messages.recent] == wanted


def test_a_result_that_a_newer_job_has_replaced_is_not_handed_over() -> None:
    jobs, gate, done = Jobs(Messages()), threading.Event(), []
    jobs.submit(Slot("open", "a"), lambda: gate.wait(20), lambda _: done.append("old"), reading="old.glb")
    jobs.submit(Slot("open", "a"), lambda: None, lambda _: done.append("new"), reading="new.glb")
    end = time.monotonic() + 60.0
    while jobs.busy(Slot("open", "a")) and time.monotonic() < end:
        jobs.deliver()
        gate.set()
    assert done == ["new"]


@pytest.mark.skipif(os.name == "nt", reason="Windows sends no signals to another process")
@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143), (None, 0)])
@pytest.mark.parametrize("recorded", [False, True])
def test_a_signal_ends_the_loop_with_its_code_and_a_sentence(
    number: int | None,
    code: int,
    recorded: bool,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    """What was recorded is kept, as after any end that was not planned; nothing else stays, no picture either."""
    monkeypatch.setattr(app_module, "END_S", 30.0)  # a busy machine must not decide
    monkeypatch.setattr(process, "FRAME_S", 30.0)
    frame = app_module.App.frame

    def watched(app: app_module.App) -> None:
        frame(app)
        if recorded and app.frames_shown == 1:
            app.takes.toggle_recording()
        if number is not None and app.frames_shown == 20:
            os.kill(os.getpid(), number)
            os.kill(os.getpid(), number)  # as an impatient user sends it

    monkeypatch.setattr(app_module.App, "frame", watched)
    options = ViewOptions(offscreen=True, frames=40, terrain="flat", screenshot=tmp_path / "shot.png")
    before = signal.default_int_handler
    shells = signal.signal(signal.SIGINT, before)  # which ignores it in the background
    assert app_module.run(options, fake_services(drawn=False), tmp_path / "config") == code
    assert signal.signal(signal.SIGINT, shells) is before
    assert len(library.find(tmp_path / "config" / "sessions")) == int(recorded and number is not None)
    assert (tmp_path / "shot.png").exists() == (number is None)
    what = {signal.SIGINT: "Ctrl+C", signal.SIGTERM: "SIGTERM"}.get(number)  # type: ignore[call-overload]
    assert capfd.readouterr().err == (f"sport: stopped by {what}.\n" if what else "")


def test_a_start_that_fails_leaves_no_session(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(workspace, "LEAVE_S", 60.0)  # a busy machine must not decide
    options = ViewOptions(offscreen=True, terrain="flat", prompt=" ")
    with pytest.raises(SportError):
        app_module.App(options, fake_services(drawn=False), config=tmp_path)
    interrupts._UNFINISHED.undo()  # as the command does before it ends
    assert [path.name for path in (tmp_path / "sessions").iterdir()] == []
    interrupts._UNFINISHED.actions.clear()
