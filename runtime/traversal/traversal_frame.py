"""One frame of a traversal: the pose to show, and the ground heights that the network sees meanwhile."""

from __future__ import annotations

import numpy as np

from runtime import rotations
from runtime.arrays import Array, Flags
from runtime.feet.ik import LEG_FEET, solve_legs
from runtime.feet.next_step import SteppedOver
from runtime.feet.skating import SOLE_HEIGHTS, SOLE_POINTS
from runtime.pose import DT, Pose
from runtime.scalar_math import damp, smoothstep
from runtime.skeleton import SPORT_SKELETON
from runtime.terrain.height_map import Terrain
from runtime.traversal.keyframes import TraversalPose
from runtime.traversal.obstacle_probe import Ahead, is_climb, is_leap
from runtime.traversal.traversal import Traversal

BEFORE_M = 0.06  # margin of an obstacle that is hidden from the network
SIGHT_HALF_LIFE_S = 0.1  # of the ground's fading into sight
ARRIVED_SIGHT_FRACTION = 1e-4  # fraction, and 1/s
MAX_LIFT_M = 0.05  # limit of lifting a sole out of the ground,
MIN_LIFT_M = 1e-6  # and its minimum: a planned foot is off by rounding only
FADE_S = 0.3  # in which the difference of the first pose from the traversal's fades


def traversal_velocity(traversal: Traversal) -> Array:
    """Advance the traversal by a frame and return the root's velocity (m/s, XZ)."""
    traversal.time += DT
    z = traversal.motion.root_z(traversal.time)
    speed, traversal.last_z = (z - traversal.last_z) / DT, z
    return speed * np.array([np.sin(traversal.yaw), np.cos(traversal.yaw)])


def traversal_pose(
    traversal: Traversal, hips: Array, local: Array, ground: float, last: Pose, terrain: Terrain
) -> tuple[Array, Array, Array]:
    """Return world hips `(3,)`, local rotations and contacts to show, from the network's pose on `ground`."""
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


def _on_the_ground(hips: Array, local: Array, terrain: Terrain) -> Array:
    """Return local rotations with soles lifted out of the ground; a foot deep inside passes before a riser, and is left."""
    positions, world = SPORT_SKELETON.forward_kinematics(hips, local)
    soles = positions[list(SOLE_POINTS)].astype(np.float64)
    lack = terrain.height(soles[:, 0], soles[:, 2]) + np.array(SOLE_HEIGHTS) - soles[:, 1]
    lift = np.max(np.where(lack < MAX_LIFT_M, lack, 0.0).reshape(2, 2), axis=1)
    if lift.max() <= MIN_LIFT_M:
        return local
    ankles = soles[::2] + np.outer(np.maximum(lift, 0.0), [0.0, 1.0, 0.0])
    return solve_legs(hips, local, ankles, world[LEG_FEET].astype(np.float64))


def seen_heights(
    traversal: Traversal, points: Array, heights: Array, present: int, ahead: Ahead | None
) -> Array:
    """Return the heights `(12,)` that the network sees at `points` `(12, 2)`, with the obstacle replaced by level ground.

    The network has learnt slopes and stairs, and would crouch or climb before a bar or gap. The body is placed over the
    mean of these heights, which therefore change on a spring.
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
    elif ahead is not None and _is_keyframed(ahead):
        along = (points - points[present]) @ ahead.path
        hidden = _and_before(along > ahead.obstacle.near - BEFORE_M)
        heights = np.where(hidden, ahead.obstacle.ground, heights)
    goal = 0.0 if traversal.kind else 1.0
    if traversal.sight == goal:
        return heights if goal else np.full_like(heights, level)
    fraction, velocity = damp(traversal.sight, traversal.sight_velocity, goal, SIGHT_HALF_LIFE_S, DT)
    arrived = abs(fraction - goal) < ARRIVED_SIGHT_FRACTION and abs(velocity) < ARRIVED_SIGHT_FRACTION
    traversal.sight, traversal.sight_velocity = (goal, 0.0) if arrived else (fraction, velocity)
    return level + traversal.sight * (heights - level)


def _is_keyframed(ahead: Ahead) -> bool:
    """Whether the obstacle ahead is leapt over or climbed, rather than stepped over by the gait."""
    return not ahead.alone and (is_leap(ahead.obstacle) or is_climb(ahead.obstacle))


def _without(over: SteppedOver, points: Array, heights: Array) -> Array:
    """Return heights `(12,)` at `points` `(12, 2)` with the ground interpolated across a bar or a gap."""
    way = np.array([np.sin(over.yaw), np.cos(over.yaw)])
    along = (points - np.array([over.x, over.z])) @ way
    within = (along > -0.5) & (along < over.length + 0.5)
    return np.where(within, over.ground + np.where(along < 0.5 * over.length, 0.0, over.rise), heights)


def _and_before(hidden: Flags) -> Flags:
    """Samples `(12,)` on `hidden` ground, and the last one before it, whose height includes what is behind it."""
    result = hidden.copy()
    result[:-1] |= hidden[1:]
    return result
