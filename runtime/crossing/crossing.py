"""How one character crosses obstacles: what lies ahead, when a keyed crossing begins, and its poses until it ends.

Over bars, gaps and low steps the legs follow a plan for one stride (`leap`) while the network goes on. Before a wall or a
deep drop the character stops, and climbs (`climb`). The crossing's frame is that of its obstacle: z along the way, 0 at
the near edge; x to the left, 0 under the root; y over the ground before it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from runtime import rotations
from runtime.arrays import Array, Flags
from runtime.controls import STAND_SPEED
from runtime.crossing.climb import Climb, Descend
from runtime.crossing.keyed_pose import CrossingPose
from runtime.crossing.leap import Leap, LeapStart, takeoff_m
from runtime.crossing.steps import PlannedSteps
from runtime.easing import smooth
from runtime.feet.ik import LEG_FEET, solve_legs
from runtime.feet.skating import SOLE_HEIGHTS, SOLE_POINTS
from runtime.pose import DT, Pose
from runtime.skeleton import SPORT_SKELETON
from runtime.spring import damp
from runtime.terrain.height_map import Terrain
from runtime.terrain.obstacles import blocked_message, step_ahead
from runtime.terrain.room import LANDING_RISE_M, can_climb, can_land
from runtime.terrain.way_ahead import ObstacleAhead, ObstacleKind, obstacle_ahead

KINDS = ("", *(kind.value for kind in ObstacleKind), "climb", "descend")
LOOK_M = 3.0  # ahead for obstacles, beside what is covered while a character stops
HIGHEST_LEAP_M = 0.75  # of a bar
HIGHEST_STEP_M = 0.55  # a higher one is climbed
HIGHEST_CLIMB_M = 1.5
STEEPEST_GAP_M = 0.35  # that the ground behind a gap may be higher
STOP_M = 0.5  # from ground that nobody can walk on the root stops,
STOP_SECONDS = 0.45  # and as much farther as it covers in this time
HOLD_M = 0.5  # it sets off again where the way is free this much farther: else it stops and starts in turn
HALF_BODY_M = 0.25  # no root comes nearer
CLIMB_M = 0.46  # from the edge the root stops,
CLIMB_SECONDS = 0.4  # and as much farther as it covers in this time
NEAREST_M = 0.38  # it comes to a wall
CLIMB_FROM_M, CLIMB_SPEED = 0.8, 0.3  # a climb begins nearer and slower (m/s)
WIDEST_SKEW = 0.9  # radians from the right angle
PACE = (0.85, 1.2)  # of the root in the steps before a leap, so that a foot comes down at its edge
LAST_STEP = 0.65  # of a step: what is left is leapt over, more is another step
LATEST_START = 0.55  # of a stride: a leap that begins later is planned as if it began then
BESIDE_BAR_M, BAR_SLACK_M = 0.3, 0.1  # before a bar, and higher than it, nothing stands beside the way
TOO_LATE_M = 0.08  # a foot whose ankle stands nearer to the edge leaps no more
BEFORE_M = 0.06  # the edge of an obstacle that the network is not to see
DEEPEST_M = 0.05  # that a sole is lifted out of the ground,
LEAST_LIFT_M = 1e-6  # and least: a planned foot stands on it but for rounding
SIGHT_HALF_LIFE = 0.1  # seconds in which ground comes halfway into sight
UNSEEN = 1e-4  # of it, and 1/s
MOST_SIGHT, FASTEST_SIGHT = 1.5, 20.0  # that the spring comes to, where it is turned round on its way
FADE_S = 0.3  # in which the first pose's difference from the crossing's goes
WALKING, FOLLOWED = 0.4, 0.7  # m/s from which the root's own direction counts, by so much
SLOWEST = 0.2  # m/s of a walk that leaps
TEMPO = (0.7, 1.2)  # of a climb
NO_LANDING = "The way ahead is blocked: no room to come down behind the edge."
NO_CLIMB = "The way ahead is blocked: no room to climb over the edge."
NEUTRAL_SPEED = 1.3  # m/s of a walk whose climb takes the time it is keyed for


@lru_cache(maxsize=64)
def _motion(kind: str, numbers: tuple[float, ...]) -> Leap | Climb | Descend:
    """The motion that these numbers describe: made again after a snapshot is put back."""
    if kind == "climb":
        return Climb(*numbers)
    if kind == "descend":
        return Descend(*numbers)
    length, top, beyond, start, speed, seconds, elapsed, stance, hips = numbers[:9]
    points = np.array(numbers[9:])
    stride = LeapStart(
        start, speed, seconds, elapsed, int(stance), points[:6].reshape(2, 3), points[6:].reshape(2, 4), hips
    )
    return Leap(ObstacleKind(kind), length, top, beyond, stride)


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


@dataclass
class Crossing:
    """State of one character's crossing, from frame to frame."""

    kind: str = field(default="", metadata={"choices": KINDS})  # of the crossing under way
    stopped: bool = False  # before ground that it neither walks on nor crosses
    pace: float = 1.0  # of the root on its way to a leap
    numbers: tuple[float, ...] = ()  # that describe the motion
    time: float = 0.0
    origin: Array = field(default_factory=lambda: np.zeros(3), metadata={"whole": (3,)})
    yaw: float = 0.0
    fresh: bool = False  # its first pose is still to tell the two offsets
    hips_offset: Array = field(default_factory=lambda: np.zeros(3), metadata={"whole": (3,)})
    offset: Array = field(
        default_factory=lambda: np.zeros((31, 3)), metadata={"whole": (31, 3)}
    )  # rotation vectors
    last_z: float = 0.0
    sight: float = 1.0  # share of the ground's heights that the network sees: none of them in a crossing
    sight_velocity: float = 0.0  # its change, 1/s
    steps: PlannedSteps = field(default_factory=PlannedSteps)

    @property
    def facing(self) -> float | None:
        """The yaw in which it climbs."""
        return self.yaw if self.climbing else None

    @property
    def climbing(self) -> bool:
        """Whether it goes up or down by itself, whatever the stick says."""
        return self.kind in ("climb", "descend")

    @property
    def motion(self) -> Leap | Climb | Descend:
        """What is crossed by; only while there is a `kind`."""
        return _motion(self.kind, self.numbers)

    def look(self, terrain: Terrain | None, place: Array, velocity: Array, speed: float) -> Look:
        """What lies ahead of a root at `place` (XZ) with this requested velocity.

        `speed` is the root's, m/s; `terrain` None where it is known to hold nothing.
        """
        seen = self._look(terrain, place, velocity, speed)
        self.stopped = seen.reason is not None
        return seen

    def _look(self, terrain: Terrain | None, place: Array, velocity: Array, speed: float) -> Look:
        requested = float(np.linalg.norm(velocity))
        if self.climbing:
            return Look(True, None, None)
        if terrain is None or requested <= STAND_SPEED:
            return CLEAR
        x, z, way = float(place[0]), float(place[1]), self.way(velocity / requested)
        reach = STOP_M + STOP_SECONDS * speed + HOLD_M * self.stopped
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
                stops = found.near <= CLIMB_M + CLIMB_SECONDS * speed + HOLD_M * self.stopped
                return Look(True, None, NO_LANDING) if stops else CLEAR
        stops = found.near <= CLIMB_M + CLIMB_SECONDS * speed + HOLD_M * self.stopped
        climbs = is_climb(found) and (stops or found.near <= CLIMB_FROM_M) and ahead.blocked is None
        if climbs and not _has_room(terrain, ahead, np.array([x, z])):
            return Look(True, None, NO_CLIMB) if stops else CLEAR
        if not ahead.stands or not stops:
            return Look(False, ahead, None)
        return Look(True, ahead, ahead.blocked)

    def way(self, heading: Array) -> Array:
        """Where the root goes (XZ, a unit vector): mostly as it has gone, for feet land there, and towards the stick's `heading`."""
        speed = float(np.linalg.norm(self.steps.velocity))
        if speed < WALKING:
            return heading
        mixed: Array = (1.0 - FOLLOWED) * heading + FOLLOWED * self.steps.velocity / speed
        size = float(np.linalg.norm(mixed))
        return mixed / size if size > 0.5 else heading

    def held_back(self, terrain: Terrain, place: Array, velocity: Array, ahead: Ahead | None) -> Array:
        """The root's velocity (m/s), zero where the next of it would be a step that nobody can take, or into a wall."""
        speed = float(np.linalg.norm(velocity))
        if speed < 1e-6:
            return velocity
        if ahead is not None and ahead.too_near(velocity / speed):
            return np.zeros(2)
        reach = speed * DT + HALF_BODY_M
        distance, _ = step_ahead(terrain, float(place[0]), float(place[1]), velocity / speed, reach)
        return velocity if distance > reach else np.zeros(2)

    def seen(self, points: Array, heights: Array, present: int, ahead: Ahead | None) -> Array:
        """Heights `(12, 3)` that the network sees at `points` `(12, 3, 2)`: as if what is crossed were level ground.

        It has learnt slopes and stairs; before a bar or a gap it would crouch or climb as before those. The body is
        placed over the mean of what it sees, so that this comes and goes on a spring.
        """
        level = heights[present, 1]
        if self.kind:
            done = smooth(self.time / self.motion.seconds)
            level = self.origin[1] + done * (self.numbers[0] if self.climbing else self.numbers[2])
            way = np.array([np.sin(self.yaw), np.cos(self.yaw)])
            along = (points - self.origin[[0, 2]]) @ way
            heights = np.where(_and_before(along > -BEFORE_M), level, heights)
        elif ahead is not None and (is_leap(ahead.obstacle) or is_climb(ahead.obstacle)):
            along = (points - points[present, 1]) @ ahead.way
            hidden = _and_before(along > ahead.obstacle.near - BEFORE_M)
            heights = np.where(hidden, ahead.obstacle.ground, heights)
        goal = 0.0 if self.kind else 1.0
        if self.sight == goal:
            return heights if goal else np.full_like(heights, level)
        share, velocity = damp(self.sight, self.sight_velocity, goal, SIGHT_HALF_LIFE, DT)
        arrived = abs(share - goal) < UNSEEN and abs(velocity) < UNSEEN
        self.sight, self.sight_velocity = (goal, 0.0) if arrived else (share, velocity)
        return level + self.sight * (heights - level)

    def watch(
        self, pose: Pose, held: Sequence[object], speed: float, walk_speed: float, ahead: Ahead | None
    ) -> None:
        """Begin what the obstacle ahead asks for. `held` tells which feet stand."""
        steps = self.steps
        came = steps.watch(pose, held, ahead.way if ahead is not None else None, self.pace)
        if ahead is None or not is_leap(ahead.obstacle):
            self.pace = 1.0
            if ahead is not None and is_climb(ahead.obstacle) and ahead.blocked is None:
                self._climb(ahead, pose, speed, walk_speed)
        elif steps.stance is not None and steps.speed > SLOWEST:
            left = ahead.obstacle.near - steps.ankle(pose, ahead.way)
            if left > TOO_LATE_M and self._last_step(ahead.obstacle, pose, ahead.way, left, came):
                self._begin_leap(ahead, pose)

    def _last_step(self, obstacle: ObstacleAhead, pose: Pose, way: Array, left: float, came: bool) -> bool:
        """Whether the foot that stands `left` m before the edge is the last one there; sets the pace to the next ones."""
        steps = self.steps
        if came:
            missing = left - takeoff_m(obstacle.kind, obstacle.top, steps.speed)
            count = int(np.ceil(missing / steps.length - LAST_STEP))
            self.pace = min(max(missing / (count * steps.length), PACE[0]), PACE[1]) if count > 0 else 1.0
            return count <= 0
        edge = obstacle.near - 0.6 * takeoff_m(obstacle.kind, obstacle.top, 0.0)
        return steps.next_ankle(self.pace) > edge

    def _climb(self, ahead: Ahead, pose: Pose, speed: float, walk_speed: float) -> None:
        """Climb where the character stands before a wall or drop, at the tempo of its style."""
        obstacle = ahead.obstacle
        if obstacle.near > CLIMB_FROM_M or speed > CLIMB_SPEED:
            return
        yaw = float(np.arctan2(ahead.way[0], ahead.way[1])) + obstacle.skew
        near = obstacle.near * float(np.cos(obstacle.skew))
        depth = min(obstacle.far - obstacle.near, 10.0)
        tempo = min(max((walk_speed / NEUTRAL_SPEED) ** 0.5, TEMPO[0]), TEMPO[1])
        kind = "climb" if obstacle.top > 0.0 else "descend"
        self._start(kind, (obstacle.top, -near, depth, tempo), pose, yaw, near, obstacle.ground)

    def _begin_leap(self, ahead: Ahead, pose: Pose) -> None:
        obstacle, way, steps = ahead.obstacle, ahead.way, self.steps
        yaw = float(np.arctan2(way[0], way[1]))
        turn = rotations.from_yaw(-yaw)
        origin = _origin(pose, way, obstacle.near, obstacle.ground)
        ankles = rotations.rotate(turn, pose.positions[LEG_FEET].astype(np.float64) - origin)
        feet = rotations.multiply(turn, pose.world_rotations[LEG_FEET].astype(np.float64))
        hips = float(pose.hips_position[1]) - obstacle.ground
        length = (
            0.0 if obstacle.kind in (ObstacleKind.UP, ObstacleKind.DOWN) else obstacle.far - obstacle.near
        )
        top = obstacle.top if obstacle.kind is ObstacleKind.BAR else 0.0
        begun = min(steps.elapsed, LATEST_START * steps.seconds)
        gait = (steps.speed * self.pace, steps.seconds, begun, float(steps.stance or 0))
        points = (*ankles.ravel().tolist(), *feet.ravel().tolist())
        numbers = (length, top, obstacle.beyond, -obstacle.near, *gait, hips, *points)
        self.pace = 1.0
        self._start(obstacle.kind.value, numbers, pose, yaw, obstacle.near, obstacle.ground)

    def _start(
        self, kind: str, numbers: tuple[float, ...], pose: Pose, yaw: float, near: float, ground: float
    ) -> None:
        way = np.array([np.sin(yaw), np.cos(yaw)])
        self.kind, self.numbers, self.time, self.yaw = kind, tuple(float(n) for n in numbers), 0.0, yaw
        self.origin = _origin(pose, way, near, ground)
        self.last_z = self.motion.root_z(0.0)
        self.fresh = True

    def root_velocity(self) -> Array:
        """The root's velocity (m/s, XZ) to the next frame, whose crossing time this begins."""
        self.time += DT
        z = self.motion.root_z(self.time)
        speed, self.last_z = (z - self.last_z) / DT, z
        return speed * np.array([np.sin(self.yaw), np.cos(self.yaw)])

    def apply(
        self, hips: Array, local: Array, ground: float, last: Pose, terrain: Terrain
    ) -> tuple[Array, Array, Array]:
        """World hips `(3,)`, local rotations and contacts to show for the network's, which stands on `ground`."""
        local = np.array(local, np.float64)
        turn = rotations.from_yaw(-self.yaw)
        if self.fresh:
            self.fresh = False
            self.offset = rotations.to_rotation_vector(
                rotations.multiply(last.local_rotations.astype(np.float64), rotations.inverse(local))
            )
            over = last.hips_position.astype(np.float64) - hips
            self.hips_offset = np.array([0.0, over[1] - (self.origin[1] - ground), 0.0])
        fade = 1.0 - smooth(self.time / FADE_S)
        if fade > 0.0:
            local = rotations.multiply(rotations.from_rotation_vector(fade * self.offset), local)
            hips = hips + fade * self.hips_offset
        placed = rotations.rotate(turn, hips - np.array([self.origin[0], ground, self.origin[2]]))
        local[0] = rotations.multiply(turn, local[0])
        shown: CrossingPose = self.motion.pose(self.time, placed, local)
        back = rotations.from_yaw(self.yaw)
        result = np.array(shown.local)
        result[0] = rotations.multiply(back, result[0])
        place = rotations.rotate(back, shown.hips) + self.origin
        return place, _on_the_ground(place, result, terrain), shown.contacts

    def ends(self) -> bool:
        """Whether the frame just shown was the crossing's last; it is over then."""
        if self.time < self.motion.seconds - 0.5 * DT:
            return False
        motion, steps = self.motion, self.steps
        vars(self).update(vars(Crossing(sight=self.sight, sight_velocity=self.sight_velocity)))
        if isinstance(motion, Leap):
            self.steps = steps
            steps.after_leap(motion.stride.stance)
        return True


