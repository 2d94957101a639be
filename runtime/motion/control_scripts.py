"""Scripted sticks: paths by name, paths of points on the ground, and the stick of a clip as text.

Text: "stand 2; walk 3; walk@90 3; jog@0*0.5 2; walk@90>0 2; jump 1". Segments `GAIT[@HEADING][*AMOUNT][>FACING] SECONDS`
are separated by semicolons:

- GAIT: stand, walk, jog, crouch or jump. `jump` presses the button at its beginning and keeps the stick position.
- HEADING: degrees in the world; 0 is +Z, 90 is +X (the left of a character that faces +Z). Default 0.
- AMOUNT: fraction of the full stick, 0 to 1. Default 1; `crouch*0` crouches in place.
- FACING: degrees that the body faces in any direction of travel (strafing); by default it faces where it goes.
- SECONDS: how long the segment lasts.

After the last segment the stick is at rest.
"""

from __future__ import annotations

import re
from bisect import bisect_right
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import accumulate
from math import atan2, cos, hypot, pi, radians, remainder, sin, tau

import numpy as np

from runtime.arrays import Array
from runtime.controls import REQUESTS, Controls, Gait
from runtime.errors import UsageError
from runtime.scalar_math import MIN_SIZE

PATH_NAMES = ("forward", "circle", "figure8", "random")
GAITS = {gait.label: gait for gait in (Gait.WALK, Gait.JOG, Gait.CROUCH, Gait.STAND)}

CIRCLE_RADIUS_M = 3.0
FIGURE_HALF_LENGTH_M = 4.0
LOOK_AHEAD_M = 0.9  # the stick points at the point of the path this far ahead
AREA_M = 14.0  # random paths turn back at this distance from the origin
STRETCHES = 4096  # straight parts of a random path: at least 100 minutes; then it repeats
STRETCH_RANGE_S, TURN_DEVIATION_RAD = (1.5, 4.0), 1.2  # duration of each, and turn from the one before
STICK_FRACTIONS = (0.0, 0.6, 1.0, 1.0, 1.0)  # of the full stick, equally likely: at rest, slow, full
HOME_OFFSET_RAD = 0.4  # beside the origin, alternately left and right, where it turns back to
CIRCLE_POINTS, FIGURE_POINTS, FINE_POINTS = 240, 400, 2001  # points per path; to measure a curve's length


@dataclass(frozen=True)
class PlanarPose:
    """Position (metres) and yaw (radians) of the character on the ground."""

    x: float
    z: float
    yaw: float


ControlScript = Callable[[float, PlanarPose], Controls]  # seconds since the start, current place


