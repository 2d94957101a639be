"""Obstacles ahead on a character's path: those to leap or climb over, and ground that ends the path."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from runtime.arrays import Array
from runtime.pose import DT
from runtime.scalar_math import MIN_SIZE
from runtime.terrain.height_map import Terrain
from runtime.terrain.obstacle_detection import ObstacleAhead, ObstacleKind, obstacle_ahead
from runtime.terrain.room import LANDING_RISE_M, can_climb, can_land
from runtime.terrain.steps import blocked_message, step_ahead

PROBE_M = 3.0  # ahead for obstacles, plus the stopping distance
HIGHEST_CLIMB_M = 1.5
HIGHEST_LEAP_M = 0.75  # of a bar
HIGHEST_STEP_M = 0.55  # a higher one is climbed
STEEPEST_GAP_M = 0.35  # how much higher the ground behind a gap may be
STOP_M = 0.5  # distance from unwalkable ground at which the root stops,
STOP_SECONDS = 0.45  # plus the distance covered in this time
HOLD_M = 0.5  # further free distance before it starts again, which avoids stopping and starting in turn
HALF_BODY_M = 0.25  # minimum distance of any root
CLIMB_M = 0.46  # distance from the edge of a climb at which the root stops,
CLIMB_SECONDS = 0.4  # plus the distance covered in this time
NEAREST_M = 0.38  # minimum distance from a wall
CLIMB_FROM_M = 0.8  # a climb begins nearer than this
MAX_SKEW_RAD = 0.9  # from the perpendicular
BESIDE_BAR_M, BAR_SLACK_M = 0.3, 0.1  # before a bar, and above it, free beside the path
NO_LANDING = "The way ahead is blocked: no room to come down behind the edge."
NO_CLIMB = "The way ahead is blocked: no room to climb over the edge."
MAX_SPEED_M_PER_S = 5.0  # up to which the probe's distance grows


@dataclass(frozen=True)
class Ahead:
    """An obstacle, and the path (XZ, a unit vector) on which it lies."""

    obstacle: ObstacleAhead
    path: Array
    alone: bool = False  # the network crosses it without keyframes

    @property
    def blocked(self) -> str | None:
        """The reason for the status line if the obstacle cannot be crossed, else None."""
        return _blocked(self.obstacle)

    @property
    def climbable(self) -> bool:
        """Whether the obstacle can be climbed up or down from the current position."""
        return is_climb(self.obstacle) and self.blocked is None

    @property
    def stands(self) -> bool:
        """Whether the character must stop before it: to climb, or because it cannot be crossed."""
        return is_climb(self.obstacle) or self.blocked is not None

    def too_near(self, direction: Array) -> bool:
        """Return whether a root moving in `direction` would get too close to a wall or drop."""
        return self.stands and self.obstacle.near < NEAREST_M and float(direction @ self.path) > 0.0


class ObstacleProbe(NamedTuple):
    """The obstacle probe of a character in this frame."""

    stops: bool  # the root does not follow the stick
    ahead: Ahead | None  # in the stick's direction
    reason: str | None  # why the character is blocked, for the status line

    @property
    def finds(self) -> bool:
        """Whether an obstacle is ahead that the network does not cross by itself."""
        return self.stops or (self.ahead is not None and not self.ahead.alone)

    def alone(self) -> ObstacleProbe:
        """Return the probe for a network that crosses this obstacle itself: it steps over bars and gaps, and ignores steps."""
        if self.ahead is None or self.ahead.obstacle.kind not in (ObstacleKind.BAR, ObstacleKind.GAP):
            return CLEAR
        return ObstacleProbe(False, replace(self.ahead, alone=True), None)


CLEAR = ObstacleProbe(False, None, None)
CLIMBING = ObstacleProbe(True, None, None)


def probe_obstacles(
    terrain: Terrain, place: Array, path: Array, speed: float, stopped: bool
) -> ObstacleProbe:
    """Return what lies ahead of a root at `place` (XZ) moving at `speed` (m/s) along `path` (XZ, a unit vector).

    A character that has `stopped` needs a longer free path to set off again.
    """
    x, z = float(place[0]), float(place[1])
    reach = STOP_M + STOP_SECONDS * speed + HOLD_M * stopped
    distance, rise = step_ahead(terrain, x, z, path, reach)
    if distance <= reach:
        return ObstacleProbe(True, None, blocked_message(rise))
    found = obstacle_ahead(terrain, x, z, path, PROBE_M + CLIMB_SECONDS * min(speed, MAX_SPEED_M_PER_S))
    if found is None:
        return CLEAR
    ahead = Ahead(found, path)
    stops = found.near <= CLIMB_M + CLIMB_SECONDS * speed + HOLD_M * stopped
    cramped = _lack_of_room(terrain, ahead, place, stops)
    if cramped is not None:
        return ObstacleProbe(True, None, cramped) if stops else CLEAR
    if not ahead.stands or not stops:
        return ObstacleProbe(False, ahead, None)
    return ObstacleProbe(True, ahead, ahead.blocked)


def _lack_of_room(terrain: Terrain, ahead: Ahead, place: Array, stops: bool) -> str | None:
    """Return the status line's reason if an obstacle leaves no room to leap or climb it from `place` (XZ), else None."""
    found = ahead.obstacle
    if is_leap(found) and not _has_landing(terrain, ahead, place):
        return NO_LANDING
    climbs = ahead.climbable and (stops or found.near <= CLIMB_FROM_M)
    return NO_CLIMB if climbs and not _has_room(terrain, ahead, place) else None


