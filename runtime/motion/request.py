"""The sticks' request of N characters in a frame: obstacles probed, speeds and gaits read, trajectories steered."""

from __future__ import annotations

from collections.abc import Sequence
from math import atan2, hypot
from typing import NamedTuple

import numpy as np

from runtime.arrays import Array
from runtime.controls import STAND_SPEED_M_PER_S, Controls, Gait
from runtime.motion.features import DT
from runtime.motion.model import MotionModel
from runtime.motion.pace import STANDING_SECONDS
from runtime.motion.root_motion import SPEED_HALF_LIFE_S
from runtime.motion.state import CharacterState
from runtime.motion.style import Style
from runtime.motion.trajectory import JOG_SPEED_FRACTION, PRESENT
from runtime.scalar_math import MIN_DIVISOR, decay
from runtime.terrain.height_map import Terrain
from runtime.terrain.obstacle_detection import EDGE_M, RUN_M
from runtime.terrain.steps import level_ahead
from runtime.traversal.obstacle_probe import PROBE_M, STOP_SECONDS, ObstacleProbe
from runtime.traversal.traversal import Traversal

TAKE_OFF_FRAMES = 6  # over which the take-off velocity is averaged
# devices give 1 at most; a script may request more than the style's own speed
MAX_STICK_LENGTH = 2.0
CROUCH_SPEED_M_PER_S = 0.8  # m/s at full stick
# of the planned speed: a slower body is still accelerating into a jog
GATHERED_SPEED_FRACTION = 0.8
JOG_START_GAIN = 1.1  # limit of the regulator's gain until then
MIN_PLANNED_SPEED_M_PER_S = 0.05  # a stopping body is regulated down to this
_SMOOTHS = 1.0 - decay(SPEED_HALF_LIFE_S)


class FrameRequest(NamedTuple):
    """Desired velocity, facing and gait of N characters in this frame."""

    velocity: list[tuple[float, float]]  # m/s
    facing: list[float | None]  # radians, None to keep it
    gait: list[int]


def full_speed(style: Style, gait: Gait) -> float:
    """Return the speed (m/s) that a full stick requests in a style."""
    walk, jog = style.speeds
    return {Gait.JOG: jog, Gait.CROUCH: CROUCH_SPEED_M_PER_S}.get(gait, walk)


def _stick(controls: Controls) -> tuple[float, float, float]:
    """Return X, Z and length of the stick, which is at most `MAX_STICK_LENGTH`."""
    x, z = float(controls.move[0]), float(controls.move[1])
    amount = hypot(x, z)
    kept = min(1.0, MAX_STICK_LENGTH / max(amount, MIN_DIVISOR))
    return x * kept, z * kept, amount * kept


def probe_paths(
    model: MotionModel, state: CharacterState, controls: Sequence[Controls], terrain: Terrain
) -> list[ObstacleProbe]:
    """Return the obstacle on each character's path that the network cannot cross; updates which characters are stopped by one."""
    sticks, here = [_stick(each) for each in controls], state.trajectory.here
    headings = np.array([(x / max(size, MIN_DIVISOR), z / max(size, MIN_DIVISOR)) for x, z, size in sticks])
    clear = _clear(state, headings, terrain)
    probes = []
    for i, traversal in enumerate(state.traversals):
        gait = state.jumps[i].requested_gait(controls[i].gait)
        requested = sticks[i][2] * full_speed(state.styles[i].style, gait)
        # beside a beam a probe would find a drop
        ground = None
        if requested > STAND_SPEED_M_PER_S and not clear[i] and not state.feet[i].on_beam:
            ground = terrain
        probe = traversal.probe(ground, here[i], headings[i], float(state.measured_speed[i]))
        if probe.ahead is not None and model.crosses(probe.ahead.obstacle):
            probe = probe.alone()
        probes.append(probe)
    return probes


def _clear(state: CharacterState, headings: Array, terrain: Terrain) -> list[bool]:
    """Return, for each character, whether the path along its heading `(N, 2)` is free of edges."""
    if terrain.steepest * RUN_M < EDGE_M:  # no slope of this ground is steep enough for an edge
        return [True] * len(state)
    ways = np.array([each.path(way) for each, way in zip(state.traversals, headings, strict=True)])
    reach = PROBE_M + STOP_SECONDS * state.measured_speed
    return level_ahead(terrain, state.trajectory.here, ways, reach, EDGE_M).tolist()


