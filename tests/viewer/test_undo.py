"""The real application by mouse and keys: whatever a user made is undone by Ctrl+Z, one thing at a time, and is in the file."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from runtime.character.shape import BodyShape
from runtime.formats.options import ExportOptions
from runtime.formats.table import save_motion
from runtime.session.session import Session
from runtime.takes.clip import Clip
from runtime.terrain.library import load_terrain
from tests.helpers import hand
from tests.helpers.app_driver import (
    Start,
    click,
    click_on,
    do,
    drag,
    drawn,
    message,
    place,
    point,
    press,
    record,
    run,
    save_and_leave,
    titles,
)
from tests.helpers.foreign_rigs import RIGS
from tests.helpers.walker import walk
from viewer import services
from viewer.app import App
from viewer.editor import Editor
from viewer.gl_bindings import imgui
from viewer.session.opening import open_file


def trim_start(app: App, share: float) -> None:
    """Drag the left handle of the ruler to a part of its width."""
    (left, y), (to, _) = (place(app, "##timeline", share=at) for at in (0.01, share))
    drag(app, (left, y + 7.0), (to, y + 7.0))


def play_row(app: App, row: int) -> None:
    """The button of a row that plays its take, and again to pause it."""
    for _ in range(2):
        click(app, *place(app, "row", index=row, share=0.04))
    assert app.takes.playback.number == app.editor.session.takes[row].number
    assert not app.takes.playback.playing


def menu(app: App, row: int, *entries: str) -> None:
    """Entries of the menu of a take's row, each in the one before."""
    click_on(app, "##take menu", index=row)
    for entry in entries:
        click_on(app, entry)
    run(app, 2)


def undo(app: App) -> None:
    press(app, "ctrl", "z")


def trims(app: App) -> list[tuple[int, int]]:
    return [take.range for take in app.editor.session.takes]


def saved_and_opened(app: App, path: Path) -> Session:
    """Saved, left, and opened again."""
    save_and_leave(app, path)
    assert not app.editor.session.takes
    app.sessions.open(path)
    run(app, 3)
    return app.editor.session


# --- trims
@pytest.mark.parametrize("then", ["another plays", "live", "opened"])
def test_undo_takes_the_trim_back_whatever_was_looked_at_since(app: App, tmp_path: Path, then: str) -> None:
    do(app, "record 40; record 40")
    play_row(app, 0)
    trim_start(app, 0.5)
    if then == "another plays":
        play_row(app, 1)
    elif then == "live":
        do(app, "key escape; run 5")
    else:
        saved_and_opened(app, tmp_path / "a.sport")
    undo(app)
    assert trims(app) == [(0, 39), (0, 39)]
    assert message(app).startswith("Undone: trim of Take 1.")
    press(app, "ctrl", "y")
    assert trims(app)[0][0] >= 17


def test_one_drag_of_a_handle_is_one_step(app: App) -> None:
    record(app, 40)
    play_row(app, 0)
    steps = app.editor.history.present.number
    y, xs = place(app, "##timeline")[1] + 7.0, [place(app, "##timeline", share=k / 20)[0] for k in range(11)]
    point(app, xs[0] + 2.0, y)
    for x in xs:
        hand.mouse(app.window, x + 2.0, y, 0, True)
        run(app)
    assert app.editor.history.present.number == steps, "it is no step while the mouse holds it"
    point(app, xs[-1] + 2.0, y, 0, False)
    assert app.editor.history.present.number == steps + 1


# --- the list
@pytest.mark.parametrize(
    "end", [Editor.undo, Editor.redo, Editor.finish_drag, lambda editor: editor.put("name", 1, name="other")]
)
def test_a_tool_drags_until_the_next_step_or_another_tool(app: App, end: Callable[[Editor], object]) -> None:
    record(app, 10)
    one, other = object(), object()
    app.editor.begin_drag(one)
    app.editor.put("name", 1, held=True, name="dragged")
    assert app.editor.dragger is one
    end(app.editor)
    assert app.editor.dragger is None
    app.editor.begin_drag(one)
    app.editor.begin_drag(other)
    assert app.editor.dragger is other


def test_a_removal_leaves_what_plays_alone(app: App) -> None:
    for _ in range(3):
        record(app, 10)
    play_row(app, 2)
    menu(app, 0, "Delete")
    assert app.takes.playback.take.title == "Take 3"
    assert app.editor.session.selected == 3


