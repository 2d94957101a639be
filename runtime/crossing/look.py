"""What a character sees on its way: obstacles that are leapt or climbed, ground that ends it, and what the network is shown."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from runtime.arrays import Array, Flags
from runtime.controls import STAND_SPEED
from runtime.crossing.crossing import HIGHEST_CLIMB_M, Crossing
from runtime.easing import smooth
from runtime.pose import DT
from runtime.spring import damp
from runtime.terrain.height_map import Terrain
from runtime.terrain.obstacles import blocked_message, step_ahead
from runtime.terrain.room import LANDING_RISE_M, can_climb, can_land
from runtime.terrain.way_ahead import ObstacleAhead, ObstacleKind, obstacle_ahead

LOOK_M = 3.0  # ahead for obstacles, beside what is covered while a character stops
HIGHEST_LEAP_M = 0.75  # of a bar
HIGHEST_STEP_M = 0.55  # a higher one is climbed
STEEPEST_GAP_M = 0.35  # that the ground behind a gap may be higher
STOP_M = 0.5  # from ground that nobody can walk on the root stops,
STOP_SECONDS = 0.45  # and as much farther as it covers in this time
HOLD_M = 0.5  # it sets off again where the way is free this much farther: else it stops and starts in turn
HALF_BODY_M = 0.25  # no root comes nearer
CLIMB_M = 0.46  # from the edge the root stops,
CLIMB_SECONDS = 0.4  # and as much farther as it covers in this time
NEAREST_M = 0.38  # it comes to a wall
CLIMB_FROM_M = 0.8  # a climb begins nearer
WIDEST_SKEW = 0.9  # radians from the right angle
BESIDE_BAR_M, BAR_SLACK_M = 0.3, 0.1  # before a bar, and higher than it, nothing stands beside the way
BEFORE_M = 0.06  # the edge of an obstacle that the network is not to see
SIGHT_HALF_LIFE = 0.1  # seconds in which ground comes halfway into sight
UNSEEN = 1e-4  # of it, and 1/s
WALKING, FOLLOWED = 0.4, 0.7  # m/s from which the root's own direction counts, by so much
NO_LANDING = "The way ahead is blocked: no room to come down behind the edge."
NO_CLIMB = "The way ahead is blocked: no room to climb over the edge."


@dataclass(frozen=True)
class Ahead:
    """An obstacle and the way (XZ, a unit vector) on which it lies ahead."""

    obstacle: ObstacleAhead
    way: Array

    @property
    def blocked(self) -> str | None:
        """What the status line says where it is neither leapt nor climbed; None where it is."""
        return _blocked(self.obstacle)

    @property
    def stands(self) -> bool:
        """Whether one has to stand before it: to climb, or because the way ends."""
        return is_climb(self.obstacle) or self.blocked is not None

    def too_near(self, direction: Array) -> bool:
        """Whether a root that goes in `direction` would come into a wall that is to be climbed, or over a drop."""
        return self.stands and self.obstacle.near < NEAREST_M and float(direction @ self.way) > 0.0


class Look(NamedTuple):
    """What a character sees on its way in one frame."""

    stops: bool  # the root does not follow the stick
    ahead: Ahead | None  # what the stick leads to
    reason: str | None  # why the character does not go on, for the status line


CLEAR = Look(False, None, None)


def look_ahead(
    crossing: Crossing, terrain: Terrain | None, place: Array, velocity: Array, speed: float
) -> Look:
    """What lies ahead of a root at `place` (XZ) with this requested velocity.

    `speed` is the root's, m/s; `terrain` None where it is known to hold nothing.
    """
    seen = _look(crossing, terrain, place, velocity, speed)
    crossing.stopped = seen.reason is not None
    return seen


def _look(crossing: Crossing, terrain: Terrain | None, place: Array, velocity: Array, speed: float) -> Look:
    requested = float(np.linalg.norm(velocity))
    if crossing.climbing:
        return Look(True, None, None)
    if terrain is None or requested <= STAND_SPEED:
        return CLEAR
    x, z, way = float(place[0]), float(place[1]), way_of(crossing, velocity / requested)
    reach = STOP_M + STOP_SECONDS * speed + HOLD_M * crossing.stopped
    distance, rise = step_ahead(terrain, x, z, way, reach)
    if distance <= reach:
        return Look(True, None, blocked_message(rise))
    found = obstacle_ahead(terrain, x, z, way, LOOK_M + CLIMB_SECONDS * min(speed, 5.0))
    if found is None:
        return CLEAR
    ahead = Ahead(found, way)
    if is_leap(found):
        edge = found.near if found.kind in (ObstacleKind.UP, ObstacleKind.DOWN) else found.far
        length, rise = found.far - found.near, max(found.beyond, 0.0)
        flight, over = {
            ObstacleKind.GAP: (length, rise + LANDING_RISE_M),
            ObstacleKind.BAR: (length + BESIDE_BAR_M, found.top + BAR_SLACK_M),
        }.get(found.kind, (0.0, 0.0))
        if not can_land(terrain, np.array([x, z]), way, edge, rise, flight, over):
            stops = found.near <= CLIMB_M + CLIMB_SECONDS * speed + HOLD_M * crossing.stopped
            return Look(True, None, NO_LANDING) if stops else CLEAR
    stops = found.near <= CLIMB_M + CLIMB_SECONDS * speed + HOLD_M * crossing.stopped
    climbs = is_climb(found) and (stops or found.near <= CLIMB_FROM_M) and ahead.blocked is None
    if climbs and not _has_room(terrain, ahead, np.array([x, z])):
        return Look(True, None, NO_CLIMB) if stops else CLEAR
    if not ahead.stands or not stops:
        return Look(False, ahead, None)
    return Look(True, ahead, ahead.blocked)


def way_of(crossing: Crossing, heading: Array) -> Array:
    """Where the root goes (XZ, a unit vector): mostly as it has gone, for feet land there, and towards the stick's `heading`."""
    speed = float(np.linalg.norm(crossing.steps.velocity))
    if speed < WALKING:
        return heading
    mixed: Array = (1.0 - FOLLOWED) * heading + FOLLOWED * crossing.steps.velocity / speed
    size = float(np.linalg.norm(mixed))
    return mixed / size if size > 0.5 else heading


