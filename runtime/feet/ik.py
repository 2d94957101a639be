"""Closed-form two-bone inverse kinematics on arrays of any leading shape: one frame, both legs, or a whole clip."""

from __future__ import annotations

import numpy as np

from runtime import rotations
from runtime.arrays import Array
from runtime.scalar_math import MIN_DIVISOR, MIN_SIZE
from runtime.skeleton import SPORT_SKELETON, Skeleton

# hips → hip joint → thigh → shin → foot, as joint indices of the SPORT skeleton (left, right)
LEG_HIP_JOINTS = np.array([1, 6])
LEG_THIGHS = np.array([2, 7])
LEG_SHINS = np.array([3, 8])
LEG_FEET = np.array([4, 9])
LEG_TOES = np.array([5, 10])

# of the leg's length (2.3 degrees): a knee never straightens fully, so its bending plane stays defined
MAX_REACH = 0.9998
# of the leg's length: beyond its own pose's length, a leg extends with falling speed
EASE_REACH_FRACTION = 0.001
MIN_REACH_FRACTION = 0.2  # of the leg's length: about 155 degrees of knee flexion
MIN_OPENING_M = 1e-4  # minimum distance of the ankle from its position in a fully folded leg
MIN_BEND_M = 1e-5  # distance of the knee from the hip-ankle line above which it defines a bending plane
MAX_HELPER_COSINE = 0.9  # of the leg's direction with Z: up to this, +Z defines the bending plane
POLE_WEIGHT_M = 0.01  # pull of the pole on the bending plane, as metres of knee offset
_FORWARD = np.array([0.0, 0.0, 1.0])


def soft_reach(distance: Array, length: Array, span: Array | float = 0.0) -> Array:
    """Return the distance that a leg of `length` spans when `distance` is requested and the incoming pose spans `span`.

    Equal to the requested distance up to `MAX_REACH - EASE_REACH_FRACTION` of the length, and always up to `span`.
    Beyond, it eases quadratically towards `MAX_REACH` of the length: without easing the knee would snap, because its
    angle grows with the square root of the missing length.
    """
    length = np.asarray(length)
    start = np.maximum((MAX_REACH - EASE_REACH_FRACTION) * length, np.minimum(span, length))
    room = np.maximum(MAX_REACH * length - start, MIN_DIVISOR * length)
    over = np.clip(np.asarray(distance) - start, 0.0, 2.0 * room)
    eased = np.minimum(distance, start) + over - over * over / (4.0 * room)
    return np.maximum(eased, MIN_REACH_FRACTION * length)


def two_bone(
    hip: Array, knee: Array, ankle: Array, target: Array, pole: Array | None = None
) -> tuple[Array, Array]:
    """Return world rotations `(..., 4)` to apply to the upper and lower bone so that the ankle reaches `target`.

    All points are `(..., 3)` in one space. The incoming bending plane is kept. With `pole` `(..., 3)`, the direction in
    which the knee may bend, a straight knee follows the pole and one bent against it is brought to its side. Bones keep
    their lengths; a target out of reach is approached along its line (see `soft_reach`).
    """
    hip, knee, ankle, target = (np.asarray(a, np.float64) for a in (hip, knee, ankle, target))
    upper, lower = np.maximum(_length(knee - hip), MIN_SIZE), np.maximum(_length(ankle - knee), MIN_SIZE)
    to_target = target - hip
    wanted = _length(to_target)
    axis = rotations.normalize(ankle - hip)
    aim = rotations.normalize(np.where(wanted[..., None] > MIN_SIZE, to_target, axis))
    distance = soft_reach(wanted, upper + lower, _length(ankle - hip))
    distance = np.maximum(distance, np.abs(upper - lower) + MIN_OPENING_M)

    bend = _bend_direction(axis, knee - hip, pole)
    swing = rotations.between(axis, aim)
    bend = rotations.rotate(swing, bend)
    cosine = (upper**2 + distance**2 - lower**2) / (2.0 * upper * distance)
    cosine = np.clip(cosine, -1.0, 1.0)[..., None]
    thigh = cosine * aim + np.sqrt(1.0 - cosine**2) * bend  # unit direction of the new upper bone
    shin = rotations.normalize(distance[..., None] * aim - upper[..., None] * thigh)
    thigh_now = rotations.rotate(swing, rotations.normalize(knee - hip))
    shin_now = rotations.rotate(swing, rotations.normalize(ankle - knee))
    return (
        rotations.multiply(rotations.between(thigh_now, thigh), swing),
        rotations.multiply(rotations.between(shin_now, shin), swing),
    )


