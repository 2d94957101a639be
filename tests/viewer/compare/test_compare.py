"""The real application without a display: variants of the prompt on one stick, one of which is kept."""

import threading

import numpy as np
import pytest

from tests.helpers.app_driver import (
    Start,
    click,
    click_on,
    controller,
    do,
    hold,
    message,
    place,
    press,
    prompt,
    run,
    run_until,
    texts,
    type_prompt,
)
from viewer.app import App
from viewer.compare.lineup import SPACING_M, places
from viewer.edit.handles import on_screen
from viewer.gl_bindings import imgui
from viewer.jobs import Slot


def over(app: App, index: int) -> tuple[float, float]:
    """Where a variant is clicked: its hips."""
    hips = np.asarray(app.compare.poses[index].hips_position, float)
    found = on_screen(app.scene.camera.current, hips, imgui.get_io().display_size)
    assert found is not None
    return found


def apply(app: App, text: str) -> None:
    type_prompt(app, text)
    press(app, "enter")


def test_variants_by_seed_walk_on_one_stick_and_one_is_kept(app: App) -> None:
    apply(app, "a proud king")
    walker, mode = controller(app), app.scene.camera.mode
    click_on(app, "Compare")
    assert app.compare.titles == [f"a proud king, seed {k}" for k in range(3)]
    begun = [pose.root_position.copy() for pose in app.compare.poses]
    steps = walker.steps
    hold(app, "w", 45)
    moved = [pose.root_position - old for pose, old in zip(app.compare.poses, begun, strict=True)]
    assert all(np.linalg.norm(way) > 0.8 for way in moved)
    assert walker.steps == steps  # who waits
    for index in range(3):  # all are in view, beside the panels
        x, y = over(app, index)
        assert 330 < x < 970
        assert 0 < y < 690
    place_of = app.compare.poses[2].root_position
    click(app, *over(app, 2))
    assert not app.compare.open
    assert controller(app) is walker
    assert (walker.seed, app.scene.camera.mode) == (2, mode)
    assert np.allclose(app.scene.simulation.current.root_position, place_of, atol=0.05)
    assert message(app) == "Kept: a proud king, seed 2."


def test_a_kept_prompt_is_the_current_one_until_undo(app: App) -> None:
    apply(app, "a proud king")
    press(app, "v")
    assert app.compare.open
    do(app, "click ##variant prompt @1; key ctrl+a; type someone limping; key enter")
    assert app.compare.titles[1] == "someone limping, seed 1"
    assert prompt(app) == "a proud king"
    click_on(app, "Keep", 1)
    assert prompt(app) == "someone limping"
    assert app.prompting.boxes[0].text == "someone limping"
    press(app, "ctrl", "z")
    assert prompt(app) == "a proud king"


def test_blends_steps_more_and_fewer(start: Start) -> None:
    app = start(prompt="a proud king", blend="someone limping", blend_weights=(0.5,) * 6)
    do(app, "run 3; key v")
    assert app.compare.titles == [f"a proud king, B {percent} %" for percent in (0, 50, 100)]
    assert [text for text in texts(app) if text.startswith("B ")] == ["B 0 %", "B 50 %", "B 100 %"]
    click(app, *place(app, "##seed", 1, share=0.9))
    assert app.compare.titles[1] == "a proud king, B 50 %, seed 1"
    do(app, "key ctrl+z; click + Add")
    for _ in range(6):  # the tenth is none
        app.compare.add()
    assert len(app.compare.poses) == 9
    click_on(app, "Blend")
    weights = [variant.prompt.weights[0] for variant in app.compare.variants]
    assert weights == pytest.approx([k / 8 for k in range(9)])
    click_on(app, "##remove")
    assert len(app.compare.poses) == 8
    for _ in range(8):  # two stay
        app.compare.remove(0)
    assert len(app.compare.poses) == 2


def test_a_recording_ends_before_the_view_opens_and_the_view_before_a_recording(app: App) -> None:
    do(app, "key r; run 20; key v")
    assert (app.takes.recording, len(app.editor.session.takes)) == (False, 1)
    press(app, "r")
    assert app.takes.recording
    assert not app.compare.open
    assert message(app) == "Compare view closed: recording started."


def test_the_variants_stand_on_the_ground_that_is_chosen(app: App) -> None:
    do(app, "key v; ground hills; run 3")
    places = [p.root_position for p in app.compare.poses]
    heights = [float(app.scene.terrain.height(at[0], at[2])) for at in places]
    assert app.scene.terrain.name == "hills"
    assert all(member.terrain is app.scene.terrain for member in app.compare.members)
    assert [float(p.root_position[1]) for p in app.compare.poses] == pytest.approx(heights, abs=1e-3)


