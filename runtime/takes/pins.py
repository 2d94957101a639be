"""Pins: a hand or foot held at a point, a look at a point, or a held pose, for a time; also as text.

"left hand 0.3 1.1 0.4 from 2 to 4" is a pin; `runtime.takes.pinned` bends the poses.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np

from runtime.arrays import Array
from runtime.easing import smootherstep
from runtime.errors import UsageError

DEFAULT_EASE_S = 0.3
MAX_TIME_S, MAX_COORDINATE_M, MAX_EASE_S = 36_000.0, 100_000.0, 60.0
MAX_PINS = 1000
KEPT_S = 3600.0  # length of the rolling memory
FORM = 'Write "left hand 0.3 1.1 0.4 from 2 to 4", "look 0 1.6 5 from 0 to 3" or "pose 1.5 from 2 to 3".'


class Pinned(StrEnum):
    """The body part held by a pin."""

    LEFT_HAND = "left hand"
    RIGHT_HAND = "right hand"
    LEFT_FOOT = "left foot"
    RIGHT_FOOT = "right foot"
    LOOK = "look"
    POSE = "pose"  # arms, spine and head


@dataclass(frozen=True)
class Pin:
    """A target point for a body part from `start` to `end` (seconds), eased in before and out after.

    `point` is in world metres; for a foot it is where the sole stands. With `rail` the target is the point nearest to
    the shoulder on the line from `point` to `rail`. With `along` it moves with the character: metres to its left, up
    from its ground, ahead. A pose pin holds the pose at the time `of`.
    """

    what: Pinned
    point: tuple[float, float, float] = (0.0, 0.0, 0.0)
    start: float = 0.0
    end: float = 1.0
    ease_in: float = DEFAULT_EASE_S
    ease_out: float = DEFAULT_EASE_S
    rail: tuple[float, float, float] | None = None
    along: bool = False
    of: float = 0.0

    def __post_init__(self) -> None:
        numbers = (*self.point, *(self.rail or ()))
        if not all(abs(value) <= MAX_COORDINATE_M for value in numbers):
            raise UsageError(f"pin {self.what}: a point farther away than {MAX_COORDINATE_M:.0f} m.", FORM)
        if not 0.0 <= self.start <= self.end <= MAX_TIME_S or not 0.0 <= self.of <= MAX_TIME_S:
            raise UsageError(
                f"pin {self.what} from {self.start:g} to {self.end:g} s: expected a start before the end.",
                FORM,
            )
        if not (0.0 <= self.ease_in <= MAX_EASE_S and 0.0 <= self.ease_out <= MAX_EASE_S):
            problem = f"pin {self.what}: ease of {self.ease_in:g} s; expected 0 to {MAX_EASE_S:g}."
            raise UsageError(problem, FORM)

    def weights(self, seconds: Array) -> Array:
        """Return the pin's weights at times `(T,)`: 1 from `start` to `end`, easing to 0 outside."""
        rise = smootherstep((seconds - (self.start - self.ease_in)) / max(self.ease_in, 1e-6))
        fall = smootherstep(((self.end + self.ease_out) - seconds) / max(self.ease_out, 1e-6))
        held = (seconds >= self.start - 1e-9) & (seconds <= self.end + 1e-9)
        return np.where(held, 1.0, np.where(seconds < self.start, rise, fall))

    def end_in(self, seconds: float) -> float:
        """Return the end time of the pin in a clip of a given length."""
        return min(self.end, seconds)


_NUMBER = r"-?\d{1,6}(?:\.\d{1,9})?"
_POINT = rf"({_NUMBER})[ ,]+({_NUMBER})[ ,]+({_NUMBER})"
_PIN = re.compile(
    rf"(?P<what>[a-z ]+?) +(?:at +|to +)?(?:(?P<point>{_POINT})|(?P<of>{_NUMBER}))(?: +rail +(?P<rail>{_POINT}))?"
    rf"(?P<along> +along)?(?: +from +(?P<start>{_NUMBER}) +to +(?P<end>{_NUMBER}))?"
    rf"(?: +ease +(?P<ease_in>{_NUMBER})(?: +(?P<ease_out>{_NUMBER}))?)?"
)


def parse_pins(text: str) -> tuple[Pin, ...]:
    """Parse pins separated by semicolons; without times a pin holds for the whole clip. UsageError shows the form."""
    entries = [entry.strip() for entry in text.split(";") if entry.strip()]
    if len(entries) > MAX_PINS:
        raise UsageError(f"{len(entries)} pins; expected at most {MAX_PINS}.", "Use fewer.")
    return tuple(_parse(entry) for entry in entries)


def _parse(entry: str) -> Pin:
    found = _PIN.fullmatch(" ".join(entry.lower().split()))
    names = [str(name) for name in Pinned]
    if found is None or found["what"] not in names:
        raise UsageError(f"pin '{entry[:60]}': expected what ({', '.join(names)}), a point and times.", FORM)
    what, place = Pinned(found["what"]), _point(found["point"])
    if (place is None) != (what is Pinned.POSE):
        raise UsageError(f"pin '{entry[:60]}': a point is three numbers, a pose one time.", FORM)
    timed = found["start"] is not None
    start, end, ease = (found["start"], found["end"], DEFAULT_EASE_S) if timed else (0.0, MAX_TIME_S, 0.0)
    ease_in = float(found["ease_in"] or ease)
    return Pin(
        what, place or (0.0, 0.0, 0.0), float(start), float(end), ease_in, float(found["ease_out"] or ease_in),
        _point(found["rail"]), found["along"] is not None, float(found["of"] or 0.0),
    )  # fmt: skip


def _point(text: str | None) -> tuple[float, float, float] | None:
    if text is None:
        return None
    x, y, z = (float(part) for part in re.findall(_NUMBER, text))
    return x, y, z


# --- pins of the live character: in seconds since the program's start; a held one ends at `MAX_TIME_S`


def held_pins(pins: Sequence[Pin]) -> tuple[Pin, ...]:
    """Return the pins without an end time, which hold until they are released."""
    return tuple(pin for pin in pins if pin.end >= MAX_TIME_S)


def released(pins: Sequence[Pin], what: Pinned, now: float) -> tuple[Pin, ...]:
    """Return the pins with those of a body part ended now; pins that ended before the recorder's memory are dropped."""
    return tuple(
        replace(pin, start=min(pin.start, now), end=now)
        if pin.what is what and pin.end >= MAX_TIME_S
        else pin
        for pin in pins
        if pin.end > now - KEPT_S
    )


def weights_at(pins: Sequence[Pin], now: float) -> list[tuple[Pin, float]]:
    """Return the pins in force at a time with their weights; a pin held since an earlier run has full weight."""
    found = []
    for pin in pins:
        earlier = pin.end >= MAX_TIME_S and pin.start > now + DEFAULT_EASE_S
        weight = 1.0 if earlier else float(pin.weights(np.array(now)))
        if weight > 0.0:
            found.append((pin, weight))
    return found


def pins_of_take(pins: Sequence[Pin], first: float, length: float) -> tuple[Pin, ...]:
    """Return the pins of a take that starts at `first` (seconds) and lasts `length`, with times relative to it."""
    last, found = first + length, []
    for pin in pins:
        start = first if pin.end >= MAX_TIME_S and pin.start > last + DEFAULT_EASE_S else pin.start
        if pin.end > first and start - pin.ease_in < last:
            begin, end = max(start - first, 0.0), min(pin.end, last) - first
            found.append(replace(pin, start=min(begin, end), end=end))
    return tuple(found)