def solve_legs(
    hips_position: Array,
    local_rotations: Array,
    ankle_targets: Array,
    foot_world_rotations: Array | None = None,
    skeleton: Skeleton = SPORT_SKELETON,
) -> Array:
    """Return local rotations `(..., 31, 4)` with both ankles at `ankle_targets` `(..., 2, 3)` (left, right; world, metres).

    `hips_position` `(..., 3)` and `local_rotations` `(..., 31, 4)` are the incoming pose. The feet take
    `foot_world_rotations` `(..., 2, 4)`, or keep their incoming world rotations if it is None.
    """
    local = np.asarray(local_rotations, np.float64)
    hips_world = local[..., None, 0, :]
    base_world = rotations.multiply(hips_world, local[..., LEG_HIP_JOINTS, :])
    thigh_world = rotations.multiply(base_world, local[..., LEG_THIGHS, :])
    shin_world = rotations.multiply(thigh_world, local[..., LEG_SHINS, :])
    foot_world = rotations.multiply(shin_world, local[..., LEG_FEET, :])
    offsets = np.asarray(skeleton.offsets, np.float64)
    base = np.asarray(hips_position)[..., None, :] + rotations.rotate(hips_world, offsets[LEG_HIP_JOINTS])
    hip = base + rotations.rotate(base_world, offsets[LEG_THIGHS])
    knee = hip + rotations.rotate(thigh_world, offsets[LEG_SHINS])
    ankle = knee + rotations.rotate(shin_world, offsets[LEG_FEET])

    pole = rotations.rotate(thigh_world, np.broadcast_to(_FORWARD, hip.shape))
    thigh_turn, shin_turn = two_bone(hip, knee, ankle, ankle_targets, pole)
    new_thigh = rotations.multiply(thigh_turn, thigh_world)
    new_shin = rotations.multiply(shin_turn, shin_world)
    new_foot = foot_world if foot_world_rotations is None else np.asarray(foot_world_rotations)
    result = local.copy()
    result[..., LEG_THIGHS, :] = _relative(base_world, new_thigh)
    result[..., LEG_SHINS, :] = _relative(new_thigh, new_shin)
    result[..., LEG_FEET, :] = _relative(new_shin, new_foot)
    return result.astype(np.asarray(local_rotations).dtype)


def _bend_direction(axis: Array, knee: Array, pole: Array | None) -> Array:
    """Unit direction `(..., 3)`, perpendicular to `axis`, in which the knee leaves the line from hip to ankle."""
    bend = _perpendicular(knee, axis)
    if pole is None:
        # a straight leg without a hint bends towards +Z, or +Y when the leg lies along Z
        helper = np.where(np.abs(axis[..., 2:]) < MAX_HELPER_COSINE, _FORWARD, np.array([0.0, 1.0, 0.0]))
        fallback = rotations.normalize(_perpendicular(helper, axis))
        return rotations.normalize(np.where(_length(bend)[..., None] > MIN_BEND_M, bend, fallback))
    forward = rotations.normalize(_perpendicular(np.asarray(pole, np.float64), axis))
    bend = bend + POLE_WEIGHT_M * forward
    against = np.sum(bend * forward, axis=-1, keepdims=True)
    return rotations.normalize(bend + forward * np.maximum(0.5 * POLE_WEIGHT_M - against, 0.0))


def _perpendicular(v: Array, axis: Array) -> Array:
    return v - np.sum(v * axis, axis=-1, keepdims=True) * axis


def _relative(parent: Array, world: Array) -> Array:
    return rotations.normalize(rotations.multiply(rotations.inverse(parent), world))


def _length(v: Array) -> Array:
    return np.linalg.norm(v, axis=-1)
