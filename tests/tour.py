"""An hour at the desk in a minute: the real application by mouse and keys alone, with a picture of every step.

`python tests/tour.py --size 1280x720 --out DIR` writes DIR/01-start.png and so on; a step that finds no button ends it.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

from app_driver import InjectedPads, click, click_on, click_prompt_box, drawn, message, place, press, run

from sport.commands.arguments import size
from viewer.app import App
from viewer.options import ViewOptions
from viewer.render.offscreen import save_png
from viewer.services import Services
from viewer.stage.path_tool import on_screen


class Tour:
    """The application, and the pictures of it."""

    def __init__(self, size: tuple[int, int], out: Path, folder: Path, terrain: str) -> None:
        options = ViewOptions(
            offscreen=True, terrain=terrain, width=size[0], height=size[1], quality="software"
        )
        self.app = App(options, Services(), InjectedPads(), folder)
        self.app.state.settings.export_folder = str(folder / "clips")
        self.out, self.number = out, 0
        out.mkdir(parents=True, exist_ok=True)
        self._draw = self.app.stage.renderer.render

    def frames(self, count: int) -> None:
        """Let frames pass without drawing the scene, which takes most of their time."""
        renderer = self.app.stage.renderer
        renderer.render = lambda *_: None  # type: ignore[method-assign]
        try:
            run(self.app, count)
        finally:
            renderer.render = self._draw  # type: ignore[method-assign]

    def quietly(self, act: Callable[[], object]) -> None:
        """Act without drawing the scene."""
        renderer = self.app.stage.renderer
        renderer.render = lambda *_: None  # type: ignore[method-assign]
        try:
            act()
        finally:
            renderer.render = self._draw  # type: ignore[method-assign]

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
        self.app.window.inject_text(text)
        self.frames(3)
        if enter:
            self.press("enter")
        self.frames(3)

    def press(self, *keys: str) -> None:
        self.quietly(lambda: press(self.app, *keys))

    def right_click(self, label: str, index: int = 0) -> None:
        x, y = place(self.app, label, index)
        for down in (None, True, False):
            self.app.window.inject_mouse(x, y, None if down is None else 1, bool(down))
            self.frames(2)

    def drag(self, start: tuple[float, float], end: tuple[float, float]) -> None:
        middle = tuple((a + b) / 2 for a, b in zip(start, end, strict=True))
        for at, down in ((start, None), (start, True), (middle, True), (end, True), (end, False)):
            self.app.window.inject_mouse(*at, None if down is None else 0, bool(down))  # type: ignore[misc]
            self.frames(2)
        self.frames(2)

    def leave(self) -> None:
        """Move the mouse to a place where nothing is explained."""
        width, height = self.app.window.framebuffer.size
        self.app.window.inject_mouse(width * 0.5, height * 0.28)
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
    tour.see("Clips", "##record")
    tour.picture("recorded")
    tour.press("p")
    tour.frames(60)
    tour.press("space")
    tour.picture("timeline")


def retime(tour: Tour) -> None:
    app = tour.app
    prompts = app.editing.tracks.prompts  # type: ignore[union-attr]
    last = len(app.state.takes.items[0].clip) - 1
    at = prompts[1].span.start
    x, y = place(app, "##prompts", share=at / last)
    to, _ = place(app, "##prompts", share=(at - 30) / last)
    tour.drag((x + 2, y), (to, y))
    tour.leave()
    tour.picture("a prompt earlier")


def pin(tour: Tour) -> None:
    app = tour.app
    assert app.state.takes.playback is not None
    x, y = place(app, "##timeline", share=0.25)
    tour.quietly(lambda: click(app, x, y))
    tour.click("+ Pin")
    tour.picture("what to pin")
    tour.click("Right hand")
    tour.click("Along")
    tour.click("Rail")
    tour.leave()
    tour.picture("hand on a rail")
    overlay = app.pinning.overlay()
    assert overlay is not None
    shown = on_screen(app.stage.camera.current, overlay.points[0], app_size(app))
    assert shown is not None
    tour.drag(shown, (shown[0] + 12.0, shown[1] - 24.0))
    x, y = place(app, "##pins 0", share=0.27)
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


def way(tour: Tour) -> None:
    tour.see("Scene", "Edit its way")
    tour.click("Edit its way")
    tour.leave()
    tour.picture("the way")
    app = tour.app
    tool = app.stage.path
    point = tool.points[-1]
    shown = on_screen(
        app.stage.camera.current,
        [point.x, float(app.stage.state.terrain.height(point.x, point.z)), point.z],  # type: ignore[arg-type]
        app_size(app),  # type: ignore[arg-type]
    )
    if shown is not None:
        tour.drag(shown, (shown[0] + 60.0, shown[1]))
    tour.see("Scene", "##drive path")
    tour.click("##drive path")
    tour.leave()
    tour.picture("another way")
    tour.press("ctrl", "z")
    tour.see("Scene", "Edit its way")
    tour.click("Edit its way")


def mirror(tour: Tour) -> None:
    tour.see("Clips", "##record")
    tour.right_click("row", 0)
    tour.picture("the menu of a take")
    tour.click("Mirror")
    tour.leave()
    tour.picture("mirrored")


def compare(tour: Tour) -> None:
    tour.see("Clips", "##record")
    tour.right_click("row", 0)
    tour.click("Show beside")
    tour.leave()
    x, y = place(tour.app, "##timeline", share=0.4)
    tour.quietly(lambda: click(tour.app, x, y))
    tour.leave()
    tour.picture("a reference beside")
    tour.click("Over it")
    tour.leave()
    tour.picture("a reference over it")
    tour.click("##close reference")


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


def rest(tour: Tour) -> None:
    tour.press("escape")
    tour.click("##settings")
    tour.picture("settings")
    tour.press("escape")
    tour.press("f1")
    tour.picture("help")
    tour.press("f1")
    tour.click("##project")
    tour.picture("the project menu")
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


STEPS = (walk, prompt, record, retime, pin, looks, way, mirror, compare, steady, export, rest)


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
