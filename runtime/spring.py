"""What goes to a goal by its half-life: a critically damped spring, of arrays and of plain floats, and a plain decay.

y(t) = goal + e^(-r t) (offset + (velocity + r offset) t) with r = 2 ln 2 / half-life: exact over a step of any length.
"""

from __future__ import annotations

import math

import numpy as np

from runtime.arrays import Array
from runtime.pose import FPS

_Vector = tuple[float, float, float]
RATE = 1.3862943611  # 2 ln 2, as all takes were recorded with it: they resimulate bit by bit


def spring(
    value: Array, velocity: Array, goal: Array, half_life: float | Array, dt: float | Array
) -> tuple[Array, Array]:
    """Value and velocity of a spring after `dt` seconds (any shape)."""
    y = 2.0 * math.log(2.0) / np.maximum(half_life, 1e-6)
    offset = value - goal
    slope = velocity + offset * y
    fade = np.exp(-y * dt)
    return goal + fade * (offset + slope * dt), fade * (velocity - slope * y * dt)


def damp(value: float, velocity: float, goal: float, half_life: float, dt: float) -> tuple[float, float]:
    """`spring` of one number, ten times as fast as by arrays."""
    rate = RATE / max(half_life, 1e-5)
    offset = value - goal
    slope = velocity + offset * rate
    fade = math.exp(-rate * dt)
    return fade * (offset + slope * dt) + goal, fade * (velocity - slope * rate * dt)


def damp_vector(
    value: _Vector, velocity: _Vector, goal: _Vector, half_life: float, dt: float
) -> tuple[_Vector, _Vector]:
    """`damp` of three numbers with one half-life."""
    rate = RATE / max(half_life, 1e-5)
    fade = math.exp(-rate * dt)
    x, y, z = value[0] - goal[0], value[1] - goal[1], value[2] - goal[2]
    vx, vy, vz = velocity
    ax, ay, az = vx + x * rate, vy + y * rate, vz + z * rate
    moved = (fade * (x + ax * dt) + goal[0], fade * (y + ay * dt) + goal[1], fade * (z + az * dt) + goal[2])
    rate *= dt
    return moved, (fade * (vx - ax * rate), fade * (vy - ay * rate), fade * (vz - az * rate))


def decay(half_life: float, dt: float = 1.0 / FPS) -> float:
    """Fraction of a difference that is left after `dt` seconds."""
    return float(0.5 ** (dt / half_life))
