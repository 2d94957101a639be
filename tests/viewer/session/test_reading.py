"""Files that take long to read: the status line names them, they can be cancelled, and the end does not wait for them."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from runtime.errors import FileError
from tests.helpers.app_driver import Start, message, run, run_until
from tests.helpers.viewer_fakes import fake_services
from viewer import jobs
from viewer.app import App
from viewer.gl_bindings import imgui
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
    begun = time.monotonic()
    endless.scene.jobs.close()
    assert time.monotonic() - begun < 5.0
    readers = [t for t in threading.enumerate() if t.name == "sport reading" and t.is_alive()]
    assert readers
    assert all(t.daemon for t in readers)


def test_the_button_of_the_status_line_is_drawn_in_place_of_the_message(
    endless: App, monkeypatch: pytest.MonkeyPatch
) -> None:
    labels: list[str] = []
    button = imgui.small_button
    monkeypatch.setattr(imgui, "small_button", lambda label: labels.append(label) or button(label))
    endless.scene.load_terrain(str(Path("folder") / "endless.npy"))
    time.sleep(0.01)
    run(endless, 2)
    assert any(label.startswith("Cancel") for label in labels)


@pytest.mark.parametrize("name", ["endless.glb", "endless.bvh"])
def test_a_character_or_clip_without_end_is_cancelled_and_the_next_one_is_read(
    name: str, start: Start, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(jobs, "PATIENCE_S", 0.0)
    monkeypatch.setattr("viewer.workspace.Jobs", lambda messages, blocking: Jobs(messages))
    never, begun, shipped = threading.Event(), [], fake_services().load_character

    def wait(path: Path) -> None:
        begun.append(path.name)
        if "endless" in path.name:
            never.wait()
        raise FileError(f"{path.name}: read to its end.", "This is the test's own.")

    def load_character(path: Path | None, joint_map: Path | None = None) -> Any:
        return shipped(None, joint_map) if path is None else wait(path)

    monkeypatch.setattr("runtime.formats.reference.open_take", wait)
    monkeypatch.setattr("viewer.scene.scene.has_skin", lambda _: True)
    app = start(services={"load_character": load_character})
    run_until(app, lambda: not app.jobs.busy(Slot("character")) and not app.jobs.busy(Slot("terrain")))
    before, drawn_before, takes = (
        app.scene.renderer.character,
        len(app.scene.renderer.poses),
        len(app.editor.session.takes),
    )
    try:
        app.open_files([Path(name)])
        run_until(app, lambda: app.jobs.shown()[0] == f"Reading {name}" and begun == [name])
        run(app, 2)
        assert len(app.scene.renderer.poses) > drawn_before  # it goes on walking meanwhile
        monkeypatch.setattr(status, "_doing", lambda *_: True)  # the button is pressed
        run(app, 2)
        assert f"Stopped reading {name}" in message(app)
        assert app.jobs.shown() == ("", None)
        app.open_files([Path(name.replace("endless", "other"))])
        monkeypatch.setattr(status, "_doing", lambda *_: False)
        run_until(app, lambda: "read to its end" in message(app))
        never.set()  # what was cancelled comes to its end, and nobody hears of it
        run(app, 3)
        assert app.scene.renderer.character is before
        assert len(app.editor.session.takes) == takes
    finally:
        never.set()


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
