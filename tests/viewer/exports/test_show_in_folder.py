"""The real application without a display: what was written is shown in its folder, by a button after every export."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.helpers.app_driver import Start, click_on, run
from viewer import process


@pytest.mark.parametrize("size", [(1280, 720), (800, 500)])
def test_an_export_is_shown_in_its_folder(
    start: Start, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, size: tuple[int, int]
) -> None:
    opened: list[list[str]] = []
    app = start(width=size[0], height=size[1])
    monkeypatch.setattr(process.subprocess, "Popen", lambda command, **_: opened.append(command))
    app.settings.export_folder = str(tmp_path)
    run(app, 2)
    app.takes.toggle_recording()
    run(app, 10)
    app.takes.toggle_recording()
    app.takes.export()
    run(app, 2)
    click_on(app, "##show in folder")
    assert str(tmp_path) in opened[-1][-1]
    app.exporting.open()
    app.exporting.export()
    run(app, 3)
    click_on(app, "##show export")
    assert len(opened) == 2
    assert str(tmp_path) in opened[-1][-1]
