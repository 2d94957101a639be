"""A defect costs an action, not the program: faults in every panel, tool and step."""

import itertools
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import pytest

from runtime.takes.pins import Pinned
from tests.helpers.app_driver import Start, click_on, do, drawn, message, record, run, texts, titles
from viewer.app import App
from viewer.gl_bindings import imgui
from viewer.gui import defects as defects_module
from viewer.gui.panels import Panel


class DefectError(Exception):
    """Nothing foresees it."""


def broken(*_: Any, **__: Any) -> Any:
    raise DefectError("put there by the test")


@pytest.fixture
def desk(start: Start) -> App:
    """A viewer that catches defects, with two takes."""
    app = start()
    app.defects.active = True
    do(app, "record; record; run 2")
    return app


def forget(app: App) -> None:
    app.defects.dismiss()
    app.defects._times_s.clear()  # one second later


def opened(app: App, what: str) -> None:
    """Bring the application into a state that shows some of its panels."""
    if what in ("a take", "a pin", "a pose", "a reference"):
        app.takes.play(1)
    run(app, 2)
    if what == "a pin":
        app.pins.add(Pinned.RIGHT_HAND)
    if what == "a pose":
        app.posing.toggle()
    if what == "a reference":
        app.references.show(2)
    windows: dict[str, Callable[[], Any]] = {
        "variants": app.compare.toggle,
        "settings": app.settings_window.toggle,
        "export": app.exporting.open,
        "the first minute": app.guide.begin,
        "help": lambda: app.shell._toggle("help_open"),
        "recording": app.takes.toggle_recording,
    }
    windows.get(what, lambda: None)()
    run(app, 2)


STATES = (
    "", "a take", "a pin", "a pose", "a reference", "variants", "settings", "export", "the first minute", "help",
    "recording",
)  # fmt: skip


def fault_after(calls: int, monkeypatch: pytest.MonkeyPatch, inside: list[bool]) -> None:
    """The so-many-th call of ImGui within a panel raises, once."""
    counter = itertools.count(1)

    def failing(draw: Callable[..., Any]) -> Callable[..., Any]:
        def draw_or_fail(*given: Any, **named: Any) -> Any:
            result = draw(*given, **named)
            if inside and next(counter) == calls:
                raise DefectError(f"after {draw.__name__}")
            return result

        return draw_or_fail

    for name in (
        "button", "begin", "begin_child", "begin_tab_item", "begin_disabled", "push_style_var", "push_style_color",
        "push_id", "push_font", "begin_group", "begin_combo", "same_line", "text_unformatted", "begin_table",
        "invisible_button", "slider_float", "indent", "table_next_row",
    ):  # fmt: skip
        monkeypatch.setattr(imgui, name, failing(getattr(imgui, name)))


@pytest.mark.parametrize("state", STATES)
def test_a_fault_in_any_panel_closes_that_panel(
    state: str, desk: App, monkeypatch: pytest.MonkeyPatch
) -> None:
    opened(desk, state)
    work, before = titles(desk), len(drawn(desk))
    panels = list(desk.shell.panels)
    met: set[str] = set()
    for number, panel in enumerate(panels):
        for calls in (1, 9):
            if not panel.shown():
                continue
            inside: list[bool] = []

            def draw(rect: Any, panel: Panel = panel, inside: list[bool] = inside) -> None:
                inside.append(True)
                panel.draw(rect)
                inside.clear()

            with monkeypatch.context() as patch:
                watched = [replace(panel, draw=draw) if n == number else p for n, p in enumerate(panels)]
                patch.setattr(desk.shell, "panels", watched)
                fault_after(calls, patch, inside)
                run(desk)
            if desk.defects.shown is not None:
                met.add(panel.name)
                assert panel.name in desk.defects.shown.doing
            forget(desk)
            run(desk)
            assert titles(desk)[: len(work)] == work
            if not panel.shown():
                opened(desk, state)
            while "An internal error closed this panel." in texts(desk):
                click_on(desk, "Open it again")
    assert met >= {"Scene", "Takes"}
    assert len(met) >= 4
    assert len(drawn(desk)) >= before / 2, "what is no window is drawn as before"
    assert imgui.get_style().alpha == 1.0


