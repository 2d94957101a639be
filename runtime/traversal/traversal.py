"""One character's traversal of an obstacle: its state, when it begins, its frames, and its end.

Over bars, gaps and low steps the legs follow a plan for one stride (`leap`) while the network goes on. Before a wall or a
deep drop the character stops, and climbs (`climb`). What lies ahead is found in `obstacle_probe`. Its frame is that of its
obstacle: z along the path, 0 at the near edge; x to the left, 0 under the root; y over the ground before it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from math import hypot

import numpy as np

from runtime import rotations
from runtime.arrays import Array, Flags
from runtime.feet.ik import LEG_FEET, solve_legs
from runtime.feet.next_step import HEEL_M, TOE_M, SteppedOver
from runtime.feet.skating import SOLE_HEIGHTS, SOLE_POINTS
from runtime.pose import DT, Pose
from runtime.scalar_math import damp, smoothstep
from runtime.skeleton import SPORT_SKELETON
from runtime.terrain.height_map import Terrain
from runtime.terrain.obstacle_detection import ObstacleAhead, ObstacleKind
from runtime.traversal.climb import Climb, Descend
from runtime.traversal.keyframes import TraversalPose
from runtime.traversal.leap import Leap, LeapStart, takeoff_m
from runtime.traversal.obstacle_probe import (
    CLEAR,
    CLIMB_FROM_M,
    CLIMBING,
    HIGHEST_CLIMB_M,
    Ahead,
    ObstacleProbe,
    is_climb,
    is_leap,
    probe_obstacles,
)

SOON_S = 0.08  # the next landing takes at least so long: a step may be slower than the last ones
SETTING_OFF = 0.3  # m/s: slower, the first steps are short and quick
STRIDE_S = (0.5, 2.2)  # seconds that a stride of two steps may take
WALKED_S = 1.05  # of a stride at a neutral walk,
JOGGED_S = 0.75  # and at a jog,
JOGS = 1.8  # which is faster than so many m/s
SHORTEST_S = 0.25  # between two landings of one foot
AGAIN = 0.8  # of a stride, until the same foot may come down twice running
TURNING = 0.15  # fraction of a frame in the mean velocity
SMOOTHING = 0.05  # fraction of a frame in the mean speed
SAME = (0.6, 1.6)  # of the stride before: other lengths come of a landing that was missed


@dataclass
class PlannedSteps:
    """Landings of the feet, from frame to frame."""

    stance: int | None = field(
        default=None, metadata={"most": 1}
    )  # the foot that came down last: 0 left, 1 right
    elapsed: float = 0.0  # seconds since then
    seconds: float = WALKED_S  # of a stride
    measured: bool = False  # whether `seconds` was
    speed: float = 0.0  # of the root, m/s, smoothed, at full pace
    velocity: Array = field(
        default_factory=lambda: np.zeros(2), metadata={"whole": (2,)}
    )  # of the root, m/s, smoothed
    ahead: float = 0.2  # m of the last landing before the root
    stood: tuple[bool, bool] = (True, True)  # which feet did in the last frame
    since: tuple[float, float] = (9.0, 9.0)  # seconds since each foot came down
    root: Array | None = field(default=None, metadata={"whole": (2,)})  # place (XZ) in the last frame

    @property
    def length(self) -> float:
        """Metres of a step at full pace."""
        return max(0.5 * self.speed * self.seconds, 0.15)

    def watch(self, pose: Pose, held: Sequence[object], way: Array | None, pace: float) -> bool:
        """Whether a foot came down in this frame; `held` tells which feet stand, `way` (XZ) where the root goes."""
        x, _, z = pose.root_position.tolist()
        if self.root is not None:
            last_x, last_z = self.root.tolist()
            velocity_x, velocity_z = self.velocity.tolist()
            way_x, way_z = (x - last_x) / DT, (z - last_z) / DT
            self.velocity = np.array(
                (velocity_x + (way_x - velocity_x) * TURNING, velocity_z + (way_z - velocity_z) * TURNING)
            )
            self.speed += (min(hypot(way_x, way_z) / pace, 6.0) - self.speed) * SMOOTHING
        self.root = np.array((x, z))
        self.elapsed += DT
        self.since = (self.since[0] + DT, self.since[1] + DT)
        fresh = [k for k in (0, 1) if held[k] and not self.stood[k] and self._comes_down(k)]
        self.stood = (bool(held[0]), bool(held[1]))
        for foot in fresh:
            ankle = pose.positions[LEG_FEET[foot]]
            ahead = 0.0 if way is None else float((ankle[0] - x) * way[0] + (ankle[2] - z) * way[1])
            if ahead > -0.05:  # else it is the trailing foot, held again
                self._landed(foot, ahead)
                return True
        return False

    def _comes_down(self, foot: int) -> bool:
        """Whether a foot that is held anew has come down, and was not let go of for a moment."""
        again = AGAIN * self.seconds if foot == self.stance else SHORTEST_S
        return self.since[foot] > again

    def _landed(self, foot: int, ahead: float) -> None:
        stride = self.since[foot]
        if STRIDE_S[0] < stride < STRIDE_S[1] and (
            not self.measured or SAME[0] < stride / self.seconds < SAME[1]
        ):
            self.seconds = stride if not self.measured else self.seconds + 0.6 * (stride - self.seconds)
            self.measured = self.speed > SETTING_OFF
        elif not self.measured:
            step = self.since[1 - foot]
            guess = JOGGED_S if self.speed > JOGS else WALKED_S
            self.seconds = 2.0 * step if STRIDE_S[0] < 2.0 * step < 1.5 * guess else guess
        self.stance, self.elapsed, self.ahead = foot, 0.0, max(ahead, 0.0)
        self.since = (0.0, self.since[1]) if foot == 0 else (self.since[0], 0.0)

    def ankle(self, pose: Pose, way: Array) -> float:
        """Metres along `way` from the root to the ankle that stands."""
        joint, root = pose.positions[LEG_FEET[self.stance or 0]], pose.root_position
        return float((joint[0] - root[0]) * way[0] + (joint[2] - root[2]) * way[1])

    def next_ankle(self, pace: float) -> float:
        """Metres from the root of now to where the next ankle will come down."""
        return self.speed * pace * max(0.5 * self.seconds - self.elapsed, SOON_S) + self.ahead

    def after_leap(self, stance: int) -> None:
        """The stance foot of a leap comes down now: half a stride after the other one."""
        self.root = None
        self.stood = (stance != 0, stance != 1)
        times = (self.seconds, 0.5 * self.seconds)
        self.since = (times[stance], times[1 - stance])


KINDS = ("", *(kind.value for kind in ObstacleKind), "climb", "descend")
BEFORE_M = 0.06  # the edge of an obstacle that the network is not to see
SIGHT_HALF_LIFE = 0.1  # seconds in which ground comes halfway into sight
UNSEEN = 1e-4  # of it, and 1/s
WALKING, FOLLOWED = 0.4, 0.7  # m/s from which the root's own direction counts, by so much
PACE = (0.85, 1.2)  # of the root in the steps before a leap, so that a foot comes down at its edge
MOST_SIGHT, FASTEST_SIGHT = 1.5, 20.0  # that the spring comes to, where it is turned round on its way
TEMPO = (0.7, 1.2)  # of a climb


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


@dataclass
class Traversal:
    """State of one character's traversal, from frame to frame."""

    kind: str = field(default="", metadata={"choices": KINDS})  # of the traversal under way
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
    sight: float = 1.0  # fraction of the ground's heights that the network sees: none of them in a traversal
    sight_velocity: float = 0.0  # its change, 1/s
    steps: PlannedSteps = field(default_factory=PlannedSteps)
    over: SteppedOver = field(default_factory=SteppedOver, metadata={"later": True})

    @property
    def climbing(self) -> bool:
        """Whether it goes up or down by itself, whatever the stick says."""
        return self.kind in ("climb", "descend")

    @property
    def motion(self) -> Leap | Climb | Descend:
        """What is crossed by; only while there is a `kind`."""
        return _motion(self.kind, self.numbers)

    @property
    def rise(self) -> float:
        """Of the ground behind the obstacle, m."""
        return self.numbers[0] if self.climbing else self.numbers[2]

    def path(self, heading: Array) -> Array:
        """Where the root goes (XZ, a unit vector): mostly as it has gone, for feet land there, and towards the stick's `heading`."""
        speed = float(np.linalg.norm(self.steps.velocity))
        if speed < WALKING:
            return heading
        mixed: Array = (1.0 - FOLLOWED) * heading + FOLLOWED * self.steps.velocity / speed
        size = float(np.linalg.norm(mixed))
        return mixed / size if size > 0.5 else heading

    def probe(self, terrain: Terrain | None, place: Array, heading: Array, speed: float) -> ObstacleProbe:
        """What lies ahead of a root at `place` (XZ) that is to go to `heading` (XZ); remembers whether it stops.

        `speed` is the root's, m/s; `terrain` None where it is known to hold nothing, or nothing is requested.
        """
        if self.climbing:
            found = CLIMBING
        elif terrain is None or self.over.is_under(float(place[0]), float(place[1])):
            found = CLEAR
        else:
            found = probe_obstacles(terrain, place, self.path(heading), speed, self.stopped)
        self.stopped = found.reason is not None
        return found


