"""The real application without a display: what stands beside a take as its own skeleton, its own character, or a film."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from runtime.character.shape import BodyShape, shaped_file
from runtime.errors import FileError
from runtime.formats.glb import glb_document
from runtime.formats.prepare import ExportOptions, prepare
from runtime.formats.reference import open_take
from runtime.session.session import Reference
from runtime.takes.clip import Clip
from runtime.takes.own_skeleton import STEP_M, OwnSkeleton
from runtime.takes.pins import Pinned
from tests.helpers.app_driver import (
    Start,
    click_on,
    do,
    drawn,
    message,
    place,
    press,
    record,
    run,
    save_and_leave,
    type_in,
)
from tests.helpers.walker import walk
from tests.runtime.formats.test_reference import TURNS, foreign
from viewer.app import App
from viewer.edit.handles import on_screen
from viewer.edit.reference import Look
from viewer.edit.video import MAX_SIDE_PX, read_video
from viewer.filming.writers import open_writer
from viewer.gl_bindings import imgui
from viewer.services import Services


def with_take(app: App) -> App:
    """A take of about a second that plays, paused at its first frame."""
    record(app, 70)
    do(app, "play 1; run 3")
    app.takes.playback.seek(0)
    return app


def choose_file(app: App, entry: str, path: Path) -> None:
    """An entry of the menu that is open, and a path typed into its dialog."""
    click_on(app, entry)
    press(app, "ctrl", "a")
    type_in(app, str(path))
    do(app, "key enter; run 5")


def choose_beside(app: App, path: Path) -> None:
    """By the menu of the timeline and the dialog, as a person would."""
    click_on(app, "Compare…")
    choose_file(app, "A take or film from a file…", path)


def film(path: Path, size: tuple[int, int] = (64, 48), count: int = 30) -> Path:
    """Pictures whose brightness says which they are, 30 a second."""
    with open_writer(path, size, 30.0) as write:
        for number in range(count):
            write(np.full((size[1], size[0], 3), 8 * number, np.uint8))
    return path


def brightness(app: App) -> float:
    """Of the middle of the film's picture on the screen."""
    show, middle = imgui.image, []

    def watched(*given: Any) -> None:
        show(*given)
        low, high = imgui.get_item_rect_min(), imgui.get_item_rect_max()
        middle[:] = round((low.x + high.x) / 2), round((low.y + high.y) / 2)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(imgui, "image", watched)
        run(app)
    x, y = middle
    return float(app.window.read_pixels()[y - 8 : y + 8, x - 8 : x + 8, :3].mean())


def test_another_skeleton_keeps_its_own_points(tmp_path: Path) -> None:
    reference = open_take(foreign(tmp_path / "other.bvh", TURNS["Z up"])).reference
    own, ours = reference.own, reference.clip.world()[0]
    assert own.points.shape[:2] == (len(reference.clip), len(own.parents))
    gap = own.points[:, :31] - ours  # it has our proportions, at another size and with other axes
    assert np.abs(gap - gap[:1].mean(axis=1, keepdims=True)).max() < 0.03
    middle, steps = own.packed()
    back = OwnSkeleton.unpacked(own.parents, middle, steps)
    assert np.abs(back.points - own.points).max() < STEP_M
    with pytest.raises(ValueError, match="points"):
        OwnSkeleton.unpacked(own.parents, middle, steps[:-2])
    with pytest.raises(ValueError, match="points"):
        OwnSkeleton.unpacked((99, *own.parents[1:]), middle, steps)


