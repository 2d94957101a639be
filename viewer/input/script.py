"""Scripted keys: "w 2.0; w+shift 1.5; idle 1" holds W for two seconds, then W with Shift, then nothing."""

from __future__ import annotations

from dataclasses import dataclass

from runtime.errors import UsageError

IDLE = "idle"
MAX_SECONDS = 24 * 3600.0


@dataclass(frozen=True)
class KeyScript:
    """Key chords and how long each is held, in seconds."""

    steps: tuple[tuple[frozenset[str], float], ...] = ()

    @staticmethod
    def parse(text: str, known_keys: frozenset[str]) -> KeyScript:
        """Read a script; UsageError names the step that cannot be read."""
        steps = []
        for step in (part.strip() for part in text.split(";")):
            if step:
                steps.append(_parse_step(step, known_keys))
        return KeyScript(tuple(steps))

    def keys_at(self, time_s: float) -> frozenset[str]:
        """Keys held at a time; nothing after the end."""
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
        raise UsageError(f'--keys: "{words[1][:60]}" is no time in seconds.', remedy)
    if words[0].lower() == IDLE:
        return frozenset(), seconds
    keys = frozenset(words[0].lower().split("+"))
    unknown = sorted(keys - known_keys)
    if unknown:
        raise UsageError(f'--keys: there is no key "{unknown[0][:60]}".', remedy)
    return keys, seconds
