"""Curves from 0 to 1 with no speed at both ends."""

from __future__ import annotations

import numpy as np

from runtime.arrays import Array


def smoothstep(t: Array) -> Array:
    """0 below 0, 1 above 1, smooth between."""
    t = np.clip(t, 0.0, 1.0)
    return np.asarray(t * t * (3.0 - 2.0 * t))


def smootherstep(t: Array) -> Array:
    """The same with no acceleration at both ends either (Perlin 2002)."""
    t = np.clip(t, 0.0, 1.0)
    return np.asarray(t * t * t * (t * (6.0 * t - 15.0) + 10.0))


def smooth(value: float) -> float:
    """`smoothstep` of one number."""
    u = min(1.0, max(0.0, value))
    return u * u * (3.0 - 2.0 * u)
