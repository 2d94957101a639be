"""An hour at the desk in a minute: the real application by mouse and keys alone, with a picture of every step.

`python -m tests.tour --size 1280x720 --out DIR` writes DIR/01-start.png and so on; a step that finds no button ends it.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np

from runtime.character.shape import BodyShape, shaped_file
from sport.commands.arguments import size
from tests.helpers import hand
from tests.helpers.app_driver import (
    InjectedPads,
    click,
    click_on,
    click_prompt_box,
    drawn,
    message,
    place,
    press,
    run,
)
from tests.runtime.formats.test_reference import TURNS, foreign
from viewer.app import App
from viewer.edit.handles import on_screen
from viewer.filming.writers import open_writer
from viewer.input.gamepad import GamepadState
from viewer.options import ViewOptions
from viewer.render.offscreen import save_png
from viewer.services import Services


class Tour:
    """The application, and the pictures of it."""

    def __init__(self, size: tuple[int, int], out: Path, folder: Path, terrain: str) -> None:
        options = ViewOptions(
            offscreen=True, terrain=terrain, width=size[0], height=size[1], quality="software"
        )
        self.pads, self.folder = InjectedPads(), folder
        self.app = App(options, Services(), self.pads, folder)
        self.app.settings.export_folder = str(folder / "clips")
        self.out, self.number = out, 0
        out.mkdir(parents=True, exist_ok=True)

    def frames(self, count: int) -> None:
        """Let frames pass without drawing the scene, which takes most of their time."""
        self.quietly(lambda: run(self.app, count))

    def quietly(self, act: Callable[[], object]) -> None:
        """Act without drawing the scene."""
        renderer = self.app.scene.renderer
        renderer.render = lambda *_: None  # type: ignore[method-assign]
        try:
            act()
        finally:
            del renderer.render  # the class's own again

    def picture(self, name: str) -> None:
        """Draw a frame and write it."""
        run(self.app, 2)
        self.number += 1
        save_png(self.app.window.read_pixels(), self.out / f"{self.number:02d}-{name}.png")
        print(f"{self.number:02d} {name}: {message(self.app)}", flush=True)

    # --- hands

    def hold(self, key: str, count: int) -> None:
        self.app.window.inject_key(key, True)
        self.frames(count)
        self.app.window.inject_key(key, False)

    def click(self, label: str, index: int = 0) -> None:
        self.quietly(lambda: click_on(self.app, label, index))

    def see(self, tab: str, label: str) -> None:
        """Bring a tab to the front where a widget is not in view."""
        labels = [full for full, _ in drawn(self.app)]
        if not any(label in full for full in labels) and any(full.startswith(tab) for full in labels):
            self.click(tab)
            self.frames(2)

    def write(self, text: str, enter: bool = True) -> None:
        hand.text(self.app.window, text)
        self.frames(3)
        if enter:
            self.press("enter")
        self.frames(3)

    def press(self, *keys: str) -> None:
        self.quietly(lambda: press(self.app, *keys))

    def right_click(self, label: str, index: int = 0) -> None:
        self.right_click_at(*place(self.app, label, index))

    def right_click_at(self, x: float, y: float) -> None:
        for down in (None, True, False):
            hand.mouse(self.app.window, x, y, None if down is None else 1, bool(down))
            self.frames(2)

    def drag(self, start: tuple[float, float], end: tuple[float, float]) -> None:
        middle = tuple((a + b) / 2 for a, b in zip(start, end, strict=True))
        for at, down in ((start, None), (start, True), (middle, True), (end, True), (end, False)):
            hand.mouse(self.app.window, *at, None if down is None else 0, bool(down))  # type: ignore[misc]
            self.frames(2)
        self.frames(2)

    def seek(self, share: float) -> None:
        """A click on the ruler of the timeline."""
        x, y = place(self.app, "##timeline", share=share)
        self.quietly(lambda: click(self.app, x, y))

    def add_camera_key(self) -> None:
        self.click("+ Pin")
        self.click("Camera view")

    def beside(self, what: str) -> None:
        """Choose what the take is compared with: by the button, or in a narrow window by the menu of a take."""
        if any("Compare…" in label for label, _ in drawn(self.app)):
            self.click("Compare…")
        else:
            self.see("Takes", "##record")
            session = self.app.editor.session
            self.click("##take menu", session.index(session.selected))
            self.click("Compare with")
        self.picture("what to compare with")
        self.click(what)

    def over(self) -> None:
        """Put the reference over the take, or beside it again."""
        wide = any(label == "Over it" for label, _ in drawn(self.app))
        self.click("Over it" if wide else "Over")
        self.leave()

    def answer(self, path: Path) -> None:
        """Type a path into the dialog."""
        self.frames(3)
        self.picture("a file is asked for")
        self.press("ctrl", "a")
        self.write(str(path))
        self.frames(10)

    def leave(self) -> None:
        """Move the mouse to a place where nothing is explained."""
        width, height = self.app.window.framebuffer.size
        hand.mouse(self.app.window, width * 0.5, height * 0.28)
        self.frames(2)


def walk(tour: Tour) -> None:
    tour.frames(30)
    tour.picture("start")
    tour.hold("w", 70)
    tour.picture("walking")


def prompt(tour: Tour) -> None:
    tour.see("Prompt", "##prompt A")
    tour.quietly(lambda: click_prompt_box(tour.app))
    tour.press("ctrl", "a")
    tour.write("an old man with a limp")
    tour.press("escape")
    tour.leave()
    tour.hold("w", 60)
    tour.picture("prompt")
    tour.click("##words")
    tour.press("ctrl", "a")
    tour.write("left hand on the hip")
    tour.picture("a part edited")
    tour.press("escape")
    tour.leave()


def record(tour: Tour) -> None:
    tour.press("r")
    tour.hold("w", 100)
    tour.picture("recording")
    tour.see("Prompt", "##prompt A")
    tour.quietly(lambda: click_prompt_box(tour.app))
    tour.press("ctrl", "a")
    tour.write("a proud king")
    tour.press("escape")
    tour.leave()
    tour.hold("w", 100)
    tour.frames(30)
    tour.press("r")
    tour.see("Takes", "##record")
    tour.picture("recorded")
    tour.press("p")
    tour.frames(60)
    tour.press("space")
    tour.picture("timeline")


def retime(tour: Tour) -> None:
    app = tour.app
    prompts = app.editing.tracks.prompts  # type: ignore[union-attr]
    last = len(app.editor.session.takes[0].clip) - 1
    at = prompts[1].start
    x, y = place(app, "##prompts", share=at / last)
    to, _ = place(app, "##prompts", share=(at - 30) / last)
    tour.drag((x + 2, y), (to, y))
    tour.leave()
    tour.picture("a prompt earlier")


def pin(tour: Tour) -> None:
    app = tour.app
    assert app.takes.playback is not None
    tour.seek(0.25)
    tour.click("+ Pin")
    tour.picture("what to pin")
    tour.click("Right hand")
    tour.click("Along")
    tour.click("Rail")
    tour.leave()
    tour.picture("hand on a rail")
    overlay = app.pins.overlay()
    assert overlay is not None
    shown = on_screen(app.scene.camera.current, overlay.points[0], app_size(app))
    assert shown is not None
    tour.drag(shown, (shown[0] + 12.0, shown[1] - 24.0))
    tour.leave()
    tour.picture("the rail raised")
    tour.press("escape")


def app_size(app: App) -> object:
    from viewer.gl_bindings import imgui

    return imgui.get_io().display_size


def looks(tour: Tour) -> None:
    tour.see("Scene", "Ghosts")
    tour.click("Ghosts")
    tour.click("Trails")
    tour.leave()
    tour.picture("ghosts and trails")
    tour.see("Scene", "Ghosts")
    tour.click("Ghosts")
    tour.click("Trails")


def path(tour: Tour) -> None:
    tour.see("Scene", "Edit its path")
    tour.click("Edit its path")
    tour.leave()
    tour.picture("the path")
    app = tour.app
    tool = app.path
    point = tool.points[-1]
    shown = on_screen(
        app.scene.camera.current,
        [point.x, float(app.scene.terrain.height(point.x, point.z)), point.z],  # type: ignore[arg-type]
        app_size(app),  # type: ignore[arg-type]
    )
    if shown is not None:
        tour.drag(shown, (shown[0] + 60.0, shown[1]))
    tour.see("Scene", "##drive path")
    tour.click("##drive path")
    tour.leave()
    tour.picture("another path")
    tour.press("ctrl", "z")
    tour.see("Scene", "Edit its path")
    tour.click("Edit its path")


def mirror(tour: Tour) -> None:
    tour.see("Takes", "##record")
    tour.click("##take menu")
    tour.picture("the menu of a take")
    tour.click("Mirror")
    tour.leave()
    tour.picture("mirrored")


def footplants(tour: Tour) -> None:
    """A plant longer, and another one taken away."""
    app = tour.app
    (_, end), *_ = app.pins.footplants(0)
    last = len(app.editor.session.takes[0].clip) - 1
    x, y = place(app, "##foot 0", share=end / last)
    tour.drag((x - 1.0, y), (x + 14.0, y))
    tour.leave()
    tour.picture("a plant longer")
    at = next((a + b) / 2 for a, b in app.pins.footplants(1) if b - a > 20)
    x, y = place(app, "##foot 1", share=at / last)
    tour.right_click_at(x, y)
    tour.picture("the menu of a plant")
    tour.click("Lift the foot here")
    tour.leave()
    tour.picture("a foot lifted")
    tour.press("ctrl", "z")
    tour.press("ctrl", "z")


def keys(tour: Tour) -> None:
    """Two keys of the camera, and a frame between them."""
    tour.seek(0.1)
    tour.add_camera_key()
    tour.see("Scene", "Side")
    tour.click("Side")
    tour.frames(40)
    tour.seek(0.8)
    tour.add_camera_key()
    tour.seek(0.45)
    tour.leave()
    tour.picture("between two keys of the camera")
    tour.see("Scene", "Follow")
    tour.click("Follow")


def compare(tour: Tour) -> None:
    """Another take, a motion of another skeleton, another character, a film."""
    tour.beside("Take 1")
    tour.seek(0.4)
    tour.leave()
    tour.picture("a reference beside")
    tour.over()
    tour.picture("a reference over it")
    tour.beside("A take or film from a file…")
    tour.answer(foreign(tour.folder / "captured.bvh", TURNS["facing +X"]))
    tour.over()
    tour.seek(0.3)
    tour.leave()
    tour.picture("its own skeleton beside")
    tour.over()
    tour.picture("its own skeleton over it")
    tour.over()
    tour.click("##reference look")
    tour.picture("who shows the reference")
    tour.click("Another character…")
    tour.answer(shaped_file(BodyShape(1.0, 1.25, 1.3), tour.folder))
    tour.leave()
    tour.picture("its own character beside")
    tour.beside("A take or film from a file…")
    tour.answer(film(tour.folder / "film.mp4"))
    tour.leave()
    tour.picture("a film beside")
    tour.over()
    tour.picture("a film over it")
    tour.click("##close reference")


def film(path: Path) -> Path:
    """A second of a disc that goes to the right over stripes."""
    rows, columns = np.mgrid[:180, :320]
    with open_writer(path, (320, 180), 30.0) as write:
        for number in range(30):
            disc = np.hypot(rows - 90, columns - 40 - 8 * number) < 30
            grey = np.where(disc, 240, 60 + 30 * (columns // 40 % 2))
            write(np.repeat(grey[..., None], 3, axis=2).astype(np.uint8))
    return path


def steady(tour: Tour) -> None:
    """A take for a loop: some seconds straight ahead."""
    tour.press("escape")
    tour.press("escape")
    tour.frames(5)
    tour.see("Prompt", "##prompt A")
    tour.quietly(lambda: click_prompt_box(tour.app))
    tour.press("ctrl", "a")
    tour.write("calm walk")
    tour.press("escape")
    tour.leave()
    tour.hold("w", 90)
    tour.press("r")
    tour.hold("w", 330)
    tour.press("r")


def export(tour: Tour) -> None:
    tour.press("ctrl", "e")
    tour.frames(3)
    tour.picture("the export window")
    tour.click("Loop")
    tour.picture("a loop")
    tour.click("2")
    tour.click("##export now")
    tour.frames(5)
    tour.picture("exported")
    tour.press("escape")


def looks_of_the_scene(tour: Tour) -> None:
    """The shape of the mannequin, the response, the quality."""
    app = tour.app
    tour.press("escape")
    tour.see("Scene", "##response")
    (low, y), (high, _) = (place(app, "##response", share=share) for share in (0.05, 0.9))
    tour.drag((low, y), (high, y))
    tour.leave()
    tour.picture("response")
    tour.click("Open a file, shape the body")
    tour.leave()
    tour.picture("a file and the shape")
    for name, share in (("height", 0.6), ("legs", 0.75), ("shoulders", 0.7)):
        (x, y), (to, _) = (place(app, f"##shape {name}", share=at) for at in (0.45, share))
        tour.drag((x, y), (to, y))
    tour.leave()
    tour.frames(5)
    tour.hold("w", 40)
    tour.picture("another shape")
    tour.see("Scene", "Its own shape")
    tour.click("Its own shape")
    tour.click("Open a file, shape the body")
    tour.see("Scene", "##quality")
    tour.click("##quality")
    tour.picture("qualities")
    tour.click("Fast")
    tour.leave()
    tour.picture("fast")
    tour.click("##quality")
    tour.click("Software")


def pad(tour: Tour) -> None:
    """The buttons of a pad, and a stick that walks."""
    tour.press("escape")
    tour.click("##settings")
    tour.picture("settings")
    tour.click("Gamepad buttons")
    tour.picture("buttons of a pad")
    tour.press("escape")
    tour.pads.state = GamepadState("Pad", left=(0.0, 1.0))
    tour.frames(60)
    tour.leave()
    tour.picture("a pad walks")
    tour.pads.state = None


def rest(tour: Tour) -> None:
    tour.press("escape")
    tour.press("f1")
    tour.picture("help")
    tour.press("f1")
    tour.click("##session")
    tour.picture("the session menu")
    tour.press("escape")
    tour.press("escape")
    tour.frames(5)
    tour.see("Scene", "Hold…")
    tour.click("Hold…")
    tour.picture("hold")
    tour.click("Left hand")
    tour.leave()
    tour.hold("w", 20)
    tour.picture("holding live")


STEPS = (
    walk, prompt, record, retime, pin, footplants, keys, looks, path, mirror, compare, steady, export,
    looks_of_the_scene, pad, rest,
)  # fmt: skip


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--size", default="1280x720", metavar="WxH")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR")
    parser.add_argument("--terrain", default="hills")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        tour = Tour(size(options.size), options.out, Path(folder), options.terrain)
        for step in STEPS:
            step(tour)
        tour.app.close()
    return 0


if __name__ == "__main__":
    sys.exit(main())
