"""The application at its worst moments: killed, no room, two at once, names that are no text."""

from __future__ import annotations

import dataclasses
import json
import os
import shutil
import tempfile
from pathlib import Path
from typing import Any

import pytest
from app_driver import Start, click_on, drawn, message, run, run_until

from runtime.errors import FileError
from runtime.formats import bvh_clip
from runtime.formats.bvh_clip import load_clip_bvh
from viewer.app import App
from viewer.settings import Settings, load_settings, save_settings
from viewer.takes import takes as takes_module


def record(app: App, frames: int = 30, stop: bool = True) -> None:
    app.takes.toggle_recording()
    run(app, frames)
    if stop:
        app.takes.toggle_recording()


def journals(tmp_path: Path) -> list[Path]:
    return sorted((tmp_path / "config" / "journals").glob("*.take"))


def killed(app: App, tmp_path: Path) -> Path:
    """The journal that a run leaves behind that records and is killed: its content under another name."""
    record(app, 40, stop=False)
    left = tmp_path / "left"
    running = app.takes.recorder.journal
    assert running is not None
    app.takes.journals.close()  # writes what is queued, lets go
    shutil.move(journals(tmp_path)[0], left)
    app.close()
    return left


def test_a_take_that_was_cut_off_is_offered_and_recovered(start: Start, tmp_path: Path) -> None:
    left = killed(start(terrain="flat"), tmp_path)
    shutil.move(left, tmp_path / "config" / "journals" / "a.take")
    app = start()
    app.settings.export_folder = str(tmp_path / "clips")
    app.takes.journals.look()
    assert "Cut off" in message(app)
    run(app, 3)
    click_on(app, "Recover")
    run_until(app, lambda: len(app.editor.session.takes) == 1)
    assert len(app.editor.session.takes[0].clip) == 40
    assert not any("Recover" in label for label, _ in drawn(app))
    assert journals(tmp_path)  # until it is exported
    app.takes.export()
    run(app, 2)
    assert len(load_clip_bvh(tmp_path / "clips" / "take-1.bvh")) == 40
    assert journals(tmp_path) == []


def test_a_take_that_was_cut_off_can_be_discarded(start: Start, tmp_path: Path) -> None:
    left = killed(start(), tmp_path)
    shutil.move(left, tmp_path / "config" / "journals" / "a.take")
    app = start()
    app.takes.journals.look()
    run(app, 3)
    click_on(app, "Discard")
    assert journals(tmp_path) == []
    assert app.editor.session.takes == []


def test_a_journal_lives_as_long_as_its_take_is_nowhere_else(start: Start, tmp_path: Path) -> None:
    app = start()
    run(app, 20)
    record(app)
    app.takes.save_last()
    for item in app.editor.session.takes:
        assert item.journal is not None
    run_until(app, lambda: len(journals(tmp_path)) == 2)
    app.takes.remove(0)
    assert len(journals(tmp_path)) == 1
    app.takes.export_path = str(tmp_path / "a.bvh")
    app.takes.export()
    run(app)
    assert journals(tmp_path) == []
    record(app)
    assert app.end() == 0  # a run offscreen that ends as planned keeps no takes
    assert journals(tmp_path) == []


