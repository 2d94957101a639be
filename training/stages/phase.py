"""Stage 0: train the (body-part) periodic autoencoder and store the phase of every frame (Sec. III-B)."""

from __future__ import annotations

import logging
from dataclasses import asdict, dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import mse_loss

from runtime.motion.features import C
from training.batches import RandomRows, window_around
from training.frames import FrameTable
from training.gpu import Losses
from training.networks.phase import WINDOW, PeriodicAutoencoder
from training.presets import ModelConfig
from training.session import (
    MovingAverage,
    Session,
    StageLength,
    TrainingState,
    load_checkpoint,
    save_checkpoint,
    train,
)

log = logging.getLogger("sport.train")
HALF = WINDOW // 2
STRIDE = 3  # frames between two encoded ones
KNOWN_FRAMES = 6000  # of the capture, from which the scale of phases is measured


class _Windows:
    """Endless windows `(batch, 121, 31, 3)` of velocities, divided by their `scale`."""

    def __init__(self, session: Session, table: FrameTable, weights: np.ndarray, batch: int) -> None:
        self._velocities = torch.as_tensor(table.velocities).to(session.device)
        self._first = torch.as_tensor(table.start[table.clip]).to(session.device)
        self._last = torch.as_tensor(table.start[table.clip + 1] - 1).to(session.device)
        self._rows = RandomRows(weights, batch, 0, self._last, session.generator(1))
        probe = next(RandomRows(weights, 20000, 0, self._last, session.generator(11)))
        self.scale = self._velocities[probe].float().std((0, 2)).mean()

    def __iter__(self) -> _Windows:
        return self

    def __next__(self) -> Tensor:
        rows = next(self._rows)
        index = window_around(
            rows, torch.arange(-HALF, HALF + 1, device=rows.device), self._first, self._last
        )
        return self._velocities[index].float() / self.scale

    def state_dict(self) -> dict[str, Tensor]:
        return self._rows.state_dict()

    def load_state_dict(self, state: dict[str, Tensor]) -> None:
        self._rows.load_state_dict(state)


def run(
    session: Session, config: ModelConfig, table: FrameTable, weights: np.ndarray, length: StageLength
) -> np.ndarray:
    """Train the autoencoder and return phase vectors `(N, 5, 2)` of all frames; also written to `phase.npy`."""
    torch.manual_seed(session.seed)
    batches = _Windows(session, table, weights, length.batch)
    module = PeriodicAutoencoder(config).to(session.device)
    optimizer = torch.optim.AdamW(module.parameters(), lr=1e-3, weight_decay=1e-4, fused=True)
    state = TrainingState(module, optimizer, MovingAverage(module, 0.99), {"windows": batches})

    def losses(window: Tensor) -> Losses:
        return {"total": mse_loss(module(window).float(), window)}

    def rate(step: float) -> float:
        return 1e-3 * min(1.0, (length.steps - step) / (0.3 * length.steps) + 0.02)

    train(session, "phase", state, batches, losses, rate, length)
    save_checkpoint(
        session.out / "phase_final.pt",
        {"module": state.average.values, "scale": batches.scale.cpu(), "config": asdict(config)},
    )
    return encode_table(session, config, table)


def encode_table(session: Session, config: ModelConfig, table: FrameTable) -> np.ndarray:
    """Compute phase vectors `(N, 5, 2)` of a table with the trained autoencoder; also written to `phase.npy`."""
    phase = _Encoder.of(session, config).phases(table)
    # unit scale for the networks: absolute amplitudes are arbitrary
    phase /= np.sqrt((phase[:: max(1, len(phase) // 50000)] ** 2).mean((0, 2), keepdims=True)) + 1e-6
    np.save(session.out / "phase.npy", phase.astype(np.float32))
    return phase.astype(np.float32)


def course_phases(
    session: Session,
    config: ModelConfig,
    table: FrameTable,
    known: tuple[FrameTable, np.ndarray],
    folder: Path,
) -> np.ndarray:
    """Return phases `(N, 5, 2)` of course clips `table`, cached in `folder`.

    They are scaled like `known`, the captured table and its phases.
    """
    stored = folder / "phase.npy"
    if stored.exists():
        found = np.load(stored, allow_pickle=False)
        if len(found) == len(table):
            return found
    encoder, (captured, phase) = _Encoder.of(session, config), known
    last = min(int(np.searchsorted(captured.start, KNOWN_FRAMES)), len(captured.start) - 1)
    count = int(captured.start[last])
    ratio = np.square(encoder.phases(captured, count)).mean((0, 2)) / np.square(phase[:count]).mean((0, 2))
    result = (encoder.phases(table) / np.sqrt(ratio)[:, None]).astype(np.float32)
    np.save(stored, result)
    return result


@dataclass(frozen=True)
class _Encoder:
    """Applies the trained autoencoder to all frames of a table."""

    session: Session
    module: PeriodicAutoencoder
    scale: float  # of velocities

    @staticmethod
    def of(session: Session, config: ModelConfig) -> _Encoder:
        """Load the autoencoder trained by stage 0."""
        saved = load_checkpoint(session.out / "phase_final.pt")
        module = PeriodicAutoencoder(config).to(session.device)
        module.load_state_dict(saved["module"])
        return _Encoder(session, module.eval(), float(saved["scale"]))

    @torch.no_grad()
    def phases(self, table: FrameTable, count: int | None = None) -> np.ndarray:
        """Return phase vectors of the clips in the first `count` frames (default: all); two of three frames are interpolated."""
        count = count or len(table)
        known = np.empty((-(-count // STRIDE), C, 2), np.float32)
        for clip, (first, end) in enumerate(pairwise(table.start.tolist())):
            own = slice(-(-first // STRIDE), -(-min(end, count) // STRIDE))
            if own.start < own.stop:
                known[own] = self._of_clip(table.velocities[first:end], own.start * STRIDE - first)
            if clip % 500 == 0:
                log.info("phase: encoded %d of %d frames", min(first, count), count)
        clip_of = table.clip[:count]
        return _between(known, table.start[clip_of], table.start[clip_of + 1] - 1)

    def _of_clip(self, velocities: np.ndarray, begin: int) -> np.ndarray:
        """Encode every third frame `(n, 5, 2)` of a clip `(T, 31, 3)` from `begin` on."""
        device = self.session.device
        padded = np.pad(velocities, ((HALF, HALF), (0, 0), (0, 0)), "edge")
        rows = torch.arange(begin, len(velocities), STRIDE, device=device)
        with self.session.autocast():
            sequence = torch.as_tensor(padded, device=device).float() / self.scale
            return self.module.phase_vectors(sequence, rows).float().cpu().numpy()


def _between(known: np.ndarray, first: np.ndarray, last: np.ndarray) -> np.ndarray:
    """Interpolate phases of all frames from every third; `first` and `last` `(N,)` bound the clip of each frame."""
    position = np.arange(len(first)) / STRIDE
    low = np.minimum(position.astype(int), len(known) - 1)
    high = np.minimum(low + 1, len(known) - 1)
    # no interpolation across two clips
    high = np.where((low * STRIDE < first), high, np.where(high * STRIDE > last, low, high))
    low = np.where(low * STRIDE < first, high, low)
    t = (position - np.floor(position))[:, None, None]
    return (1 - t) * known[low] + t * known[high]
