"""A path of points on the ground, with speed and gait on each leg, and the stick that follows it to its end."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import hypot

import numpy as np

from runtime.arrays import Array
from runtime.controls import Controls, Gait
from runtime.errors import UsageError
from runtime.motion.paths import LOOK_AHEAD_M, PlanarPose

MAX_POINTS = 500
ARRIVED_M = 0.3  # of the way left
SLOWING_M = 1.2  # over the last of the way the stick goes back,
SLOWEST = 0.4  # not further than this
SEARCH_M = 2.0  # ahead of the progress so far: where a path crosses itself, the other branch is not taken
STUCK_SECONDS, STUCK_M = 4.0, 0.15  # with less progress than this in so long, the walk ends


@dataclass(frozen=True)
class Waypoint:
    """A point in metres; `speed` (share of the full stick) and `gait` belong to the leg that leads to it."""

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
    """Legs from point to point; the first one begins where the character stands."""

    points: tuple[Waypoint, ...]

    def __post_init__(self) -> None:
        if not 1 <= len(self.points) <= MAX_POINTS:
            raise UsageError(
                f"path of {len(self.points)} points: expected 1 to {MAX_POINTS}.", "Add or remove points."
            )

    def walk_from(self, place: PlanarPose) -> PathWalk:
        """A stick that leads a character from `place` along the path."""
        corners = np.array([(place.x, place.z), *((p.x, p.z) for p in self.points)])
        lengths = np.hypot(*np.diff(corners, axis=0).T)
        return PathWalk(self, corners, np.concatenate([[0.0], np.cumsum(lengths)]))


@dataclass
class PathWalk:
    """A `ControlScript` with a memory: how far along the path the character has come."""

    path: PointPath
    corners: Array  # (n + 1, 2) x and z, metres
    ends: Array  # (n + 1,) metres along the path
    progress: float = 0.0  # metres along the path
    arrived: bool = False
    stuck: bool = False
    _mark: tuple[float, float] = field(default=(0.0, 0.0))  # seconds and progress when it last went on

    @property
    def ended(self) -> bool:
        """Whether the stick rests for good: at the end, or where there is no way on."""
        return self.arrived or self.stuck

    def __call__(self, time: float, place: PlanarPose) -> Controls:
        """The stick at a time (seconds since the start) and place."""
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
        length = max(hypot(dx, dz), 1e-6)
        amount = min(leg.speed, max(left / SLOWING_M, SLOWEST))
        return Controls((amount * dx / length, amount * dz / length), gait=leg.gait)

    def _leg(self, along: float) -> Waypoint:
        k = int(np.searchsorted(self.ends[1:], along, side="right"))
        return self.path.points[min(k, len(self.path.points) - 1)]

    def _at(self, along: float) -> tuple[float, float]:
        x, z = (float(np.interp(along, self.ends, self.corners[:, k])) for k in (0, 1))
        return x, z

    def _nearest(self, place: PlanarPose) -> float:
        """Metres along the path of its nearest point within reach of the progress so far."""
        along = np.linspace(self.progress, min(self.progress + SEARCH_M, float(self.ends[-1])), 41)
        x, z = (np.interp(along, self.ends, self.corners[:, k]) for k in (0, 1))
        return float(along[int(np.argmin((x - place.x) ** 2 + (z - place.z) ** 2))])