def is_possible(traversal: Traversal) -> bool:
    """Whether the numbers of a traversal that was read from a file describe one of its kind."""
    numbers = traversal.numbers
    in_sight = abs(traversal.sight) <= MOST_SIGHT and abs(traversal.sight_velocity) <= FASTEST_SIGHT
    over = traversal.over
    in_sight = in_sight and max(over.length, abs(over.top), abs(over.rise)) <= 10.0
    if (
        not in_sight
        or max(map(abs, numbers), default=0.0) > 100.0
        or not PACE[0] <= traversal.pace <= PACE[1]
    ):
        return False
    if not traversal.kind:
        return True
    if traversal.climbing:
        return len(numbers) == 4 and _is_climb_possible(traversal.kind, numbers[0], numbers[3])
    return len(numbers) == 23 and _is_leap_possible(*numbers[4:8])


def _is_climb_possible(kind: str, rise: float, tempo: float) -> bool:
    upwards = 1.0 if kind == "climb" else -1.0
    return 0.0 < upwards * rise <= HIGHEST_CLIMB_M and TEMPO[0] <= tempo <= TEMPO[1]


def _is_leap_possible(speed: float, seconds: float, elapsed: float, stance: float) -> bool:
    return speed >= 0.0 and 0.1 <= seconds <= 10.0 and 0.0 <= elapsed < seconds and stance in (0.0, 1.0)