def held_back(terrain: Terrain, place: Array, velocity: Array, ahead: Ahead | None) -> Array:
    """Return the root's velocity (m/s), or zero if it leads into a wall or to a step that is too high."""
    speed = float(np.linalg.norm(velocity))
    if speed < MIN_SIZE:
        return velocity
    if ahead is not None and ahead.too_near(velocity / speed):
        return np.zeros(2)
    reach = speed * DT + HALF_BODY_M
    distance, _ = step_ahead(terrain, float(place[0]), float(place[1]), velocity / speed, reach)
    return velocity if distance > reach else np.zeros(2)


def is_leap(obstacle: ObstacleAhead) -> bool:
    """Return whether an obstacle is crossed in one stride."""
    if obstacle.kind is ObstacleKind.BAR:
        return obstacle.top <= HIGHEST_LEAP_M
    if obstacle.kind is ObstacleKind.GAP:
        return obstacle.beyond <= STEEPEST_GAP_M
    return abs(obstacle.top) <= HIGHEST_STEP_M


def is_climb(obstacle: ObstacleAhead) -> bool:
    """Return whether an obstacle is climbed up or down."""
    steps = obstacle.kind in (ObstacleKind.UP, ObstacleKind.DOWN)
    return steps and HIGHEST_STEP_M < abs(obstacle.top) <= HIGHEST_CLIMB_M


def _has_landing(terrain: Terrain, ahead: Ahead, place: Array) -> bool:
    """Whether a leap from `place` (XZ) over the obstacle ahead has room for flight and landing."""
    found = ahead.obstacle
    edge = found.near if found.kind in (ObstacleKind.UP, ObstacleKind.DOWN) else found.far
    length, rise = found.far - found.near, max(found.beyond, 0.0)
    flight, over = {
        ObstacleKind.GAP: (length, rise + LANDING_RISE_M),
        ObstacleKind.BAR: (length + BESIDE_BAR_M, found.top + BAR_SLACK_M),
    }.get(found.kind, (0.0, 0.0))
    return can_land(terrain, place, ahead.path, edge, rise, flight, over)


def _has_room(terrain: Terrain, ahead: Ahead, place: Array) -> bool:
    """Whether a climb from `place` (XZ), perpendicular to the edge ahead, has room."""
    skew, (x, z) = ahead.obstacle.skew, ahead.path
    path = np.array([x * np.cos(skew) + z * np.sin(skew), z * np.cos(skew) - x * np.sin(skew)])
    return can_climb(terrain, place, path, ahead.obstacle.near * float(np.cos(skew)), ahead.obstacle.top)


def _blocked(obstacle: ObstacleAhead) -> str | None:
    """Return the status line's reason if an obstacle can be neither leapt nor climbed, else None."""
    if obstacle.kind is ObstacleKind.BAR and obstacle.top > HIGHEST_LEAP_M:
        return f"The way ahead is blocked: a bar of {obstacle.top:.1f} m, too high to leap over and too narrow to stand on."
    if abs(obstacle.skew) > MAX_SKEW_RAD and is_climb(obstacle):
        return "The way ahead is blocked: walk straight at the wall to climb it."
    return None