def control_script(path: str, gait: str, speed: float = 1.0, seed: int = 0) -> ControlScript:
    """Return the control script of one of `PATH_NAMES` in one of `GAITS`; `speed` 0..1 is the fraction of the full stick.

    The same arguments, time and place give the same controls. Raises UsageError for an unknown name.
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
    distance = max(hypot(dx, dz), MIN_SIZE)
    return speed * dx / distance, speed * dz / distance


def _along(curve: Array, place: PlanarPose, speed: float) -> tuple[float, float]:
    """Stick towards the point of the closed curve `(N, 3)` (x, z, heading) ahead of the nearest one.

    Where the curve crosses itself, the branch that the character faces is taken.
    """
    turn = np.abs(np.remainder(curve[:, 2] - place.yaw + pi, tau) - pi)
    away = (curve[:, 0] - place.x) ** 2 + (curve[:, 1] - place.z) ** 2
    nearest = int(np.argmin(away + np.minimum(turn, 2.0) ** 2))
    spacing = float(np.hypot(*(curve[1, :2] - curve[0, :2])))
    ahead = curve[(nearest + max(1, round(LOOK_AHEAD_M / spacing))) % len(curve)]
    return _towards(place, float(ahead[0]), float(ahead[1]), speed)


def _circle() -> Array:
    """Circle through the origin, clockwise from above, leaving the origin along +Z."""
    t = np.linspace(0.0, tau, CIRCLE_POINTS, endpoint=False)
    x, z = CIRCLE_RADIUS_M * (1.0 - np.cos(t)), CIRCLE_RADIUS_M * np.sin(t)
    return np.stack([x, z, t], axis=-1)


def _figure8() -> Array:
    """Lemniscate of Gerono along X through the origin, resampled to equal steps."""
    t = np.linspace(0.0, tau, FINE_POINTS)
    x, z = FIGURE_HALF_LENGTH_M * np.sin(t), FIGURE_HALF_LENGTH_M * np.sin(t) * np.cos(t)
    length = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(x), np.diff(z)))])
    even = np.interp(np.linspace(0.0, length[-1], FIGURE_POINTS, endpoint=False), length, t)
    dx, dz = np.cos(even), np.cos(2.0 * even)
    x, z = FIGURE_HALF_LENGTH_M * np.sin(even), FIGURE_HALF_LENGTH_M * np.sin(even) * np.cos(even)
    return np.stack([x, z, np.arctan2(dx, dz)], axis=-1)


def _random_script(gait: Gait, speed: float, seed: int) -> ControlScript:
    """A new direction and stick length every 1.5 to 4 s, sometimes none; back to the centre from outside the area."""
    rng = np.random.default_rng(seed)
    ends = np.cumsum(rng.uniform(*STRETCH_RANGE_S, STRETCHES))
    headings = np.cumsum(rng.normal(0.0, TURN_DEVIATION_RAD, STRETCHES))
    lengths = rng.choice(STICK_FRACTIONS, STRETCHES)
    lengths[0] = 1.0

    def script(time: float, place: PlanarPose) -> Controls:
        k = int(np.searchsorted(ends, time % ends[-1], side="right"))
        heading, length = float(headings[k]), speed * float(lengths[k])
        home = atan2(-place.x, -place.z)
        if hypot(place.x, place.z) > AREA_M and abs(remainder(heading - home, tau)) > 0.5 * pi:
            heading = home + HOME_OFFSET_RAD * (1.0 if k % 2 else -1.0)
        return Controls((length * sin(heading), length * cos(heading)), gait=gait)

    return script


MAX_POINTS = 500
ARRIVED_M = 0.3  # remaining distance at which the walk has arrived
SLOWING_M = 1.2  # the stick eases back over this last distance,
MIN_STICK_FRACTION = 0.4  # but no further than this
SEARCH_M = 2.0  # ahead of the present progress; keeps the branch where a path crosses itself
SEARCH_POINTS = 41  # number of points searched
STUCK_SECONDS, STUCK_M = 4.0, 0.15  # the walk ends after less progress than this in this time


@dataclass(frozen=True)
class Waypoint:
    """A point of a path, in metres; `speed` (fraction of the full stick) and `gait` apply on the way to it."""

    x: float
    z: float
    speed: float = 1.0
    gait: Gait = Gait.WALK

    def __post_init__(self) -> None:
        if not 0.0 < self.speed <= 1.0 or not np.isfinite([self.x, self.z]).all():
            raise UsageError(
                f"point at {self.x:g}, {self.z:g} with speed {self.speed:g}: expected finite metres, "
                "more than 0 and at most 1 (full stick).",
                "Choose another point or speed.",
            )


@dataclass(frozen=True)
class PointPath:
    """A path of points on the ground; it starts where the character stands."""

    points: tuple[Waypoint, ...]

    def __post_init__(self) -> None:
        if not 1 <= len(self.points) <= MAX_POINTS:
            raise UsageError(
                f"path of {len(self.points)} points: expected 1 to {MAX_POINTS}.", "Add or remove points."
            )

    def walk_from(self, place: PlanarPose) -> PathWalk:
        """Return a control script that leads a character from `place` along the path."""
        corners = np.array([(place.x, place.z), *((p.x, p.z) for p in self.points)])
        lengths = np.hypot(*np.diff(corners, axis=0).T)
        return PathWalk(self, corners, np.concatenate([[0.0], np.cumsum(lengths)]))


@dataclass
class PathWalk:
    """A `ControlScript` along a path, with the character's progress."""

    path: PointPath
    corners: Array  # (n + 1, 2) x and z, metres
    ends: Array  # (n + 1,) metres along the path
    progress: float = 0.0  # metres along the path
    arrived: bool = False
    stuck: bool = False
    _mark: tuple[float, float] = field(default=(0.0, 0.0))  # seconds and progress when it last advanced

    @property
    def ended(self) -> bool:
        """Whether the walk is over: at the end, or where the character is stuck."""
        return self.arrived or self.stuck

    def __call__(self, time: float, place: PlanarPose) -> Controls:
        """Return the controls at a time (seconds since the start) and place."""
        self.progress = max(self.progress, self._nearest(place))
        left = float(self.ends[-1]) - self.progress
        away = hypot(self.corners[-1][0] - place.x, self.corners[-1][1] - place.z)
        self.arrived = self.arrived or (left < ARRIVED_M and away < 2 * ARRIVED_M)
        if self.progress - self._mark[1] > STUCK_M:
            self._mark = time, self.progress
        self.stuck = self.stuck or (not self.arrived and time - self._mark[0] > STUCK_SECONDS)
        if self.ended:
            return Controls()
        leg = self._leg(self.progress)
        x, z = self._at(min(self.progress + LOOK_AHEAD_M, float(self.ends[-1])))
        dx, dz = x - place.x, z - place.z
        length = max(hypot(dx, dz), MIN_SIZE)
        amount = min(leg.speed, max(left / SLOWING_M, MIN_STICK_FRACTION))
        return Controls((amount * dx / length, amount * dz / length), gait=leg.gait)

    def _leg(self, along: float) -> Waypoint:
        k = int(np.searchsorted(self.ends[1:], along, side="right"))
        return self.path.points[min(k, len(self.path.points) - 1)]

    def _at(self, along: float) -> tuple[float, float]:
        x, z = (float(np.interp(along, self.ends, self.corners[:, k])) for k in (0, 1))
        return x, z

    def _nearest(self, place: PlanarPose) -> float:
        """Metres along the path of the nearest point within reach of the present progress."""
        along = np.linspace(self.progress, min(self.progress + SEARCH_M, float(self.ends[-1])), SEARCH_POINTS)
        x, z = (np.interp(along, self.ends, self.corners[:, k]) for k in (0, 1))
        return float(along[int(np.argmin((x - place.x) ** 2 + (z - place.z) ** 2))])