CLIMB_SPEED = 0.3  # m/s: a climb begins slower
LAST_STEP = 0.65  # of a step: what is left is leapt over, more is another step
LATEST_START = 0.55  # of a stride: a leap that begins later is planned as if it began then
TOO_LATE_M = 0.08  # a foot whose ankle stands nearer to the edge leaps no more
SLOWEST_LEAP = 0.2  # m/s of a walk that leaps
NEUTRAL_SPEED = 1.3  # m/s of a walk whose climb takes the time it is keyframed for


def decide(
    traversal: Traversal,
    pose: Pose,
    held: Sequence[object],
    speed: float,
    walk_speed: float,
    ahead: Ahead | None,
) -> None:
    """Begin what the obstacle ahead requests. `held` tells which feet stand."""
    steps = traversal.steps
    came = steps.watch(pose, held, ahead.path if ahead is not None else None, traversal.pace)
    leads_over = _step_over(traversal, pose, ahead)
    if ahead is None or not is_leap(ahead.obstacle):
        traversal.pace = 1.0
        if ahead is not None and ahead.climbable:
            _climb(traversal, ahead, pose, speed, walk_speed)
    elif steps.stance is not None and steps.speed > SLOWEST_LEAP:
        left = ahead.obstacle.near - steps.ankle(pose, ahead.path)
        if ahead.alone:
            if came and leads_over:
                traversal.over.crossing = _last_step(traversal, ahead.obstacle, left, came, alone=True)
        elif left > TOO_LATE_M and _last_step(traversal, ahead.obstacle, left, came):
            _leap(traversal, ahead, pose)


OVER_M = 1.2  # behind what was stepped over the network sees it no more
FARTHEST_OVER_M = 5.0
LEFT_M = 0.4  # behind it the legs have left it


def _step_over(traversal: Traversal, pose: Pose, ahead: Ahead | None) -> bool:
    """Remember the bar or gap ahead that the gait itself steps over, until it lies behind; whether it is the one ahead."""
    x, _, z = pose.root_position.tolist()
    over = traversal.over
    if over.length >= 0.0:
        done = over.along(x, z) > over.length + OVER_M
        if done or hypot(x - over.x, z - over.z) > FARTHEST_OVER_M:
            over = traversal.over = SteppedOver()
    if (
        ahead is None
        or not ahead.alone
        or (over.length >= 0.0 and 0.0 < over.along(x, z) < over.length + LEFT_M)
    ):
        return False
    way, found = ahead.path, ahead.obstacle
    edge_x, edge_z, yaw = x + found.near * way[0], z + found.near * way[1], np.arctan2(way[0], way[1])
    crossing = over.crossing and bool(over.along(x, z) < 0.0)
    traversal.over = SteppedOver(
        float(edge_x), float(edge_z), float(yaw), float(found.far - found.near), float(found.ground),
        float(found.beyond), float(found.top), crossing,
    )  # fmt: skip
    return True