def test_color_and_order_are_chosen_in_the_menu_undone_and_kept(app: App, tmp_path: Path) -> None:
    for _ in range(3):
        record(app, 10)
    menu(app, 0, "Color", "Green")
    assert [take.color for take in app.editor.session.takes] == [3, 0, 0]
    menu(app, 2, "Move up")
    assert titles(app) == ["Take 1", "Take 3", "Take 2"]
    menu(app, 0, "Move down")
    assert titles(app) == ["Take 3", "Take 1", "Take 2"]
    opened = saved_and_opened(app, tmp_path / "a.sport")
    assert [take.number for take in opened.takes] == [3, 1, 2]
    assert [take.color for take in opened.takes] == [0, 3, 0]
    undo(app)
    assert titles(app) == ["Take 1", "Take 3", "Take 2"]
    undo(app)
    undo(app)
    assert [take.color for take in app.editor.session.takes] == [0, 0, 0]
    assert titles(app) == ["Take 1", "Take 2", "Take 3"]


# --- pins, keys, path
def test_undo_removes_the_camera_key_and_not_the_pin_before_it(app: App) -> None:
    record(app, 40)
    play_row(app, 0)
    for entry in ("Left hand", "Camera key"):
        click_on(app, "+ Pin")
        click_on(app, entry)
    take = app.editor.session.takes[0]
    assert (len(take.poses.pins), len(take.cameras)) == (1, 1)
    undo(app)
    take = app.editor.session.takes[0]
    assert (len(take.poses.pins), len(take.cameras)) == (1, 0)
    undo(app)
    assert not app.editor.session.takes[0].poses


# --- body and ground
def test_a_shape_of_the_mannequin_is_one_step_and_comes_back_as_sliders(start: Start, tmp_path: Path) -> None:
    app = start(services={"load_character": services.load_character})
    do(app, "run 2; click Files, body, links; click Mannequin")
    begin, end = (place(app, "##shape height", share=share) for share in (0.5, 0.2))
    steps = app.editor.history.present.number
    drag(app, begin, end)
    shape = app.editor.session.character.shape
    assert shape.height < 0.95
    assert app.editor.history.present.number == steps + 1
    saved_and_opened(app, tmp_path / "a.sport")
    assert app.editor.session.character.shape == shape
    assert app.scene.character_name == "mannequin"
    assert "##shape height" in [label for label, _ in drawn(app)], "a slider, and no file"
    undo(app)
    assert app.editor.session.character.shape == BodyShape()
    assert app.scene.size == 1.0


def test_the_unit_of_a_character_is_chosen_and_undone(start: Start, tmp_path: Path) -> None:
    """A file that is in centimetres by the height of its body, in inches by choice."""
    app = start(services={"load_character": services.load_character})
    app.open_files([RIGS["centimetres"](tmp_path / "rig.glb")])
    run(app, 6)
    guessed = app.scene.size
    do(app, "click Files, body, links; click ##character unit; click Unit: inches; run 4")
    assert app.scene.size == pytest.approx(2.54 * guessed)
    saved_and_opened(app, tmp_path / "a.sport")
    assert app.scene.size == pytest.approx(2.54 * guessed)
    undo(app)
    assert app.scene.size == pytest.approx(guessed)


def shown_ground(app: App) -> str:
    """What the list of grounds shows."""
    begin, shown = imgui.begin_combo, {}

    def watched(label: str, preview: str, *rest: int) -> bool:
        shown[label] = preview
        return bool(begin(label, preview, *rest))

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(imgui, "begin_combo", watched)
        run(app)
    return shown["##terrain"]


def test_the_scene_panel_names_the_ground_of_the_take_that_plays(app: App) -> None:
    do(app, "record 40; ground hills; run 2")
    assert shown_ground(app).lower() == "hills"
    play_row(app, 0)
    assert shown_ground(app).lower() == "flat"
    assert app.scene.renderer.terrain.name == "flat"
    press(app, "escape")
    assert shown_ground(app).lower() == "hills"
    undo(app)
    assert shown_ground(app).lower() == "flat"


@pytest.mark.parametrize("named", [True, False])
def test_the_scene_panel_names_the_ground_under_a_file(start: Start, tmp_path: Path, named: bool) -> None:
    """That of the file, or without one the live ground; the one that is drawn in both cases."""
    clip = Clip("walk", 60.0, *walk(90), terrain="stairs" if named else "flat")
    save_motion(clip, tmp_path / "walk.glb", ExportOptions(), load_terrain(clip.terrain))
    app = start()
    do(app, "ground hills; run 2")
    open_file(app.takes, tmp_path / "walk.glb")
    run(app, 4)
    wanted = "stairs" if named else "hills"
    assert (shown_ground(app).lower(), app.scene.renderer.terrain.name) == (wanted, wanted)
    assert np.allclose(app.takes.playback.clip.contacts, clip.contacts, atol=1e-3)
