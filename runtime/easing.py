"""Easing curves on arrays (smoothstep), and a critically damped spring."""

import math

import numpy as np

from runtime.arrays import Array


def smoothstep(t: Array) -> Array:
    """Ease from 0 at t = 0 to 1 at t = 1 with zero slope at both ends (cubic); constant outside."""
    t = np.minimum(np.maximum(t, 0.0), 1.0)
    return np.asarray(t * t * (3.0 - 2.0 * t))


def smootherstep(t: Array) -> Array:
    """Ease from 0 to 1 like `smoothstep`, with zero second derivative at both ends too (Perlin 2002)."""
    t = np.minimum(np.maximum(t, 0.0), 1.0)
    return np.asarray(t * t * t * (t * (6.0 * t - 15.0) + 10.0))


def spring(
    value: Array, velocity: Array, goal: Array, half_life: float | Array, dt: float | Array
) -> tuple[Array, Array]:
    """Return value and velocity of a critically damped spring after `dt` seconds, any shape."""
    y = 2.0 * math.log(2.0) / np.maximum(half_life, 1e-6)
    offset = value - goal
    slope = velocity + offset * y
    fade = np.exp(-y * dt)
    return goal + fade * (offset + slope * dt), fade * (velocity - slope * y * dt)
