"""When feet stand and swing: landings, the phase of a stride, and curves over swings, all from contacts."""

from __future__ import annotations

import itertools

import numpy as np
from numpy.typing import NDArray

from runtime.arrays import Array
from runtime.easing import smoothstep
from runtime.motion.features import FPS


def step_phase(contacts: NDArray[np.uint8]) -> Array:
    """Cycles `(T,)` that are whole where the left foot lands; 0.8 Hz where there are fewer than three landings."""
    landings = left_landings(contacts)
    time = np.arange(len(contacts), dtype=np.float64)
    if len(landings) < 3:
        return 0.8 * time / FPS
    cycle = float(np.median(np.diff(landings)))
    before = np.arange(1, int(landings[0] / cycle) + 2)[::-1]
    after = np.arange(1, int((len(contacts) - landings[-1]) / cycle) + 2)
    knots = np.concatenate([landings[0] - before * cycle, landings, landings[-1] + after * cycle])
    return np.interp(time, knots, np.arange(len(knots)) - len(before))


def left_landings(contacts: NDArray[np.uint8], gap: int = 6) -> NDArray[np.intp]:
    """Frames where the left foot comes down; contacts interrupted for up to `gap` frames count as one."""
    down = np.array(contacts[:, :2].any(1))
    edges = np.flatnonzero(np.diff(down.astype(np.int8)))
    for a, b in itertools.pairwise(edges):
        if not down[a + 1] and b - a <= gap:
            down[a + 1 : b + 1] = True
    return np.flatnonzero(np.diff(down.astype(np.int8)) == 1) + 1


def swings(down: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Intervals of at least eight frames in which a foot is in the air."""
    edges = np.flatnonzero(np.diff(np.concatenate([[True], down, [True]]).astype(np.int8)))
    return [(a, b) for a, b in zip(edges[::2], edges[1::2], strict=True) if b - a >= 8]


def held_in_stance(values: Array, down: NDArray[np.bool_]) -> Array:
    """`values` `(T, n)` made constant while the foot stands, so that a planted foot does not slide with the facing."""
    held = values.copy()
    found = swings(down)
    bounds = [0, *[t for s in found for t in s], len(values)]
    for a, b in zip(bounds[::2], bounds[1::2], strict=True):
        if b > a:
            held[a:b] = values[a:b].mean(0)
    for a, b in found:
        t = smoothstep(np.linspace(0, 1, b - a + 2)[1:-1, None])
        before, after = held[max(a - 1, 0)], held[min(b, len(values) - 1)]
        held[a:b] = (1 - t) * before + t * after
    return held


def bumps(down: NDArray[np.bool_]) -> Array:
    """One smooth hill of height 1 for every swing of a foot."""
    result = np.zeros(len(down))
    for a, b in swings(down):
        result[a:b] = np.sin(np.pi * (np.arange(a, b) - a + 0.5) / (b - a)) ** 2
    return result


def height_in_swing(height: Array, down: NDArray[np.bool_]) -> Array:
    """How far a swinging foot is above the line between its lift-off and its landing."""
    result = np.zeros(len(height))
    for a, b in swings(down):
        line = np.linspace(height[max(a - 1, 0)], height[min(b, len(height) - 1)], b - a)
        result[a:b] = np.maximum(height[a:b] - line, 0.0)
    return result


def swing_share(down: NDArray[np.bool_]) -> Array:
    """One while a foot swings, rising to it over the first quarter and falling over the last."""
    result = np.zeros(len(down))
    for a, b in swings(down):
        t = (np.arange(a, b) - a + 0.5) / (b - a)
        result[a:b] = smoothstep(np.minimum(t / 0.25, (1.0 - t) / 0.25))
    return result
