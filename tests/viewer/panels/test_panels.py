"""The real application without a display: names of takes, removing and undo, exports, settings, the first minute."""

import re
from pathlib import Path

import pytest

from runtime.errors import FileError
from runtime.formats.bvh_clip import load_clip_bvh
from tests.helpers.app_driver import (
    Start,
    click,
    click_on,
    do,
    drawn,
    export_bvh,
    hold,
    place,
    press,
    record,
    run,
    texts,
    titles,
    type_in,
)
from viewer.app import App
from viewer.gl_bindings import imgui
from viewer.gui.layout import STATUS_HEIGHT_PX
from viewer.gui.theme import ICON
from viewer.messages import SETTLED_S, WARNING_S, Level, Messages
from viewer.panels.guide import STEPS


def said(app: App) -> str:
    """The last message, also when a slow machine has let it fade."""
    return app.messages.recent[-1].text


def labels(app: App) -> str:
    return " ".join(label for label, _ in drawn(app))


def test_a_take_is_renamed_in_its_row_and_exported_under_its_name(app: App, tmp_path: Path) -> None:
    app.settings.export_folder = str(tmp_path)
    do(app, "run 3; record")
    x, y = place(app, "row")
    click(app, x, y)
    click(app, x, y)  # twice within the time of a double click
    do(app, "run 3; type A proud walk; key enter")
    assert titles(app) == ["A proud walk"]
    export_bvh(app)
    assert (tmp_path / "a-proud-walk.bvh").is_file()


def test_a_removed_take_comes_back_by_key_and_by_the_menu(app: App) -> None:
    for _ in range(3):
        record(app)
    click_on(app, ICON.trash, index=1)
    assert titles(app) == ["Take 1", "Take 3"]
    assert "Ctrl+Z brings it back" in said(app)
    press(app, "ctrl", "z")
    assert titles(app) == ["Take 1", "Take 2", "Take 3"]
    click_on(app, ICON.trash)
    assert titles(app) == ["Take 2", "Take 3"]
    click_on(app, "##session")
    click_on(app, "##undo", index=-1)  # the prompt panel has one too
    assert titles(app) == ["Take 1", "Take 2", "Take 3"]


@pytest.mark.parametrize("height", [720, 560])  # the lower one has tabs
def test_the_newest_take_is_in_view(start: Start, height: int) -> None:
    app = start(width=1280, height=height)
    for _ in range(14):
        record(app, 4)
    if "Takes" in {label.partition("##")[0] for label, _ in drawn(app)}:
        click_on(app, "Takes")
    run(app, 3)
    rows = [box for label, box in drawn(app) if label == "row"]
    window = next(w for w in imgui.get_current_context().windows if "take list" in w.name)
    assert window.pos.y <= rows[-1][1]
    assert rows[-1][3] <= window.pos.y + window.size.y
    app.takes.select(1)
    run(app, 3)
    rows = [box for label, box in drawn(app) if label == "row"]
    assert window.pos.y <= rows[0][1]


def test_every_take_is_exported_at_once_and_no_file_is_replaced(app: App, tmp_path: Path) -> None:
    app.settings.export_folder = str(tmp_path)
    (tmp_path / "take-1.bvh").write_text("of somebody else", encoding="utf-8")
    do(app, "record; record; run 2; click ##export all")
    names = ["take-1-2.bvh", "take-1.bvh", "take-2.bvh"]
    assert sorted(path.name for path in tmp_path.glob("*.bvh")) == names
    assert "Saved 2 takes" in said(app)
    assert all(app.bvh_export.saved(take) for take in app.editor.session.takes)


@pytest.mark.parametrize("size", [(1280, 720), (800, 500)])
def test_what_became_of_an_export_is_in_view(start: Start, tmp_path: Path, size: tuple[int, int]) -> None:
    app = start(width=size[0], height=size[1])
    app.settings.export_folder = str(tmp_path)
    do(app, "record 40; key ctrl+e; click ##export now; run 5")
    exports = app.exporting
    assert exports.report_good, exports.report
    window, size_y = imgui.internal.find_window_by_name("Export##overlay"), imgui.get_io().display_size.y
    assert window.pos.y + window.size.y <= size_y - STATUS_HEIGHT_PX, "the status line can be read"
    assert window.scroll.y == pytest.approx(window.scroll_max.y)


