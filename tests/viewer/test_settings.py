"""Settings of two windows, of newer versions, and with values that are none."""

import dataclasses
import json
from pathlib import Path

import pytest

from runtime.errors import FileError
from tests.helpers.app_driver import Start, run
from viewer.settings import Settings, load_settings, save_settings


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
    assert json.loads((tmp_path / "settings.json").read_text("utf-8"))["newer"] == [1]
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
