"""Random actions in the real application without a display: `python -m tests.monkey --actions 5000 --seed 1`.

Every action is one that a user can do: keys, clicks, words, files dropped, takes recorded, edited and exported. Whatever
raises ends the run with the actions before it.
"""

import argparse
import gc
import logging
import random
import tempfile
from collections import deque
from collections.abc import Callable
from pathlib import Path

from runtime.takes.pins import Pinned
from tests.helpers import hand
from tests.helpers.app_driver import run as show
from tests.helpers.height_maps import write_height_png
from tests.helpers.viewer_fakes import fake_services
from viewer.app import App
from viewer.input.bindings import Action
from viewer.options import ViewOptions
from viewer.process import resident_mb
from viewer.services import Services
from viewer.window import KEY_CODES

WORDS = ("a proud king", "an old king", "limping", "", "x" * 300, "zombie, arms out", "\u2603 snow")
NOT_PRESSED = {Action.FULLSCREEN}


class Monkey:
    """Does one random thing after the other to an application; `done` are the last ones."""

    def __init__(self, app: App, folder: Path, seed: int) -> None:
        self.app, self.folder, self.rng = app, folder, random.Random(seed)
        self.done: deque[str] = deque(maxlen=12)
        self.broken: list[str] = []  # jobs that failed in a way that nobody foresaw
        unforeseen = logging.Handler(logging.ERROR)
        unforeseen.filter = lambda record: record.exc_info is not None  # type: ignore[assignment, method-assign, return-value]
        unforeseen.emit = lambda record: self.broken.append(record.getMessage())  # type: ignore[method-assign]
        logging.getLogger("sport.viewer").addHandler(unforeseen)
        self.acts = self._acts()

    def act(self) -> None:
        """One random action and some pictures."""
        name = self.rng.choice(sorted(self.acts))
        self.done.append(name)
        self.acts[name]()
        show(self.app, self.rng.choice((1, 1, 2, 5)))
        assert not self.broken, self.broken

    def _acts(self) -> dict[str, Callable[[], object]]:
        app, choice = self.app, self.rng.choice
        takes, compare, sessions = app.takes, app.compare, app.sessions
        grounds = ["flat", "hills", "stairs", str(self.folder / "dunes.png")]
        return {
            "press": self.press,
            "key": lambda: self.key(choice(sorted(set(KEY_CODES) - {"f11"})), 1),
            "walk": lambda: self.key("w", 10),
            "click": self.click,
            "type": lambda: hand.text(app.window, choice(WORDS)),
            "prompt": lambda: app.prompting.submit_prompt(choice(WORDS)),
            "record": takes.toggle_recording,
            "last seconds": takes.save_last,
            "play": lambda: takes.play(self.take()),
            "trim": self.trim,
            "edit": lambda: takes.playback is not None and app.editing.insert_prompt(choice(WORDS[:3])),
            "undo": app.editor.undo,
            "redo": app.editor.redo,
            "export": lambda: (takes.select(self.take()), app.bvh_export.export()),
            "remove": lambda: takes.remove(self.take()),
            "selection": lambda: self.act_on_selection(),
            "mirror": lambda: takes.mirror(self.take()),
            "color": lambda: takes.set_color(self.take(), self.rng.randrange(6)),
            "pin": lambda: app.pins.add(choice(list(Pinned))),
            "camera key": app.camera_keys.add,
            "reference": lambda: app.references.show(self.take()),
            "ground": lambda: app.scene.load_terrain(choice(grounds)),
            "drop": self.drop,
            "save": lambda: sessions.save_as(self.folder / f"monkey{self.rng.randrange(2)}.sport"),
            "session": lambda: choice((sessions.new, sessions.revert, sessions.open_last))(),
            "compare": compare.toggle,
            "one more or less": lambda: choice((compare.add, lambda: compare.remove(0)))(),
            "compare blends": lambda: choice((compare.seeds, compare.last_prompts))(),
            "export window": lambda: choice((app.exporting.open, app.exporting.propose))(),
        }

    def take(self) -> int:
        """The number of a take of the list; 1 where it is empty."""
        return self.rng.choice([take.number for take in self.app.editor.session.takes] or [1])

    def press(self) -> None:
        actions = sorted((a for a in self.app.actions if a not in NOT_PRESSED), key=lambda a: a.name)
        action = self.rng.choice(actions)
        self.done[-1] = f"press {action.name}"
        self.app.actions[action]()

    def key(self, name: str, frames: int) -> None:
        self.done[-1] = f"key {name}"
        self.app.window.inject_key(name, True)
        show(self.app, frames)
        self.app.window.inject_key(name, False)

    def click(self) -> None:
        width, height = self.app.window.unscaled_size
        x, y = self.rng.uniform(0, width), self.rng.uniform(0, height)
        self.done[-1] = f"click {x:.0f} {y:.0f}"
        for down in (False, True, False):
            hand.mouse(self.app.window, x, y, 0 if down else None, down)
            show(self.app)

    def trim(self) -> None:
        playback = self.app.takes.playback
        if playback is not None:
            name, held = self.rng.choice(("first", "last")), self.rng.random() < 0.5
            self.app.takes.trim(**{name: self.rng.randrange(playback.frames)}, held=held)

    def act_on_selection(self) -> None:
        """Select something or all of a kind, and do one thing to it."""
        chosen = self.app.transport.selection
        items = chosen.all([self.rng.choice(sorted(chosen.kinds))])
        chosen.pick(self.rng.choice((items[:1], items, items[-1:])))
        acts = (chosen.delete, chosen.copy, chosen.cut, chosen.paste, chosen.duplicate, chosen.pick_all)
        act = self.rng.choice((*acts, lambda: chosen.nudge(1), lambda: chosen.nudge(-10)))
        self.done[-1] = f"selection {[item.key for item in items]}: {act}"
        act()

    def drop(self) -> None:
        files = sorted(self.folder.glob("clips/*.bvh")) + sorted(self.folder.glob("*.*"))
        self.app.open_files([self.rng.choice(files)])


def run(actions: int, seed: int, services: Services, say: Callable[[str], None] = print) -> Monkey:
    """So many random actions; raises what the application raises, with the actions before it."""
    with tempfile.TemporaryDirectory() as home:
        folder = Path(home)
        write_height_png(folder / "dunes.png", [[0.0, 0.5, 0.0], [0.5, 1.0, 0.5], [0.0, 0.5, 0.0]])
        (folder / "damaged.bvh").write_text("HIERARCHY\n", encoding="utf-8")
        (folder / "damaged.sport").write_bytes(b"PK")
        app = App(ViewOptions(offscreen=True, terrain="flat"), services, config=folder / "config")
        app.settings.export_folder = str(folder / "clips")
        monkey = Monkey(app, folder, seed)
        try:
            for number in range(1, actions + 1):
                monkey.act()
                if number % 500 == 0:
                    gc.collect()
                    say(f"{number} actions, {resident_mb():.0f} MB, {len(app.editor.session.takes)} takes")
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
    parser.add_argument("--fake", action="store_true", help="a fake model, and no drawing")
    options = parser.parse_args()
    run(options.actions, options.seed, fake_services() if options.fake else Services())
    print(f"{resident_mb():.0f} MB at the end")


if __name__ == "__main__":
    main()
