"""Random actions in the real application without a display: `python -m tests.monkey --actions 5000 --seed 1`.

Every action is one that a user can do: keys, clicks, words, files dropped, takes recorded, edited and exported. Whatever
raises ends the run with the actions before it; the slowest pictures and the memory are printed at the end. Without a
graphics card drawing takes most of a picture, so that it is told apart from the rest.
"""

from __future__ import annotations

import argparse
import gc
import logging
import random
import tempfile
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from runtime.takes.pins import Pinned
from runtime.terrain.files import write_height_png
from tests.helpers import hand
from tests.helpers.viewer_fakes import FakeRenderer, fake_services
from viewer.app import App
from viewer.input.bindings import Action
from viewer.options import ViewOptions
from viewer.process import resident_mb
from viewer.services import Services
from viewer.window import KEY_CODES

WORDS = ("a proud king", "an old king", "limping", "", "x" * 300, "zombie, arms out", "\u2603 snow")
NOT_PRESSED = {Action.FULLSCREEN}
SHOWN = 8  # slow pictures


@dataclass(frozen=True, order=True)
class Slow:
    """Seconds of one picture: of the processor without drawing, passed without drawing, and passed in all."""

    worked: float
    passed: float
    whole: float
    action: str

    def __str__(self) -> str:
        worked, passed, whole = (f"{1e3 * s:6.0f}" for s in (self.worked, self.passed, self.whole))
        return f"{worked} ms of the processor, {passed} ms passed, {whole} ms with drawing  {self.action}"


@dataclass
class Drawing:
    """Time spent in the graphics library, of the main thread."""

    worked: float = 0.0
    passed: float = 0.0

    def timed(self, draw: Callable[..., Any]) -> Callable[..., Any]:
        """The same function, whose time is added."""

        def call(*arguments: Any, **named: Any) -> Any:
            begun, worked = time.perf_counter(), time.thread_time()
            try:
                return draw(*arguments, **named)
            finally:
                self.passed += time.perf_counter() - begun
                self.worked += time.thread_time() - worked

        return call


