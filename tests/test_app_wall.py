"""The real application without a display: characters side by side on one stick, one of which is kept."""

from __future__ import annotations

import numpy as np
import pytest
from app_driver import Start, click, click_on, controller, drawn, message, press, prompt, run, type_prompt

from viewer.app import App
from viewer.edit.path import on_screen
from viewer.gl_bindings import imgui
from viewer.wall import labels
from viewer.wall.state import SPACING_M, places


def over(app: App, index: int) -> tuple[float, float]:
    """Where a character of the wall is clicked: its hips."""
    hips = np.asarray(app.compare.poses[index].hips_position, float)
    found = on_screen(app.scene.camera.current, hips, imgui.get_io().display_size)
    assert found is not None
    return found


def apply(app: App, text: str) -> None:
    type_prompt(app, text)
    press(app, "enter")
    run(app, 2)


def test_variants_by_seed_walk_on_one_stick_and_one_is_kept(start: Start) -> None:
    app = start()
    apply(app, "a proud king")
    walker, mode = controller(app), app.scene.camera.mode
    click_on(app, "Compare")
    assert app.state.wall.titles == [f"a proud king, seed {k}" for k in range(3)]
    begun = [pose.root_position.copy() for pose in app.compare.poses]
    steps = walker.steps
    app.window.inject_key("w", True)
    run(app, 45)
    app.window.inject_key("w", False)
    moved = [pose.root_position - old for pose, old in zip(app.compare.poses, begun, strict=True)]
    assert all(np.linalg.norm(way) > 0.8 for way in moved)
    assert walker.steps == steps  # who waits
    for index in range(3):  # all are in view, beside the panels
        x, y = over(app, index)
        assert 330 < x < 970
        assert 0 < y < 690
    place_of = app.compare.poses[2].root_position
    click(app, *over(app, 2))
    assert not app.state.wall.open
    assert controller(app) is walker
    assert (walker.seed, app.scene.camera.mode) == (2, mode)
    assert np.allclose(app.scene.simulation.current.root_position, place_of, atol=0.05)
    assert message(app) == "Kept: a proud king, seed 2."


def test_a_kept_prompt_is_the_current_one_until_undo(start: Start) -> None:
    app = start()
    apply(app, "a proud king")
    press(app, "v")
    assert app.state.wall.open
    click_on(app, "##wall prompt", 1)
    press(app, "ctrl", "a")
    app.window.inject_text("someone limping")
    run(app, 3)
    press(app, "enter")
    run(app, 3)
    assert app.state.wall.titles[1] == "someone limping"
    assert prompt(app) == "a proud king"
    click_on(app, "Keep", 1)
    assert prompt(app) == "someone limping"
    assert app.prompting.boxes[0].text == "someone limping"
    press(app, "ctrl", "z")
    run(app, 2)
    assert prompt(app) == "a proud king"


def test_escape_leaves_the_walker_as_it_was(start: Start) -> None:
    app = start()
    run(app, 5)
    before = app.scene.simulation.current
    press(app, "v")
    app.window.inject_key("w", True)
    run(app, 10)
    app.window.inject_key("w", False)
    press(app, "f1")
    press(app, "escape")  # the help first
    assert app.state.wall.open
    press(app, "escape")
    assert not app.state.wall.open
    assert np.allclose(app.scene.simulation.current.root_position, before.root_position, atol=1e-3)


def test_blends_steps_more_and_fewer(start: Start) -> None:
    app = start(prompt="a proud king", blend="someone limping", blend_weights=(0.5,) * 6)
    run(app, 3)
    press(app, "v")
    names = [candidate.name for candidate in app.state.wall.candidates]
    assert names == [
        "a proud king",
        "50% someone limping, else a proud king",
        "100% someone limping, else a proud king",
    ]
    click_on(app, "+ Add")
    for _ in range(6):  # the tenth is none
        app.compare.add()
    assert len(app.compare.poses) == 9
    click_on(app, "Blend")
    weights = [candidate.edit.weights[0] for candidate in app.state.wall.candidates]
    assert weights == pytest.approx([k / 8 for k in range(9)])
    click_on(app, "##remove")
    assert len(app.compare.poses) == 8
    for _ in range(8):  # two stay
        app.compare.remove(0)
    assert len(app.compare.poses) == 2


def test_a_recording_ends_before_the_wall_and_the_wall_before_a_recording(start: Start) -> None:
    app = start()
    press(app, "r")
    run(app, 20)
    press(app, "v")
    assert (app.takes.recording, len(app.editor.session.takes)) == (False, 1)
    press(app, "r")
    assert app.takes.recording
    assert not app.state.wall.open


def test_the_wall_stands_on_the_ground_that_is_chosen(start: Start) -> None:
    app = start()
    run(app, 3)
    press(app, "v")
    app.scene.load_terrain("hills")
    run(app, 3)
    heights = [
        float(app.scene.terrain.height(p.root_position[0], p.root_position[2])) for p in app.compare.poses
    ]
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
def test_leaving_the_wall_brings_the_view_of_the_walker_back(start: Start, mode: str) -> None:
    app = start()
    apply(app, "a proud king")
    app.scene.camera.use(mode)
    run(app, 30)
    camera = app.scene.camera
    before = camera.current.distance, camera.current.pitch
    press(app, "v")
    app.window.inject_key("w", True)
    run(app, 120)  # away from the walker
    app.window.inject_key("w", False)
    assert camera.current.distance != pytest.approx(before[0])
    press(app, "escape")
    run(app, 3)
    assert (camera.current.distance, camera.current.pitch) == pytest.approx(before, abs=0.02)
    walker = np.asarray(app.scene.simulation.current.hips_position, float)
    assert on_screen(camera.current, walker, imgui.get_io().display_size) is not None
    assert np.linalg.norm(camera.current.target - walker) < 1.0


def test_steps_of_the_wall_are_counted(start: Start) -> None:
    app = start()
    apply(app, "a proud king")
    press(app, "v")
    app.state.stats.steps_per_s = 0.0
    run(app, 5)
    assert app.state.stats.steps_per_s > 0.0


def test_names_that_are_cut_keep_the_seed(start: Start) -> None:
    app = start(width=800, height=500)
    apply(app, "somebody who is walking in a relaxed, everyday way")
    press(app, "v")
    texts: list[str] = []
    with pytest.MonkeyPatch.context() as patch:
        real = labels._label
        patch.setattr(labels, "_label", lambda text, *rest: (texts.append(text), real(text, *rest)))
        run(app)
    assert [text.split("…")[1] for text in texts] == [f", seed {k}" for k in range(3)]
    assert all(text.startswith(f"{k + 1}  some") for k, text in enumerate(texts))


def test_the_first_minute_covers_no_character_of_the_wall(start: Start) -> None:
    app = start()
    apply(app, "a proud king")
    app.guide.begin()
    run(app, 2)
    assert "Skip##guide" in [label for label, _ in drawn(app)]
    press(app, "v")
    assert "Skip##guide" not in [label for label, _ in drawn(app)]