def test_a_reference_is_drawn_as_its_own_skeleton_and_comes_back_with_the_project(
    start: Start, tmp_path: Path
) -> None:
    app = with_take(start())
    choose_beside(app, foreign(tmp_path / "other.bvh", TURNS["as ours"]))
    reference, playback = app.references, app.takes.playback
    assert playback.number == 1, "the take goes on playing"
    assert reference.name == "other"
    assert reference.look is Look.SKELETON
    beside = reference.pose(playback)
    assert beside is not None
    figure = reference.figure(playback, beside)
    starts = figure.matrices[:, :3, 3]  # where the bones begin
    assert np.abs(starts[:, 1] - playback.terrain.height(0.0, 0.0)).min() < 0.2
    assert starts.mean(axis=0) == pytest.approx(beside.positions.mean(axis=0), abs=0.25)
    assert figure.on_top is False
    assert app.scene.renderer.overlays.figure is not None  # type: ignore[attr-defined]
    reference.close()
    run(app, 2)
    assert app.scene.renderer.overlays.figure is None  # type: ignore[attr-defined]

    reference.show(2)
    reference.set(aside_m=1.5, offset_s=0.25)
    click_on(app, "Over it")
    path = tmp_path / "a.sport"
    app.sessions.save_as(path)
    run(app, 2)
    assert path.stat().st_size < 500_000
    app.sessions.new()
    run(app, 2)
    assert app.editor.session.reference is None
    app.sessions.open(path)
    run(app, 2)
    assert app.editor.session.reference == Reference(2, offset_s=0.25, aside_m=1.5, over=True)
    assert reference.look is Look.SKELETON
    do(app, "play 1; run 2")
    overlays = app.overlays(None, [])
    assert overlays.figure.on_top
    assert not overlays.extra_poses
    assert not overlays.ghosts


def test_a_reference_is_shown_by_a_character_of_its_own(start: Start, tmp_path: Path) -> None:
    app = with_take(start(services={"load_character": Services().load_character}))
    do(app, "mirror 1; play 1; click Compare…")
    click_on(app, app.editor.session.takes[1].title)
    path = shaped_file(BodyShape(1.0, 1.2, 1.2), tmp_path)
    click_on(app, "##reference look")
    choose_file(app, "Another character…", path)
    assert app.overlays(None, []).figure.mesh is app.references.character
    save_and_leave(app, tmp_path / "a.sport")
    assert app.references.character is None
    path.unlink()
    app.sessions.open(tmp_path / "a.sport")
    do(app, "run 3; play 1; run 2")
    assert app.references.look is Look.CHARACTER
    assert app.overlays(None, []).figure is not None


def card_box(app: App) -> tuple[float, float, float, float]:
    """Left, top, right, bottom of the reference's card."""
    window = imgui.internal.find_window_by_name("Reference")
    return window.pos.x, window.pos.y, window.pos.x + window.size.x, window.pos.y + window.size.y


def body_box(app: App) -> tuple[float, float, float, float]:
    """The same of the joints of the character in the window."""
    playback, size = app.takes.playback, imgui.get_io().display_size
    seen = [on_screen(app.scene.camera.current, point, size) for point in playback.pose().positions]
    xs, ys = zip(*[point for point in seen if point is not None], strict=True)
    return min(xs), min(ys), max(xs), max(ys)


def apart(a: tuple[float, float, float, float], b: tuple[float, float, float, float]) -> bool:
    return a[2] <= b[0] or b[2] <= a[0] or a[3] <= b[1] or b[3] <= a[1]


@pytest.mark.parametrize(("size", "pinned"), [((1280, 720), True), ((800, 500), False)])
def test_the_card_hides_nobody(start: Start, tmp_path: Path, size: tuple[int, int], pinned: bool) -> None:
    app = with_take(start(width=size[0], height=size[1]))
    do(app, "mirror 1; play 1")
    app.references.show(2)
    if pinned:
        app.pins.add(Pinned.LEFT_HAND)
    app.takes.playback.playing = False
    run(app, 60)
    desk = imgui.internal.find_window_by_name("Session")
    bar = (desk.pos.x, desk.pos.y, desk.pos.x + desk.size.x, desk.pos.y + desk.size.y)
    assert apart(card_box(app), bar)
    assert apart(card_box(app), body_box(app))
    labels = {label for label, _ in drawn(app)}
    assert {"##reference offset", "##reference aside"} <= labels
    assert labels & {"Over it", "Over"}
    app.references.open_video(film(tmp_path / "film.mp4"))
    run(app, 60)
    assert app.references.video is not None
    assert apart(card_box(app), body_box(app)), "a film stands beside the character"
    app.references.set(size=1.0)  # hardly anything is left beside it
    run(app, 30)
    assert body_box(app)[2] < size[0]