@dataclass
class Monkey:
    """Does one random thing after the other to an application."""

    app: App
    folder: Path
    rng: random.Random
    drawing: Drawing = field(default_factory=Drawing)
    done: deque[str] = field(default_factory=lambda: deque(maxlen=12))
    slowest: list[Slow] = field(default_factory=list)
    most_mb: float = 0.0
    broken: list[str] = field(default_factory=list)  # jobs that failed in a way that nobody foresaw

    def __post_init__(self) -> None:
        for name in ("draw_interface", "present", "read_pixels"):
            setattr(self.app.window, name, self.drawing.timed(getattr(self.app.window, name)))
        unforeseen = logging.Handler(logging.ERROR)
        unforeseen.filter = lambda record: record.exc_info is not None  # type: ignore[assignment, method-assign, return-value]
        unforeseen.emit = lambda record: self.broken.append(record.getMessage())  # type: ignore[method-assign]
        logging.getLogger("sport.viewer").addHandler(unforeseen)

    def frame(self, count: int = 1) -> None:
        """Show pictures, and remember the slow ones."""
        for _ in range(count):
            begun, worked = time.perf_counter(), time.thread_time()
            drawn = (self.drawing.worked, self.drawing.passed)
            self.app.frame()
            whole = time.perf_counter() - begun
            worked = time.thread_time() - worked - (self.drawing.worked - drawn[0])
            passed = whole - (self.drawing.passed - drawn[1])
            slow = Slow(worked, passed, whole, self.done[-1] if self.done else "")
            self.slowest = sorted([*self.slowest, slow])[-SHOWN:]

    def keep(self, takes: int) -> None:
        """Walk for ten seconds, then put the last ten into the list again and again."""
        if takes:
            self.done.append("last_seconds")
            self.app.window.inject_key("w", True)
            self.frame(600)
            self.app.window.inject_key("w", False)
        for _ in range(takes):
            self.app.takes.save_last()
            self.frame(3)
            self.most_mb = max(self.most_mb, resident_mb())

    def act(self) -> None:
        """One random action and some pictures."""
        names = [name for name in dir(self) if name.startswith("do_")]
        name = self.rng.choice(names)
        self.done.append(name[3:])
        getattr(self, name)()
        self.frame(self.rng.choice((1, 1, 2, 5)))

    # --- what it does

    def do_press(self) -> None:
        actions = sorted((a for a in self.app.actions if a not in NOT_PRESSED), key=lambda a: a.name)
        action = self.rng.choice(actions)
        self.done[-1] = f"press {action.name}"
        self.app.actions[action]()

    def do_key(self) -> None:
        name = self.rng.choice(sorted(set(KEY_CODES) - {"f11"}))
        self.done[-1] = f"key {name}"
        self.app.window.inject_key(name, True)
        self.frame()
        self.app.window.inject_key(name, False)

    def do_click(self) -> None:
        width, height = self.app.window.unscaled_size
        x, y = self.rng.uniform(0, width), self.rng.uniform(0, height)
        self.done[-1] = f"click {x:.0f} {y:.0f}"
        for down in (False, True, False):
            hand.mouse(self.app.window, x, y, 0 if down else None, down)
            self.frame()

    def do_type(self) -> None:
        hand.text(self.app.window, self.rng.choice(WORDS))

    def do_walk(self) -> None:
        self.app.window.inject_key("w", True)
        self.frame(10)
        self.app.window.inject_key("w", False)

    def do_prompt(self) -> None:
        self.app.prompting.submit_prompt(self.rng.choice(WORDS))

    def do_record(self) -> None:
        self.app.takes.toggle_recording()

    def do_last_seconds(self) -> None:
        self.app.takes.save_last()

    def take(self) -> int:
        """The number of a take of the list; 1 where it is empty."""
        return self.rng.choice([take.number for take in self.app.editor.session.takes] or [1])

    def do_play(self) -> None:
        self.app.takes.play(self.take())

    def do_trim(self) -> None:
        playback = self.app.takes.playback
        if playback is not None:
            name, held = self.rng.choice(("first", "last")), self.rng.random() < 0.5
            self.app.takes.trim(**{name: self.rng.randrange(playback.frames)}, held=held)

    def do_edit(self) -> None:
        if self.app.takes.playback is not None:
            self.app.editing.insert_prompt(self.rng.choice(WORDS[:3]))

    def do_undo(self) -> None:
        self.app.editor.undo()

    def do_redo(self) -> None:
        self.app.editor.redo()

    def do_export(self) -> None:
        self.app.takes.select(self.take())
        self.app.takes.export()

    def do_remove(self) -> None:
        self.app.takes.remove(self.take())

    def do_move(self) -> None:
        self.app.takes.move(self.take(), self.rng.choice((-1, 1)))

    def do_mirror(self) -> None:
        self.app.takes.mirror(self.take())

    def do_color(self) -> None:
        self.app.takes.set_color(self.take(), self.rng.randrange(6))

    def do_pin(self) -> None:
        self.app.pins.add(self.rng.choice(list(Pinned)))

    def do_camera_key(self) -> None:
        self.app.camera_keys.add()

    def do_compare(self) -> None:
        self.app.references.show(self.take())

    def do_ground(self) -> None:
        self.app.scene.load_terrain(
            self.rng.choice(["flat", "hills", "stairs", str(self.folder / "dunes.png")])
        )

    def do_drop(self) -> None:
        files = sorted(self.folder.glob("clips/*.bvh")) + sorted(self.folder.glob("*.*"))
        self.app.open_files([self.rng.choice(files)])

    def do_save(self) -> None:
        self.app.sessions.save_as(self.folder / f"monkey{self.rng.randrange(2)}.sport")

    def do_session(self) -> None:
        self.rng.choice((self.app.sessions.new, self.app.sessions.revert, self.app.sessions.open_last))()

    def do_wall(self) -> None:
        self.app.compare.toggle()

    def do_more_on_the_wall(self) -> None:
        self.rng.choice((self.app.compare.add, lambda: self.app.compare.remove(0)))()

    def do_wall_of_blends(self) -> None:
        self.rng.choice((self.app.compare.seeds, self.app.compare.last_prompts))()

    def do_export_window(self) -> None:
        self.rng.choice((self.app.exporting.open, self.app.exporting.propose))()


