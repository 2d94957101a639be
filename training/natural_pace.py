"""What the runtime needs besides weights: each style's natural speeds, what is neutral, and the frame of the beginning."""

from __future__ import annotations

import numpy as np
import torch
from sport.runtime.controls import Gait
from sport.runtime.motion.features import INPUT, OUTPUT, PHASE_OFFSETS, L
from sport.training.frames import LAYERED, PLAIN, FrameTable
from sport.training.stages.motion import StyleTable


def style_speeds(table: FrameTable, style: StyleTable, ridge: float = 0.3, draws: int = 4) -> np.ndarray:
    """Ridge regression `(385, 2)` from Z^t to the clips' natural walking and jogging speeds in m/s."""
    present = INPUT["gait"].start + 6 * (L // 2)
    gait = table.x[:, present : present + 6].astype(np.float32)
    speed = np.linalg.norm(table.y[:, OUTPUT["root"]][:, :2].astype(np.float32), axis=1)
    backward = table.y[:, OUTPUT["root"]][:, 1].astype(np.float32) < 0.0
    torch.manual_seed(0)
    columns = []
    for label, fallback in ((Gait.WALK, 1.3), (Gait.JOG, 2.6)):
        chosen = (gait[:, label] > 0.9) & (speed > 0.3) & ~backward
        clips = np.unique(table.clip[chosen])
        spans = [slice(table.start[c], table.start[c + 1]) for c in clips]
        enough = np.array([chosen[s].sum() > 120 for s in spans], bool)
        clips = clips[enough] if len(clips) else clips
        targets = np.array([np.median(speed[s][chosen[s]]) for s, e in zip(spans, enough, strict=True) if e])
        index = torch.as_tensor(np.repeat(clips, draws).astype(np.int64), device=style.index.device)
        inputs = style.draw(index).cpu().numpy() if len(clips) else np.zeros((0, 384), np.float32)
        columns.append(_ridge(inputs, np.repeat(targets, draws), ridge, fallback))
    return np.stack(columns, 1).astype(np.float32)


def neutral_style(table: FrameTable, style: StyleTable) -> np.ndarray:
    """Mean Z^t `(6, n / 6)` of the words of plain captured clips; of all clips where there are none."""
    plain = [s == PLAIN and c != LAYERED for s, c in zip(table.styles, table.contents, strict=True)]
    clips = [c for c, known in enumerate(plain) if known] or list(range(len(table.styles)))
    index = style.index[torch.as_tensor(clips, device=style.index.device)]
    return style.of(index.flatten(0, 1)).mean(0).view(6, -1).cpu().numpy()


def _ridge(inputs: np.ndarray, values: np.ndarray, ridge: float, fallback: float) -> np.ndarray:
    if len(values) < 2:
        return np.concatenate([np.zeros(inputs.shape[-1]), [fallback]])
    mean = values.mean()
    matrix = inputs.T @ inputs + ridge * len(inputs) / 100 * np.eye(inputs.shape[1])
    return np.concatenate([np.linalg.solve(matrix, inputs.T @ (values - mean)), [mean]])


def start_state(table: FrameTable, phase: np.ndarray) -> dict[str, list[float]]:
    """The quietest standing frame of a neutral clip: where a character begins."""
    styles = np.array(table.styles)[table.clip]
    gait = table.x[:, INPUT["gait"]].reshape(len(table), L, -1)[:, :, Gait.STAND].min(1)
    contacts = table.y[:, OUTPUT["contacts"]].min(1)
    speed = np.abs(table.y[:, OUTPUT["joint_velocities"]].astype(np.float32)).mean(1)
    captured = np.array([c != LAYERED for c in table.contents])[table.clip]
    neutral = np.char.startswith(styles, "neutral") & ~table.mirrored[table.clip] & captured
    penalty = 10.0 * (gait < 0.9) + 5.0 * (contacts < 0.5) + 20.0 * ~neutral
    row = int(np.argmin(speed + penalty))
    first, last = table.start[table.clip[row]], table.start[table.clip[row] + 1] - 1
    window = np.clip(row + PHASE_OFFSETS, first, last)
    output = table.y[row].astype(np.float32)
    output[OUTPUT["joint_positions"]][1::3] -= table.ground[row, 0]
    return {
        "output": [round(float(v), 4) for v in output],
        "phase": [round(float(v), 4) for v in phase[window].reshape(-1)],
    }
