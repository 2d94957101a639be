"""The real application by mouse and keys: what lies on a track or in the list is selected and edited, each kind the same way."""

from dataclasses import replace

import pytest

from runtime.controls import Gait
from runtime.session.session import Session
from runtime.takes.pins import Pin, Pinned
from tests.helpers.app_driver import (
    click,
    click_on,
    drag,
    place,
    point,
    press,
    record,
    right_click,
    run,
    seek,
    titles,
)
from tests.helpers.full_session import text_of
from viewer.app import App
from viewer.edit.selection import Selection
from viewer.edit.tracks import Item

FRAMES = 120
TRACKS = {
    "prompts": "##prompts", "gaits": "##gaits", "pins": "##pins 0", "footplants": "##foot 0",
    "camera keys": "##camera keys", "pose keys": "##pose keys",
}  # fmt: skip
CHORDS = {"copy": "c", "cut": "x", "paste": "v", "duplicate": "d"}


@pytest.fixture(scope="module")
def made(desk: App) -> Session:
    """A take with three prompts and gaits, two pins, keys of camera and poses, and footplants."""
    app = desk
    app.prompting.submit_prompt("a proud king")
    run(app, 2)
    record(app, FRAMES)
    app.takes.play(1)
    for frame, text in ((40, "a zombie"), (80, "an old king")):
        seek(app, frame)
        app.editing.insert_prompt(text)
        run(app, 2)
    for frame, gait in ((40, Gait.JOG), (80, Gait.CROUCH)):
        seek(app, frame)
        app.editing.insert_gait(gait)
        run(app, 2)
    for frame in (20, 70):
        seek(app, frame)
        app.camera_keys.add()
        app.posing.joint = 16
        app.posing.set_key()
        run(app, 2)
    app.posing.close()
    at = (0.3, 1.2, 0.3)
    pins = tuple(Pin(Pinned.LEFT_HAND, at, start / 60.0, end / 60.0) for start, end in ((10, 30), (60, 80)))
    poses = replace(app.editor.session.takes[0].poses, pins=pins)
    app.editor.do("pins", lambda session: session.with_take(1, poses=poses))
    run(app, 3)
    contacts(app)
    return app.editor.session


@pytest.fixture
def app(desk: App, made: Session) -> App:
    """The window with that take, which stands at its start."""
    desk.editor.do("as it was made", lambda _: made)
    desk.takes.play(1)
    seek(desk, 0)
    chosen(desk).let_go()
    chosen(desk).copied = ()
    desk.scene.camera.keyed = False
    run(desk, 3)
    return desk


def contacts(app: App) -> None:
    """The left foot bears in frames 0 to 20 and 50 to 70 only."""
    for new in ((0, 20), (50, 70)):
        known = [i for i in chosen(app).all(["footplants"]) if i.lane == 0]
        whole = next((i for i in known if i.start == 0 and i.end == FRAMES), None)
        gone = [] if whole is None else [whole]
        chosen(app).replace("change", gone, [Item(*new, "footplants", None, 0)])
        run(app, 3)


def chosen(app: App) -> Selection:
    return app.transport.selection


def items(app: App, kind: str) -> list[Item]:
    return [item for item in chosen(app).all([kind]) if kind != "footplants" or item.lane == 0]


def spans(app: App, kind: str) -> list[tuple[int, int]]:
    return [(item.start, item.end) for item in items(app, kind)]


def at(app: App, kind: str, frame: float) -> tuple[float, float]:
    """Where a frame lies on the track of a kind."""
    edge = 4.0
    (left, y), (right, _) = (place(app, TRACKS[kind], share=share) for share in (0.0, 1.0))
    return left + edge + (right - left - 2 * edge) * frame / (FRAMES - 1), y


def middle(item: Item) -> float:
    return (item.start + item.end - 1 * (item.end > item.start)) / 2


def pick(app: App, kind: str, *places: int) -> list[Item]:
    """Click on items, with Shift from the second one on."""
    found = [items(app, kind)[i] for i in places]
    for number, item in enumerate(found):
        if number:
            app.window.inject_key("shift", True)
        click(app, *at(app, kind, middle(item)))
        app.window.inject_key("shift", False)
        run(app, 2)
    return found


def session(app: App) -> str:
    return text_of(replace(app.editor.session, selected=0))


def do(app: App, by: str, act: str) -> None:
    """An action by its key, or by the menu of a right click on what is selected."""
    if by == "keys":
        press(app, *(("delete",) if act == "delete" else ("ctrl", CHORDS[act])))
    else:
        item = chosen(app).items[0]
        x, y = at(app, item.kind, middle(item))
        right_click(app, x, y)
        click_on(app, act.capitalize(), index=-1)
    run(app, 3)


def undone(app: App, before: str, steps: int = 1) -> None:
    """Ctrl+Z takes back what was done, as one step."""
    assert session(app) != before
    for _ in range(steps):
        press(app, "ctrl", "z")
    assert session(app) == before


