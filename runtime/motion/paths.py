"""Scripted sticks: where a character is led without a person at the pad, as pure functions of time and place."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import atan2, cos, hypot, pi, remainder, sin, tau

import numpy as np

from runtime.arrays import Array
from runtime.controls import Controls, Gait
from runtime.errors import UsageError

PATH_NAMES = ("forward", "circle", "figure8", "random")
GAITS = {gait.label: gait for gait in (Gait.WALK, Gait.JOG, Gait.CROUCH, Gait.STAND)}

CIRCLE_RADIUS_M = 3.0
FIGURE_HALF_LENGTH_M = 4.0
LOOK_AHEAD_M = 0.9  # the stick points at the place of the path that lies so far ahead
AREA_M = 14.0  # random paths turn back at this distance from the origin


@dataclass(frozen=True)
class PlanarPose:
    """Where the character is: metres and radians."""

    x: float
    z: float
    yaw: float


ControlScript = Callable[[float, PlanarPose], Controls]  # seconds since the start, current place


def control_script(path: str, gait: str, speed: float = 1.0, seed: int = 0) -> ControlScript:
    """Script of one of `PATH_NAMES` in one of `GAITS`; `speed` 0..1 is the share of the full stick.

    The same arguments, time and place give the same controls. UsageError names what is unknown.
    """
    if gait not in GAITS:
        raise UsageError(f" {gait}: expected {', '.join(GAITS)}.", "Choose one of them.", "gait")
    if not 0.0 < speed <= 1.0:
        raise UsageError(f" {speed}: expected more than 0 and at most 1 (full stick).", "Try 1.", "speed")
    if path not in PATH_NAMES:
        raise UsageError(f" {path}: expected {', '.join(PATH_NAMES)}.", "Choose one of them.", "path")
    if gait == "stand":
        return lambda _time, _place: Controls(gait=Gait.WALK)
    wanted = GAITS[gait]
    if path == "forward":
        return lambda _time, place: Controls(_towards(place, 0.0, place.z + 2.0, speed), gait=wanted)
    if path == "random":
        return _random_script(wanted, speed, seed)
    curve = _circle() if path == "circle" else _figure8()
    return lambda _time, place: Controls(_along(curve, place, speed), gait=wanted)


def _towards(place: PlanarPose, x: float, z: float, speed: float) -> tuple[float, float]:
    dx, dz = x - place.x, z - place.z
    distance = max(hypot(dx, dz), 1e-6)
    return speed * dx / distance, speed * dz / distance


def _along(curve: Array, place: PlanarPose, speed: float) -> tuple[float, float]:
    """Stick towards the point of the closed curve `(N, 3)` (x, z, heading) ahead of the nearest one.

    Where the curve crosses itself the branch that the character faces is the near one.
    """
    turn = np.abs(np.remainder(curve[:, 2] - place.yaw + pi, tau) - pi)
    away = (curve[:, 0] - place.x) ** 2 + (curve[:, 1] - place.z) ** 2
    nearest = int(np.argmin(away + np.minimum(turn, 2.0) ** 2))
    spacing = float(np.hypot(*(curve[1, :2] - curve[0, :2])))
    ahead = curve[(nearest + max(1, round(LOOK_AHEAD_M / spacing))) % len(curve)]
    return _towards(place, float(ahead[0]), float(ahead[1]), speed)


def _circle() -> Array:
    """Clockwise (seen from above, towards +X) circle through the origin, which it leaves along +Z."""
    t = np.linspace(0.0, tau, 240, endpoint=False)
    x, z = CIRCLE_RADIUS_M * (1.0 - np.cos(t)), CIRCLE_RADIUS_M * np.sin(t)
    return np.stack([x, z, t], axis=-1)


def _figure8() -> Array:
    """Lemniscate of Gerono along X through the origin, resampled to equal steps."""
    t = np.linspace(0.0, tau, 2001)
    x, z = FIGURE_HALF_LENGTH_M * np.sin(t), FIGURE_HALF_LENGTH_M * np.sin(t) * np.cos(t)
    length = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(x), np.diff(z)))])
    even = np.interp(np.linspace(0.0, length[-1], 400, endpoint=False), length, t)
    dx, dz = np.cos(even), np.cos(2.0 * even)
    x, z = FIGURE_HALF_LENGTH_M * np.sin(even), FIGURE_HALF_LENGTH_M * np.sin(even) * np.cos(even)
    return np.stack([x, z, np.arctan2(dx, dz)], axis=-1)


def _random_script(gait: Gait, speed: float, seed: int) -> ControlScript:
    """A new direction and stick length every 1.5 to 4 s, sometimes none; back to the middle from outside."""
    rng = np.random.default_rng(seed)
    count = 4096  # at least 100 minutes; then it begins again
    ends = np.cumsum(rng.uniform(1.5, 4.0, count))
    headings = np.cumsum(rng.normal(0.0, 1.2, count))
    lengths = rng.choice([0.0, 0.6, 1.0, 1.0, 1.0], count)
    lengths[0] = 1.0

    def script(time: float, place: PlanarPose) -> Controls:
        k = int(np.searchsorted(ends, time % ends[-1], side="right"))
        heading, length = float(headings[k]), speed * float(lengths[k])
        home = atan2(-place.x, -place.z)
        if hypot(place.x, place.z) > AREA_M and abs(remainder(heading - home, tau)) > 0.5 * pi:
            heading = home + 0.4 * (1.0 if k % 2 else -1.0)
        return Controls((length * sin(heading), length * cos(heading)), gait=gait)

    return script