def is_possible(crossing: Crossing) -> bool:
    """Whether the numbers of a crossing that was read from a file describe one of its kind."""
    numbers = crossing.numbers
    if not (abs(crossing.sight) <= MOST_SIGHT and abs(crossing.sight_velocity) <= FASTEST_SIGHT):
        return False
    if any(abs(number) > 100.0 for number in numbers) or not PACE[0] <= crossing.pace <= PACE[1]:
        return False
    if not crossing.kind:
        return True
    if crossing.climbing:
        upwards = 1.0 if crossing.kind == "climb" else -1.0
        return (
            len(numbers) == 4
            and 0.0 < upwards * numbers[0] <= HIGHEST_CLIMB_M
            and TEMPO[0] <= numbers[3] <= TEMPO[1]
        )
    if len(numbers) != 23:
        return False
    _, _, _, _, speed, seconds, elapsed, stance, _ = numbers[:9]
    return speed >= 0.0 and 0.1 <= seconds <= 10.0 and 0.0 <= elapsed < seconds and stance in (0.0, 1.0)


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


def _on_the_ground(hips: Array, local: Array, terrain: Terrain) -> Array:
    """Local rotations with soles lifted out of the ground; a foot far inside passes before a face, and stays."""
    positions, world = SPORT_SKELETON.forward_kinematics(hips, local)
    soles = positions[list(SOLE_POINTS)].astype(np.float64)
    lack = terrain.height(soles[:, 0], soles[:, 2]) + np.array(SOLE_HEIGHTS) - soles[:, 1]
    lift = np.max(np.where(lack < DEEPEST_M, lack, 0.0).reshape(2, 2), axis=1)
    if lift.max() <= LEAST_LIFT_M:
        return local
    ankles = soles[::2] + np.outer(np.maximum(lift, 0.0), [0.0, 1.0, 0.0])
    return solve_legs(hips, local, ankles, world[LEG_FEET].astype(np.float64))


def _origin(pose: Pose, way: Array, near: float, ground: float) -> Array:
    """The near edge on the way of the root, on the ground before it."""
    root = pose.root_position.astype(np.float64)
    return np.array([root[0] + near * way[0], ground, root[2] + near * way[1]])
