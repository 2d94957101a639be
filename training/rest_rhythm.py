"""What goes on moving at rest: amplitude and rate of the phases of standing clips, by their words.

A standing body has no steps to keep time by. Of a hand that waves the network knows how it moves at each phase, but its own
forecast of the phase comes to rest; so the runtime turns the phases of such styles by a clock.
"""

from __future__ import annotations

import numpy as np
import torch

from runtime.controls import Gait
from runtime.motion.features import FPS, INPUT, C, L
from training.frames import FrameTable
from training.natural_pace import ridge_regression
from training.styles import StyleTable

DRAWS = 6  # of words for each clip
STANDING = 0.9  # share of a clip's frames
MARGIN = 10  # frames at both ends, where the periodic autoencoder sees half a window
SHORTEST = FPS  # frames


def rest_rhythm(table: FrameTable, phase: np.ndarray, style: StyleTable, ridge: float = 0.5) -> np.ndarray:
    """Ridge regression `(n + 1, 2 C)` from the n numbers of Z^t to each channel's amplitude and, after these, turns a second at rest."""
    torch.manual_seed(0)
    clips = [clip for clip in range(len(table.styles)) if _stands(table, clip)]
    found = np.array([_rhythm(phase[_inner(table, clip)]) for clip in clips]).reshape(len(clips), 2 * C)
    index = torch.as_tensor(clips * DRAWS, device=style.index.device, dtype=torch.long)
    inputs = style.draw(index).cpu().numpy()  # (0, n) where no clip stands
    values, weights = np.tile(found, (DRAWS, 1)), np.ones(len(index))
    columns = [ridge_regression(inputs, values[:, k], weights, ridge, 0.0) for k in range(2 * C)]
    return np.stack(columns, 1).astype(np.float32)


def _inner(table: FrameTable, clip: int) -> slice:
    return slice(int(table.start[clip]) + MARGIN, int(table.start[clip + 1]) - MARGIN)


def _stands(table: FrameTable, clip: int) -> bool:
    frames = _inner(table, clip)
    if frames.stop - frames.start < SHORTEST or table.held_out[clip]:
        return False
    gait = table.x[frames, INPUT["gait"]].reshape(-1, L, len(Gait))[:, L // 2, Gait.STAND]
    return float((gait > 0.5).mean()) > STANDING


def _rhythm(phase: np.ndarray) -> np.ndarray:
    """Mean amplitude `(C,)` and turns a second `(C,)` of phases `(T, C, 2)`."""
    phase = np.asarray(phase, np.float64)
    angle = np.unwrap(np.arctan2(phase[..., 0], phase[..., 1]), axis=0)
    turns = (angle[-1] - angle[0]) / (2 * np.pi) * FPS / (len(angle) - 1)
    return np.concatenate([np.linalg.norm(phase, axis=-1).mean(0), turns])
