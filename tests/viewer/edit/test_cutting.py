"""The real application without a display: takes are split, cut, repeated and joined by the timeline's menu."""

import pytest

from tests.helpers.app_driver import Start, click_on, do, message, press, run, texts
from tests.viewer.edit.test_timeline import record, same, seek
from viewer.app import App

SIZES = ((1920, 1080), (800, 500))


def choose(app: App, *entries: str) -> None:
    click_on(app, "Cut…")
    for entry in entries:
        run(app, 2)
        click_on(app, entry)
    run(app, 3)


def takes(app: App) -> list[tuple[str, int, tuple[int, int]]]:
    return [(take.title, take.frames, take.range) for take in app.editor.session.takes]


@pytest.mark.parametrize("size", SIZES)
def test_a_take_is_split_and_joined_again(start: Start, size: tuple[int, int]) -> None:
    app = start(width=size[0], height=size[1])
    record(app)
    seek(app, 30)
    choose(app, "Split here")
    split = [("Take 1", 80, (0, 30)), ("Take 1, rest", 80, (30, 79))]
    assert takes(app) == split
    app.takes.play(2)
    seek(app, 30)
    assert any(text.startswith("0 / 49") for text in texts(app))  # each part counts its own frames
    app.takes.play(1)
    choose(app, "Join with", "Take 1, rest")
    assert takes(app) == [*split, ("Take 1 + Take 1, rest", 80, (0, 79))]
    assert app.takes.played == app.editor.session.takes[-1]
    first, made = app.editor.session.takes[0].clip, app.editor.session.takes[-1].clip
    assert same(first, made)
    do(app, "key ctrl+z; key ctrl+z")
    assert takes(app) == [("Take 1", 80, (0, 79))]
    press(app, "ctrl", "y")
    assert takes(app) == split


def test_what_the_trim_keeps_is_repeated_or_cut_out(app: App) -> None:
    record(app)
    choose(app, "Cut out the trimmed range")
    assert "trim handles" in message(app)
    seek(app, 20)
    click_on(app, "[ In")
    seek(app, 50)
    click_on(app, "Out ]")
    choose(app, "Repeat", "3 times")
    assert takes(app)[-1] == ("Take 1 x 3", 91, (0, 90))
    do(app, "play 1; run 2")
    choose(app, "Cut out the trimmed range")
    assert takes(app)[-1] == ("Take 1, cut", 50, (0, 49))