def held_back(terrain: Terrain, place: Array, velocity: Array, ahead: Ahead | None) -> Array:
    """The root's velocity (m/s), zero where the next of it would be a step that nobody can take, or into a wall."""
    speed = float(np.linalg.norm(velocity))
    if speed < 1e-6:
        return velocity
    if ahead is not None and ahead.too_near(velocity / speed):
        return np.zeros(2)
    reach = speed * DT + HALF_BODY_M
    distance, _ = step_ahead(terrain, float(place[0]), float(place[1]), velocity / speed, reach)
    return velocity if distance > reach else np.zeros(2)


def seen_heights(
    crossing: Crossing, points: Array, heights: Array, present: int, ahead: Ahead | None
) -> Array:
    """Heights `(12, 3)` that the network sees at `points` `(12, 3, 2)`: as if what is crossed were level ground.

    It has learnt slopes and stairs; before a bar or a gap it would crouch or climb as before those. The body is
    placed over the mean of what it sees, so that this comes and goes on a spring.
    """
    level = heights[present, 1]
    if crossing.kind:
        done = smooth(crossing.time / crossing.motion.seconds)
        level = crossing.origin[1] + done * crossing.rise
        way = np.array([np.sin(crossing.yaw), np.cos(crossing.yaw)])
        along = (points - crossing.origin[[0, 2]]) @ way
        heights = np.where(_and_before(along > -BEFORE_M), level, heights)
    elif ahead is not None and (is_leap(ahead.obstacle) or is_climb(ahead.obstacle)):
        along = (points - points[present, 1]) @ ahead.way
        hidden = _and_before(along > ahead.obstacle.near - BEFORE_M)
        heights = np.where(hidden, ahead.obstacle.ground, heights)
    goal = 0.0 if crossing.kind else 1.0
    if crossing.sight == goal:
        return heights if goal else np.full_like(heights, level)
    share, velocity = damp(crossing.sight, crossing.sight_velocity, goal, SIGHT_HALF_LIFE, DT)
    arrived = abs(share - goal) < UNSEEN and abs(velocity) < UNSEEN
    crossing.sight, crossing.sight_velocity = (goal, 0.0) if arrived else (share, velocity)
    return level + crossing.sight * (heights - level)


def is_leap(obstacle: ObstacleAhead) -> bool:
    """Whether it is crossed in one stride."""
    if obstacle.kind is ObstacleKind.BAR:
        return obstacle.top <= HIGHEST_LEAP_M
    if obstacle.kind is ObstacleKind.GAP:
        return obstacle.beyond <= STEEPEST_GAP_M
    return abs(obstacle.top) <= HIGHEST_STEP_M


def is_climb(obstacle: ObstacleAhead) -> bool:
    """Whether it is climbed up or down."""
    steps = obstacle.kind in (ObstacleKind.UP, ObstacleKind.DOWN)
    return steps and HIGHEST_STEP_M < abs(obstacle.top) <= HIGHEST_CLIMB_M


def _has_room(terrain: Terrain, ahead: Ahead, place: Array) -> bool:
    """Whether a climb from `place` (XZ) over the edge ahead, at a right angle to it, has room."""
    skew, (x, z) = ahead.obstacle.skew, ahead.way
    way = np.array([x * np.cos(skew) + z * np.sin(skew), z * np.cos(skew) - x * np.sin(skew)])
    return can_climb(terrain, place, way, ahead.obstacle.near * float(np.cos(skew)), ahead.obstacle.top)


def _and_before(hidden: Flags) -> Flags:
    """Samples `(12, 3)` that lie on `hidden` ground, and the last one before it: it tells what stands behind it too."""
    result = hidden.copy()
    result[:-1] |= hidden[1:]
    return result


def _blocked(obstacle: ObstacleAhead) -> str | None:
    """What the status line says where an obstacle is neither leapt nor climbed; None where it is."""
    if obstacle.kind is ObstacleKind.BAR and obstacle.top > HIGHEST_LEAP_M:
        return f"The way ahead is blocked: a bar of {obstacle.top:.1f} m, too high to leap over and too narrow to stand on."
    if abs(obstacle.skew) > WIDEST_SKEW and is_climb(obstacle):
        return "The way ahead is blocked: walk straight at the wall to climb it."
    return None