@pytest.mark.parametrize("count", range(2, 10))
def test_nobody_stands_in_another(count: int) -> None:
    spots = np.array(places(count, (3.0, -2.0), 0.7))
    apart = np.linalg.norm(spots[:, None] - spots[None], axis=-1) + 9.0 * np.eye(count)
    assert apart.min() > 0.99 * SPACING_M
    assert np.allclose(spots.mean(0), (3.0, -2.0), atol=0.5)


@pytest.mark.parametrize("mode", ["follow", "orbit"])
def test_closing_brings_the_view_of_the_live_character_back(app: App, mode: str) -> None:
    apply(app, "a proud king")
    app.scene.camera.use(mode)
    run(app, 30)
    camera = app.scene.camera
    before = camera.current.distance, camera.current.pitch
    press(app, "v")
    hold(app, "w", 120)  # away from the walker
    assert camera.current.distance != pytest.approx(before[0])
    press(app, "escape")
    assert (camera.current.distance, camera.current.pitch) == pytest.approx(before, abs=0.02)
    walker = np.asarray(app.scene.simulation.current.hips_position, float)
    assert on_screen(camera.current, walker, imgui.get_io().display_size) is not None
    assert np.linalg.norm(camera.current.target - walker) < 1.0


# --- as edits of the session
def test_variants_come_change_and_go_as_steps(app: App) -> None:
    apply(app, "a proud king")
    press(app, "v")
    assert app.editor.undo_label == "variants of “a proud king”"
    click_on(app, "+ Add")
    assert app.editor.undo_label == "variant 4 added"
    x, y = place(app, "##seed", 1, share=0.9)  # the button for one more
    click(app, x, y)
    assert app.editor.undo_label == "seed of variant 2"
    assert [member.seed for member in app.compare.members] == [0, 2, 2, 3]
    click_on(app, "##remove")
    assert app.editor.undo_label == "variant 1 removed"
    assert len(app.compare.poses) == 3
    for seeds in ([0, 2, 2, 3], [0, 1, 2, 3], [0, 1, 2]):
        press(app, "ctrl", "z")
        assert [member.seed for member in app.compare.members] == seeds
    press(app, "ctrl", "z")  # there were none
    assert not app.compare.open
    press(app, "ctrl", "y")
    assert [variant.seed for variant in app.compare.variants] == [0, 1, 2]


def test_a_prompt_of_a_variant_is_a_step_and_its_field_follows(app: App) -> None:
    apply(app, "a proud king")
    press(app, "v")
    app.compare.ask(1, "a duck")
    assert app.editor.undo_label == "prompt “a duck” of variant 2"
    before = app.compare.poses[1].root_position.copy()
    run(app, 2)
    duck = app.compare.members[1].styles[-1]
    assert duck[1] == app.settings.blend_seconds
    assert not np.array_equal(duck[0], app.compare.members[0].styles[-1][0])
    assert np.allclose(app.compare.poses[1].root_position, before)  # it moves on where it is
    click_on(app, "##variant prompt", 1)
    press(app, "ctrl", "z")  # nothing was typed
    assert app.compare.titles[1] == "a proud king, seed 1"
    assert app.compare.texts == {}


def test_variants_are_kept_for_their_prompt_and_replaced_for_another(app: App) -> None:
    apply(app, "a proud king")
    press(app, "v")
    app.compare.add()
    press(app, "escape")
    assert len(app.compare.variants) == 4
    press(app, "v")
    assert len(app.compare.poses) == 4
    assert app.editor.undo_label == "variant 4 added"  # to look at them again is no edit
    press(app, "escape")
    apply(app, "a duck")
    press(app, "v")
    assert app.compare.titles == [f"a duck, seed {k}" for k in range(3)]
    press(app, "ctrl", "z")  # the former ones
    assert app.compare.titles == [f"a proud king, seed {k}" for k in range(4)]


def test_the_last_prompts_are_one_step(app: App) -> None:
    for text in ("a duck", "someone limping", "a proud king"):
        apply(app, text)
    do(app, "key v; click Prompts")
    assert app.compare.titles == ["a proud king", "someone limping", "a duck"]
    assert app.editor.undo_label == "comparison of the last prompts"
    press(app, "ctrl", "z")
    assert app.compare.titles == [f"a proud king, seed {k}" for k in range(3)]


def test_undo_withdraws_a_prompt_of_a_variant_without_an_answer(app: App) -> None:
    apply(app, "a proud king")
    press(app, "v")
    app.jobs.blocking = False
    released, real = threading.Event(), app.prompting.answer
    app.prompting.answer = lambda text: (released.wait(10.0), real(text))[1]  # type: ignore[method-assign]
    app.compare.ask(0, "a duck")
    press(app, "ctrl", "z")
    assert message(app) == "Withdrawn: prompt “a duck”."
    released.set()
    run_until(app, lambda: not app.jobs.busy(Slot("variant", app.compare.variants[0].number)))
    assert app.compare.open
    assert app.compare.titles[0] == "a proud king, seed 0"