def services(model: str, draws: bool, drawing: Drawing) -> Services:
    """A real model (by folder, "" is the shipped one) or "fake"; a real renderer, or one that clears the picture."""
    fake = fake_services(real_renderer=draws)
    real = Services()
    make = real.make_renderer if draws else FakeRenderer

    def make_renderer(context: Any, quality: str) -> Any:
        renderer = make(context, quality)
        renderer.render = drawing.timed(renderer.render)
        return renderer

    if model == "fake":
        return replace(fake, make_renderer=make_renderer)
    chosen = Path(model) if model else None
    return replace(
        real,
        load_model=lambda folder, terrain, seed, gpt: real.load_model(folder or chosen, terrain, seed, gpt),
        load_character=fake.load_character,
        make_renderer=make_renderer,
    )


def run(
    actions: int,
    seed: int,
    say: Callable[[str], None] = print,
    model: str = "fake",
    draws: bool = False,
    takes: int = 0,
) -> Monkey:
    """So many random actions, with so many takes in the list; raises what the application raises, with the actions before it."""
    with tempfile.TemporaryDirectory() as home:
        folder, drawing = Path(home), Drawing()
        write_height_png(folder / "dunes.png", [[0.0, 0.5, 0.0], [0.5, 1.0, 0.5], [0.0, 0.5, 0.0]])
        (folder / "damaged.bvh").write_text("HIERARCHY\n", encoding="utf-8")
        (folder / "damaged.sport").write_bytes(b"PK")
        options = ViewOptions(offscreen=True, terrain="flat")
        app = App(options, services(model, draws, drawing), config=folder / "config")
        app.settings.export_folder = str(folder / "clips")
        monkey = Monkey(app, folder, random.Random(seed), drawing)
        try:
            monkey.keep(takes)
            if takes:
                say(f"{resident_mb():.0f} MB, {len(app.editor.session.takes)} takes")
            for number in range(1, actions + 1):
                monkey.act()
                assert not monkey.broken, monkey.broken
                if number % 100 == 0:
                    monkey.most_mb = max(monkey.most_mb, resident_mb())
                if number % 500 == 0:
                    gc.collect()
                    say(f"{number} actions, {resident_mb():.0f} MB, {len(app.editor.session.takes)} takes")
                    say(f"slowest: {monkey.slowest[-1]}")
        except BaseException as error:
            error.add_note(f"seed {seed}, after: {', '.join(monkey.done)}")
            raise
        finally:
            app.close()
        return monkey


def main() -> None:
    """The command."""
    parser = argparse.ArgumentParser(prog="python -m tests.monkey", description=__doc__)
    parser.add_argument("--actions", type=int, default=5000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument(
        "--model", default="", help='folder of a model, or "fake"; the shipped one by default'
    )
    parser.add_argument(
        "--takes", type=int, default=0, help="of ten seconds, in the list before the first action"
    )
    parser.add_argument("--draw", action="store_true", help="draw with the real renderer")
    options = parser.parse_args()
    monkey = run(options.actions, options.seed, model=options.model, draws=options.draw, takes=options.takes)
    for slow in reversed(monkey.slowest):
        print(slow)
    print(f"at most {monkey.most_mb:.0f} MB, {resident_mb():.0f} MB at the end")


if __name__ == "__main__":
    main()