def test_the_report_says_what_happened_and_the_panel_opens_again(
    desk: App, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as patch:
        patch.setattr("viewer.panels.scene_panel._views", broken)
        run(desk, 3)
        said = " ".join(texts(desk))
        assert "drawing the panel Scene" in said
        assert "Your work is safe" in said
        report = desk.defects.shown.report
        assert "put there by the test" in report
        assert "Python 3." in report
        assert "moderngl" in report
        assert desk.defects.shown.path.read_text(encoding="utf-8") == report
        assert "An internal error closed this panel." in said
        assert desk.frames_shown > 3
    click_on(desk, "Continue")
    assert desk.defects.shown is None
    click_on(desk, "Open it again")
    assert "An internal error closed this panel." not in texts(desk)


TOOLS = (
    ("posing", "use_mouse"), ("pins", "use_mouse"), ("path", "use_mouse"), ("camera_keys", "look"),
    ("compare", "frame_all"), ("path", "overlay"), ("pins", "overlay"), ("references", "pose"), ("pins", "poll"),
    ("path", "poll"), ("sessions", "poll"), ("prompting", "poll"), ("jobs", "deliver"), ("path", "controls"),
    ("compare", "advance"), ("scene", "advance"), ("takes", "add_poses"), ("takes", "before_steps"),
    ("scene", "frame_character"), ("guide", "watch"),
)  # fmt: skip


@pytest.fixture(params=TOOLS, ids=lambda tool: ".".join(tool))
def faulty(request: Any, desk: App, monkeypatch: pytest.MonkeyPatch) -> Iterator[App]:
    """One method of a tool raises the next time."""
    room, name = request.param
    owner = getattr(desk, room)
    if room == "references":
        opened(desk, "a reference")
    with monkeypatch.context() as patch:
        left = [1]

        def once(*given: Any, **named: Any) -> Any:
            if left and left.pop():
                raise DefectError(name)
            return getattr(type(owner), name)(owner, *given, **named)

        patch.setattr(owner, name, once)
        yield desk


def test_a_fault_in_any_tool_and_step_costs_no_work(faulty: App) -> None:
    before = faulty.frames_shown
    faulty.window.inject_key("kp_decimal", True)  # frames the character
    faulty.window.inject_key("0", True)
    run(faulty, 4)
    assert faulty.defects.shown is not None or "0" in message(faulty)
    assert faulty.frames_shown >= before + 3
    assert titles(faulty) == ["Take 1", "Take 2"]


def test_a_fault_while_recording_keeps_what_was_recorded(desk: App, monkeypatch: pytest.MonkeyPatch) -> None:
    record(desk, 30, stop=False)
    with monkeypatch.context() as patch:
        patch.setattr(desk.scene.renderer, "render", broken)
        run(desk)
    run(desk, 3)
    desk.takes.toggle_recording()
    run(desk)
    assert titles(desk) == ["Take 1", "Take 2", "Take 3"]
    assert desk.editor.session.takes[2].frames >= 30


def test_three_faults_within_a_second_end_the_program(desk: App, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(desk.scene.renderer, "render", broken)
    monkeypatch.setattr(defects_module.time, "monotonic", lambda: 100.0)
    run(desk, 2)
    with pytest.raises(DefectError):
        run(desk)


def test_faults_that_are_far_apart_do_not(desk: App, monkeypatch: pytest.MonkeyPatch) -> None:
    clock = itertools.count(0.0, 0.6)
    monkeypatch.setattr(desk.scene.renderer, "render", broken)
    monkeypatch.setattr(defects_module.time, "monotonic", lambda: next(clock))
    run(desk, 8)
    assert desk.defects.shown is not None
