"""The file dialog of the program's own, cards that can be moved, and windows that fit the screen."""

from pathlib import Path

import pytest

from tests.helpers import hand
from tests.helpers.app_driver import Start, click_on, do, drag, drawn, press, run, texts
from viewer import window as window_module
from viewer.app import App
from viewer.gl_bindings import imgui
from viewer.gui.dialogs import DialogKind, PendingDialog


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    home = tmp_path / "home"
    for name in ("b.bvh", "a.bvh", "notes.txt", ".hidden.bvh", "Müde König.bvh"):
        (home / "clips").mkdir(parents=True, exist_ok=True)
        (home / "clips" / name).write_text("", encoding="utf-8")
    (home / "clips" / "more").mkdir()
    return home


@pytest.mark.parametrize(
    ("kind", "filters", "names"),
    [
        (DialogKind.OPEN, ("Clips", "*.bvh"), ["more", "a.bvh", "b.bvh", "Müde König.bvh"]),
        (DialogKind.OPEN, ("Clips", "*.bvh", "All", "*"), ["more", "a.bvh", "b.bvh", "Müde König.bvh", "notes.txt"]),
        (DialogKind.FOLDER, (), ["more"]),
    ],
)  # fmt: skip
def test_a_dialog_lists_folders_and_files_that_fit(
    folder: Path, kind: DialogKind, filters: tuple[str, ...], names: list[str]
) -> None:
    question = PendingDialog(kind, "Open", folder, filters, lambda _: None)
    question.typed = str(folder / "clips")
    assert [path.name for path in question.entries()] == names
    question.typed = str(folder / "clips" / "nothing here" / "x")
    assert question.entries() == []


@pytest.mark.parametrize("typed", ["~nobody-of-this-name/x", "x" * 300, "/", "."])
def test_what_is_typed_on_the_way_to_a_name_is_an_answer_or_none(typed: str) -> None:
    question = PendingDialog(
        DialogKind.SAVE, "Save", Path(), ("Sessions", "*.sport"), lambda _: None, typed=typed
    )
    assert isinstance(question.entries(), list)
    assert question.accept() == (typed if Path(typed).name else None)


def test_a_file_is_found_by_clicks_alone(start: Start, folder: Path) -> None:
    app, found = start(), []
    app.sessions.dialogs.ask(DialogKind.OPEN, "Open", folder, found.append, ("Clips", "*.bvh"))
    run(app, 3)
    click_on(app, next(label for label, _ in drawn(app) if "clips" in label).partition("##")[0])
    assert app.sessions.dialogs.question.folder == folder / "clips"
    click_on(app, "##up")
    assert app.sessions.dialogs.question.folder == folder
    click_on(app, next(label for label, _ in drawn(app) if "clips" in label).partition("##")[0])
    click_on(app, next(label for label, _ in drawn(app) if "a.bvh" in label).partition("##")[0])
    click_on(app, "##dialog ok")
    assert found == [folder / "clips" / "a.bvh"]


def test_cancel_answers_nothing(start: Start, folder: Path) -> None:
    app, found = start(), []
    app.sessions.dialogs.ask(DialogKind.OPEN, "Open", folder, found.append)
    do(app, "run 3; click ##dialog cancel")
    assert app.sessions.dialogs.question is None
    assert found == []


def test_the_pose_panel_is_moved_and_stays_there(app: App) -> None:
    do(app, "record 40; play 1")
    app.posing.toggle()
    run(app, 3)
    card = next(w for w in imgui.get_current_context().windows if w.name == "Pose")
    at = card.pos.x, card.pos.y
    drag(app, (at[0] + 60.0, at[1] + 4.0), (at[0] - 140.0, at[1] + 60.0))
    run(app, 3)
    assert (card.pos.x, card.pos.y) == (at[0] - 200.0, at[1] + 56.0)
    app.posing.joint = 16
    run(app, 3)
    assert (card.pos.x, card.pos.y) == (at[0] - 200.0, at[1] + 56.0)
    hand.resize(app.window, 1000, 700)
    run(app, 4)
    assert card.pos.x + card.size.x <= 1000.0, "a view of another size has it in its corner again"


@pytest.mark.parametrize(
    ("asked", "screen", "scale", "fits"),
    [
        ((2560, 1440), (1280, 700), 1.0, (1280, 700)),
        ((1280, 720), (1920, 1040), 1.0, (1280, 720)),
        ((1280, 720), (1920, 1040), 2.0, (960, 520)),
    ],
)
def test_a_remembered_window_fits_the_screen(
    asked: tuple[int, int], screen: tuple[int, int], scale: float, fits: tuple[int, int],
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    glfw = window_module.glfw
    monkeypatch.setattr(glfw, "get_primary_monitor", lambda: object())
    monkeypatch.setattr(glfw, "get_monitor_workarea", lambda _: (0, 0, *screen))
    monkeypatch.setattr(glfw, "get_monitor_content_scale", lambda _: (scale, scale))
    assert window_module._fitting_screen(*asked) == fits
    monkeypatch.setattr(glfw, "get_primary_monitor", lambda: None)
    assert window_module._fitting_screen(*asked) == asked


def test_the_help_has_the_keys_of_the_session(app: App) -> None:
    press(app, "f1")
    said = " ".join(texts(app))
    assert all(key in said for key in ("Ctrl+S", "Ctrl+O", "Ctrl+E"))