STICK_GAITS = {gait.label: gait for gait in REQUESTS}
EXAMPLE = "stand 2; walk 3; walk@90 3; jog@0*0.5 2; jump 1"
MAX_SECONDS = 24 * 3600.0
MAX_CHARACTERS = 100_000
PRESS_SECONDS = 0.1  # how long the jump button is down
ROUNDING_S = 1e-9  # rounding error of a sum of times

_NUMBER = r"[-+]?\d{1,9}(?:\.\d{0,9})?"
_FORM = re.compile(
    rf"(?P<gait>[a-z]+)(?:@(?P<heading>{_NUMBER}))?(?:\*(?P<amount>{_NUMBER}))?(?:>(?P<facing>{_NUMBER}))?"
    rf"\s+(?P<seconds>{_NUMBER})",
    re.IGNORECASE,
)


@dataclass(frozen=True)
class StickSegment:
    """A stick position held for some seconds: heading and facing in degrees, `amount` as a fraction of the full stick."""

    gait: Gait
    seconds: float
    heading: float = 0.0
    amount: float = 1.0
    facing: float | None = None

    def __str__(self) -> str:
        text = self.gait.label
        text += f"@{_plain(self.heading)}" if self.heading else ""
        text += f"*{_plain(self.amount)}" if self.amount != 1.0 else ""
        text += "" if self.facing is None else f">{_plain(self.facing)}"
        return f"{text} {_plain(self.seconds)}"

    @property
    def controls(self) -> Controls:
        """Return the controls of this stick position."""
        if self.gait in (Gait.STAND, Gait.JUMP):
            return Controls()
        facing = None if self.facing is None else _direction(self.facing)
        x, z = _direction(self.heading)
        return Controls((self.amount * x, self.amount * z), facing, self.gait)


