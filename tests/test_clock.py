"""Clocks that jump and times that no clock gives: nothing is lost, swept away under another program, or not finite."""

from __future__ import annotations

import random
import subprocess
import sys
import time
from itertools import cycle
from pathlib import Path

import numpy as np
import pytest
from app_driver import Start, run

from runtime.assets import PROJECT_ROOT
from runtime.atomic import atomic_path, sweep
from runtime.formats.bvh_clip import load_clip_bvh
from runtime.projects.project import load_project
from runtime.takes.journal import find_journals
from viewer.projects.autosave import AutosaveFile, LeftBehind, find_sessions
from viewer.projects.notes import StyleNotes
from viewer.takes.journals import describe

YEAR_S = 365 * 86400.0
JUMPS = (0.0, -5.0, 1.0, 4e9, 1e12, 1.5e9, -1e9)


BESIDE = """
import sys
sys.path[:0] = [sys.argv[1], sys.argv[1] + "/tests"]
from pathlib import Path
from viewer_fakes import fake_services
from viewer.app import App
from viewer.options import ViewOptions
folder = Path(sys.argv[2])
app = App(ViewOptions(offscreen=True, terrain="flat"), fake_services(), config=folder / "config")
app.settings.export_folder = str(folder / "clips")
app.sessions.autosaving = True
app.takes.toggle_recording()
for _ in range(int(sys.argv[3])):
    app.frame()
app.takes.toggle_recording()
for _ in range(10):
    app.sessions.save_as(folder / "both.sport")
    app.takes.export()
    app.frame()
app.interrupt()
code = app.end()
app.close()
sys.exit(code)
"""


@pytest.fixture
def jumping(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every look at the clock on the wall gives another year."""
    times, stamps = random.Random(3), cycle(("19700101-000000", "20991231-235959", "20260301-120000"))
    monkeypatch.setattr(time, "time", lambda: times.choice(JUMPS))
    real = time.strftime
    monkeypatch.setattr(
        time, "strftime", lambda form, *t: next(stamps) if form == "%Y%m%d-%H%M%S" else real(form, *t)
    )


@pytest.mark.usefixtures("jumping")
def test_takes_are_recorded_played_and_autosaved_while_the_clock_jumps(start: Start, tmp_path: Path) -> None:
    app = start()
    app.settings.export_folder = str(tmp_path / "clips")
    app.sessions.autosaving = True
    for _ in range(3):
        app.takes.toggle_recording()
        run(app, 30)
        app.takes.toggle_recording()
        app.takes.play(0)
        run(app, 5)
        app.takes.close_playback()
    assert [len(item.clip) for item in app.editor.session.takes] == [30, 30, 30]
    app.takes.export()
    assert len(load_clip_bvh(next((tmp_path / "clips").glob("*.bvh")))) == 30
    app.sessions.autosaving = False
    app.takes.journals.close()
    found, complaints = find_journals(tmp_path / "config" / "journals")
    assert complaints == []
    for journal in found:
        describe(journal)
        journal.release()


@pytest.mark.usefixtures("jumping")
def test_the_newest_session_is_that_of_the_last_run(start: Start, tmp_path: Path) -> None:
    folder = tmp_path / "config" / "sessions"
    for frames in (3, 6, 9, 12):
        app = start()
        app.sessions.autosaving = True
        app.takes.toggle_recording()
        run(app, frames)
        app.takes.toggle_recording()
        for _ in range(frames // 3 - 1):
            app.takes.mirror(0)
        app.interrupt()
        app.end()
        app.close()
        left = find_sessions(folder)
        assert [one.takes for one in left if one.ended] == [frames // 3]


@pytest.mark.parametrize("seconds", [-1e18, -1.0, 0.0, 4e9, 1e18])
def test_a_session_of_any_time_can_be_described(tmp_path: Path, seconds: float) -> None:
    assert LeftBehind(tmp_path, "", 1, True, seconds).describe().startswith("untitled, 1 take")


def test_what_a_running_program_writes_is_not_swept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with atomic_path(tmp_path / "film.mp4") as temporary:
        temporary.write_bytes(b"half")
        now = time.time()
        monkeypatch.setattr(time, "time", lambda: now + YEAR_S)
        assert sweep(tmp_path) == []
    assert (tmp_path / "film.mp4").read_bytes() == b"half"


def test_names_of_sessions_sort_after_those_that_are_there(tmp_path: Path) -> None:
    (tmp_path / "29991231-235959-0007-00000000.sport").touch()
    (tmp_path / "29991231-235959-notours.sport").touch()
    assert AutosaveFile(tmp_path).path.name.startswith("29991231-235959-0008-")
    assert AutosaveFile(tmp_path / "none").path.name[15:20] == "-0000"


def test_steps_of_no_time_and_of_ten_seconds(start: Start, monkeypatch: pytest.MonkeyPatch) -> None:
    app = start()
    steps = cycle((0.0, 1e-9, 10.0, 1e-300, 1 / 60, 1.0))
    monkeypatch.setattr(app, "_tick", lambda: next(steps))
    app.takes.toggle_recording()
    app.window.inject_key("w", True)
    run(app, 40)
    app.window.inject_key("w", False)
    app.takes.toggle_recording()
    (item,) = app.editor.session.takes
    assert np.isfinite(item.clip.hips_positions).all()
    app.takes.play(0)
    for _ in range(30):
        run(app)
        assert np.isfinite(np.array(app.scene.camera.current.heading)).all()
        assert np.isfinite(app.takes.playback.pose().positions).all()  # type: ignore[union-attr]


def test_two_programs_share_a_folder(tmp_path: Path) -> None:
    """Settings, journals, sessions and one project of both: each keeps its own, and the file is one of the two, whole."""
    command = [sys.executable, "-c", BESIDE, str(PROJECT_ROOT), str(tmp_path)]
    both = [subprocess.Popen([*command, str(20 + k)], stderr=subprocess.PIPE, text=True) for k in range(2)]
    for process in both:
        _, said = process.communicate(timeout=300)
        assert process.returncode == 0, said
        assert "Traceback" not in said, said
    (take,) = load_project(tmp_path / "both.sport", StyleNotes()).takes
    assert len(take.shown.clip) in (20, 21)
    lengths = [len(load_clip_bvh(path)) for path in (tmp_path / "clips").glob("*.bvh")]
    assert sorted(set(lengths)) == [20, 21]
    assert find_journals(tmp_path / "config" / "journals") == ([], [])
    left = [path for path in tmp_path.rglob("*") if "-sport-" in path.name]
    assert left == []
