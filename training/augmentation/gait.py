"""Gait timing from contacts: stances and swings, stride phase, curves over swings, and means over a gait cycle."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from runtime.arrays import Array
from runtime.easing import smoothstep
from runtime.measures.signals import landings
from runtime.motion.features import FPS
from runtime.takes.footplants import stretches
from training.frames import smooth

_DEEPEST_FRAMES = 6.0  # from a landing to the deepest knee flexion
USUAL_CYCLE_FRAMES = 66  # used if there are too few landings


def left_landings(contacts: NDArray[np.uint8]) -> NDArray[np.intp]:
    """Return the frames where the left foot lands, from contacts `(T, 4)`."""
    return landings(np.asarray(contacts[:, :2].any(1)))


def right_landings(contacts: NDArray[np.uint8]) -> NDArray[np.intp]:
    """Return the frames where the right foot lands."""
    return landings(np.asarray(contacts[:, 2:].any(1)))


def all_landings(contacts: NDArray[np.uint8]) -> NDArray[np.intp]:
    """Return the frames where the left foot lands, then those of the right foot."""
    return np.concatenate([left_landings(contacts), right_landings(contacts)])


def step_phase(contacts: NDArray[np.uint8]) -> Array:
    """Return gait cycles `(T,)`, integer where the left foot lands; at 0.8 Hz if there are fewer than three landings."""
    landings = left_landings(contacts)
    time = np.arange(len(contacts), dtype=np.float64)
    if len(landings) < 3:
        return 0.8 * time / FPS
    cycle = float(np.median(np.diff(landings)))
    before = np.arange(1, int(landings[0] / cycle) + 2)[::-1]
    after = np.arange(1, int((len(contacts) - landings[-1]) / cycle) + 2)
    knots = np.concatenate([landings[0] - before * cycle, landings, landings[-1] + after * cycle])
    return np.interp(time, knots, np.arange(len(knots)) - len(before))


def cycle_frames(contacts: NDArray[np.uint8]) -> int:
    """Return the length of a gait cycle: the median time between landings of the same foot."""
    gaps = np.concatenate([np.diff(left_landings(contacts)), np.diff(right_landings(contacts))])
    return int(np.clip(np.median(gaps), 20, 150)) if len(gaps) else USUAL_CYCLE_FRAMES


def cycle_mean(values: Array, frames: int) -> Array:
    """Return the mean of values `(T, n)` over a cycle around every frame; ends are extrapolated periodically with drift."""
    half = frames // 2
    if len(values) < frames + 2:
        return np.broadcast_to(values.mean(0), values.shape).copy()
    before = values[frames - half : frames] - (values[frames] - values[0])
    after = values[len(values) - frames : len(values) - frames + half] + (values[-1] - values[-1 - frames])
    total = np.cumsum(np.concatenate([np.zeros_like(values[:1]), before, values, after]), axis=0)
    return (total[2 * half + 1 :] - total[: -2 * half - 1]) / (2 * half + 1)


def swings(down: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Return intervals of at least eight frames in which a foot is in the air."""
    return [(a, b) for a, b in stretches(~down) if b - a >= 8]


def over_swings(down: NDArray[np.bool_], curve: Callable[[Array, int], Array]) -> Array:
    """Evaluate `curve(time, frames)` over every swing, 0 in stance, `(T,)`; `time` runs from 0 to `frames`."""
    result = np.zeros(len(down))
    for a, b in swings(down):
        result[a:b] = curve(np.arange(a, b) - a + 0.5, b - a)
    return result


def hill(time: Array, frames: int) -> Array:
    """Return a smooth hill of height 1."""
    return np.sin(np.pi * time / frames) ** 2


def plateau(time: Array, frames: int) -> Array:
    """Return a curve that rises to 1 in the first quarter and falls in the last."""
    t = time / frames
    return smoothstep(np.minimum(t / 0.25, (1.0 - t) / 0.25))


def late_hill(time: Array, frames: int) -> Array:
    """Return a hill of height 1 with its maximum at two thirds and a steep end."""
    t = time / frames
    return t**2 * (1.0 - t) / (4.0 / 27.0)


def early_rise(time: Array, frames: int) -> Array:
    """Return a curve that is 0 in the first third and 1 from two thirds on."""
    return smoothstep((time / frames - 0.3) / 0.35)


def height_in_swing(height: Array, down: NDArray[np.bool_]) -> Array:
    """Return the height of a swinging foot above the line from lift-off to landing."""
    result = np.zeros(len(height))
    for a, b in swings(down):
        line = np.linspace(height[max(a - 1, 0)], height[min(b, len(height) - 1)], b - a)
        result[a:b] = np.maximum(height[a:b] - line, 0.0)
    return result


def held_in_stance(values: Array, down: NDArray[np.bool_]) -> Array:
    """Make `values` `(T, n)` constant in each stance, so that a planted foot does not slide with the facing."""
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


def per_stance(standing: NDArray[np.bool_], random: np.random.Generator) -> Array:
    """Return a normal random number per stance, `(T,)`."""
    number = np.cumsum(np.diff(standing.astype(int), prepend=0) == 1)
    return random.normal(size=int(number.max()) + 1).clip(-1.5, 1.5)[number]


def jolts(contacts: NDArray[np.uint8]) -> Array:
    """Return a curve that rises to 1 within 0.1 s of every landing and is 0 after half a second."""
    frames = all_landings(contacts)
    if not len(frames):
        return np.zeros(len(contacts))
    since = np.maximum((np.arange(len(contacts))[:, None] - frames[None]) / _DEEPEST_FRAMES, 0.0)
    return smooth((since * np.exp(1.0 - since)).sum(1, keepdims=True), 1.0)[:, 0]


def drift(length: int, random: np.random.Generator) -> Array:
    """Return slow unit noise `(T, 3)`: a held hand is never perfectly still."""
    time = np.arange(length)[:, None] / FPS
    drift = np.zeros((length, 3))
    for _ in range(2):
        drift += np.sin(2 * np.pi * (random.uniform(0.1, 0.7, 3) * time + random.random(3)))
    return drift
