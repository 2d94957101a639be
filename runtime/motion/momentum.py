"""Momentum: a stick is a wish, and a body changes its velocity and its facing in the time that a body takes.

What is missing of a wish goes in the same way for both: by `reach` in every `seconds`, faster in proportion where more
than `reach` is missing. Captures stop from a walk in 0.95 to 1.97 s at 0.9 to 1.5 m/s2, from a run in 1.1 to 2.2 s, start
in 1.0 to 1.6 s and turn at up to 90 to 220 degrees/s walking, 180 to 340 running (docs/results/moments.md). The network sees
the whole way of the coming second, with the labels of gait that its training gave to such speeds.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from runtime.arrays import Array
from runtime.controls import Gait
from runtime.easing import smoothstep
from runtime.motion.features import FPS, GAITS

TO_WALK = 0.72  # seconds from rest to the walking speed of a neutral body, and back
NEUTRAL_SPEED = 1.3  # m/s; a slower style has slower steps, and takes so much longer:
FASTEST_CHANGE, SLOWEST_CHANGE = 0.85, 1.12  # of TO_WALK
TURN = np.pi / 2  # radians
TO_TURN = (0.95, 1.25, 0.75)  # seconds: standing, walking, and at twice that speed
GAME = 0.13  # of these times, at full response
MIN_RESPONSE, MAX_RESPONSE = 0.0, 1.0
WISH_HALF_LIFE = 0.1  # seconds in which a body makes up its mind
LABEL_HALF_LIFE = 0.08  # seconds in which a gait's label comes and goes
CROUCH_HALF_LIFE = 0.35  # of the label of a crouch: knees and elbows snap where it comes at once
STILL_SPEED = 0.15  # m/s: slower is standing, as the training's labels have it
JOG_SHARE = 0.75  # of a slow jog's speed from which it is a jog
AHEAD = np.arange(61) / FPS  # seconds of the coming frames, the present one first


@dataclass(frozen=True)
class Plan:
    """The coming second of N characters, the present frame first."""

    velocities: Array  # (N, 61, 2) m/s
    yaws: Array  # (N, 61) radians
    gaits: Array  # (N, 61, 6) weights


def change_seconds(walk_speed: Array, response: Array) -> Array:
    """Seconds `(N,)` in which bodies change their velocity by their walking speed (m/s); `response` 0 (capture) to 1 (game)."""
    style = np.clip(np.sqrt(NEUTRAL_SPEED / walk_speed), FASTEST_CHANGE, SLOWEST_CHANGE)
    return np.asarray(TO_WALK * style * GAME**response)


def turn_seconds(speed: Array, walk_speed: Array, response: Array) -> Array:
    """Seconds `(N,)` in which bodies at a speed turn by TURN (m/s; see `change_seconds`)."""
    return np.asarray(np.interp(speed / walk_speed, (0.0, 1.0, 2.0), TO_TURN) * GAME**response)


def remaining(missing: Array, reach: Array | float, seconds: Array, after: Array) -> Array:
    """What is left of `missing` (0 or more) `after` seconds: exponential above `reach`, linear from there to 0."""
    fast = np.log(np.maximum(missing / reach, 1.0))  # in units of `seconds`
    t = after / seconds
    slow = np.minimum(missing, reach) - reach * (t - fast)
    return np.where(t < fast, missing * np.exp(-t), np.maximum(slow, 0.0))


def velocities(now: Array, wish: Array, reach: Array, seconds: Array) -> Array:
    """Velocities `(N, 61, 2)` on the way from `now` to `wish` `(N, 2)`, m/s."""
    change = now - wish
    missing = np.sqrt((change * change).sum(-1, keepdims=True))
    share = remaining(missing, reach[:, None], seconds[:, None], AHEAD) / np.maximum(missing, 1e-9)
    return np.asarray(wish[:, None] + share[..., None] * change[:, None])


def facings(now: Array, wish: Array, seconds: Array) -> Array:
    """Yaws `(N, 61)` on the shorter way from `now` to `wish` `(N,)`, radians."""
    turn = (now - wish + np.pi) % (2 * np.pi) - np.pi
    left = remaining(np.abs(turn)[:, None], TURN, seconds[:, None], AHEAD)
    return np.asarray((now - turn)[:, None] + np.sign(turn)[:, None] * left)


def labels(speeds: Array, now: Array, gait: NDArray[np.integer], jog_from: Array, response: Array) -> Array:
    """Weights of gaits `(N, 61, 6)` of planned speeds `(N, 61)`, as the training's labels follow the speed.

    `gait` `(N,)` is the requested one, `now` `(N, 6)` the present weights, which go over into the plan's; `jog_from`
    `(N,)` m/s is where a jog begins. A gait other than standing, walking and jogging is kept as it is. At full `response`
    `(N,)` a crouch comes as fast as other labels.
    """
    moves, jogs = _over(speeds, STILL_SPEED), _over(speeds, jog_from[:, None])
    plan = np.zeros((*speeds.shape, GAITS))
    plan[..., Gait.STAND] = 1.0 - moves
    plan[..., Gait.WALK] = moves * (1.0 - jogs)
    plan[..., Gait.JOG] = moves * jogs
    own = np.isin(gait, (Gait.CROUCH, Gait.JUMP, Gait.OTHER))
    plan[own] = np.eye(GAITS)[gait[own], None]
    change = now - plan[:, 0]
    crouches = np.abs(change[:, Gait.CROUCH, None, None]) > 0.02
    slow = np.maximum(CROUCH_HALF_LIFE * GAME ** response[:, None, None], LABEL_HALF_LIFE)
    half_life = np.where(crouches, slow, LABEL_HALF_LIFE)
    return plan + change[:, None] * 0.5 ** ((AHEAD[:, None] + 1.0 / FPS) / half_life)


def _over(speeds: Array, threshold: Array | float) -> Array:
    """0 below to 1 above a threshold, over a third of it to both sides."""
    # a body that jumps without a stick has a threshold of 0
    return smoothstep(1.5 * (speeds / np.maximum(threshold, 1e-6) - 1.0) + 0.5)
