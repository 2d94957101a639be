"""Keyboard, gamepad and the script of keys as one: what they ask for in each frame."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from viewer.input.bindings import BINDINGS, InputMapper, Intent
from viewer.input.gamepad import GamepadSource
from viewer.input.keyboard import Keyboard
from viewer.input.script import KeyScript
from viewer.settings import Settings

KEYBOARD = "keyboard"


@dataclass
class Devices:
    """What drives the character; `name` is the gamepad in use, or the keyboard."""

    pads: GamepadSource
    script: KeyScript
    press: Callable[[str, bool], None]  # does as if a key went down or up
    keyboard: Keyboard = field(default_factory=Keyboard)
    mapper: InputMapper = field(default_factory=InputMapper)
    name: str = KEYBOARD
    _scripted: frozenset[str] = frozenset()

    @staticmethod
    def acts_alone(name: str) -> bool:
        """Whether a letter does something in the view."""
        return len(name) == 1 and any(name in binding.keys for binding in BINDINGS)

    def play_script(self, time_s: float) -> None:
        """Press and release the keys that the script holds at this time."""
        keys = self.script.keys_at(time_s)
        for name in sorted(self._scripted - keys):
            self.press(name, False)
        for name in sorted(keys - self._scripted):
            self.press(name, True)
        self._scripted = keys

    def read(self, dt: float, typing: bool, settings: Settings, take: bool) -> tuple[Intent, str]:
        """The intent of a frame of `dt` seconds, and what there is to say of a pad that came or went.

        `take`: one is shown, and some keys are its.
        """
        if typing:
            self.keyboard.release_all()
        pad = self.pads.poll()
        before, self.name = self.name, KEYBOARD if pad is None else pad.name
        changed = f"{self.name} connected." if pad else "Gamepad gone: keyboard and mouse drive."
        intent = self.mapper.read(self.keyboard, pad, dt, settings.dead_zone, settings.invert_look, take)
        return intent, changed if self.name != before else ""
