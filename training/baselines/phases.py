"""Phases out of foot contacts: the footstep phase of PFNN, and a local phase for each point of the soles.

Five channels, as our phase windows have them: left heel, left toe, right heel, right toe (Mason et al. 2022 take the local phases of
Starke et al. 2020; ours run from one onset of a contact to the next, without the fit of a sine), and the footstep phase, which
is 0 when the right foot comes down and half a turn when the left one does (Holden et al. 2017, Sec. 4.1).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from runtime.arrays import Array
from runtime.motion.features import FPS, FUTURE_PHASE_OFFSETS, PHASE_OFFSETS, C

FOOTSTEP = 4  # channel
IDLE_HZ = 0.5  # turns a second without any onset
MAX_GAP_S = 2.0  # a longer time between two onsets is standing


def onsets(contact: NDArray[np.bool_]) -> NDArray[np.integer]:
    """Frames at which a contact `(T,)` begins."""
    return np.flatnonzero(contact[1:] & ~contact[:-1]) + 1


def through(frames: NDArray[np.integer], turns: Array, length: int) -> Array:
    """Turns `(length,)` that have the given values at the given frames, straight between them, and go on at both ends."""
    if len(frames) < 2:
        start = float(turns[0]) - IDLE_HZ * frames[0] / FPS if len(frames) else 0.0
        return start + IDLE_HZ * np.arange(length) / FPS
    rate = float(np.median(np.diff(turns) / np.diff(frames)))
    at = np.arange(length)
    result = np.interp(at, frames, turns)
    before, after = at < frames[0], at > frames[-1]
    result[before] = turns[0] - rate * (frames[0] - at[before])
    result[after] = turns[-1] + rate * (at[after] - frames[-1])
    return result


def local_phase(contact: NDArray[np.bool_]) -> Array:
    """Turns `(T,)` that are whole at every onset of a contact `(T,)`."""
    frames = onsets(contact)
    return through(frames, np.arange(len(frames), dtype=np.float64), len(contact))


def footstep_phase(left: NDArray[np.bool_], right: NDArray[np.bool_]) -> Array:
    """Turns `(T,)` that are whole when the right foot comes down, and a half more when the left one does.

    Steps alternate: of two onsets of one foot in a row the phase makes a whole turn.
    """
    steps = sorted([(int(f), 0.5) for f in onsets(left)] + [(int(f), 0.0) for f in onsets(right)])
    frames: list[int] = []
    turns: list[float] = []
    for frame, fraction in steps:
        if frames and frame - frames[-1] < 2:  # both feet at once: a jump comes down
            continue
        last = turns[-1] if turns else -0.5
        ahead = (fraction - last) % 1.0
        turns.append(last + (ahead if ahead > 0 else 1.0))
        frames.append(frame)
    return through(np.array(frames, int), np.array(turns), len(left))


def phase_vectors(contacts: NDArray[np.bool_]) -> Array:
    """Vectors `(T, 5, 2)` (sine, cosine) of contacts `(T, 4)` left heel, left toe, right heel, right toe; of standing, short ones."""
    turns = [local_phase(contacts[:, k]) for k in range(4)]
    turns.append(footstep_phase(contacts[:, 0] | contacts[:, 1], contacts[:, 2] | contacts[:, 3]))
    angle = 2.0 * np.pi * np.stack(turns, 1)
    steps = np.concatenate([onsets(contacts[:, k]) for k in range(4)])
    at = np.arange(len(contacts))
    gap = np.abs(at[:, None] - steps[None]).min(1) if len(steps) else np.full(len(at), np.inf)
    size = np.where(gap < MAX_GAP_S * FPS / 2, 1.0, 0.1)[:, None]
    size = np.concatenate([np.repeat(size, 4, 1), np.ones_like(size)], 1)  # the footstep phase always turns
    return size[..., None] * np.stack([np.sin(angle), np.cos(angle)], -1)


def windows(vectors: Array) -> tuple[Array, Array]:
    """Inputs' windows `(T, 13, 5, 2)` around the frame before each, and outputs' `(T, 7, 5, 2)` of each and its future."""
    at, last = np.arange(len(vectors)), len(vectors) - 1
    before = np.clip(at[:, None] - 1 + PHASE_OFFSETS, 0, last)
    after = np.clip(at[:, None] + FUTURE_PHASE_OFFSETS, 0, last)
    assert vectors.shape[1] == C
    return vectors[before], vectors[after]
