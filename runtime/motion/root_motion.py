"""What the roots take of the network's velocity: feet carry them in a stop, strides stretch, obstacles hold them back."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from runtime.arrays import Array, Flags
from runtime.controls import STAND_SPEED, Gait
from runtime.crossing.crossing import CLEAR, HALF_BODY_M, Look
from runtime.motion import features, momentum, stride
from runtime.motion.coming_to_rest import over_feet, rest_share
from runtime.motion.features import DT
from runtime.motion.state import CharacterState
from runtime.motion.trajectory import PRESENT
from runtime.spring import decay
from runtime.terrain.height_map import Terrain
from runtime.terrain.obstacles import level_ahead
from runtime.terrain.room import has_walls, led_clear
from runtime.terrain.way_ahead import EDGE_M, RUN_M

LAST_SPEED = 9.0  # times the planned speed: what is more fades at the end of a stop,
FIRM_CONTACT = 0.5  # sum of squared contacts that carry a root
COAST = 0.24  # seconds, half-life: the planted feet carry the root on, or they would slide under it
SPEED_HALF_LIFE = 0.25  # seconds, smoothing of the measured speed (a stride speeds up and slows down)


def root_velocity(
    state: CharacterState,
    velocity: Array,
    contacts: Array,
    looks: Sequence[Look],
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
    longer = stride.stretch(
        state.smooth_request,
        state.requested_speed,
        state.measured_speed,
        state.root_speed,
        state.trajectory.gait[:, PRESENT, Gait.JOG] > 0.5,
        response,
    )
    velocity = velocity * np.where(walks & ~flying, longer, 1.0)[:, None]
    return _past_obstacles(state, velocity, looks, terrain)


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
    """At rest nobody creeps: what is faster than the plan fades. Writes `root_speed`."""
    speed = np.sqrt((velocity * velocity).sum(-1))
    still = (state.wished_speed == 0.0) & ~flying
    coast = decay(COAST) ** (momentum.GAME**-response)
    most = np.maximum(LAST_SPEED * state.requested_speed, coast * state.root_speed)
    creep = np.where(still, np.minimum(1.0, most / np.maximum(speed, 1e-6)), 1.0)
    state.root_speed = speed * creep
    return velocity * creep[:, None]


def _past_obstacles(state: CharacterState, velocity: Array, looks: Sequence[Look], terrain: Terrain) -> Array:
    """Keyed while an obstacle is crossed, held back before one, led along walls."""
    near = 2.0 * state.root_speed * DT + HALF_BODY_M  # strides are scaled by less
    way = velocity / np.maximum(np.sqrt((velocity * velocity).sum(-1, keepdims=True)), 1e-9)
    gentle, walls = terrain.steepest * RUN_M < EDGE_M, has_walls(terrain)
    clear = np.full(len(state), True) if gentle else level_ahead(terrain, state.trajectory.here, way, near)
    for i, (crossing, look) in enumerate(zip(state.crossings, looks, strict=True)):
        if crossing.kind:
            velocity[i] = crossing.root_velocity()
        else:
            velocity[i] *= crossing.pace
            if look is not CLEAR or not clear[i]:
                here = state.trajectory.here[i]
                velocity[i] = crossing.held_back(terrain, here, velocity[i], look.ahead)
            if walls:
                velocity[i] = led_clear(terrain, state.trajectory.here[i], velocity[i])
    return velocity
