"""Clocks that jump and times that no clock gives: nothing is lost, swept away under another program, or not finite."""

import random
import time
from itertools import cycle
from pathlib import Path

import pytest

from runtime.atomic import atomic_path, sweep
from runtime.formats.bvh_clip import load_clip_bvh
from runtime.session import library
from runtime.session.library import SessionSummary
from tests.helpers.app_driver import Start, do, run
from viewer.session.summaries import describe

YEAR_S = 365 * 86400.0
JUMPS = (0.0, -5.0, 1.0, 4e9, 1e12, 1.5e9, -1e9)


@pytest.fixture
def jumping(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every look at the clock on the wall gives another year."""
    times, stamps = random.Random(3), cycle(("19700101-000000", "20991231-235959", "20260301-120000"))
    monkeypatch.setattr(time, "time", lambda: times.choice(JUMPS))
    real = time.strftime
    stamp = "%Y%m%d-%H%M%S"
    monkeypatch.setattr(time, "strftime", lambda form, *t: next(stamps) if form == stamp else real(form, *t))


@pytest.mark.usefixtures("jumping")
def test_takes_are_recorded_played_and_kept_while_the_clock_jumps(start: Start, tmp_path: Path) -> None:
    app = start()
    app.settings.export_folder = str(tmp_path / "clips")
    for _ in range(3):
        app.takes.toggle_recording()
        run(app, 30)
        app.takes.toggle_recording()
        app.takes.play(app.editor.session.counter)
        do(app, "run 5; close")
    assert [len(item.clip) for item in app.editor.session.takes] == [30, 30, 30]
    app.bvh_export.export()
    assert len(load_clip_bvh(next((tmp_path / "clips").glob("*.bvh")))) == 30
    app.interrupt()
    app.end()
    (left,) = library.find(tmp_path / "config" / "sessions")
    assert (left.takes, left.ended) == (3, True)
    assert describe(left).startswith("Untitled, 3 takes")


@pytest.mark.usefixtures("jumping")
def test_the_newest_session_is_that_of_the_last_run(start: Start, tmp_path: Path) -> None:
    folder = tmp_path / "config" / "sessions"
    for frames in (3, 6, 9, 12):
        app = start()
        app.takes.toggle_recording()
        run(app, frames)
        app.takes.toggle_recording()
        for _ in range(frames // 3 - 1):
            app.takes.mirror(1)
        app.interrupt()
        app.end()
        app.close()
        assert library.find(folder)[0].takes == frames // 3


@pytest.mark.parametrize("seconds", [-1e18, -1.0, 0.0, 4e9, 1e18])
def test_a_session_of_any_time_can_be_described(tmp_path: Path, seconds: float) -> None:
    summary = SessionSummary(tmp_path, "Untitled", True, seconds, 1, 2.0, b"")
    assert describe(summary).startswith("Untitled, 1 take")


def test_what_a_running_program_writes_is_not_swept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with atomic_path(tmp_path / "film.mp4") as temporary:
        temporary.write_bytes(b"half")
        now = time.time()
        monkeypatch.setattr(time, "time", lambda: now + YEAR_S)
        assert sweep(tmp_path) == []
    assert (tmp_path / "film.mp4").read_bytes() == b"half"
