"""The real application without a display: open lists and Escape, typing on a slow machine, tooltips that stay out of the way."""

import pytest

from runtime.session.prompt_blend import Side
from tests.helpers import hand
from tests.helpers.app_driver import (
    Start,
    click,
    click_on,
    do,
    drawn,
    place,
    point,
    press,
    run,
    texts,
    type_key,
)
from viewer.app import App
from viewer.gl_bindings import imgui


def open_lists() -> int:
    return len(imgui.get_current_context().open_popup_stack)


def test_escape_closes_a_list_and_the_next_click_takes_nothing_of_it(app: App) -> None:
    click_on(app, "##terrain")
    assert open_lists() == 1
    x, y = place(app, "Wall")
    press(app, "escape")
    assert open_lists() == 0
    assert not [label for label, _ in drawn(app) if label == "Wall"]
    click(app, x, y)
    assert app.scene.terrain_spec == "flat"


def test_every_key_of_a_slow_frame_is_taken_in_it(app: App) -> None:
    app.shell.focus_prompt()
    run(app, 4)
    for letter in "anoldman":
        type_key(app, letter)
    for _ in range(3):
        app.window.inject_key("backspace", True)
        app.window.inject_key("backspace", False)
    type_key(app, "x")
    run(app)  # one frame
    assert app.prompting.boxes[Side.A].text == "anoldx"
    assert not app.window.input_waits


def tooltip_rect() -> tuple[float, float, float, float] | None:
    for window in imgui.get_current_context().windows:
        if window.name.startswith("##Tooltip") and window.active:
            return window.pos.x, window.pos.y, window.pos.x + window.size.x, window.pos.y + window.size.y
    return None


@pytest.mark.parametrize("size", [(1280, 720), (800, 500)])
def test_tooltips_lie_beside_the_panel_and_say_what_cannot_be_read(
    start: Start, size: tuple[int, int]
) -> None:
    app = start(prompt="a proud king", width=size[0], height=size[1])
    run(app, 2)
    x, y = place(app, "##words", 0)
    hand.mouse(app.window, x, y)
    run(app, 90)
    assert tooltip_rect() is None  # these few words can be read in the field
    app.prompting.parts["left_arm"] = "swings wide and slow " * 20
    app.prompting.submit_part("left_arm")
    run(app, 90)
    found = tooltip_rect()
    columns = [rect[2] for label, rect in drawn(app) if label == "##words"]
    assert found[0] >= max(columns)
    assert (found[2] <= size[0]) & (found[3] <= size[1]) & (found[1] >= 0)


def test_tooltips_of_the_timeline_lie_over_it(app: App) -> None:
    do(app, "stand 30; play 1")
    app.takes.playback.playing = False
    run(app, 3)
    hand.mouse(app.window, *place(app, "##prompts"))
    run(app, 60)
    found = tooltip_rect()
    assert found[3] <= min(top for label, (_, top, _, _) in drawn(app) if label == "##timeline")


def test_a_message_pushes_the_facts_away_where_both_have_no_room(start: Start) -> None:
    app = start(width=800, height=500)
    app.state.clocked = True
    app.messages.note("Take 1: 6.7 s in the clip list. Export writes it as BVH.")
    assert "Take 1: 6.7 s in the clip list. Export writes it as BVH." in texts(app)


def test_six_fields_fit_into_a_window_of_the_first_start(app: App) -> None:
    fields = [box for label, box in drawn(app) if label == "##words"]
    assert len(fields) == 6
    assert max(bottom for _, _, _, bottom in fields) <= 680 - 10


def test_a_click_on_a_tab_counts_where_move_and_click_fall_into_one_frame(start: Start) -> None:
    """At twenty frames a second they do; ImGui alone takes it for a click on what was under the mouse before."""
    app = start(width=800, height=500)
    run(app, 3)
    takes, prompts = place(app, "Takes"), place(app, "Prompt")
    for tab, label in ((takes, "Takes"), (prompts, "Prompt")):
        point(app, *tab, 0, True)
        point(app, *tab, 0, False)
        assert ("##prompt A" in {full for full, _ in drawn(app)}) == (label == "Prompt")
