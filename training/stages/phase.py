"""Stage 0: train the (body-part) periodic autoencoder and store the phase of every frame (Sec. III-B)."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from dataclasses import asdict

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import mse_loss

from training.frames import FrameTable
from training.networks.phase import WINDOW, PeriodicAutoencoder
from training.presets import ModelConfig
from training.session import (
    MovingAverage,
    Session,
    StageState,
    load_checkpoint,
    save_checkpoint,
    train,
)

log = logging.getLogger("sport.train")
HALF = WINDOW // 2


def _windows(velocities: Tensor, rows: Tensor, first: Tensor, last: Tensor) -> Tensor:
    """`(B, 121, 31, 3)` around rows; frames beyond the clip repeat its end."""
    index = rows[:, None] + torch.arange(-HALF, HALF + 1, device=rows.device)
    index = torch.minimum(torch.maximum(index, first[rows, None]), last[rows, None])
    return velocities[index].float()


def _batches(
    session: Session, table: FrameTable, weights: np.ndarray, batch: int
) -> tuple[Tensor, Iterator[Tensor]]:
    """Scale of the velocities, and endless windows `(batch, 121, 31, 3)` divided by it."""
    device = session.device
    velocities = torch.as_tensor(table.velocities).to(device)
    first = torch.as_tensor(table.start[table.clip]).to(device)
    last = torch.as_tensor(table.start[table.clip + 1] - 1).to(device)
    cumulative = torch.as_tensor(np.cumsum(weights))
    generator = session.generator(1)
    probe = torch.searchsorted(cumulative, torch.rand(20000, generator=generator, dtype=torch.float64))
    scale = velocities[probe.clamp_max(len(table) - 1).to(device)].float().std((0, 2)).mean()

    def windows() -> Iterator[Tensor]:
        while True:
            draw = torch.rand(batch, generator=generator, dtype=torch.float64)
            rows = torch.searchsorted(cumulative, draw).clamp_max(len(table) - 1)
            yield _windows(velocities, rows.to(device), first, last) / scale

    return scale, windows()


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
    scale, batches = _batches(session, table, weights, batch)
    module = PeriodicAutoencoder(config).to(session.device)
    optimizer = torch.optim.AdamW(module.parameters(), lr=1e-3, weight_decay=1e-4)
    state = StageState(module, optimizer, MovingAverage(module, 0.99))

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
    )
    save_checkpoint(
        session.out / "phase_final.pt",
        {"module": state.average.values, "scale": scale.cpu(), "config": asdict(config)},
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
    return phase.astype(np.float32)


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
    parts = []
    for k, chunk in enumerate(rows.split(batch)):
        with session.autocast():  # type: ignore[attr-defined]
            parts.append(module.phase_vectors(_windows(velocities, chunk, first, last) / scale).float().cpu())
        if k % 200 == 0:
            log.info("phase: encoded %d of %d frames", k * batch * stride, count)
    known = torch.cat(parts).numpy()
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
