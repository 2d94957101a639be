"""Pins of the live character: what it holds or looks at while it is driven, over the pose of the network."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from runtime.pose import FPS, Pose
from runtime.takes.pinned import bent_pose
from runtime.takes.pins import DEFAULT_EASE_S, MAX_TIME_S, Pin, Pinned
from viewer.stage.simulation import make_pose

KEPT_S = 3600.0  # that the rolling memory may hold: pins that ended before are forgotten


@dataclass
class LivePins:
    """Pins in seconds of the program's own count of frames; one that is still held ends at `MAX_TIME_S`."""

    pins: list[Pin] = field(default_factory=list)

    @property
    def held(self) -> tuple[Pin, ...]:
        """Those that hold now."""
        return tuple(pin for pin in self.pins if pin.end >= MAX_TIME_S)

    def hold(self, what: Pinned, point: Sequence[float], now: float) -> None:
        """Begin to hold a part of the body at a point (metres)."""
        self.release(what, now)
        x, y, z = (float(value) for value in point)
        self.pins.append(Pin(what, (x, y, z), now + DEFAULT_EASE_S, MAX_TIME_S))

    def change(self, index: int, pin: Pin) -> None:
        """Another point for one of `held`."""
        held = self.held[index]
        self.pins[[id(one) for one in self.pins].index(id(held))] = pin

    def release(self, what: Pinned, now: float) -> None:
        """Let go of what a part holds."""
        self.pins = [
            replace(pin, start=min(pin.start, now), end=now)
            if pin.what is what and pin.end >= MAX_TIME_S
            else pin
            for pin in self.pins
            if pin.end > now - KEPT_S
        ]

    def bend(self, pose: Pose, now: float) -> Pose:
        """The pose with what holds at a time; the same object where nothing does."""
        at = np.array(now)
        weights = [(pin, float(pin.weights(at))) for pin in self.pins if pin.end + pin.ease_out > now]
        weights = [(pin, weight) for pin, weight in weights if weight > 0.0]
        if not weights:
            return pose
        hips, local, contacts = bent_pose(pose.hips_position, pose.local_rotations, pose.contacts, weights)
        return make_pose(hips, local, contacts, float(pose.root_position[1]), pose.root_yaw)

    def cut(self, first_frame: int, frames: int) -> tuple[Pin, ...]:
        """The pins of a take of so many frames, in its own time."""
        first, last = first_frame / FPS, (first_frame + frames) / FPS
        return tuple(
            replace(pin, start=max(pin.start - first, 0.0), end=min(pin.end, last) - first)
            for pin in self.pins
            if pin.end + pin.ease_out > first and pin.start - pin.ease_in < last and pin.end > first
        )