def test_the_export_window_writes_what_the_command_writes(app: App, tmp_path: Path) -> None:
    app.settings.export_folder = str(tmp_path)
    do(app, "record 40; click ##more formats")
    exports = app.exporting
    app.exporting.choose_format(".bvh")
    exports.choose(fps=30.0, rest_frame=True, ground=".obj")
    do(app, "run 3; click ##export now")
    assert len(load_clip_bvh(tmp_path / "take-1.bvh")) == 21  # 40 frames at half the rate, and the rest pose
    assert (tmp_path / "take-1-ground.obj").is_file()
    assert "21 frames at 30 fps" in app.exporting.report
    (take,) = app.editor.session.takes
    assert app.bvh_export.exported(take) == tmp_path / "take-1.bvh"
    assert app.bvh_export.saved(take) is None  # half the frames
    exports.choose(in_place=True)
    click_on(app, "##export now")
    assert "In place with a ground next to it" in app.exporting.report
    press(app, "escape")
    assert "##export now" not in labels(app)


def test_settings_are_chosen_in_a_window(app: App, tmp_path: Path) -> None:
    click_on(app, "##settings")
    settings = app.settings
    click_on(app, "Invert look")
    assert settings.invert_look
    do(app, "click ##ui scale; click 150 %")
    assert settings.ui_scale == app.window.ui_scale == 1.5
    do(app, "click ##text size; click Large")
    assert imgui.get_style().font_scale_main == pytest.approx(1.15)
    click_on(app, "Back to the defaults")
    assert (settings.ui_scale, settings.text_size, settings.invert_look) == (0.0, 1.0, False)
    press(app, "escape")
    assert not app.settings_window.shown


def test_another_model_is_loaded_by_a_dialog_and_remembered(app: App, tmp_path: Path) -> None:
    before = app.scene.controller
    app.settings_window.choose_model(tmp_path)
    run(app, 2)
    assert app.settings.model_folder == str(tmp_path)
    assert app.scene.controller is not before
    for gone in (str(tmp_path / "gone"), "shipped-no-more", str(tmp_path / ("x" * 300))):
        app.settings.model_folder = gone
        assert app.settings_window.chosen_model() is None
        assert f"The model {gone} is missing" in said(app)


def test_the_first_minute_ticks_itself_off_and_does_not_come_back(app: App, tmp_path: Path) -> None:
    app.settings.export_folder = str(tmp_path)
    run(app, 3)
    guide = app.guide
    guide.begin()
    hold(app, "w", 70)
    assert guide.is_done(0)
    do(app, "prompt a proud king; run 2")
    app.prompting.parts["left_arm"] = "the left arm hangs"
    app.prompting.submit_part("left_arm")
    do(app, "run 2; record")
    assert [guide.is_done(step) for step in range(len(STEPS))] == [True, True, True, True, False]
    export_bvh(app)
    assert guide.is_done(4)
    guide._left_s = 0.05
    run(app, 5)
    assert not guide.shown
    assert app.settings.first_minute_seen
    guide.begin()
    do(app, "run 2; click ##guide")
    assert not guide.shown


def test_a_message_leaves_when_it_holds_no_longer() -> None:
    now = [0.0]
    messages = Messages(clock=lambda: now[0])
    messages.error("no such\nground", "terrain")
    now[0] = 1000.0
    assert messages.current.text == "no such ground"  # an error stays
    messages.note("fine")
    assert messages.current.text == "fine"
    now[0] = 2000.0  # it has faded
    messages.settle("model")
    assert messages.current is not None
    messages.settle("terrain")
    assert messages.current is None
    messages.error("no such ground", "terrain")
    messages.settle("terrain")
    assert messages.current is not None  # there to be read
    now[0] += SETTLED_S + 0.1
    assert messages.current is None
    messages.warn("something")
    now[0] += WARNING_S + 0.1
    assert messages.current is None


