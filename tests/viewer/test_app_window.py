"""The real application without a display (PLATFORM_NULL and EGL): its window, size, scale and options."""

import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from benchmarks import frames
from runtime.errors import DisplayError, UsageError
from tests.faults.faults import display
from tests.helpers import hand
from tests.helpers.app_driver import InjectedPads, Start, run
from tests.helpers.viewer_fakes import fake_services
from viewer.app import App
from viewer.gl_bindings import imgui
from viewer.options import ViewOptions


def test_first_frame_shows_scene_and_panels(start: Start) -> None:
    app = start(real_renderer=True, width=640, height=400, panels=True)
    run(app, 2)
    picture = app.window.read_pixels()
    assert picture.shape == (400, 640, 3)
    assert picture[:30].mean() > 90  # the bright sky
    assert picture[-15:, 300:].mean() < 60  # the dark status line
    assert app.scene.model_name == "fake"
    assert app.prompting.parts["torso"] != ""


IN_A_WINDOW = """
import sys
from functools import partial
from pathlib import Path
from tests.helpers import hand
from tests.helpers.app_driver import InjectedPads, run
from tests.helpers.viewer_fakes import fake_services
from viewer.app import App
from viewer.options import ViewOptions

options = ViewOptions(width=480, height=320, terrain="flat", quality="software")
app = App(options, fake_services(True), InjectedPads(), Path(sys.argv[1]))
for size in ((480, 320), (610, 390)):
    hand.resize(app.window, *size)
    for _ in range(400):
        run(app)
        if app.frames_shown > 5 and app.window.pixels == size:
            break
    run(app, 2)
    picture = app.window.read_pixels()
    assert picture.shape == (size[1], size[0], 3), (picture.shape, size)
    assert picture[:6].mean() > 60, "the sky"
    assert picture[-12:, 200:].mean() < 60, "the status line"
    assert picture.std() > 20
app.close()
"""


@pytest.mark.skipif(shutil.which("Xvfb") is None, reason="no Xvfb here")
def test_a_shown_window_has_scene_and_panels_at_every_size(tmp_path: Path) -> None:
    with display() as (_, name):
        command = [sys.executable, "-c", IN_A_WINDOW, str(tmp_path)]
        environment = os.environ | {"DISPLAY": name, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
        done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("size", [(333, 217), (1921, 1081), (64, 64), (2000, 200)])
def test_resize_to_odd_sizes(app: App, size: tuple[int, int]) -> None:
    hand.resize(app.window, *size)
    run(app, 3)
    assert app.window.framebuffer.size == size
    assert app.window.read_pixels().shape == (size[1], size[0], 3)


def test_change_of_scale_does_not_add_up(start: Start) -> None:
    from viewer.gl_bindings import imgui

    app = start()
    run(app)
    before = imgui.get_style().window_padding.x
    for scale in (2.0, 1.0):
        app.window.wanted_scale = scale
        run(app)
    assert imgui.get_style().window_padding.x == before


@pytest.mark.parametrize("panels", [True, False])
def test_saved_frames_without_panels_have_no_status_line_either(
    start: Start, panels: bool, tmp_path: Path
) -> None:
    app = start(panels=panels, screenshot=tmp_path / "shot.png")
    names = []
    begin = imgui.begin
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(imgui, "begin", lambda name, *rest: names.append(name) or begin(name, *rest))
        run(app, 2)
    assert bool(names) == panels
    assert ("Status" in names) == panels


def test_minimised_window_draws_nothing_and_comes_back(app: App, monkeypatch: pytest.MonkeyPatch) -> None:
    drawn = app.frames_shown
    monkeypatch.setattr(app.window, "pixels", (0, 0))
    run(app, 2)
    assert app.frames_shown == drawn
    monkeypatch.undo()
    run(app)
    assert app.frames_shown == drawn + 1


def test_without_a_display_the_error_names_the_remedy(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    with pytest.raises(DisplayError, match="--offscreen"):
        App(ViewOptions(), fake_services(), InjectedPads(), tmp_path)


@pytest.mark.parametrize(
    "options",
    [
        {"width": 5},
        {"frames": 0},
        {"ui_scale": 9.0},
        {"camera": "behind"},
        {"controls": "jump"},
        {"frames_directory": Path("x")},
    ],
)
def test_options_are_checked_before_a_window_opens(options: dict[str, Any]) -> None:
    with pytest.raises(UsageError, match=r"--|^controls: "):
        App(ViewOptions(**options), fake_services())


def test_frames_are_timed_by_part_and_left_as_they_were(app: App) -> None:
    times = frames.measure(app, 3)
    assert set(times) == {"frame", "all else", "motion", "scene", "panels", "panels' drawing", "showing"}
    assert all(len(ms) == 3 for ms in times.values())
    assert "advance" not in vars(app.scene)