def _takeoff_alone(obstacle: ObstacleAhead, step: float) -> float:
    """How far before an edge the last foot stands so that a `step` (m) leaves as much room before as behind."""
    length = obstacle.far - obstacle.near
    return TOE_M + max(0.5 * (step - length - TOE_M - HEEL_M), 0.0)


def _last_step(
    traversal: Traversal, obstacle: ObstacleAhead, left: float, came: bool, alone: bool = False
) -> bool:
    """Whether the foot that stands `left` m before the edge is the last one there; sets the pace to the next ones."""
    steps = traversal.steps
    if came:
        best = takeoff_m(obstacle.kind, obstacle.top, steps.speed)
        missing = left - (_takeoff_alone(obstacle, steps.length) if alone else best)
        count = int(np.ceil(missing / steps.length - LAST_STEP))
        traversal.pace = min(max(missing / (count * steps.length), PACE[0]), PACE[1]) if count > 0 else 1.0
        return bool(count <= 0)
    edge = obstacle.near - 0.6 * takeoff_m(obstacle.kind, obstacle.top, 0.0)
    return steps.next_ankle(traversal.pace) > edge


def _climb(traversal: Traversal, ahead: Ahead, pose: Pose, speed: float, walk_speed: float) -> None:
    """Climb where the character stands before a wall or drop, at the tempo of its style."""
    obstacle = ahead.obstacle
    if obstacle.near > CLIMB_FROM_M or speed > CLIMB_SPEED:
        return
    yaw = float(np.arctan2(ahead.path[0], ahead.path[1])) + obstacle.skew
    near = obstacle.near * float(np.cos(obstacle.skew))
    depth = min(obstacle.far - obstacle.near, 10.0)
    tempo = min(max((walk_speed / NEUTRAL_SPEED) ** 0.5, TEMPO[0]), TEMPO[1])
    kind = "climb" if obstacle.top > 0.0 else "descend"
    _start(traversal, kind, (obstacle.top, -near, depth, tempo), pose, yaw, near, obstacle.ground)


def _leap(traversal: Traversal, ahead: Ahead, pose: Pose) -> None:
    obstacle, way, steps = ahead.obstacle, ahead.path, traversal.steps
    yaw = float(np.arctan2(way[0], way[1]))
    turn = rotations.from_yaw(-yaw)
    origin = _origin(pose, way, obstacle.near, obstacle.ground)
    ankles = rotations.rotate(turn, pose.positions[LEG_FEET].astype(np.float64) - origin)
    feet = rotations.multiply(turn, pose.world_rotations[LEG_FEET].astype(np.float64))
    hips = float(pose.hips_position[1]) - obstacle.ground
    length = 0.0 if obstacle.kind in (ObstacleKind.UP, ObstacleKind.DOWN) else obstacle.far - obstacle.near
    top = obstacle.top if obstacle.kind is ObstacleKind.BAR else 0.0
    begun = min(steps.elapsed, LATEST_START * steps.seconds)
    gait = (steps.speed * traversal.pace, steps.seconds, begun, float(steps.stance or 0))
    points = (*ankles.ravel().tolist(), *feet.ravel().tolist())
    numbers = (length, top, obstacle.beyond, -obstacle.near, *gait, hips, *points)
    traversal.pace = 1.0
    _start(traversal, obstacle.kind.value, numbers, pose, yaw, obstacle.near, obstacle.ground)


def _start(
    traversal: Traversal,
    kind: str,
    numbers: tuple[float, ...],
    pose: Pose,
    yaw: float,
    near: float,
    ground: float,
) -> None:
    way = np.array([np.sin(yaw), np.cos(yaw)])
    traversal.kind, traversal.numbers = kind, tuple(float(n) for n in numbers)
    traversal.time, traversal.yaw = 0.0, yaw
    traversal.origin = _origin(pose, way, near, ground)
    traversal.last_z = traversal.motion.root_z(0.0)
    traversal.fresh = True


def _origin(pose: Pose, way: Array, near: float, ground: float) -> Array:
    """The near edge on the way of the root, on the ground before it."""
    root = pose.root_position.astype(np.float64)
    return np.array([root[0] + near * way[0], ground, root[2] + near * way[1]])


DEEPEST_M = 0.05  # that a sole is lifted out of the ground,
LEAST_LIFT_M = 1e-6  # and least: a planned foot stands on it but for rounding
FADE_S = 0.3  # in which the first pose's difference from the traversal's goes


def traversal_velocity(traversal: Traversal) -> Array:
    """The root's velocity (m/s, XZ) to the next frame, whose traversal time this begins."""
    traversal.time += DT
    z = traversal.motion.root_z(traversal.time)
    speed, traversal.last_z = (z - traversal.last_z) / DT, z
    return speed * np.array([np.sin(traversal.yaw), np.cos(traversal.yaw)])