def test_a_film_runs_in_sync_with_the_take_and_comes_back(start: Start, tmp_path: Path) -> None:
    app = with_take(start(drawn=True))
    app.open_files([film(tmp_path / "film.mp4")])  # as by dropping it
    run(app, 3)
    assert "30 pictures, 1.0 s" in message(app)
    reference, playback = app.references, app.takes.playback
    assert playback is not None
    for frame in (0, 30, 50):
        playback.seek(frame)
        run(app, 2)
        assert brightness(app) == pytest.approx(8 * (frame // 2), abs=5), f"frame {frame}"
    reference.set(offset_s=-0.5)
    run(app, 2)
    assert brightness(app) == pytest.approx(8 * 10, abs=5)
    click_on(app, "Over it")
    low, high = (place(app, "##reference opacity", share=share) for share in (0.0, 0.9))
    assert low[0] < high[0]
    assert app.window.read_pixels()[300, 640].astype(int).sum() != 0
    save_and_leave(app, tmp_path / "a.sport")
    assert reference.video is None
    app.sessions.open(tmp_path / "a.sport")
    run(app, 3)
    assert reference.video is not None
    assert (reference.reference.offset_s, reference.reference.over) == (-0.5, True)
    do(app, "play 1; run 2; click ##close reference")
    assert not reference.shown


def test_films_are_made_small_and_what_is_none_is_said(start: Start, tmp_path: Path) -> None:
    video = read_video(film(tmp_path / "wide.mp4", (1280, 320), 3))
    assert video.size == (MAX_SIDE_PX, MAX_SIDE_PX // 4)
    assert video.picture(0).shape == (MAX_SIDE_PX // 4, MAX_SIDE_PX, 3)
    assert [video.index(t) for t in (-1.0, 0.0, 0.034, 9.0)] == [0, 0, 1, 2]
    animation = read_video(film(tmp_path / "film.gif"))
    means = [float(animation.picture(animation.index(t)).mean()) for t in (0.0, 0.5, 50 / 60)]
    assert means == pytest.approx([0.0, 8.0 * 15, 8.0 * 25], abs=5)
    for name in ("text.mp4", "text.gif", "text.webp"):
        (tmp_path / name).write_text("no film")
        with pytest.raises(FileError, match=name):
            read_video(tmp_path / name)
    app = with_take(start())
    app.open_files([tmp_path / "text.mp4"])
    run(app, 3)
    assert "text.mp4: not a readable film" in message(app)
    assert not app.references.shown


def test_another_animation_of_a_file_is_chosen_in_the_menu_of_its_take(start: Start, tmp_path: Path) -> None:
    """It plays, or is compared where the take is; names may be there twice, empty or long."""
    names = ["walk", "مشي سريع 🏃", "walk", "", "x" * 200]
    clips = [Clip(name, 30.0, *walk(40 + 10 * k)) for k, name in enumerate(names)]
    path = tmp_path / "many.glb"
    takes = [prepare(clip, ExportOptions(fps=30.0)) for clip in clips]
    document, _ = glb_document(takes, ExportOptions(animation_only=True), None)
    for animation, name in zip(document.gltf.animations, names, strict=True):
        animation.name = name
    document.save(path)
    app = start()
    app.open_files([path])
    run(app, 4)
    assert "5 animations; walk is read" in message(app)

    def choose(row: int, number: int) -> None:
        click_on(app, "##take menu", row)
        click_on(app, "Animations")
        click_on(app, f"##animation {number}")
        run(app, 4)

    names = {"مشي سريع 🏃": 50, "walk (3)": 60, "animation 4": 70, "x" * 60: 80}
    for number, (shown, frames) in enumerate(names.items(), 1):
        choose(0, number)
        assert (app.takes.played.title, app.takes.played.made.header.frames) == (shown, frames)
    app.references.show(1)
    choose(0, 2)
    assert app.takes.played.title == "x" * 60
    assert app.references.name == "walk (3)"
