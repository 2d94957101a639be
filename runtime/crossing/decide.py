"""When a crossing begins: at the last step before what is leapt, or where the character stands before what is climbed."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from runtime import rotations
from runtime.arrays import Array
from runtime.crossing.crossing import PACE, TEMPO, Crossing
from runtime.crossing.leap import takeoff_m
from runtime.crossing.look import CLIMB_FROM_M, Ahead, is_climb, is_leap
from runtime.feet.ik import LEG_FEET
from runtime.pose import Pose
from runtime.terrain.way_ahead import ObstacleAhead, ObstacleKind

CLIMB_SPEED = 0.3  # m/s: a climb begins slower
LAST_STEP = 0.65  # of a step: what is left is leapt over, more is another step
LATEST_START = 0.55  # of a stride: a leap that begins later is planned as if it began then
TOO_LATE_M = 0.08  # a foot whose ankle stands nearer to the edge leaps no more
SLOWEST = 0.2  # m/s of a walk that leaps
NEUTRAL_SPEED = 1.3  # m/s of a walk whose climb takes the time it is keyed for


def decide(
    crossing: Crossing,
    pose: Pose,
    held: Sequence[object],
    speed: float,
    walk_speed: float,
    ahead: Ahead | None,
) -> None:
    """Begin what the obstacle ahead asks for. `held` tells which feet stand."""
    steps = crossing.steps
    came = steps.watch(pose, held, ahead.way if ahead is not None else None, crossing.pace)
    if ahead is None or not is_leap(ahead.obstacle):
        crossing.pace = 1.0
        if ahead is not None and is_climb(ahead.obstacle) and ahead.blocked is None:
            _climb(crossing, ahead, pose, speed, walk_speed)
    elif steps.stance is not None and steps.speed > SLOWEST:
        left = ahead.obstacle.near - steps.ankle(pose, ahead.way)
        if left > TOO_LATE_M and _last_step(crossing, ahead.obstacle, pose, ahead.way, left, came):
            _leap(crossing, ahead, pose)


def _last_step(
    crossing: Crossing, obstacle: ObstacleAhead, pose: Pose, way: Array, left: float, came: bool
) -> bool:
    """Whether the foot that stands `left` m before the edge is the last one there; sets the pace to the next ones."""
    steps = crossing.steps
    if came:
        missing = left - takeoff_m(obstacle.kind, obstacle.top, steps.speed)
        count = int(np.ceil(missing / steps.length - LAST_STEP))
        crossing.pace = min(max(missing / (count * steps.length), PACE[0]), PACE[1]) if count > 0 else 1.0
        return count <= 0
    edge = obstacle.near - 0.6 * takeoff_m(obstacle.kind, obstacle.top, 0.0)
    return steps.next_ankle(crossing.pace) > edge


def _climb(crossing: Crossing, ahead: Ahead, pose: Pose, speed: float, walk_speed: float) -> None:
    """Climb where the character stands before a wall or drop, at the tempo of its style."""
    obstacle = ahead.obstacle
    if obstacle.near > CLIMB_FROM_M or speed > CLIMB_SPEED:
        return
    yaw = float(np.arctan2(ahead.way[0], ahead.way[1])) + obstacle.skew
    near = obstacle.near * float(np.cos(obstacle.skew))
    depth = min(obstacle.far - obstacle.near, 10.0)
    tempo = min(max((walk_speed / NEUTRAL_SPEED) ** 0.5, TEMPO[0]), TEMPO[1])
    kind = "climb" if obstacle.top > 0.0 else "descend"
    _start(crossing, kind, (obstacle.top, -near, depth, tempo), pose, yaw, near, obstacle.ground)


def _leap(crossing: Crossing, ahead: Ahead, pose: Pose) -> None:
    obstacle, way, steps = ahead.obstacle, ahead.way, crossing.steps
    yaw = float(np.arctan2(way[0], way[1]))
    turn = rotations.from_yaw(-yaw)
    origin = _origin(pose, way, obstacle.near, obstacle.ground)
    ankles = rotations.rotate(turn, pose.positions[LEG_FEET].astype(np.float64) - origin)
    feet = rotations.multiply(turn, pose.world_rotations[LEG_FEET].astype(np.float64))
    hips = float(pose.hips_position[1]) - obstacle.ground
    length = 0.0 if obstacle.kind in (ObstacleKind.UP, ObstacleKind.DOWN) else obstacle.far - obstacle.near
    top = obstacle.top if obstacle.kind is ObstacleKind.BAR else 0.0
    begun = min(steps.elapsed, LATEST_START * steps.seconds)
    gait = (steps.speed * crossing.pace, steps.seconds, begun, float(steps.stance or 0))
    points = (*ankles.ravel().tolist(), *feet.ravel().tolist())
    numbers = (length, top, obstacle.beyond, -obstacle.near, *gait, hips, *points)
    crossing.pace = 1.0
    _start(crossing, obstacle.kind.value, numbers, pose, yaw, obstacle.near, obstacle.ground)


def _start(
    crossing: Crossing,
    kind: str,
    numbers: tuple[float, ...],
    pose: Pose,
    yaw: float,
    near: float,
    ground: float,
) -> None:
    way = np.array([np.sin(yaw), np.cos(yaw)])
    crossing.kind, crossing.numbers = kind, tuple(float(n) for n in numbers)
    crossing.time, crossing.yaw = 0.0, yaw
    crossing.origin = _origin(pose, way, near, ground)
    crossing.last_z = crossing.motion.root_z(0.0)
    crossing.fresh = True


def _origin(pose: Pose, way: Array, near: float, ground: float) -> Array:
    """The near edge on the way of the root, on the ground before it."""
    root = pose.root_position.astype(np.float64)
    return np.array([root[0] + near * way[0], ground, root[2] + near * way[1]])