def traversal_pose(
    traversal: Traversal, hips: Array, local: Array, ground: float, last: Pose, terrain: Terrain
) -> tuple[Array, Array, Array]:
    """World hips `(3,)`, local rotations and contacts to show for the network's, which stands on `ground`."""
    local = np.array(local, np.float64)
    turn = rotations.from_yaw(-traversal.yaw)
    if traversal.fresh:
        traversal.fresh = False
        traversal.offset = rotations.to_rotation_vector(
            rotations.multiply(last.local_rotations.astype(np.float64), rotations.inverse(local))
        )
        over = last.hips_position.astype(np.float64) - hips
        traversal.hips_offset = np.array([0.0, over[1] - (traversal.origin[1] - ground), 0.0])
    fade = 1.0 - smoothstep(traversal.time / FADE_S)
    if fade > 0.0:
        local = rotations.multiply(rotations.from_rotation_vector(fade * traversal.offset), local)
        hips = hips + fade * traversal.hips_offset
    placed = rotations.rotate(turn, hips - np.array([traversal.origin[0], ground, traversal.origin[2]]))
    local[0] = rotations.multiply(turn, local[0])
    shown: TraversalPose = traversal.motion.pose(traversal.time, placed, local)
    back = rotations.from_yaw(traversal.yaw)
    result = np.array(shown.local)
    result[0] = rotations.multiply(back, result[0])
    place = rotations.rotate(back, shown.hips) + traversal.origin
    return place, _on_the_ground(place, result, terrain), shown.contacts


def end_when_over(traversal: Traversal) -> bool:
    """Whether the frame just shown was the traversal's last; it is over then."""
    if traversal.time < traversal.motion.seconds - 0.5 * DT:
        return False
    motion, steps = traversal.motion, traversal.steps
    vars(traversal).update(vars(Traversal(sight=traversal.sight, sight_velocity=traversal.sight_velocity)))
    if isinstance(motion, Leap):
        traversal.steps = steps
        steps.after_leap(motion.stride.stance)
    return True


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


def seen_heights(
    traversal: Traversal, points: Array, heights: Array, present: int, ahead: Ahead | None
) -> Array:
    """Heights `(12,)` that the network sees at `points` `(12, 2)`: as if what is crossed were level ground.

    It has learnt slopes and stairs; before a bar or a gap it would crouch or climb as before those. The body is
    placed over the mean of what it sees, so that this comes and goes on a spring.
    """
    level = heights[present]
    if traversal.over.length >= 0.0:
        heights = _without(traversal.over, points, heights)
        level = heights[present]
    if traversal.kind:
        done = smoothstep(traversal.time / traversal.motion.seconds)
        level = traversal.origin[1] + done * traversal.rise
        way = np.array([np.sin(traversal.yaw), np.cos(traversal.yaw)])
        along = (points - traversal.origin[[0, 2]]) @ way
        heights = np.where(_and_before(along > -BEFORE_M), level, heights)
    elif ahead is not None and not ahead.alone and (is_leap(ahead.obstacle) or is_climb(ahead.obstacle)):
        along = (points - points[present]) @ ahead.path
        hidden = _and_before(along > ahead.obstacle.near - BEFORE_M)
        heights = np.where(hidden, ahead.obstacle.ground, heights)
    goal = 0.0 if traversal.kind else 1.0
    if traversal.sight == goal:
        return heights if goal else np.full_like(heights, level)
    fraction, velocity = damp(traversal.sight, traversal.sight_velocity, goal, SIGHT_HALF_LIFE, DT)
    arrived = abs(fraction - goal) < UNSEEN and abs(velocity) < UNSEEN
    traversal.sight, traversal.sight_velocity = (goal, 0.0) if arrived else (fraction, velocity)
    return level + traversal.sight * (heights - level)


def _without(over: SteppedOver, points: Array, heights: Array) -> Array:
    """Heights `(12,)` at `points` `(12, 2)` as if the ground went on evenly over a bar or a gap."""
    way = np.array([np.sin(over.yaw), np.cos(over.yaw)])
    along = (points - np.array([over.x, over.z])) @ way
    within = (along > -0.5) & (along < over.length + 0.5)
    return np.where(within, over.ground + np.where(along < 0.5 * over.length, 0.0, over.rise), heights)


def _and_before(hidden: Flags) -> Flags:
    """Samples `(12,)` that lie on `hidden` ground, and the last one before it: it tells what stands behind it too."""
    result = hidden.copy()
    result[:-1] |= hidden[1:]
    return result
