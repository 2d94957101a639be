"""The real application without a display: two prompts blended by body part."""

import numpy as np

from runtime.prompts.blend import read_words, write_words
from runtime.session.prompt_blend import Side
from tests.helpers.app_driver import (
    Start,
    click_on,
    controller,
    do,
    drawn,
    place,
    point,
    press,
    run,
    style,
    texts,
    words,
)
from tests.helpers.viewer_fakes import FakeEncoder, FakeLibrary


def test_a_blend_moves_each_part_by_its_share(start: Start) -> None:
    app = start(prompt="a proud king")
    run(app)
    king, duck = style(app), FakeEncoder().encode(FakeLibrary().expand("a duck").descriptions)
    app.prompting.submit_prompt("a duck", Side.B)
    assert np.allclose(style(app), (king + duck) / 2)  # half at first, so that it shows
    app.prompting.set_all_weights(0.0)
    app.prompting.set_weight("torso", 1.0)
    app.prompting.set_weight("head", 0.25)
    styles = len(controller(app).styles)
    run(app)
    assert len(controller(app).styles) == styles + 1  # three changes, one fold
    assert np.array_equal(style(app)[:4], king[:4])
    assert np.array_equal(style(app)[4], duck[4])
    assert np.allclose(style(app)[5], 0.75 * king[5] + 0.25 * duck[5])
    run(app, 3)
    assert len(controller(app).styles) == styles + 1  # and none without a change


def test_a_blend_is_undone_swapped_dropped_and_kept_in_takes(start: Start) -> None:
    app = start(prompt="a proud king")
    run(app, 2)
    marks: list[str] = []
    app.prompting.mark = lambda edit, _: marks.append(write_words(edit.replayable()))
    app.prompting.submit_prompt("a duck", Side.B)
    for weight in (0.1, 0.2, 0.3):  # one drag
        app.prompting.set_weight("torso", weight)
        app.prompting.poll()
    run(app)
    assert app.editor.undo_label == "blend of the torso"
    blended = style(app)
    kept = read_words(marks[-1])
    assert (kept.a, kept.b, kept.weights) == ("a proud king", "a duck", (0.5, 0.5, 0.5, 0.5, 0.3, 0.5))
    app.prompting.swap()
    run(app)
    assert np.allclose(style(app), blended, atol=1e-4)
    assert (app.prompting.boxes[Side.A].text, app.prompting.boxes[Side.B].text) == ("a duck", "a proud king")
    assert words(app)["torso"] == app.prompting.parts["torso"] == "torso of a duck"
    do(app, "key ctrl+z; key ctrl+z")
    assert app.editor.session.live.prompt.weights == (0.5,) * 6
    press(app, "ctrl", "z")
    assert (app.editor.session.live.prompt.b, app.prompting.boxes[Side.B].text) == (None, "")
    press(app, "ctrl", "y")
    assert app.prompting.boxes[Side.B].text == "a duck"
    app.prompting.drop_blend()
    run(app)
    assert marks[-1] == "a proud king"
    assert not app.editor.session.live.prompt.blended


def test_the_blend_panel_is_used_by_mouse_and_keys(start: Start) -> None:
    app = start(prompt="a proud king")
    do(app, "run 3; click Blend; click ##prompt B; type a duck; key enter")
    assert app.editor.session.live.prompt.b.prompt == "a duck"
    assert app.editor.undo_label == "prompt B “a duck”"
    left, y = place(app, "##all")
    point(app, left, y, 0, True)
    for share in (0.6, 0.7, 0.9):
        right = place(app, "##all", share=share)[0]
        point(app, right, y)
    point(app, right, y, 0, False)
    assert app.editor.session.live.prompt.master_weight > 0.8
    assert app.editor.undo_label == "blend of all parts"
    press(app, "ctrl", "z")  # the drag is one step
    assert app.editor.session.live.prompt.weights == (0.5,) * 6
    click_on(app, "Body parts")
    assert "B 50 %: a duck" in texts(app)
    click_on(app, "No blend")  # in reach under every tab
    assert app.editor.session.live.prompt.b is None
    assert app.editor.undo_label == "end of the blend"
    assert "No blend" not in [label.split(" ", 1)[-1] for label, _ in drawn(app)]


def test_an_emptied_prompt_b_ends_the_blend(start: Start) -> None:
    app = start(prompt="a proud king")
    run(app, 3)
    king = style(app)
    click_on(app, "Blend")
    for leave in (lambda: press(app, "enter"), lambda: click_on(app, "##prompt A")):
        app.prompting.submit_prompt("a duck", Side.B)
        run(app, 2)
        assert app.editor.session.live.prompt.blended
        do(app, "click ##prompt B; key ctrl+a; key backspace")
        assert app.editor.session.live.prompt.blended  # while it is typed into
        leave()
        run(app, 2)
        assert app.editor.session.live.prompt.b is None
        assert app.editor.undo_label == "end of the blend"
        assert np.array_equal(style(app), king)
        do(app, "key escape; key escape")
    press(app, "ctrl", "z")
    assert app.prompting.boxes[Side.B].text == "a duck"
    assert app.editor.session.live.prompt.weights == (0.5,) * 6
