"""How bodies come to rest when nothing more is asked of them: their time slows down, and they come over their feet."""

from __future__ import annotations

import numpy as np

from runtime.arrays import Array
from runtime.motion import calm, features
from runtime.motion.state import CharacterState
from runtime.motion.trajectory import PRESENT, wrap_angle
from runtime.skeleton import SPORT_SKELETON

# m/s of the plan of a stop: from there on the feet carry the root, and arms and trunk grow calm
CALM_FROM = 0.8
TURNS = 0.03  # rad of the stick's facing that the plan has not reached: a body turns on the spot
STANDS = 0.5  # of a contact of heel or toe
CHANGES = 0.03  # of the labels of gait in a frame: a body crouches or gets up


def rest_share(state: CharacterState) -> Array:
    """How far bodies have come to rest `(N,)`: 0 while they move or gesticulate, 1 when their plan stands still."""
    stops = (state.wished_speed == 0.0) & ~np.array([jump.airborne for jump in state.jumps])
    slow = np.minimum(np.maximum(1.0 - state.requested_speed / CALM_FROM, 0.0), 1.0)
    return np.asarray(np.where(stops, slow * (1.0 - state.rest.share.max(-1)), 0.0))


def calmed_pose(
    state: CharacterState, hips: Array, local: Array, joints: Array, contacts: Array
) -> tuple[Array, Array, Array]:
    """The network's pose as far as a body at rest moves towards it in a frame; writes `state.calm`.

    Hips `(N, 3)`, local rotations `(N, 31, 4)` and joints `(N, 31, 3)` in the world; contacts `(N, 4)`.
    """
    path = state.trajectory
    yaw, gait = path.yaw[:, PRESENT], path.gait
    turning = np.abs(wrap_angle(path.wish_yaw - path.requested_yaw)) > TURNS
    changes = np.abs(gait[:, PRESENT] - gait[:, PRESENT - 1]).max(-1) > CHANGES
    free = (state.wished_speed == 0.0) & (state.rest.share.max(-1) == 0.0) & (state.arms.left == 0.0)
    free &= [
        jump.stage == "" and crossing.kind == ""
        for jump, crossing in zip(state.jumps, state.crossings, strict=True)
    ]
    still = (state.requested_speed < calm.SLOW) & ~turning & ~changes
    grounded = (contacts.reshape(-1, 2, 2).max(-1) > STANDS).all(-1)
    relative = features.relative_joints(joints, path.here, state.ground, yaw)
    rate = state.calm.slow(relative, state.joints, free & ~turning, still, grounded)
    local = state.calm.between(local, yaw)
    slow = rate < 1.0
    if slow.any():
        place = state.joints[:, 0] + rate[:, None] * (relative[:, 0] - state.joints[:, 0])
        there = features.to_world(place, yaw) + np.stack([path.here[:, 0], state.ground, path.here[:, 1]], -1)
        hips = np.where(slow[:, None], there, hips)
        joints[slow] = SPORT_SKELETON.forward_kinematics(hips[slow], local[slow])[0]
    return hips, local, joints


def over_feet(state: CharacterState) -> Array:
    """Velocities `(N, 2)` (m/s) that bring calm bodies over their feet: one that stops leaves them up to 0.2 m behind."""
    share = np.maximum(1.0 - state.calm.share / calm.NEARLY, 0.0)
    away = [
        [foot.offset for foot in feet.feet] if all(feet.held) else ((0.0,) * 3,) * 2 for feet in state.feet
    ]
    offset = np.array(away).mean(1)[:, [0, 2]]
    distance = np.sqrt((offset * offset).sum(-1))
    speed = np.minimum(np.maximum(distance - calm.UNSEEN, 0.0) / calm.OVER_FEET_S, calm.SWAYS)
    return np.asarray(offset * (share * speed / np.maximum(distance, 1e-9))[:, None])
