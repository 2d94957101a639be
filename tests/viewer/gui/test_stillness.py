"""What is under the mouse stays there when tracks, panels, formats and answers appear."""

from collections.abc import Callable

import pytest

from runtime.session.prompt_blend import Side
from runtime.takes.pins import Pinned
from tests.helpers.app_driver import Start, do, drawn, record, run
from viewer.app import App
from viewer.exports.exporting import ExportForm
from viewer.gl_bindings import imgui

SIZES = ((1280, 720), (800, 500), (1920, 1080))
Places = dict[str, list[tuple[float, float]]]


def places(app: App) -> Places:
    """The top left corner of every widget that is drawn, by its name without what changes of it."""
    run(app, 2)
    found: Places = {}
    for label, (left, top, _, _) in drawn(app):
        found.setdefault(label.rpartition("##")[2], []).append((round(left), round(top)))
    return found


def moved(before: Places, after: Places) -> dict[str, tuple[object, object]]:
    """Widgets that are in both, and lie elsewhere."""
    both = {name: ({*before[name]}, {*after[name]}) for name in before.keys() & after.keys()}
    moved = [name for name, (old, new) in both.items() if not old <= new and not new <= old]
    return {name: (before[name], after[name]) for name in moved}


def camera_keys(app: App) -> None:
    app.camera_keys.add()


CHANGES: dict[str, Callable[[App], object]] = {
    "a camera key": camera_keys,
    "a pin": lambda app: (app.pins.add(Pinned.LEFT_HAND), app.pins.close()),
    "three pins at once": lambda app: [(app.pins.add(what), app.pins.close()) for what in list(Pinned)[:3]],
    "a pose key": lambda app: (app.posing.toggle(), setattr(app.posing, "joint", 16), app.posing.set_key(), app.posing.toggle()),
    "another prompt": lambda app: app.editing.insert_prompt("an old king"),
    "a trim": lambda app: app.takes.trim(first=5),
    "an error": lambda app: app.messages.error("something is wrong"),
    "more takes": lambda app: [app.takes.mirror(1) or app.takes.play(1) for _ in range(4)],
    "a rating": lambda app: app.takes.rate(1, 5),
    "the path tool": lambda app: setattr(app.path, "active", True),
}  # fmt: skip


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("change", CHANGES)
def test_no_control_moves_when_a_take_gets_more(start: Start, size: tuple[int, int], change: str) -> None:
    app = start(width=size[0], height=size[1])
    do(app, "record 40; record 40; play 1")
    before = places(app)
    CHANGES[change](app)
    assert moved(before, places(app)) == {}


@pytest.mark.parametrize("size", SIZES)
def test_no_control_moves_when_another_format_is_chosen(start: Start, size: tuple[int, int]) -> None:
    app = start(width=size[0], height=size[1])
    record(app, 40)
    app.exporting.open()
    run(app, 3)

    def fixed() -> dict[str, list[tuple[float, float]]]:
        shown = places(app)
        names = ("export format", "export now", "close Export")
        return {name: shown[name] for name in names if name in shown}

    app.exporting.choose_format(".bvh")
    before = fixed()
    assert len(before) == 3
    formats = ExportForm.__dataclass_fields__["suffix"].metadata["spec"].choices
    for suffix in formats:
        app.exporting.choose_format(suffix)
        app.exporting.missing = ""
        app.exporting.choose(loop=True)
        after = fixed()
        assert moved(before, after) == {}, suffix
        assert len(after) == 3, suffix
    app.exporting.report = "Saved a file. " * 20
    assert moved(before, fixed()) == {}


@pytest.mark.parametrize("size", SIZES)
def test_no_control_moves_when_an_answer_comes(start: Start, size: tuple[int, int]) -> None:
    app = start(width=size[0], height=size[1])
    run(app, 3)
    before = places(app)
    do(app, "prompt an old king; run 3")
    assert moved(before, places(app)) == {}
    app.prompting.submit_prompt("a duck", Side.B)
    run(app, 3)
    assert moved(before, places(app)) == {}


@pytest.mark.parametrize("window", ["settings", "export", "joints"])
def test_a_window_stays_where_it_opened_and_on_the_screen(app: App, window: str) -> None:
    record(app)
    (app.exporting.open if window == "export" else app.settings_window.toggle)()
    run(app, 3)
    found = next(w for w in imgui.get_current_context().windows if w.name.endswith("##overlay"))
    at = found.pos.x, found.pos.y
    for scale in (1.0, 1.5, 2.0, 1.0):
        app.window.use_scale(scale)
        run(app, 4)
        assert found.pos.y >= 0.0
        assert found.pos.y + found.size.y <= 720.0
    assert found.pos.x == at[0] or found.pos.x + found.size.x <= 1280.0
