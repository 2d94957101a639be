"""Root velocity from the network's, corrected: carried by the feet in a stop, with scaled strides, held back by obstacles.

When nothing is requested any more, bodies come to rest: their time slows down, and they move over their feet.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import cos, hypot, pi, sin

import numpy as np

from runtime.arrays import Array
from runtime.controls import STAND_SPEED_M_PER_S, Gait
from runtime.motion.features import DT
from runtime.motion.pace import stretch
from runtime.motion.pose_smoothing import (
    MAX_SWAY_M_PER_S,
    NEARLY_AT_REST_FRACTION,
    OVER_FEET_S,
    RESTING_SPEED_M_PER_S,
    UNSEEN_M,
)
from runtime.motion.state import CharacterState
from runtime.motion.trajectory import GAME_RESPONSE_FRACTION, PRESENT
from runtime.scalar_math import MIN_DIVISOR, MIN_SIZE, decay
from runtime.skeleton import SPORT_SKELETON
from runtime.terrain.height_map import Terrain
from runtime.terrain.obstacle_detection import EDGE_M, RUN_M
from runtime.terrain.room import drift_from_walls, has_walls
from runtime.terrain.steps import level_ahead
from runtime.traversal.obstacle_probe import CLEAR, HALF_BODY_M, ObstacleProbe, held_back
from runtime.traversal.traversal_frame import traversal_velocity

LAST_SPEED_RATIO = 9.0  # times the planned speed: more than that fades at the end of a stop,
FIRM_CONTACT_WEIGHT = 0.5  # sum of squared contacts from which feet carry the root
# half-life: planted feet carry the root, which would otherwise slide over them
COAST_HALF_LIFE_S = 0.24
SPEED_HALF_LIFE_S = 0.25  # smoothing of the measured speed, which varies within a stride
_COAST, _FOLLOWS = decay(COAST_HALF_LIFE_S), 1.0 - decay(SPEED_HALF_LIFE_S)


def root_velocity(
    state: CharacterState,
    velocity: Array,
    contacts: Array,
    probes: Sequence[ObstacleProbe],
    terrain: Terrain,
    response: Sequence[float],
) -> Array:
    """Return the root velocities `(N, 2)` (m/s, in root frames), corrected from the network's; updates root speeds and strides.

    `contacts` `(N, 4)` are the network's; `response` is 0 (as captured) to 1 (game).
    """
    root, measured = state.root_speed.tolist(), state.measured_speed.tolist()
    jogs = (state.trajectory.gait[:, PRESENT, Gait.JOG] > 0.5).tolist()
    carried = state.stride.carried(state.joints, contacts, [jump.airborne for jump in state.jumps])
    rest, velocities = rest_share(state), velocity.tolist()
    for i, (jump, haste) in enumerate(zip(state.jumps, response, strict=True)):
        x, z = _carried(state, i, velocities[i], carried[i], rest[i])
        speed, requested = hypot(x, z), float(state.requested_speed[i])
        if state.wished_speed[i] == 0.0 and not jump.airborne:
            # a body at rest does not creep: speed beyond the plan fades
            most = max(LAST_SPEED_RATIO * requested, _COAST ** (GAME_RESPONSE_FRACTION**-haste) * root[i])
            creep = min(1.0, most / max(speed, MIN_SIZE))
            x, z, speed = creep * x, creep * z, creep * speed
        root[i], measured[i] = speed, measured[i] + (speed - measured[i]) * _FOLLOWS
        aside_x, aside_z = over_feet(state, i)
        longer = 1.0
        if measured[i] > 0.5 * requested > 0.5 * STAND_SPEED_M_PER_S and not jump.airborne:
            planned = float(state.smooth_request[i]), requested
            longer = stretch(planned, (measured[i], speed), jogs[i], haste)
        velocities[i] = (longer * (x + aside_x), longer * (z + aside_z))
    state.root_speed, state.measured_speed = np.array(root), np.array(measured)
    state.stride.update(state.joints, carried, measured)
    return _past_obstacles(state, np.array(velocities), probes, terrain)


def _carried(
    state: CharacterState, i: int, velocity: list[float], carried: tuple[float, float, float], rest: float
) -> tuple[float, float]:
    """Root velocity after foot lock: pulled by held feet, carried by planted feet in a stop, ballistic in the air."""
    pull, yaw = state.feet[i].pull, float(state.trajectory.yaw[i, PRESENT])
    cosine, sine = cos(yaw), sin(yaw)
    x = cosine * velocity[0] + sine * velocity[1] + pull[0]
    z = cosine * velocity[1] - sine * velocity[0] + pull[1]
    across, along, weight = carried
    firm = rest * min(weight / FIRM_CONTACT_WEIGHT, 1.0)
    x += (cosine * across + sine * along - x) * firm
    z += (cosine * along - sine * across - z) * firm
    return state.jumps[i].carried((x, z))


def _past_obstacles(
    state: CharacterState, velocity: Array, probes: Sequence[ObstacleProbe], terrain: Terrain
) -> Array:
    """Correct velocities at obstacles: keyframed in a traversal, held back before an obstacle, kept from walls."""
    gentle, walls = terrain.steepest * RUN_M < EDGE_M, has_walls(terrain)
    clear = [True] * len(state)
    if not gentle:
        near = 2.0 * state.root_speed * DT + HALF_BODY_M  # strides are scaled by less than 2
        way = velocity / np.maximum(np.sqrt((velocity * velocity).sum(-1, keepdims=True)), MIN_DIVISOR)
        clear = level_ahead(terrain, state.trajectory.here, way, near).tolist()
    for i, (traversal, probe) in enumerate(zip(state.traversals, probes, strict=True)):
        if traversal.kind:
            velocity[i] = traversal_velocity(traversal)
        else:
            velocity[i] *= traversal.pace
            if probe is not CLEAR or not clear[i]:
                here = state.trajectory.here[i]
                velocity[i] = held_back(terrain, here, velocity[i], probe.ahead)
            if walls:
                velocity[i] = drift_from_walls(terrain, state.trajectory.here[i], velocity[i])
    return velocity


# planned speed (m/s) of a stop below which feet carry the root, and arms and trunk settle
SETTLING_SPEED_M_PER_S = 0.8
TURNING_RAD = 0.03  # difference between requested and planned facing from which a body turns in place
STANDING_CONTACT_FRACTION = 0.5  # contact of heel or toe from which a foot stands
GAIT_CHANGE_FRACTION = 0.03  # change of the gait labels per frame from which a body crouches or gets up


def rest_share(state: CharacterState) -> list[float]:
    """Return how far each body has come to rest: 0 while it moves or gestures, 1 when its plan has stopped."""
    return [
        0.0
        if wished > 0.0 or jump.airborne
        else min(max(1.0 - requested / SETTLING_SPEED_M_PER_S, 0.0), 1.0) * (1.0 - max(swings))
        for wished, requested, swings, jump in zip(
            state.wished_speed.tolist(),
            state.requested_speed.tolist(),
            state.rest.fraction.tolist(),
            state.jumps,
            strict=True,
        )
    ]


def settled_pose(state: CharacterState, local: Array, joints: Array, contacts: Array) -> tuple[Array, Array]:
    """Return the local rotations and joints to show: the network's, slowed as a body comes to rest. Updates `state.settling`.

    Local rotations `(N, 31, 4)` and joints `(N, 31, 3)` are relative to the root; contacts `(N, 4)`.
    """
    free = [_is_free(state, i) for i in range(len(state))]
    still = [free[i] and _stands_still(state, i) for i in range(len(state))]
    grounded = [
        min(max(heels[0], heels[1]), max(heels[2], heels[3])) > STANDING_CONTACT_FRACTION
        for heels in contacts.tolist()
    ]
    rate = state.settling.slow(joints, state.joints, free, still, grounded)
    local = state.settling.between(local)
    slow = rate < 1.0
    if any(slow.tolist()):
        before = state.joints[slow, 0]
        hips = before + rate[slow, None] * (joints[slow, 0] - before)
        joints[slow] = SPORT_SKELETON.forward_kinematics(hips, local[slow])[0]
    return local, joints


def _is_free(state: CharacterState, i: int) -> bool:
    """Whether nothing is requested of a body, so that it may come to rest."""
    path, arms, swings = state.trajectory, state.arms, state.rest.fraction[i]
    if state.wished_speed[i] > 0.0 or arms.left[i] > 0.0 or state.jumps[i].stage or state.traversals[i].kind:
        return False
    turn = (float(path.wish_yaw[i] - path.requested_yaw[i]) + pi) % (2.0 * pi) - pi
    return abs(turn) <= TURNING_RAD and not np.count_nonzero(swings)


def _stands_still(state: CharacterState, i: int) -> bool:
    """Whether the plan has stopped and the gait no longer changes."""
    gait = state.trajectory.gait[i]
    same = np.abs(gait[PRESENT] - gait[PRESENT - 1]).max() <= GAIT_CHANGE_FRACTION
    return bool(state.requested_speed[i] < RESTING_SPEED_M_PER_S and same)


def over_feet(state: CharacterState, i: int) -> tuple[float, float]:
    """Return the velocity (m/s, X and Z) that brings a body at rest over its feet, which a stop leaves up to 0.2 m behind."""
    feet, fraction = state.feet[i], 1.0 - float(state.settling.fraction[i]) / NEARLY_AT_REST_FRACTION
    if fraction <= 0.0 or not all(feet.held):
        return 0.0, 0.0
    (left_x, _, left_z), (right_x, _, right_z) = (foot.offset for foot in feet.feet)
    x, z = 0.5 * (left_x + right_x), 0.5 * (left_z + right_z)
    distance = hypot(x, z)
    speed = (
        fraction
        * min(max(distance - UNSEEN_M, 0.0) / OVER_FEET_S, MAX_SWAY_M_PER_S)
        / max(distance, MIN_DIVISOR)
    )
    return speed * x, speed * z
