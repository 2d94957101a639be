"""A critically damped spring: what cameras follow with, and what takes back a jump of an arm."""

from __future__ import annotations

import math

import numpy as np

from runtime.arrays import Array


def spring(
    value: Array, velocity: Array, goal: Array, half_life: float | Array, dt: float | Array
) -> tuple[Array, Array]:
    """One exact step of a critically damped spring; returns the new value and velocity (any shape)."""
    y = 2.0 * math.log(2.0) / np.maximum(half_life, 1e-6)
    offset = value - goal
    slope = velocity + offset * y
    decay = np.exp(-y * dt)
    return goal + decay * (offset + slope * dt), decay * (velocity - slope * y * dt)
