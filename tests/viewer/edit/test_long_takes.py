"""The real application without a display: the timeline of a take of a minute, zoomed, scrolled and fitted."""

from dataclasses import replace

import numpy as np
import pytest

from runtime.controls import Gait
from runtime.session import edits
from runtime.session.motion import Motion
from runtime.session.session import Take
from runtime.takes.pins import Pinned
from tests.helpers.app_driver import (
    Start,
    click,
    click_on,
    do,
    frame,
    place,
    point,
    press,
    seek,
    wheel,
)
from viewer.app import App
from viewer.edit.timeline_look import Range

SIZES = ((1920, 1080), (800, 500))
FRAMES = 3661
JUMP = 1800


def play_a_minute(app: App) -> None:
    """A take of 61 s that walks and jumps once plays, paused at its start."""
    do(app, "run 2; stand 61")
    clip = app.editor.session.takes[0].clip
    at = np.resize(np.arange(len(clip)), FRAMES)
    gaits = np.full(FRAMES, Gait.WALK, np.int8)
    gaits[JUMP : JUMP + 8] = Gait.JUMP
    long = replace(
        clip, name="A minute", hips_positions=clip.hips_positions[at], contacts=clip.contacts[at],
        local_rotations=clip.local_rotations[at], gaits=gaits,
    )  # fmt: skip
    app.editor.do("a minute", lambda session: edits.with_new_take(session, Take(motion=Motion.of(long))))
    do(app, "play 2; seek 0")


def shown(app: App) -> Range:
    return app.transport.timeline.shown


def wheel_over(app: App, steps: float, label: str = "##timeline", share: float = 0.5) -> None:
    point(app, *place(app, label, share=share))
    wheel(app, steps)


@pytest.mark.parametrize("size", SIZES)
def test_a_minute_is_zoomed_and_scrolled_by_the_mouse(start: Start, size: tuple[int, int]) -> None:
    app = start(width=size[0], height=size[1])
    play_a_minute(app)
    assert (shown(app).first, shown(app).last) == (0, FRAMES - 1)
    history = app.editor.history.at
    wheel_over(app, 8.0, share=0.5)
    first, last = shown(app).first, shown(app).last
    assert last - first < 0.2 * FRAMES
    # the frame under the pointer stays
    assert first + (last - first) / 2 == pytest.approx(FRAMES / 2, abs=60)
    x, y = place(app, "##timeline", share=0.25)
    click(app, x, y - 8.0)
    assert frame(app) == pytest.approx(first + 0.25 * (last - first), abs=3 + (last - first) / 200)
    app.window.inject_key("shift", True)
    wheel_over(app, -2.0)
    app.window.inject_key("shift", False)
    assert shown(app).first == pytest.approx(first + 0.2 * (last - first), abs=2.0)
    point(app, x, y, 2, True)
    point(app, x + 60, y)
    point(app, x + 60, y, 2, False)
    assert shown(app).first < first + 0.2 * (last - first)  # the ruler went along to the right
    assert app.editor.history.at == history  # what is shown is no edit
    press(app, "end")
    assert frame(app) == FRAMES - 1
    assert shown(app).last == FRAMES - 1
    press(app, "home")
    assert shown(app).first == 0


def test_what_is_shown_fits_the_take_the_trim_and_a_pin(app: App) -> None:
    play_a_minute(app)
    wheel_over(app, 5.0)
    click_on(app, "Fit")
    assert app.transport.timeline.whole
    do(app, "seek 600; click [ In; seek 1200; click Out ]; click Sel")
    assert (shown(app).first, shown(app).last) == pytest.approx((570, 1230))
    press(app, "z")
    assert app.transport.timeline.whole
    seek(app, 700)
    app.pins.add(Pinned.LEFT_HAND)
    pin = app.pins.pins[0]
    press(app, "z")
    assert shown(app).first < pin.start * 60 < pin.end * 60 < shown(app).last < 1300


@pytest.mark.parametrize("size", SIZES)
def test_a_jump_of_a_long_take_can_be_hit(start: Start, size: tuple[int, int]) -> None:
    app = start(width=size[0], height=size[1])
    play_a_minute(app)
    _, y = place(app, "##gaits", share=0.5)
    row = app.transport.timeline
    left = place(app, "##timeline", share=0.0)[0] + 4.0
    right = place(app, "##timeline", share=1.0)[0] - 4.0
    at = left + (JUMP + 4) / (FRAMES - 1) * (right - left)
    for aside in (-3.0, 0.0, 3.0):
        point(app, at + aside, y)
        point(app, at + aside, y, 0, True)
        assert row.held.mark.text == "Jump"
        point(app, at + aside, y, 0, False)


def test_the_frame_shown_stays_in_view_while_it_plays(app: App) -> None:
    play_a_minute(app)
    app.transport.timeline.fit((0, 60))
    do(app, "seek 60; key space; run 30")
    assert shown(app).first > 10
    assert shown(app).first <= frame(app) <= shown(app).last
