"""Files that take long to read: the status line names them, they can be cancelled, and the end does not wait for them."""

import os
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.helpers.app_driver import Start, message, run, run_until
from tests.helpers.viewer_fakes import fake_services
from viewer import jobs
from viewer.app import App
from viewer.gui import status
from viewer.jobs import Jobs, Slot


@pytest.fixture
def endless(start: Start, monkeypatch: pytest.MonkeyPatch) -> Iterator[App]:
    """An application in which the ground "endless.npy" is never read to its end."""
    monkeypatch.setattr(jobs, "PATIENCE_S", 0.0)
    monkeypatch.setattr("viewer.workspace.Jobs", lambda messages, blocking: Jobs(messages))
    real, never = fake_services().load_terrain, threading.Event()

    def load(spec: str, *sizes: float) -> Any:
        if "endless" in spec:
            never.wait()
        return real(spec, *sizes)

    app = start(services={"load_terrain": load})
    run_until(app, lambda: app.scene.terrain is not None and not app.scene.jobs.busy(Slot("terrain")))
    yield app
    never.set()


def test_a_ground_without_end_is_cancelled_and_another_one_loads(
    endless: App, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = endless.scene.terrain
    endless.scene.load_terrain("endless.npy")
    time.sleep(0.01)
    shown: list[str] = []
    real = status._doing

    def pressed(text: str, width: float, can_end: bool) -> bool:
        shown.append(text)
        return real(text, width, can_end) or len(shown) == 3

    monkeypatch.setattr(status, "_doing", pressed)
    run(endless, 3)
    assert shown == ["Reading endless.npy"] * 3
    assert "Stopped reading endless.npy" in message(endless)
    assert endless.scene.loading == ""
    assert endless.scene.terrain is before
    run(endless, 2)
    assert len(shown) == 3  # nothing is read any more
    endless.scene.load_terrain("stairs")
    run_until(endless, lambda: endless.scene.terrain_spec == "stairs")


def test_the_end_of_the_program_does_not_wait_for_a_file_that_is_read(endless: App) -> None:
    endless.scene.load_terrain("endless.npy")
    endless.scene.jobs.close(0.0)
    readers = [t for t in threading.enumerate() if t.name == "sport reading" and t.is_alive()]
    assert readers
    assert all(t.daemon for t in readers)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="a pipe with a name")
@pytest.mark.parametrize("name", ["pipe.glb", "pipe.bvh", "pipe.npy"])
def test_a_pipe_that_nobody_writes_is_refused_without_waiting(
    name: str, start: Start, tmp_path: Path
) -> None:
    os.mkfifo(tmp_path / name)
    app = start()
    app.open_files([tmp_path / name])
    run(app, 2)
    assert name in message(app)
    assert app.jobs.shown() == ("", None)
