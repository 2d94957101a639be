"""Approach to an obstacle: adapts the pace to its edge, and starts a leap or a climb."""

from __future__ import annotations

from collections.abc import Sequence
from math import hypot

import numpy as np

from runtime import rotations
from runtime.arrays import Array
from runtime.feet.ik import LEG_FEET
from runtime.feet.next_step import HEEL_M, TOE_M, SteppedOver
from runtime.pose import Pose
from runtime.skeleton import ANKLE_HEIGHT
from runtime.terrain.obstacle_detection import ObstacleAhead, ObstacleKind
from runtime.traversal.leap import takeoff_m
from runtime.traversal.obstacle_probe import CLIMB_FROM_M, Ahead, is_leap
from runtime.traversal.traversal import PACE_RANGE, TEMPO_RANGE, Traversal

MAX_CLIMB_START_SPEED_M_PER_S = 0.3  # faster, no climb begins
LAST_STEP_FRACTION = 0.65  # of a step: a shorter remaining distance is leapt over
LATEST_START_FRACTION = 0.55  # of a stride: a leap that begins later is planned as if it began then
FAR_TAKEOFF_FRACTION = 0.6  # of the best distance from an edge: the next step would land nearer
MAX_DEPTH_M = 10.0  # of what is climbed onto or down from
TOO_LATE_M = 0.08  # a foot whose ankle is nearer to the edge cannot leap
MAX_STANCE_RISE_M = 0.12  # of the last foot over the ground before: a higher one stands beyond a ditch
MIN_LEAP_SPEED_M_PER_S = 0.2  # minimum of a walk that leaps
NEUTRAL_SPEED_M_PER_S = 1.3  # of a walk whose climb runs at tempo 1


def decide(
    traversal: Traversal,
    pose: Pose,
    held: Sequence[object],
    speed: float,
    walk_speed: float,
    ahead: Ahead | None,
) -> None:
    """Plan the steps towards the obstacle ahead, and start a leap or climb when it is reached; `held` tells which feet stand."""
    steps = traversal.steps
    came = steps.watch(pose, held, ahead.path if ahead is not None else None, traversal.pace)
    leads_over = _step_over(traversal, pose, ahead)
    if ahead is None or not is_leap(ahead.obstacle):
        traversal.pace = 1.0
        if ahead is not None and ahead.climbable:
            _climb(traversal, ahead, pose, speed, walk_speed)
    elif steps.stance is not None and steps.speed > MIN_LEAP_SPEED_M_PER_S:
        _approach(traversal, ahead, pose, came, leads_over)


def _approach(traversal: Traversal, ahead: Ahead, pose: Pose, came: bool, leads_over: bool) -> None:
    """Adapt the pace to the edge of a bar or gap; from the last step leap over it, or let the gait step over it."""
    left = ahead.obstacle.near - traversal.steps.ankle(pose, ahead.path)
    if ahead.alone:
        if came and leads_over:
            traversal.over.crossing = _last_step(traversal, ahead.obstacle, left, came, alone=True)
    elif left > TOO_LATE_M and _last_step(traversal, ahead.obstacle, left, came):
        sole = float(pose.positions[LEG_FEET[traversal.steps.stance or 0], 1]) - ANKLE_HEIGHT
        if sole < ahead.obstacle.ground + MAX_STANCE_RISE_M:
            _leap(traversal, ahead, pose)


FORGET_BEHIND_M = 1.2  # behind an obstacle, where it has left the network's view
FORGET_AWAY_M = 5.0
LEGS_CLEAR_M = 0.4  # behind an obstacle, where the legs are clear of it


def _step_over(traversal: Traversal, pose: Pose, ahead: Ahead | None) -> bool:
    """Keep the bar or gap that the gait steps over until it lies behind; return whether it is the one ahead."""
    x, _, z = pose.root_position.tolist()
    over = traversal.over
    if over.length >= 0.0:
        done = over.along(x, z) > over.length + FORGET_BEHIND_M
        if done or hypot(x - over.x, z - over.z) > FORGET_AWAY_M:
            over = traversal.over = SteppedOver()
    if (
        ahead is None
        or not ahead.alone
        or (over.length >= 0.0 and 0.0 < over.along(x, z) < over.length + LEGS_CLEAR_M)
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
    """Return the distance from an edge at which the last foot stands for a `step` (m) to be centred over the obstacle."""
    length = obstacle.far - obstacle.near
    return TOE_M + max(0.5 * (step - length - TOE_M - HEEL_M), 0.0)


def _last_step(
    traversal: Traversal, obstacle: ObstacleAhead, left: float, came: bool, alone: bool = False
) -> bool:
    """Return whether the foot `left` m before the edge is the last one there; sets the pace of the remaining steps."""
    steps = traversal.steps
    if came:
        best = takeoff_m(obstacle.kind, obstacle.top, steps.speed)
        missing = left - (_takeoff_alone(obstacle, steps.length) if alone else best)
        count = int(np.ceil(missing / steps.length - LAST_STEP_FRACTION))
        traversal.pace = (
            min(max(missing / (count * steps.length), PACE_RANGE[0]), PACE_RANGE[1]) if count > 0 else 1.0
        )
        return bool(count <= 0)
    edge = obstacle.near - FAR_TAKEOFF_FRACTION * takeoff_m(obstacle.kind, obstacle.top, 0.0)
    return steps.next_ankle(traversal.pace) > edge


def _climb(traversal: Traversal, ahead: Ahead, pose: Pose, speed: float, walk_speed: float) -> None:
    """Start a climb if the character stands before a wall or drop, at the tempo of its style."""
    obstacle = ahead.obstacle
    if obstacle.near > CLIMB_FROM_M or speed > MAX_CLIMB_START_SPEED_M_PER_S:
        return
    yaw = float(np.arctan2(ahead.path[0], ahead.path[1])) + obstacle.skew
    near = obstacle.near * float(np.cos(obstacle.skew))
    depth = min(obstacle.far - obstacle.near, MAX_DEPTH_M)
    tempo = min(max((walk_speed / NEUTRAL_SPEED_M_PER_S) ** 0.5, TEMPO_RANGE[0]), TEMPO_RANGE[1])
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
    begun = min(steps.elapsed, LATEST_START_FRACTION * steps.seconds)
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
    """The near edge on the root's path, on the ground before it."""
    root = pose.root_position.astype(np.float64)
    return np.array([root[0] + near * way[0], ground, root[2] + near * way[1]])