def test_a_name_that_another_run_takes_meanwhile_is_left_to_it(
    start: Start, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(takes_module, "free_path", lambda path: path)  # it was free a moment ago
    (tmp_path / "take-1.bvh").write_text("of another run", encoding="utf-8")
    app = start()
    app.settings.export_folder = str(tmp_path)
    record(app)
    app.takes.export()
    run(app, 2)
    assert app.editor.session.takes[0].saved == tmp_path / "take-1-2.bvh"
    record(app)
    app.editor.session.takes[1] = dataclasses.replace(
        app.editor.session.takes[1], clip=app.editor.session.takes[0].clip
    )
    assert app.takes.rescue() == [tmp_path / "take-1-3.bvh"]
    assert (tmp_path / "take-1.bvh").read_text("utf-8") == "of another run"


def test_where_the_folder_takes_nothing_another_place_does_and_the_code_says_so(
    start: Start, tmp_path: Path
) -> None:
    app = start()
    (tmp_path / "file").write_text("", encoding="utf-8")
    app.settings.export_folder = str(tmp_path / "file")
    record(app)
    app.interrupt()
    assert app.end() == 1
    kept = tmp_path / "config" / "takes" / "take-1.bvh"
    assert len(load_clip_bvh(kept)) == 30
    errors = [m.text for m in app.messages.recent]
    assert any(str(kept) in text and "not where it was asked for" in text for text in errors)


def test_an_export_on_its_way_at_the_end_is_not_saved_twice_and_not_lost(
    start: Start, tmp_path: Path
) -> None:
    app = start()
    app.jobs.blocking = False
    app.settings.export_folder = str(tmp_path / "clips")
    record(app)
    app.takes.export()
    record(app)
    app.takes.export_path = str(tmp_path / "config" / "settings.lock" / "b.bvh")
    (tmp_path / "config").mkdir(exist_ok=True)
    (tmp_path / "config" / "settings.lock").write_text("", encoding="utf-8")
    app.takes.export()  # fails
    app.interrupt()
    assert app.end() == 1
    assert sorted(p.name for p in (tmp_path / "clips").glob("*.bvh")) == ["take-1.bvh", "take-2.bvh"]


def test_when_no_place_takes_it_the_journal_stays_and_the_code_says_so(
    start: Start, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: Any, **__: Any) -> Path:
        raise FileError("No space left on device.", "")

    app = start()
    record(app)
    monkeypatch.setattr(bvh_clip, "save_bvh", full)
    app.interrupt()
    assert app.end() == 1
    app.close()
    assert len(journals(tmp_path)) == 1


def test_a_defect_in_saving_one_take_costs_no_other(
    start: Start, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def save(clip: Any, *rest: Any, **more: Any) -> Path:
        if clip.name == "Take 1":
            raise ZeroDivisionError
        return original(clip, *rest, **more)

    original = bvh_clip.save_bvh
    monkeypatch.setattr(bvh_clip, "save_bvh", save)
    monkeypatch.setattr(tempfile, "gettempdir", lambda: str(tmp_path))
    app = start()
    app.settings.export_folder = str(tmp_path / "clips")
    record(app)
    record(app)
    app.interrupt()
    assert app.end() == 1
    assert [p.name for p in (tmp_path / "clips").glob("*.bvh")] == ["take-2.bvh"]


@pytest.mark.skipif(os.name != "posix", reason="names of POSIX are bytes")
def test_a_name_that_is_no_text_kills_nothing(start: Start, tmp_path: Path) -> None:
    app = start()
    record(app)
    folder = tmp_path / os.fsdecode(b"clips-\xff")
    try:
        folder.mkdir()
    except OSError:
        pytest.skip("this file system takes UTF-8 only")
    app.settings.export_folder = str(folder)
    app.takes.select(0)
    run(app, 2)  # the field shows it
    app.takes.export()
    run(app, 2)
    assert (folder / "take-1.bvh").is_file()
    app.takes.select(0)
    run(app, 2)
    strange = folder / os.fsdecode(b"walk-\xfe.bvh")
    shutil.copy(folder / "take-1.bvh", strange)
    app.open_files([strange, folder / os.fsdecode(b"\xfe.png"), folder / os.fsdecode(b"\xfe.xyz")])
    run(app, 3)
    assert app.editor.session.takes[-1].name == "walk-\ufffd"
    app.takes.play(1)
    run(app, 2)
    app.scene.load_terrain(str(folder / os.fsdecode(b"\xfe.npy")))
    run(app, 2)
    record(app)
    assert len(app.takes.rescue()) == 1


# --- settings


def test_the_last_to_close_does_not_undo_what_the_other_changed(tmp_path: Path) -> None:
    save_settings(Settings(prompt_history=["old"]), tmp_path)
    runs = [load_settings(tmp_path)[0] for _ in range(2)]
    before = [dataclasses.replace(run, prompt_history=list(run.prompt_history)) for run in runs]
    runs[0].blend_seconds, runs[0].prompt_history = 2.5, ["first", "old"]
    runs[1].terrain, runs[1].prompt_history = "stairs", ["second", "old"]
    for now, then in zip(runs, before, strict=True):
        save_settings(now, tmp_path, then)
    both, complaints = load_settings(tmp_path)
    assert complaints == []
    assert (both.blend_seconds, both.terrain) == (2.5, "stairs")
    assert both.prompt_history == ["second", "old", "first"]


def test_fields_of_a_newer_version_stay(tmp_path: Path) -> None:
    (tmp_path / "settings.json").write_text('{"newer": [1], "width": "wide"}', encoding="utf-8")
    now, complaints = load_settings(tmp_path)
    assert len(complaints) == 1
    save_settings(now, tmp_path, dataclasses.replace(now))
    content = json.loads((tmp_path / "settings.json").read_text("utf-8"))
    assert content["newer"] == [1]
    assert load_settings(tmp_path) == (Settings(), [])  # what was unusable is said once


@pytest.mark.parametrize(
    "value",
    ["1" + "0" * 5000, "1" + "0" * 400, "1e999", "NaN", '"\\udc80"', "[" * 300 + "]" * 300, '["\\udc80"]'],
)
def test_no_value_stops_the_start_or_the_other_settings(start: Start, tmp_path: Path, value: str) -> None:
    (tmp_path / "config").mkdir()
    names = ("width", "max_fps", "terrain", "prompt_history", "export_fps", "vsync")
    text = ", ".join(f'"{name}": {value}' for name in names)
    (tmp_path / "config" / "settings.json").write_text(f'{{{text}, "dead_zone": 0.3}}', encoding="utf-8")
    app = start()
    run(app, 2)
    assert app.settings == Settings(dead_zone=0.3, terrain="flat")
    assert sum("unusable" in m.text for m in app.messages.recent) == 1


def test_nothing_changed_is_no_loss_where_nothing_can_be_written(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("", encoding="utf-8")
    save_settings(Settings(), tmp_path / "file" / "config", Settings())
    with pytest.raises(FileError, match="file"):
        save_settings(Settings(width=999), tmp_path / "file" / "config", Settings())
