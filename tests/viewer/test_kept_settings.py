"""Settings are in their file a second after they change, whatever becomes of the program then."""

import json
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from tests.helpers.app_driver import do, message, run, run_until
from viewer.app import App
from viewer.jobs import Jobs, Slot
from viewer.messages import Messages
from viewer.settings import FILE_NAME, WRITE_INTERVAL_S, KeptSettings, Settings, load_settings, save_settings

KILLED = """
import sys
import time
from dataclasses import replace
from pathlib import Path

from tests.helpers.app_driver import InjectedPads, click_on, run
from tests.helpers.viewer_fakes import fake_services

from viewer.app import App
from viewer.options import ViewOptions

app = App(ViewOptions(offscreen=True, terrain="flat"), fake_services(False), InjectedPads(), Path(sys.argv[1]))
app.kept.active, app.jobs.blocking = True, False
run(app, 3)
click_on(app, "Ghosts")
print("changed", flush=True)
while True:
    run(app)
    time.sleep(0.02)
"""


def written(app: App) -> dict[str, Any]:
    file = app.config / FILE_NAME
    content = json.loads(file.read_text("utf-8")) if file.exists() else {}
    assert isinstance(content, dict)
    return content


def test_a_change_by_mouse_is_in_the_file_a_second_later(app: App) -> None:
    now = [0.0]
    app.kept.active, app.kept.clock, app.jobs.blocking = True, lambda: now[0], False
    do(app, "run 3; click Ghosts")
    assert app.settings.show_ghosts
    now[0] += WRITE_INTERVAL_S
    run_until(app, lambda: written(app).get("show_ghosts") is True)
    do(app, "click ##settings; click ##text size; click Large")
    assert not app.jobs.busy(Slot("settings"))
    now[0] += WRITE_INTERVAL_S
    run_until(app, lambda: written(app).get("text_size") == 1.15)


def test_a_run_without_a_display_writes_none(app: App) -> None:
    app.settings.show_ghosts = True
    run(app, 3)
    assert app.end() == 0
    assert not (app.config / FILE_NAME).exists()


def test_a_kill_costs_no_setting_that_was_written(tmp_path: Path) -> None:
    process = subprocess.Popen([sys.executable, "-c", KILLED, str(tmp_path)], stdout=subprocess.PIPE)
    try:
        assert process.stdout.readline() == b"changed\n"
        end = time.monotonic() + 60.0
        while not load_settings(tmp_path)[0].show_ghosts:
            assert time.monotonic() < end
            time.sleep(0.02)
    finally:
        process.kill()
        assert process.wait() == -signal.SIGKILL
    settings, complaints = load_settings(tmp_path)
    assert settings.show_ghosts
    assert not complaints


def kept(folder: Path, now: list[float]) -> tuple[Settings, KeptSettings, Messages]:
    settings, messages = load_settings(folder)[0], Messages()
    watch = KeptSettings(settings, folder, Jobs(messages, blocking=True), True, lambda: now[0])
    return settings, watch, messages


def test_two_windows_keep_what_the_other_one_changed_meanwhile(tmp_path: Path) -> None:
    save_settings(Settings(), tmp_path)
    now = [0.0]
    (a, keep_a, _), (b, keep_b, _) = kept(tmp_path, now), kept(tmp_path, now)
    a.camera, a.dead_zone = "orbit", 0.2
    keep_a.watch()
    now[0] += WRITE_INTERVAL_S
    b.dead_zone = 0.4
    keep_b.watch()
    now[0] += WRITE_INTERVAL_S
    a.show_grid = False  # what it wrote before is no change any more
    keep_a.watch()
    assert keep_a.finish(0.0)
    assert keep_b.finish(0.0)
    found, _ = load_settings(tmp_path)
    assert (found.camera, found.dead_zone, found.show_grid) == ("orbit", 0.4, False)


def test_a_folder_that_cannot_be_written_is_said_once_and_at_the_end(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("", encoding="utf-8")
    now = [0.0]
    settings, keep, messages = kept(tmp_path / "file" / "config", now)
    settings.show_grid = False
    for _ in range(10):
        now[0] += WRITE_INTERVAL_S
        keep.watch()
    assert len(messages.recent) == 1
    assert not keep.finish(time.monotonic() + 5.0)
    assert "Choose a folder that can be written" in messages.recent[-1].text


def test_what_changed_in_the_last_second_is_written_at_the_end(app: App) -> None:
    app.kept.active = True
    run(app, 2)
    app.settings.invert_look = True
    assert app.end() == 0, message(app)
    assert written(app)["invert_look"] is True


@pytest.mark.parametrize("content", ["{", '{"width": "wide", "prompt_history": ["a", 5, "b"]}'])
def test_a_damaged_file_is_kept_aside_before_it_is_replaced(content: str, tmp_path: Path) -> None:
    (tmp_path / FILE_NAME).write_text(content)
    before, _ = load_settings(tmp_path)
    save_settings(replace(before, height=500), tmp_path, before)
    (aside,) = tmp_path.glob(f"{FILE_NAME}.damaged-*")
    assert aside.read_text() == content
    again, problems = load_settings(tmp_path)
    assert (again.height, problems) == (500, [])
    assert again.prompt_history == (["a", "b"] if "prompt" in content else [])
    save_settings(replace(again, height=600), tmp_path, again)
    assert len(list(tmp_path.glob(f"{FILE_NAME}.damaged-*"))) == 1