@pytest.mark.parametrize("by", ["keys", "menu"])
@pytest.mark.parametrize("kind", TRACKS)
@pytest.mark.parametrize("act", ["select", "several", "delete", "copy", "cut", "paste", "duplicate", "move"])
def test_what_lies_on_a_track_is_edited(app: App, kind: str, act: str, by: str) -> None:
    before, known, count = session(app), spans(app, kind), len(items(app, kind))
    assert count >= 2
    (item,) = pick(app, kind, 1)
    assert [i.key for i in chosen(app).items] == [item.key]
    if act == "select":
        press(app, "escape")
        assert not chosen(app).keys
        assert app.takes.playback is not None, "Esc lets go before it leaves the take"
        assert session(app) == before
    elif act == "several":
        pick(app, kind, 0, 1)
        assert len(chosen(app).items) == 2
        press(app, "ctrl", "a")
        assert len(chosen(app).items) >= count
        assert session(app) == before
    elif act in ("delete", "cut"):
        do(app, by, act)
        assert len(items(app, kind)) == count - 1
        assert len(chosen(app).copied) == 1 or act == "delete"
        undone(app, before)
    elif act == "copy":
        do(app, by, act)
        assert [i.key for i in chosen(app).copied] == [item.key]
        assert session(app) == before
    elif act == "paste":
        do(app, "keys", "copy")
        seek(app, 100 if kind != "footplants" else 90)
        do(app, by, act)
        pasted = chosen(app).items
        assert [i.start for i in pasted] == [pytest.approx(100 if kind != "footplants" else 90, abs=1)]
        assert pasted[0].end - pasted[0].start in (item.end - item.start, FRAMES - pasted[0].start)
        undone(app, before)
    elif act == "duplicate":
        do(app, by, act)
        made = [i.start for i in chosen(app).items]
        if kind == "gaits":  # it joins the one before
            assert spans(app, kind)[1] == (item.start, item.end + item.end - item.start)
        else:
            assert made != [item.start]
            assert len(made) == 1
            assert (item.start, item.end) in spans(app, kind)
        undone(app, before)
    elif by == "keys":
        press(app, "right")
        assert spans(app, kind)[1][0] == known[1][0] + 1
        undone(app, before)
    else:
        x, y = at(app, kind, middle(item))
        to, _ = at(app, kind, middle(item) + 5)
        app.window.inject_key("alt", True)
        drag(app, (x, y), (to, y))
        app.window.inject_key("alt", False)
        run(app, 3)
        assert spans(app, kind)[1][0] == pytest.approx(known[1][0] + 5, abs=1)
        undone(app, before)


def test_several_kinds_are_boxed_moved_and_pasted_in_one_step_each(app: App) -> None:
    before = session(app)
    x, y = at(app, "camera keys", 10)
    to, below = at(app, "pose keys", 75)
    drag(app, (x, y), (to, below))
    assert {i.kind for i in chosen(app).items} == {"camera keys", "pose keys"}
    assert len(chosen(app).items) == 4
    pick_also = items(app, "gaits")[1]
    app.window.inject_key("shift", True)
    click(app, *at(app, "gaits", middle(pick_also)))
    app.window.inject_key("shift", False)
    run(app, 2)
    press(app, "right")
    assert spans(app, "camera keys") == [(21, 21), (71, 71)]
    assert spans(app, "gaits")[1] == (41, 81)
    undone(app, before)


def test_a_drag_snaps_to_what_is_near_unless_alt_is_held(app: App) -> None:
    pick(app, "camera keys", 0)
    for alt, wanted in ((False, 40), (True, 41)):
        x, y = at(app, "camera keys", items(app, "camera keys")[0].start)
        to, _ = at(app, "camera keys", 41)
        if alt:
            app.window.inject_key("alt", True)
        point(app, x, y)
        point(app, x, y, 0, True)
        point(app, to, y)
        assert (app.transport.timeline.held.snapped is None) is alt
        point(app, to, y, 0, False)
        app.window.inject_key("alt", False)
        assert items(app, "camera keys")[0].start == wanted
        press(app, "ctrl", "z")


def test_takes_of_the_list_are_selected_deleted_copied_and_moved(app: App) -> None:
    record(app, 10)
    record(app, 10)
    before, names = session(app), titles(app)

    def row(index: int, *held: str) -> None:
        for key in held:
            app.window.inject_key(key, True)
        click(app, *place(app, "row", index, share=0.5))
        for key in held:
            app.window.inject_key(key, False)
        run(app, 2)

    row(0)
    row(2, "ctrl")
    assert [i.lane for i in chosen(app).items] == [1, 3]
    press(app, "delete")
    assert titles(app) == [names[1]]
    undone(app, before)
    row(0)
    row(2, "shift")
    assert [i.lane for i in chosen(app).items] == [1, 2, 3]
    row(1)
    press(app, "down")
    assert titles(app) == [names[0], names[2], names[1]]
    undone(app, before)
    row(1)
    press(app, "ctrl", "c")
    press(app, "ctrl", "v")
    assert titles(app) == [*names, f"{names[1]}, copy"]
    undone(app, before)
    row(1)
    press(app, "ctrl", "d")
    assert len(titles(app)) == 4
    undone(app, before)


def test_space_plays_the_take_that_was_clicked_until_one_walks(app: App) -> None:
    app.takes.close_playback()
    click(app, *place(app, "row", 0, share=0.5))
    press(app, "space")
    assert app.takes.played is app.editor.session.takes[0]
    app.window.inject_key("w", True)
    run(app, 2)
    assert app.takes.playback is None
    assert not chosen(app).keys
    press(app, "space")
    app.window.inject_key("w", False)
    assert app.takes.playback is None


def test_the_last_prompt_of_a_take_stays(app: App) -> None:
    pick(app, "prompts", 0, 1, 2)
    press(app, "delete")
    assert len(items(app, "prompts")) == 3
    assert "needs at least one prompt" in app.messages.recent[-1].text