# what is said at which second, and what the line shows at which: n, w and e begin notes, warnings and errors
@pytest.mark.parametrize(
    ("said", "shown"),
    [
        ({0: "w at start", 1: "n slow"}, {0: "w at start", 3: "w at start", 4.5: "n slow", 13: ""}),
        ({0: "n one", 1: "n two"}, {0: "n one", 1: "n two", 10: ""}),
        ({0: "n one", 1: "e bad"}, {1: "e bad", 20: "e bad"}),
        ({0: "e bad", 10: "n done"}, {10: "n done", 19: ""}),
        ({0: "h disk", 10: "n done"}, {10: "n done", 19: "h disk", 1000: "h disk"}),
        ({0: "h disk", 10: "n done", 20: "over"}, {10: "n done", 21: ""}),
        ({0: "w at start", 1: "n slow", 2: "n third"}, {3: "w at start", 5: "n third", 20: ""}),
    ],
)
def test_the_line_shows_what_weighs_more_first_and_again_what_holds(
    said: dict[float, str], shown: dict[float, str]
) -> None:
    now = [0.0]
    messages = Messages(clock=lambda: now[0])
    say = {"n": messages.note, "w": messages.warn, "e": messages.error}
    for second in sorted({*said, *shown}):
        now[0], text = second, said.get(second, "")
        if text == "over":
            messages.settle("disk")
        elif text.startswith("h"):
            messages.error(text, "disk")
        elif text:
            say[text[0]](text)
        if second in shown:
            current = messages.current
            assert (current.text if current else "") == shown[second], second
    assert [m.text for m in messages.recent] == [text for text in said.values() if text != "over"]


def test_behind_the_line_is_a_list_with_what_can_be_done(app: App) -> None:
    app.messages.error(FileError("dunes.png: damaged.", "Save it again as PNG."), "ground")
    app.messages.note("Saved walk.bvh", Path("walk.bvh"))
    run(app, 2)
    click(app, 100.0, app.window.size[1] - 15.0)
    said = texts(app)
    assert "Save it again as PNG." in said
    assert "dunes.png: damaged." in said
    assert said.index("Saved walk.bvh") < said.index("dunes.png: damaged.")
    assert any(re.fullmatch(r"\d\d:\d\d:\d\d", text) for text in said)
    app.messages.settle("ground")
    assert "dunes.png: damaged. It is over." in texts(app)
    assert "Save it again as PNG." not in texts(app)
    press(app, "escape")
    assert "dunes.png: damaged. It is over." not in texts(app)
    assert app.messages.recent[0].level is Level.ERROR


def test_takes_are_rated_noted_searched_sorted_and_exported_as_found(start: Start, tmp_path: Path) -> None:
    app = start(width=1280, height=720)
    app.settings.export_folder = str(tmp_path)
    for number in range(7):
        record(app, 4 + number)
    assert "##search takes" not in dict(drawn(app))
    do(app, "record 4; run 3; click Files, body, links")
    window = next(w for w in imgui.get_current_context().windows if "take list" in w.name)
    rows = [box for label, box in drawn(app) if label == "row"]
    whole = [b for b in rows if b[1] >= window.pos.y and b[3] <= window.pos.y + window.size.y + 1]
    assert len(whole) >= 4
    do(app, "click ##take menu @6; click Rating")
    click_on(app, ICON.star * 4)
    assert app.editor.session.takes[6].rating == 4
    assert app.editor.undo_label == "rating of a take"
    do(app, "click ##take menu @5; click Note; type for the queen; key enter")
    assert app.editor.session.takes[5].note == "for the queen"
    do(app, "click ##order of takes; click By rating")
    assert app.takes.found[0].title == "Take 7"
    for text, found in (("***", ["Take 7"]), ("*****", []), ("QUEEN", ["Take 6"])):
        do(app, "click ##search takes; key ctrl+a")
        type_in(app, text)
        assert [take.title for take in app.takes.found] == found
        assert len([label for label, _ in drawn(app) if label == "row"]) == len(found)
    do(app, "key enter; click ##export all")
    assert [path.name for path in tmp_path.glob("*.bvh")] == ["take-6.bvh"]


def test_recordings_are_numbered_by_themselves_and_the_folder_stays_under_home(
    start: Start, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HOME", str(tmp_path))
    app = start()
    do(app, "record; mirror 1")
    export_bvh(app)
    record(app)
    assert titles(app)[-1] == "Take 2"
    do(app, "undo; record")
    assert titles(app)[-1] == "Take 2"
    app.takes.remove(app.editor.session.takes[-1].number)
    record(app)
    assert titles(app)[-1] == "Take 3"  # an undo may bring the other one back
    assert app.settings.export_folder == "~/sport-clips"
    app.exporting.open()
    app.exporting.choose_format(".bvh")
    app.exporting.export()
    run(app, 2)
    assert app.settings.export_folder == "~/sport-clips"
    assert app.exporting.path.startswith("~/sport-clips/")
