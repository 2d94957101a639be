"""The character's past and requested motion: ±1 s of root path, facing and gait, blended from stick and network.

Momentum: the stick is a request, and the body takes time to change its velocity and its facing.
Both approach the request in the same way: by `reach` in every `seconds`, and faster in proportion if the difference is more
than `reach`. Captures stop from a walk in 0.95 to 1.97 s at 0.9 to 1.5 m/s2, from a run in 1.1 to 2.2 s, start
in 1.0 to 1.6 s and turn at up to 90 to 220 degrees/s walking, 180 to 340 running (docs/results/moments.md). The network sees
the whole path of the coming second, with the gait labels that its training data has at such speeds.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from math import atan2, hypot, pi, sqrt
from typing import NamedTuple

import numpy as np

from runtime.arrays import Array
from runtime.controls import Gait
from runtime.easing import smoothstep
from runtime.motion import features
from runtime.motion.features import FPS, GAITS, SAMPLE_STEP, TRAJECTORY_OFFSETS
from runtime.motion.style import NEUTRAL_M_PER_S
from runtime.scalar_math import MIN_DIVISOR, MIN_SIZE, decay
from runtime.terrain.height_map import Terrain

TO_WALK_S = 0.72  # from rest to the walking speed of a neutral body, and back
# of TO_WALK_S: a style slower than neutral has slower steps, but not into a jog
FASTEST_CHANGE_RATIO, SLOWEST_CHANGE_RATIO = 0.85, 1.12
TURN_RAD = np.pi / 2  # radians
TO_TURN_S = (0.95, 1.25, 0.75)  # seconds: standing, walking, and at twice that speed
GAME_RESPONSE_FRACTION = 0.13  # factor on these times at full response
MIN_RESPONSE, MAX_RESPONSE = 0.0, 1.0
REQUEST_HALF_LIFE = 0.1  # seconds, of the reaction to a request
LABEL_HALF_LIFE = 0.08  # seconds, in which a gait's label fades in and out
CROUCH_HALF_LIFE = 0.35  # seconds, of a crouch's label: knees and elbows would snap if it changed at once
STILL_SPEED_M_PER_S = 0.15  # m/s: slower is standing, as in the training labels
JOG_SPEED_FRACTION = 0.75  # fraction of a slow jog's speed from which it counts as a jog
# a label fades in from 1 to 2 on this multiple of speed over threshold: at 2/3 to 4/3 of the threshold
LABEL_CHANGE_RATIO = 1.5
MIN_CROUCH_CHANGE = 0.02  # of the weight of a crouch: more is faded slowly
AHEAD = np.arange(61) / FPS  # seconds of the coming frames, the present one first
_STAND, _WALK, _JOG, _CROUCH = map(int, (Gait.STAND, Gait.WALK, Gait.JOG, Gait.CROUCH))
_MAKES_UP = decay(REQUEST_HALF_LIFE)
_LABEL_FADE = 0.5 ** ((AHEAD + 1.0 / FPS) / LABEL_HALF_LIFE)


class Plan(NamedTuple):
    """Planned velocities, yaws and gaits of N characters for the next second, the present frame first."""

    velocities: Array  # (N, 61, 2) m/s
    yaws: Array  # (N, 61) radians
    gaits: Array  # (N, 61, 6) weights


def change_seconds(walk_speed: float, response: float, jogs: bool = False) -> float:
    """Return the time constant (seconds) to change velocity by the walking speed (m/s); `response` is 0 (as captured) to 1 (game)."""
    most = 1.0 if jogs else SLOWEST_CHANGE_RATIO
    style = min(max(sqrt(NEUTRAL_M_PER_S[0] / walk_speed), FASTEST_CHANGE_RATIO), most)
    return TO_WALK_S * style * GAME_RESPONSE_FRACTION**response


def turn_seconds(speed: float, walk_speed: float, response: float) -> float:
    """Return the time (seconds) to turn by TURN_RAD at a speed (m/s); see `change_seconds`."""
    standing, walking, twice = TO_TURN_S
    going = min(speed / walk_speed, 2.0)
    slower, faster, part = (standing, walking, going) if going < 1.0 else (walking, twice, going - 1.0)
    return (slower + part * (faster - slower)) * GAME_RESPONSE_FRACTION**response


def remaining(missing: Array, reach: Array | float, seconds: Array, after: Array) -> Array:
    """Return what remains of a difference `missing` (0 or more) after a time: exponential above `reach`, then linear to 0."""
    t = after / seconds
    if not np.count_nonzero(missing > reach):
        return np.maximum(missing - reach * t, 0.0)
    fast = np.log(np.maximum(missing / reach, 1.0))  # in units of `seconds`
    slow = np.minimum(missing, reach) - reach * (t - fast)
    return np.where(t < fast, missing * np.exp(-t), np.maximum(slow, 0.0))


def planned_velocities(now: Array, wish: Array, reach: Array, seconds: Array) -> Array:
    """Return velocities `(N, 61, 2)` (m/s) that go from `now` to `wish` `(N, 2)`.

    They change by `reach` `(N,)` (m/s) in `seconds` `(N,)`, and faster if the difference is larger.
    """
    change = now - wish
    missing = np.sqrt(np.add.reduce(change * change, -1, keepdims=True))
    fraction = remaining(missing, reach[:, None], seconds[:, None], AHEAD) / np.maximum(missing, MIN_DIVISOR)
    return np.asarray(wish[:, None] + fraction[..., None] * change[:, None])


def facings(now: Array, wish: Array, seconds: Array) -> Array:
    """Return yaws `(N, 61)` (radians) that turn the shorter way from `now` to `wish` `(N,)`, by TURN_RAD in `seconds` `(N,)`."""
    turn = (now - wish + np.pi) % (2 * np.pi) - np.pi
    left = remaining(np.abs(turn)[:, None], TURN_RAD, seconds[:, None], AHEAD)
    return np.asarray((now - turn)[:, None] + np.sign(turn)[:, None] * left)


def labels(
    speeds: Array, now: Array, gait: Sequence[int], jog_from: Sequence[float], response: Sequence[float]
) -> Array:
    """Return gait weights `(N, 61, 6)` for planned speeds `(N, 61)`, following the speed as training labels do.

    `gait` is the requested one, `now` `(N, 6)` the present weights, from which the plan fades in; `jog_from` (m/s) is where
    a jog begins. Gaits other than stand, walk and jog are kept. At full `response` a crouch comes as fast as other labels.
    """
    # a jump with the stick at rest has a threshold of 0
    thresholds = np.array([[STILL_SPEED_M_PER_S, max(each, MIN_SIZE)] for each in jog_from]).T
    moves, jogs = smoothstep(speeds * (LABEL_CHANGE_RATIO / thresholds)[..., None] - 1.0)
    jogs *= moves
    plan = np.zeros((*speeds.shape, GAITS))
    plan[..., _STAND], plan[..., _WALK], plan[..., _JOG] = 1.0 - moves, moves - jogs, jogs
    for i, own in enumerate(gait):
        if own >= _CROUCH:
            plan[i] = np.eye(GAITS)[own]
    change = now - plan[:, 0]
    fade = _LABEL_FADE
    crouches = np.abs(change[:, _CROUCH]) > MIN_CROUCH_CHANGE
    if any(crouches.tolist()):
        slow = np.maximum(CROUCH_HALF_LIFE * GAME_RESPONSE_FRACTION ** np.array(response), LABEL_HALF_LIFE)
        fade = np.where(crouches[:, None], 0.5 ** ((AHEAD + 1.0 / FPS) / slow[:, None]), fade)
    plan += change[:, None] * fade[..., None]
    return plan


PRESENT = 60  # index of the current frame in the dense ±60 frame window
LENGTH = 2 * PRESENT + 1
SAMPLES = TRAJECTORY_OFFSETS + PRESENT  # the network's 12 samples

# How strongly the stick overrides the network along the coming second: 1 - (1 - t)^bias at time t.
POSITION_BIAS_RATIO = 8.0
DIRECTION_BIAS_RATIO = 3.0

_AT = features.FUTURE_OFFSETS.astype(float)  # frames of the network's coming samples,
_FRAMES = np.arange(1, LENGTH - PRESENT)  # coming frames,
_BEYOND = np.maximum(_FRAMES - _AT[-1], 0.0) / SAMPLE_STEP  # and distance of each beyond the last sample
_TIME = _FRAMES / (LENGTH - PRESENT - 1)
_ALONG = (1 - (1 - _TIME) ** POSITION_BIAS_RATIO)[:, None]
_AROUND = 1 - (1 - _TIME) ** DIRECTION_BIAS_RATIO
# weights (60, 6) of the samples in every coming frame: the last one held beyond it, or extrapolated
_KEPT = np.maximum(1.0 - np.abs(np.minimum(_FRAMES, _AT[-1])[:, None] - _AT) / SAMPLE_STEP, 0.0)
_GOING_ON = _KEPT.copy()
_GOING_ON[:, -1] += _BEYOND
_GOING_ON[:, -2] -= _BEYOND


def wrap_angle(angle: Array | float) -> Array:
    """Return angles in radians wrapped to -pi..pi."""
    return (np.asarray(angle) + np.pi) % (2 * np.pi) - np.pi


@dataclass(frozen=True)
class TrajectoryView:
    """The 12 trajectory samples in world space, for drawing."""

    positions: Array  # (12, 3)
    directions: Array  # (12, 2)


@dataclass
class Trajectory:
    """Trajectory windows of 121 frames (±1 s) of N characters."""

    xz: Array = field(metadata={"shape": (LENGTH, 2)})  # (N, 121, 2)
    yaw: Array = field(metadata={"shape": (LENGTH,)})  # (N, 121) unwrapped
    gait: Array = field(metadata={"shape": (LENGTH, GAITS)})  # (N, 121, 6)
    wish: Array = field(metadata={"shape": (2,)})  # (N, 2) the stick's velocity, smoothed, m/s
    wish_yaw: Array = field(metadata={"shape": ()})  # (N,) the stick's facing, smoothed, radians
    velocity: Array = field(metadata={"shape": (2,)})  # (N, 2) planned, m/s
    requested_yaw: Array = field(metadata={"shape": ()})  # (N,)

    @staticmethod
    def standing(x: float = 0.0, z: float = 0.0, yaw: float = 0.0) -> Trajectory:
        """Return the trajectory of one character standing at x, z (metres), facing `yaw` (radians)."""
        gait = np.zeros((1, LENGTH, GAITS))
        gait[..., 0] = 1.0
        xz = np.tile(np.array([x, z], np.float64), (1, LENGTH, 1))
        return Trajectory(
            xz,
            np.full((1, LENGTH), float(yaw)),
            gait,
            np.zeros((1, 2)),
            np.array([float(yaw)]),
            np.zeros((1, 2)),
            np.array([float(yaw)]),
        )

    @property
    def here(self) -> Array:
        """XZ position of the roots in this frame, `(N, 2)`."""
        return self.xz[:, PRESENT]

    def view(self, terrain: Terrain, index: int = 0) -> TrajectoryView:
        """Return the 12 samples of one character, projected onto the terrain."""
        xz, yaw = self.xz[index, SAMPLES], self.yaw[index, SAMPLES]
        height = terrain.height(xz[:, 0], xz[:, 1])
        directions = np.stack([np.sin(yaw), np.cos(yaw)], axis=-1)
        return TrajectoryView(np.stack([xz[:, 0], height, xz[:, 1]], -1), directions)

    def plan(
        self,
        wish: Sequence[tuple[float, float]],
        facing: Sequence[float | None],
        gait: Sequence[int],
        walk: Sequence[float],
        jog_from: Sequence[float],
        response: Sequence[float],
    ) -> Plan:
        """Plan the next second towards velocities (m/s), facings (radians, None keeps the present one) and gaits.

        `walk` are the styles' walking speeds, `response` is 0 (as captured) to 1 (game). Advances `wish`, `wish_yaw`,
        `velocity` and `requested_yaw` by a frame.
        """
        seconds, around, wishes, yaws = [], [], [], []
        for i, (pace, haste) in enumerate(zip(walk, response, strict=True)):
            quick = _MAKES_UP ** (GAME_RESPONSE_FRACTION**-haste)
            seconds.append(change_seconds(pace, haste, gait[i] == _JOG))
            around.append(turn_seconds(hypot(*self.velocity[i].tolist()), pace, haste))
            (x, z), (wish_x, wish_z), ahead = self.wish[i].tolist(), wish[i], facing[i]
            wishes.append((wish_x + (x - wish_x) * quick, wish_z + (z - wish_z) * quick))
            goal = float(self.requested_yaw[i]) if ahead is None else ahead
            # a plan that turns at once makes the network's pose jump: elbows by 10 degrees in a frame
            yaws.append(goal + ((float(self.wish_yaw[i]) - goal + pi) % (2.0 * pi) - pi) * quick)
        self.wish, self.wish_yaw = np.array(wishes), np.array(yaws)
        velocities = planned_velocities(self.velocity, self.wish, np.array(walk), np.array(seconds))
        ways = facings(self.requested_yaw, self.wish_yaw, np.array(around))
        self.velocity, self.requested_yaw = velocities[:, 1], ways[:, 1]
        speeds = np.sqrt(np.add.reduce(velocities * velocities, -1))
        return Plan(velocities, ways, labels(speeds, self.gait[:, PRESENT], gait, jog_from, response))

    def steer(self, plan: Plan) -> None:
        """Blend a plan into the trajectory's next second."""
        self.xz, self.yaw, self.gait = self.xz.copy(), self.yaw.copy(), self.gait.copy()
        ahead = self.xz[:, PRESENT:]
        steps = ahead[:, 1:] - ahead[:, :-1]
        steps += (plan.velocities[:, 1:] / FPS - steps) * _ALONG
        ahead[:, 1:] = ahead[:, :1] + steps.cumsum(1)
        turning = self.yaw[:, PRESENT + 1 :]
        turning += wrap_angle(plan.yaws[:, 1:] - turning) * _AROUND
        self.gait[:, PRESENT:] = plan.gaits

    def advance(self, displacement: Array, turn: Array, positions: Array, directions: Array) -> None:
        """Advance the windows by one frame, after `steer`: displacements `(N, 2)` metres and turns `(N,)` radians.

        `positions`, `directions` `(N, 6, 2)` are the network's predicted samples (0, 10 ... 50 frames ahead), in world space.
        """
        for window in (self.xz, self.yaw, self.gait):
            window[:, :PRESENT] = window[:, 1 : PRESENT + 1]
        self.xz[:, PRESENT] += displacement
        self.yaw[:, PRESENT] += turn
        here = self.yaw[:, PRESENT]
        self.xz[:, PRESENT + 1 :] = self.xz[:, PRESENT, None] + _GOING_ON @ (positions - positions[:, :1])
        turns = [_turns(ways, yaw) for ways, yaw in zip(directions.tolist(), here.tolist(), strict=True)]
        self.yaw[:, PRESENT + 1 :] = here[:, None] + np.array(turns) @ _KEPT.T


def _turns(directions: list[list[float]], yaw: float) -> list[float]:
    """Return the angles (radians) from a yaw through successive directions, each by the shorter turn."""
    turns, last = [], yaw
    for x, z in directions:
        last += (atan2(x, z) - last + pi) % (2.0 * pi) - pi
        turns.append(last - yaw)
    return turns
