"""The frames of a crossing under way: the root's velocity, the pose in place of the network's, and its end."""

from __future__ import annotations

import numpy as np

from runtime import rotations
from runtime.arrays import Array
from runtime.crossing.crossing import Crossing
from runtime.crossing.keyed_pose import CrossingPose
from runtime.crossing.leap import Leap
from runtime.easing import smooth
from runtime.feet.ik import LEG_FEET, solve_legs
from runtime.feet.skating import SOLE_HEIGHTS, SOLE_POINTS
from runtime.pose import DT, Pose
from runtime.skeleton import SPORT_SKELETON
from runtime.terrain.height_map import Terrain

DEEPEST_M = 0.05  # that a sole is lifted out of the ground,
LEAST_LIFT_M = 1e-6  # and least: a planned foot stands on it but for rounding
FADE_S = 0.3  # in which the first pose's difference from the crossing's goes


def keyed_velocity(crossing: Crossing) -> Array:
    """The root's velocity (m/s, XZ) to the next frame, whose crossing time this begins."""
    crossing.time += DT
    z = crossing.motion.root_z(crossing.time)
    speed, crossing.last_z = (z - crossing.last_z) / DT, z
    return speed * np.array([np.sin(crossing.yaw), np.cos(crossing.yaw)])


def crossing_pose(
    crossing: Crossing, hips: Array, local: Array, ground: float, last: Pose, terrain: Terrain
) -> tuple[Array, Array, Array]:
    """World hips `(3,)`, local rotations and contacts to show for the network's, which stands on `ground`."""
    local = np.array(local, np.float64)
    turn = rotations.from_yaw(-crossing.yaw)
    if crossing.fresh:
        crossing.fresh = False
        crossing.offset = rotations.to_rotation_vector(
            rotations.multiply(last.local_rotations.astype(np.float64), rotations.inverse(local))
        )
        over = last.hips_position.astype(np.float64) - hips
        crossing.hips_offset = np.array([0.0, over[1] - (crossing.origin[1] - ground), 0.0])
    fade = 1.0 - smooth(crossing.time / FADE_S)
    if fade > 0.0:
        local = rotations.multiply(rotations.from_rotation_vector(fade * crossing.offset), local)
        hips = hips + fade * crossing.hips_offset
    placed = rotations.rotate(turn, hips - np.array([crossing.origin[0], ground, crossing.origin[2]]))
    local[0] = rotations.multiply(turn, local[0])
    shown: CrossingPose = crossing.motion.pose(crossing.time, placed, local)
    back = rotations.from_yaw(crossing.yaw)
    result = np.array(shown.local)
    result[0] = rotations.multiply(back, result[0])
    place = rotations.rotate(back, shown.hips) + crossing.origin
    return place, _on_the_ground(place, result, terrain), shown.contacts


def end_when_over(crossing: Crossing) -> bool:
    """Whether the frame just shown was the crossing's last; it is over then."""
    if crossing.time < crossing.motion.seconds - 0.5 * DT:
        return False
    motion, steps = crossing.motion, crossing.steps
    vars(crossing).update(vars(Crossing(sight=crossing.sight, sight_velocity=crossing.sight_velocity)))
    if isinstance(motion, Leap):
        crossing.steps = steps
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