def read_request(
    state: CharacterState,
    controls: Sequence[Controls],
    probes: Sequence[ObstacleProbe],
    styles: Sequence[Style],
) -> FrameRequest:
    """Return the desired velocity, facing and gait of each character; updates `wished_speed` and starts jumps."""
    request, speeds = FrameRequest([], [], []), []
    for i, (stick, probe, style) in enumerate(zip(controls, probes, styles, strict=True)):
        jump, traversal = state.jumps[i], state.traversals[i]
        if jump.press(stick.gait, traversal.kind == ""):
            jump.start(state.poses.pose(i), traversal.steps, root_velocity_of(state, i))
        x, z, amount = _stick(stick)
        gait = jump.requested_gait(stick.gait)
        full = full_speed(style, gait)
        speed = 0.0 if probe.stops else amount * full
        ahead = (x * full, z * full) if speed > STAND_SPEED_M_PER_S else None
        way = ahead or (0.0, 0.0)
        if jump.airborne:  # no steering in the air
            way = state.trajectory.velocity[i].tolist()
            speed = hypot(*way)
        elif ahead is None and gait != Gait.CROUCH:
            gait = Gait.STAND
        request.velocity.append(way)
        request.gait.append(int(gait))
        request.facing.append(_facing(traversal, stick.facing, ahead))
        speeds.append(speed if speed > STAND_SPEED_M_PER_S else 0.0)
    state.wished_speed = np.array(speeds)
    return request


def _facing(
    traversal: Traversal, facing: tuple[float, float] | None, ahead: tuple[float, float] | None
) -> float | None:
    """Yaw (radians) towards a climbed wall, or of the stick's facing, or of the direction of travel; None to keep it."""
    if traversal.climbing:
        return traversal.yaw
    direction = ahead if facing is None else facing
    return None if direction is None else atan2(*direction)


def root_velocity_of(state: CharacterState, index: int) -> tuple[float, float]:
    """Return the root velocity averaged over the last frames, m/s (X, Z)."""
    xz = state.trajectory.xz[index]
    x, z = ((xz[PRESENT] - xz[PRESENT - TAKE_OFF_FRAMES]) / (TAKE_OFF_FRAMES * DT)).tolist()
    return x, z


def _jog_from(style: Style, gait: int, wished: float) -> float:
    """Planned speed (m/s) from which the gait is a jog, also for slow jogs."""
    middle = 0.5 * sum(style.speeds)
    return min(middle, JOG_SPEED_FRACTION * wished) if gait == Gait.JOG else middle


def steer(
    state: CharacterState, request: FrameRequest, styles: Sequence[Style], response: Sequence[float]
) -> None:
    """Plan the next second of the trajectory towards the request, which the network then reads."""
    wished = state.wished_speed.tolist()
    plan = state.trajectory.plan(
        request.velocity,
        request.facing,
        request.gait,
        [style.speeds[0] for style in styles],
        [_jog_from(*each) for each in zip(styles, request.gait, wished, strict=True)],
        response,
    )
    speeds = [hypot(x, z) for x, z in state.trajectory.velocity.tolist()]
    state.requested_speed = np.array(speeds)
    state.smooth_request = state.smooth_request + (state.requested_speed - state.smooth_request) * _SMOOTHS
    moving = [
        wish > 0.0 or speed > MIN_PLANNED_SPEED_M_PER_S for wish, speed in zip(wished, speeds, strict=True)
    ]
    shown = (state.root_speed * state.stride.fraction).tolist()
    gains = state.regulator.update(speeds, shown, moving)
    for i, speed in enumerate(speeds):
        # requested more while it accelerates, the network would lurch into a jog
        gathers = state.regulator.measured[i] < GATHERED_SPEED_FRACTION * speed
        if request.gait[i] == Gait.JOG and gathers and state.regulator.stood[i] < STANDING_SECONDS:
            gains[i] = min(gains[i], JOG_START_GAIN)
    state.trajectory.steer(plan._replace(velocities=plan.velocities * np.array(gains)[:, None, None]))
