"""What the roots take of the network's velocity: feet carry them in a stop, strides stretch, obstacles hold them back.

When nothing more is requested bodies come to rest: their time slows down, and they come over their feet.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from runtime.arrays import Array, Flags
from runtime.controls import STAND_SPEED, Gait
from runtime.motion import features
from runtime.motion.features import DT
from runtime.motion.pace import stretch
from runtime.motion.pose_smoothing import NEARLY, OVER_FEET_S, RESTS_BELOW, SWAYS, UNSEEN_M
from runtime.motion.state import CharacterState
from runtime.motion.trajectory import GAME, PRESENT, wrap_angle
from runtime.scalar_math import decay
from runtime.skeleton import SPORT_SKELETON
from runtime.terrain.height_map import Terrain
from runtime.terrain.obstacle_detection import EDGE_M, RUN_M, has_walls, led_clear, level_ahead
from runtime.traversal.obstacle_probe import CLEAR, HALF_BODY_M, ObstacleProbe, held_back
from runtime.traversal.traversal import traversal_velocity

LAST_SPEED = 9.0  # times the planned speed: what is more fades at the end of a stop,
FIRM_CONTACT = 0.5  # sum of squared contacts that carry a root
COAST = 0.24  # seconds, half-life: the planted feet carry the root on, or they would slide under it
SPEED_HALF_LIFE = 0.25  # seconds, smoothing of the measured speed (a stride speeds up and slows down)


def root_velocity(
    state: CharacterState,
    velocity: Array,
    contacts: Array,
    probes: Sequence[ObstacleProbe],
    terrain: Terrain,
    response: Array,
) -> Array:
    """The velocities `(N, 2)` (m/s) that the roots take of the network's; writes the speeds and the strides.

    Contacts `(N, 4)` are the network's; `response` `(N,)` is 0 for a captured body and 1 for a player's.
    """
    flying = np.array([jump.airborne for jump in state.jumps])
    velocity = _carried(state, velocity, contacts, flying)
    velocity = _slowed(state, velocity, flying, response) + over_feet(state)
    change = (state.root_speed - state.measured_speed) * (1 - decay(SPEED_HALF_LIFE))
    state.measured_speed = state.measured_speed + change
    state.stride.update(state.joints, np.where(flying[:, None], 0.0, contacts), state.measured_speed)
    walks = (state.measured_speed > 0.5 * state.requested_speed) & (state.requested_speed > STAND_SPEED)
    longer = stretch(
        state.smooth_request,
        state.requested_speed,
        state.measured_speed,
        state.root_speed,
        state.trajectory.gait[:, PRESENT, Gait.JOG] > 0.5,
        response,
    )
    velocity = velocity * np.where(walks & ~flying, longer, 1.0)[:, None]
    return _past_obstacles(state, velocity, probes, terrain)


def _carried(state: CharacterState, velocity: Array, contacts: Array, flying: Flags) -> Array:
    """Pulled by held feet, carried by planted ones in a stop, and as a body in the air flies."""
    velocity = velocity + np.array([feet.pull for feet in state.feet])
    carried, weight = state.stride.carried(state.joints, contacts)
    firm = np.where(flying, 0.0, rest_share(state) * np.minimum(weight / FIRM_CONTACT, 1.0))
    carried = features.to_world(carried, state.trajectory.yaw[:, PRESENT])
    velocity = velocity + (carried - velocity) * firm[:, None]
    for i, jump in enumerate(state.jumps):
        velocity[i] = jump.carried(velocity[i])
    return velocity


def _slowed(state: CharacterState, velocity: Array, flying: Flags, response: Array) -> Array:
    """A body at rest does not creep: what is faster than the plan fades. Writes `root_speed`."""
    speed = np.sqrt((velocity * velocity).sum(-1))
    still = (state.wished_speed == 0.0) & ~flying
    coast = decay(COAST) ** (GAME**-response)
    most = np.maximum(LAST_SPEED * state.requested_speed, coast * state.root_speed)
    creep = np.where(still, np.minimum(1.0, most / np.maximum(speed, 1e-6)), 1.0)
    state.root_speed = speed * creep
    return velocity * creep[:, None]


def _past_obstacles(
    state: CharacterState, velocity: Array, probes: Sequence[ObstacleProbe], terrain: Terrain
) -> Array:
    """Keyframed while an obstacle is crossed, held back before one, led along walls."""
    near = 2.0 * state.root_speed * DT + HALF_BODY_M  # strides are scaled by less
    way = velocity / np.maximum(np.sqrt((velocity * velocity).sum(-1, keepdims=True)), 1e-9)
    gentle, walls = terrain.steepest * RUN_M < EDGE_M, has_walls(terrain)
    clear = np.full(len(state), True) if gentle else level_ahead(terrain, state.trajectory.here, way, near)
    for i, (traversal, probe) in enumerate(zip(state.traversals, probes, strict=True)):
        if traversal.kind:
            velocity[i] = traversal_velocity(traversal)
        else:
            velocity[i] *= traversal.pace
            if probe is not CLEAR or not clear[i]:
                here = state.trajectory.here[i]
                velocity[i] = held_back(terrain, here, velocity[i], probe.ahead)
            if walls:
                velocity[i] = led_clear(terrain, state.trajectory.here[i], velocity[i])
    return velocity


# m/s of the plan of a stop: from there on the feet carry the root, and arms and trunk grow calm
CALM_FROM = 0.8
TURNS = 0.03  # rad of the stick's facing that the plan has not reached: a body turns on the spot
STANDS = 0.5  # of a contact of heel or toe
CHANGES = 0.03  # of the labels of gait in a frame: a body crouches or gets up


def rest_share(state: CharacterState) -> Array:
    """How far bodies have come to rest `(N,)`: 0 while they move or gesticulate, 1 when their plan stands still."""
    stops = (state.wished_speed == 0.0) & ~np.array([jump.airborne for jump in state.jumps])
    slow = np.minimum(np.maximum(1.0 - state.requested_speed / CALM_FROM, 0.0), 1.0)
    return np.asarray(np.where(stops, slow * (1.0 - state.rest.fraction.max(-1)), 0.0))


def settled_pose(
    state: CharacterState, hips: Array, local: Array, joints: Array, contacts: Array
) -> tuple[Array, Array, Array]:
    """The network's pose as far as a body at rest moves towards it in a frame; writes `state.settling`.

    Hips `(N, 3)`, local rotations `(N, 31, 4)` and joints `(N, 31, 3)` in the world; contacts `(N, 4)`.
    """
    path = state.trajectory
    yaw, gait = path.yaw[:, PRESENT], path.gait
    turning = np.abs(wrap_angle(path.wish_yaw - path.requested_yaw)) > TURNS
    changes = np.abs(gait[:, PRESENT] - gait[:, PRESENT - 1]).max(-1) > CHANGES
    free = (state.wished_speed == 0.0) & (state.rest.fraction.max(-1) == 0.0) & (state.arms.left == 0.0)
    free &= [
        jump.stage == "" and traversal.kind == ""
        for jump, traversal in zip(state.jumps, state.traversals, strict=True)
    ]
    still = (state.requested_speed < RESTS_BELOW) & ~turning & ~changes
    grounded = (contacts.reshape(-1, 2, 2).max(-1) > STANDS).all(-1)
    relative = features.relative_joints(joints, path.here, state.ground, yaw)
    rate = state.settling.slow(relative, state.joints, free & ~turning, still, grounded)
    local = state.settling.between(local, yaw)
    slow = rate < 1.0
    if slow.any():
        place = state.joints[:, 0] + rate[:, None] * (relative[:, 0] - state.joints[:, 0])
        there = features.to_world(place, yaw) + np.stack([path.here[:, 0], state.ground, path.here[:, 1]], -1)
        hips = np.where(slow[:, None], there, hips)
        joints[slow] = SPORT_SKELETON.forward_kinematics(hips[slow], local[slow])[0]
    return hips, local, joints


def over_feet(state: CharacterState) -> Array:
    """Velocities `(N, 2)` (m/s) that bring calm bodies over their feet: one that stops leaves them up to 0.2 m behind."""
    fraction = np.maximum(1.0 - state.settling.fraction / NEARLY, 0.0)
    away = [
        [foot.offset for foot in feet.feet] if all(feet.held) else ((0.0,) * 3,) * 2 for feet in state.feet
    ]
    offset = np.array(away).mean(1)[:, [0, 2]]
    distance = np.sqrt((offset * offset).sum(-1))
    speed = np.minimum(np.maximum(distance - UNSEEN_M, 0.0) / OVER_FEET_S, SWAYS)
    return np.asarray(offset * (fraction * speed / np.maximum(distance, 1e-9))[:, None])
