"""The real application without a display: a motion without prompts is restyled, and lies beside what comes of it."""

from dataclasses import replace

from tests.helpers.app_driver import click_on, message, press, run, run_until
from tests.viewer.edit.test_timeline import record
from viewer.app import App


def without_prompts(app: App) -> int:
    """A take whose motion came from somewhere else; its number."""
    record(app, 60)
    (take,) = app.editor.session.takes
    motion = take.made
    from runtime.session.motion import Motion

    clip = replace(motion.clip, prompts=(), gaits=None)
    app.editor.do("import", lambda s: s.with_take(take.number, motion=Motion.of(clip, None), recorded=False))
    app.takes.play(take.number)
    run(app, 4)
    return take.number


def test_a_motion_is_restyled_and_stays_beside_the_new_take(app: App) -> None:
    number = without_prompts(app)
    app.editing.prompt = "a proud king"
    app.editing.shown = None
    click_on(app, "Restyle")
    run_until(app, lambda: len(app.editor.session.takes) == 2)
    run(app, 3)
    new = app.editor.session.takes[-1]
    assert new.frames == app.editor.session.takes[0].frames
    assert app.takes.played.number == new.number
    assert new.made.clip.prompts[0].prompt == "a proud king"
    assert app.editor.session.reference.take == number
    assert "restyled" in message(app) or "off its time" in message(app)
    assert new.made.inputs is not None
    assert not app.editing.fixed
    press(app, "ctrl", "z")
    assert len(app.editor.session.takes) == 1
