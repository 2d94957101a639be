"""Combines keyboard, gamepad and key script into one request per frame."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from runtime.errors import UsageError
from viewer.input.bindings import InputMapper, Intent, Keyboard, key_tables
from viewer.input.gamepad import GamepadSource
from viewer.settings import Settings

IDLE = "idle"
MAX_SECONDS = 24 * 3600.0


@dataclass(frozen=True)
class KeyScript:
    """A script of key chords, each held for a time in seconds."""

    steps: tuple[tuple[frozenset[str], float], ...] = ()

    @staticmethod
    def parse(text: str, known_keys: frozenset[str]) -> KeyScript:
        """Parse a script; UsageError names the step that cannot be read."""
        steps = (step.strip() for step in text.split(";"))
        return KeyScript(tuple(_parse_step(step, known_keys) for step in steps if step))

    def keys_at(self, time_s: float) -> frozenset[str]:
        """Return the keys held at a time; none after the end."""
        for keys, seconds in self.steps:
            if time_s < seconds - 1e-9:
                return keys
            time_s -= seconds
        return frozenset()


def _parse_step(step: str, known_keys: frozenset[str]) -> tuple[frozenset[str], float]:
    words = step.split()
    remedy = 'Write a script such as "w 2.0; w+shift 1.5; idle 1".'
    if len(words) != 2:
        raise UsageError(f'--keys: the step "{step[:60]}" needs keys and seconds.', remedy)
    try:
        seconds = float(words[1])
    except ValueError:
        seconds = -1.0
    if not 0.0 < seconds <= MAX_SECONDS:
        raise UsageError(f'--keys: "{words[1][:60]}" is not a time in seconds.', remedy)
    if words[0].lower() == IDLE:
        return frozenset(), seconds
    keys = frozenset(words[0].lower().split("+"))
    unknown = sorted(keys - known_keys)
    if unknown:
        raise UsageError(f'--keys: there is no key "{unknown[0][:60]}".', remedy)
    return keys, seconds


KEYBOARD = "keyboard"


@dataclass
class Devices:
    """All input devices; `name` is the gamepad in use, or the keyboard."""

    pads: GamepadSource
    script: KeyScript
    press: Callable[[str, bool], None]  # simulates a key press or release
    keyboard: Keyboard = field(default_factory=Keyboard)
    mapper: InputMapper = field(default_factory=InputMapper)
    name: str = KEYBOARD
    _scripted: frozenset[str] = frozenset()
    _keys: str = ""  # the user's changes, see `bindings.bound`

    def acts_alone(self, name: str) -> bool:
        """Return whether a single letter is bound to an action in the view."""
        return len(name) == 1 and any(name in keys for keys in key_tables(self._keys)[0].values())

    def play_script(self, time_s: float) -> None:
        """Press and release the keys of the script at this time."""
        keys = self.script.keys_at(time_s)
        for name in sorted(self._scripted - keys):
            self.press(name, False)
        for name in sorted(keys - self._scripted):
            self.press(name, True)
        self._scripted = keys

    def read(
        self, dt: float, typing: bool, settings: Settings, take: bool, listed: bool
    ) -> tuple[Intent, str]:
        """Return the intent of a frame of `dt` seconds, and a message if a gamepad came or went.

        `take`: a take is shown, and some keys control it; `listed`: a take is selected in the list.
        """
        self._keys = settings.keys
        if typing:
            self.keyboard.release_all()
        pad = self.pads.poll()
        before, self.name = self.name, KEYBOARD if pad is None else pad.name
        changed = f"{self.name} connected." if pad else "Gamepad disconnected: use keyboard and mouse."
        intent = self.mapper.read(
            self.keyboard, pad, dt, settings.dead_zone, settings.invert_look, take, listed,
            settings.pad_buttons, settings.keys,
        )  # fmt: skip
        return intent, changed if self.name != before else ""
