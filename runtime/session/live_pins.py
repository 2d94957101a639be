"""Pins of the live character, in seconds of the program's own count of frames; a held one ends at `MAX_TIME_S`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from runtime.pose import FPS
from runtime.takes.pins import DEFAULT_EASE_S, MAX_TIME_S, Pin, Pinned

KEPT_S = 3600.0  # that the rolling memory may hold: pins that ended before are forgotten
Pins = tuple[Pin, ...]


def held(pins: Pins) -> Pins:
    """Those that hold now."""
    return tuple(pin for pin in pins if pin.end >= MAX_TIME_S)


def with_held(pins: Pins, what: Pinned, point: Sequence[float], now: float) -> Pins:
    """Begin to hold a part of the body at a point (metres)."""
    x, y, z = (float(value) for value in point)
    return (*released(pins, what, now), Pin(what, (x, y, z), now + DEFAULT_EASE_S, MAX_TIME_S))


def released(pins: Pins, what: Pinned, now: float) -> Pins:
    """Let go of what a part holds."""
    return tuple(
        replace(pin, start=min(pin.start, now), end=now)
        if pin.what is what and pin.end >= MAX_TIME_S
        else pin
        for pin in pins
        if pin.end > now - KEPT_S
    )


def weights(pins: Pins, now: float) -> list[tuple[Pin, float]]:
    """The pins that bend the pose of a time, with their weights; one held since an earlier run of the program holds fully."""
    found = []
    for pin in pins:
        earlier = pin.end >= MAX_TIME_S and pin.start > now + DEFAULT_EASE_S
        weight = 1.0 if earlier else float(pin.weights(np.array(now)))
        if weight > 0.0:
            found.append((pin, weight))
    return found


def of_take(pins: Pins, first_frame: int, frames: int) -> Pins:
    """The pins of a take of so many frames from `first_frame` on, in its own time."""
    first, last = first_frame / FPS, (first_frame + frames) / FPS
    found = []
    for pin in pins:
        start = first if pin.end >= MAX_TIME_S and pin.start > last + DEFAULT_EASE_S else pin.start
        if pin.end > first and start - pin.ease_in < last:
            begin, end = max(start - first, 0.0), min(pin.end, last) - first
            found.append(replace(pin, start=min(begin, end), end=end))
    return tuple(found)