@dataclass(frozen=True)
class StickScript:
    """Stick segments in order; a `ControlScript` that depends on time alone."""

    segments: tuple[StickSegment, ...]

    def __str__(self) -> str:
        return "; ".join(map(str, self.segments))

    @property
    def seconds(self) -> float:
        """Total duration in seconds."""
        return sum(segment.seconds for segment in self.segments)

    @cached_property
    def _ends(self) -> list[float]:
        """Seconds since the start at the end of each segment."""
        return list(accumulate(segment.seconds for segment in self.segments))

    @cached_property
    def _held(self) -> list[Controls]:
        """Controls of each segment; a jump keeps those of the segment before it."""
        held, controls = [], Controls()
        for segment in self.segments:
            controls = controls if segment.gait == Gait.JUMP else segment.controls
            held.append(controls)
        return held

    def __call__(self, time: float, _place: PlanarPose | None = None) -> Controls:
        """Return the controls at `time`; at rest after the end."""
        k = bisect_right(self._ends, time, key=lambda end: end - ROUNDING_S)
        if k == len(self.segments):
            return Controls()
        start = self._ends[k - 1] if k else 0.0
        pressed = self.segments[k].gait == Gait.JUMP and time - start < PRESS_SECONDS - ROUNDING_S
        return replace(self._held[k], gait=Gait.JUMP) if pressed else self._held[k]


def parse_stick(text: str) -> StickScript:
    """Parse the text form of a stick script; UsageError names the segment that cannot be read and why."""
    if len(text) > MAX_CHARACTERS:
        raise _error(f"{len(text)} characters; expected at most {MAX_CHARACTERS}")
    segments = tuple(_segment(part.strip()) for part in text.split(";") if part.strip())
    if not segments:
        raise _error("no segment")
    return StickScript(segments)


def _segment(text: str) -> StickSegment:
    found = _FORM.fullmatch(text)
    if found is None:
        raise _error(f"'{text[:60]}' is not GAIT[@HEADING][*AMOUNT][>FACING] SECONDS")
    name = found["gait"].lower()
    if name not in STICK_GAITS:
        raise _error(f"'{text[:60]}': no gait '{name[:20]}'; expected {', '.join(STICK_GAITS)}")
    seconds, amount = float(found["seconds"]), float(found["amount"] or 1.0)
    directed = any(found.group("heading", "amount", "facing"))
    for wrong, problem in (
        (
            not 0.0 < seconds <= MAX_SECONDS,
            f"{seconds:g} seconds; expected more than 0 and at most {MAX_SECONDS:g}",
        ),
        (not 0.0 <= amount <= 1.0, f"amount {amount:g}; expected 0 to 1"),
        (
            directed and name in ("stand", "jump"),
            f"{name} takes seconds only, its stick is at rest or as before",
        ),
    ):
        if wrong:
            raise _error(f"'{text[:60]}': {problem}")
    facing = None if found["facing"] is None else float(found["facing"])
    return StickSegment(STICK_GAITS[name], seconds, float(found["heading"] or 0.0), amount, facing)


def _error(problem: str) -> UsageError:
    return UsageError(f": {problem}.", f'Write "{EXAMPLE}".', "controls")


def _direction(degrees: float) -> tuple[float, float]:
    return sin(radians(degrees)), cos(radians(degrees))


def _plain(number: float) -> str:
    return f"{number:.9f}".rstrip("0").rstrip(".")
