"""Stage 0: train the (body-part) periodic autoencoder and store the phase of every frame (Sec. III-B)."""

from __future__ import annotations

import logging
from dataclasses import asdict

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import mse_loss

from runtime.motion.features import C
from training.batches import RandomRows
from training.frames import FrameTable
from training.networks.phase import WINDOW, PeriodicAutoencoder
from training.presets import ModelConfig
from training.session import (
    MovingAverage,
    Session,
    TrainingState,
    load_checkpoint,
    save_checkpoint,
    train,
)

log = logging.getLogger("sport.train")
HALF = WINDOW // 2
ENCODED = "phase_encoded.npy"  # of the run: phase vectors so far


def _windows(velocities: Tensor, rows: Tensor, first: Tensor, last: Tensor) -> Tensor:
    """`(B, 121, 31, 3)` around rows; frames beyond the clip repeat its end."""
    index = rows[:, None] + torch.arange(-HALF, HALF + 1, device=rows.device)
    index = torch.minimum(torch.maximum(index, first[rows, None]), last[rows, None])
    return velocities[index].float()


class _Windows:
    """Endless windows `(batch, 121, 31, 3)` of velocities, divided by their `scale`."""

    def __init__(self, session: Session, table: FrameTable, weights: np.ndarray, batch: int) -> None:
        device = session.device
        self._velocities = torch.as_tensor(table.velocities).to(device)
        first, last = torch.as_tensor(table.start[:-1]), torch.as_tensor(table.start[1:] - 1)
        clip = torch.as_tensor(table.clip.astype(np.int64))
        self._first, self._last = first[clip].to(device), last[clip].to(device)
        self._rows = RandomRows(weights, batch, 0, self._last, session.generator(1))
        probe = next(RandomRows(weights, 20000, 0, self._last, session.generator(11)))
        self.scale = self._velocities[probe].float().std((0, 2)).mean()

    def __iter__(self) -> _Windows:
        return self

    def __next__(self) -> Tensor:
        return _windows(self._velocities, next(self._rows), self._first, self._last) / self.scale

    def state_dict(self) -> dict[str, Tensor]:
        return self._rows.state_dict()

    def load_state_dict(self, state: dict[str, Tensor]) -> None:
        self._rows.load_state_dict(state)


def run(
    session: Session,
    config: ModelConfig,
    table: FrameTable,
    weights: np.ndarray,
    steps: int = 1500,
    batch: int = 128,
    max_minutes: float | None = None,
) -> np.ndarray:
    """Phase vectors `(N, 5, 2)` of every frame; also written to `phase.npy` beside the checkpoint."""
    torch.manual_seed(session.seed)
    batches = _Windows(session, table, weights, batch)
    module = PeriodicAutoencoder(config).to(session.device)
    optimizer = torch.optim.AdamW(module.parameters(), lr=1e-3, weight_decay=1e-4)
    state = TrainingState(module, optimizer, MovingAverage(module, 0.99))

    def losses(window: object, step: int) -> dict[str, Tensor]:
        assert isinstance(window, Tensor)
        loss = mse_loss(module(window).float(), window)
        return {"total": loss}

    train(
        session,
        "phase",
        state,
        batches,
        losses,
        steps,
        lambda s: 1e-3 * min(1.0, (steps - s) / (0.3 * steps) + 0.02),
        batch,
        max_minutes,
        {"windows": batches},
    )
    save_checkpoint(
        session.out / "phase_final.pt",
        {"module": state.average.values, "scale": batches.scale.cpu(), "config": asdict(config)},
    )
    return encode_table(session, config, table)


def encode_table(session: Session, config: ModelConfig, table: FrameTable) -> np.ndarray:
    """Phase vectors `(N, 5, 2)` of a table by the trained autoencoder; written to `phase.npy`."""
    saved = load_checkpoint(session.out / "phase_final.pt")
    module = PeriodicAutoencoder(config).to(session.device)
    module.load_state_dict(saved["module"])
    velocities = torch.as_tensor(table.velocities).to(session.device)
    first = torch.as_tensor(table.start[table.clip]).to(session.device)
    last = torch.as_tensor(table.start[table.clip + 1] - 1).to(session.device)
    phase = encode_all(session, module, velocities, float(saved["scale"]), first, last)
    # a unit scale for the networks: amplitudes themselves are arbitrary
    phase /= np.sqrt((phase[:: max(1, len(phase) // 50000)] ** 2).mean((0, 2), keepdims=True)) + 1e-6
    np.save(session.out / "phase.npy", phase.astype(np.float32))
    (session.out / ENCODED).unlink(missing_ok=True)
    return phase.astype(np.float32)


def _encoded_so_far(session: Session, count: int) -> np.ndarray:
    """Phase vectors `(count, 5, 2)` in a file of the run, NaN where still to be computed: hours of work survive an end."""
    path = session.out / ENCODED
    trained = session.out / "phase_final.pt"
    if path.exists() and path.stat().st_mtime >= trained.stat().st_mtime:
        kept = np.load(path, mmap_mode="r+")
        if kept.shape == (count, C, 2):
            return kept
    fresh = np.lib.format.open_memmap(path, mode="w+", dtype=np.float32, shape=(count, C, 2))
    fresh[:] = np.nan
    return fresh


@torch.no_grad()
def encode_all(
    session: Session,
    module: PeriodicAutoencoder,
    velocities: Tensor,
    scale: float,
    first: Tensor,
    last: Tensor,
    stride: int = 3,
    batch: int = 1024,
) -> np.ndarray:
    """Phase vectors of every frame; computed at every `stride`-th frame and interpolated between."""
    module.eval()
    count = len(velocities)
    rows = torch.arange(0, count, stride, device=velocities.device)
    known = _encoded_so_far(session, len(rows))
    for k, chunk in enumerate(rows.split(batch)):
        part = known[k * batch : (k + 1) * batch]
        if not np.isnan(part).any():
            continue
        with session.autocast():
            part[:] = (
                module.phase_vectors(_windows(velocities, chunk, first, last) / scale).float().cpu().numpy()
            )
        if k % 50 == 0:
            log.info("phase: encoded %d of %d frames", k * batch * stride, count)
    position = np.arange(count) / stride
    low = np.minimum(position.astype(int), len(known) - 1)
    high = np.minimum(low + 1, len(known) - 1)
    # no blending across two clips
    high = np.where(
        (low * stride < first.cpu().numpy()), high, np.where(high * stride > last.cpu().numpy(), low, high)
    )
    low = np.where(low * stride < first.cpu().numpy(), high, low)
    t = (position - np.floor(position))[:, None, None]
    return (1 - t) * known[low] + t * known[high]
