"""The real application without a display: pins of the live character and of takes, their card, track and handles; plants."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from runtime.formats.bvh_clip import load_clip_bvh
from runtime.session import edits
from runtime.session.motion import Motion
from runtime.session.session import Take
from runtime.skeleton import SPORT_SKELETON
from runtime.takes.clip import Clip
from runtime.takes.footplants import FootplantEdit
from runtime.takes.pinned import farthest
from runtime.takes.pins import Pinned
from tests.helpers.app_driver import (
    click,
    click_on,
    do,
    drag,
    export_bvh,
    message,
    place,
    press,
    record_standing,
    right_click,
    run,
    texts,
)
from viewer.app import App
from viewer.edit.handles import on_screen
from viewer.gl_bindings import imgui

HAND = SPORT_SKELETON.index("LeftHand")


@pytest.fixture
def app(desk: App) -> App:
    """The window as it was at its start."""
    desk.sessions.new()
    desk.scene.reset_character()
    run(desk, 3)
    return desk


def glide(app: App, speed: float = 0.0) -> Take:
    """A take of a figure that stands, or glides at m/s; it plays, paused at frame 20."""
    pose, count = app.scene.simulation.current, 60
    hips = np.tile(pose.hips_position, (count, 1))
    hips[:, 2] += speed * np.arange(count) / 60.0
    local, contacts = np.tile(pose.local_rotations, (count, 1, 1)), np.ones((count, 4), np.float32)
    made = Take(motion=Motion.of(Clip("Take", 60.0, hips, local, contacts)))
    app.editor.do("take", lambda session: edits.with_new_take(session, made))
    return played(app)


def recorded(app: App) -> Take:
    """The same of the live character, driven."""
    record_standing(app, 24)
    return played(app)


def played(app: App) -> Take:
    app.takes.play(app.editor.session.counter)
    app.takes.playback.seek(20)
    run(app, 2)
    return item(app)


def item(app: App) -> Take:
    return app.editor.session.takes[-1]


def add_pin(app: App, what: str) -> None:
    click_on(app, "+ Pin")
    click_on(app, what)


def handle(app: App, index: int = 0) -> tuple[float, float]:
    overlay = app.pins.overlay()
    shown = on_screen(app.scene.camera.current, overlay.points[index], imgui.get_io().display_size)
    assert shown is not None
    return shown


def test_a_pin_of_a_take_is_dragged_undone_and_exported(app: App, tmp_path: Path) -> None:
    before = glide(app)
    add_pin(app, "Left hand")
    (pin,) = item(app).poses.pins
    assert (pin.what, round(pin.start * 60)) == (Pinned.LEFT_HAND, 20)
    # where it was
    assert np.allclose(item(app).clip.world()[0][:, HAND], before.clip.world()[0][:, HAND], atol=0.005)
    x, y = handle(app)
    drag(app, (x, y), (x + 30.0, y - 40.0))
    (moved,) = item(app).poses.pins
    assert moved.point[1] > pin.point[1] + 0.05
    assert farthest(item(app).clip, moved) < 0.01
    assert app.editor.undo_label == "pin of the left hand"
    assert item(app).motion == before.motion
    export_bvh(app, tmp_path / "pinned.bvh")
    exported = load_clip_bvh(tmp_path / "pinned.bvh")
    assert np.linalg.norm(exported.world()[0][40, HAND] - moved.point) < 0.01
    run(app, 2)
    for _ in range(2):
        press(app, "ctrl", "z")
    assert item(app) == before


def test_the_card_sets_frames_and_removes(app: App) -> None:
    glide(app)
    add_pin(app, "Right hand")
    click_on(app, "Along")
    assert item(app).poses.pins[0].along
    click_on(app, "Rail")
    rail = item(app).poses.pins[0]
    assert rail.rail is not None
    assert not rail.along  # a rail stands in the world
    assert len(app.pins.overlay().points) == 2  # type: ignore[union-attr]
    x, y = place(app, "##pin to")
    drag(app, (x, y), (x - 60.0, y))
    assert item(app).poses.pins[0].end < 55 / 60
    click_on(app, "##remove pin")
    assert not item(app).poses.pins
    assert app.pins.pin is None
    press(app, "ctrl", "z")
    assert len(item(app).poses.pins) == 1


def test_a_pin_is_moved_on_its_track(app: App) -> None:
    glide(app)
    add_pin(app, "Look")
    app.pins.change(replace(item(app).poses.pins[0], end=0.6))
    run(app, 3)
    frames = [round(t * 60) for t in (item(app).poses.pins[0].start, item(app).poses.pins[0].end)]
    assert frames == [20, 36]
    (x, y), (far, _) = (place(app, "##pins 0", share=share) for share in (28 / 59, 38 / 59))
    drag(app, (x, y), (far, y))
    frames = [round(t * 60) for t in (item(app).poses.pins[0].start, item(app).poses.pins[0].end)]
    assert frames == [30, 46]


def test_words_of_a_take_change_under_its_pins(app: App) -> None:
    recorded(app)
    add_pin(app, "Left hand")
    app.pins.change(replace(item(app).poses.pins[0], point=(0.3, 1.3, 0.3)))
    do(app, "run 3; insert an old king; run 3")
    assert app.editor.undo_label.startswith("prompt an old king")
    assert item(app).poses.pins
    assert farthest(item(app).clip, item(app).poses.pins[0]) < 0.01


def test_a_plant_without_its_step_is_said_after_a_redrive(app: App) -> None:
    recorded(app)
    lifted = replace(item(app).poses, footplants=(FootplantEdit(0, (2, 5), None),))
    app.editor.do("plant", lambda session: session.with_take(session.counter, poses=lifted))
    do(app, "insert an old king; run 3")
    assert "One changed footplant" in message(app)
    assert item(app).poses.footplants  # it comes back with the version before


def test_a_hand_of_someone_who_walks_goes_along(app: App) -> None:
    glide(app, speed=1.0)
    add_pin(app, "Left hand")
    assert item(app).poses.pins[0].along
    assert farthest(item(app).clip, item(app).poses.pins[0]) < 0.01


def test_out_of_reach_is_said(app: App) -> None:
    glide(app)
    add_pin(app, "Left hand")
    app.pins.change(replace(item(app).poses.pins[0], point=(5.0, 1.0, 0.0)))
    run(app, 3)
    assert any("m out of reach" in text for text in texts(app))


def test_the_live_hand_holds_is_dragged_recorded_and_let_go(app: App) -> None:
    do(app, "click Hold…; click Left hand")
    app.pins.change(replace(app.pins.pin, point=(0.3, 1.3, 0.3)))  # type: ignore[type-var]
    run(app, 20)
    shown = app.shown_pose().positions[HAND]
    assert np.allclose(shown, (0.3, 1.3, 0.3), atol=0.01)
    assert not np.allclose(app.scene.simulation.current.positions[HAND], shown, atol=0.1)
    recorded(app)
    assert np.allclose(item(app).clip.world()[0][10, HAND], shown, atol=0.01)
    assert not np.allclose(item(app).base_clip.world()[0][10, HAND], shown, atol=0.1)
    do(app, "key escape; key escape")
    assert app.takes.playback is None
    app.pins.toggle_live(Pinned.LEFT_HAND)
    run(app, 20)
    assert app.shown_pose() is app.scene.simulation.current


def test_a_plant_is_dragged_lifted_and_planted(app: App) -> None:
    glide(app)
    assert app.pins.footplants(0) == [(0, 60)]
    (end, y), (to, _) = (place(app, "##foot 0", share=share) for share in (0.99, 40 / 59))
    drag(app, (end, y), (to, y))
    assert app.pins.footplants(0) == [item(app).poses.footplants[0].new]
    assert item(app).poses.footplants[0].new == (0, pytest.approx(40, abs=1))
    x, y = place(app, "##foot 0", share=50 / 59)
    right_click(app, x, y)
    click_on(app, "Plant the foot here")
    added = app.pins.footplants(0)[1]
    assert sum(added) / 2 == pytest.approx(50, abs=2)
    click(app, *place(app, "##foot 0", share=20 / 59))
    press(app, "delete")
    assert app.pins.footplants(0) == [added]
    assert app.editor.undo_label == "removal of a footplant of Take"
