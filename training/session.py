"""What every stage needs: device and precision, moving-average weights, resumable checkpoints, progress."""

from __future__ import annotations

import logging
import os
import time
from collections.abc import Callable, Iterator
from contextlib import nullcontext
from dataclasses import dataclass, field
from pathlib import Path

import torch
from torch import Tensor, nn

from sport.runtime.errors import FileError
from sport.training import parallel

log = logging.getLogger("sport.train")


@dataclass
class Session:
    """Where results go and on what they are computed; the same code runs on CPU and CUDA."""

    out: Path
    device: torch.device = field(
        default_factory=lambda: torch.device("cuda" if torch.cuda.is_available() else "cpu")
    )
    half: bool = True  # bf16 autocast
    seed: int = 0
    checkpoint_seconds: float = 120.0

    def autocast(self) -> object:
        """bf16 mixed precision, or nothing."""
        return torch.autocast(self.device.type, torch.bfloat16) if self.half else nullcontext()

    def generator(self, salt: int = 0) -> torch.Generator:
        """A seeded generator for sampling on the CPU, equal in all processes that train together."""
        return torch.Generator().manual_seed(self.seed * 7919 + salt)

    def batch_generator(self, salt: int) -> torch.Generator:
        """A seeded generator for what each process draws for itself."""
        return self.generator(salt + 1_000_003 * parallel.rank())


class MovingAverage:
    """Exponential moving average of a module's floating parameters and buffers (EMA weights)."""

    def __init__(self, module: nn.Module, decay: float = 0.999) -> None:
        self.decay = decay
        self.values = {n: v.detach().clone() for n, v in module.state_dict().items()}

    @torch.no_grad()
    def update(self, module: nn.Module, step: int) -> None:
        """Blend in the module's weights; the early average is short so that it forgets the start."""
        decay = min(self.decay, (step + 1) / (step + 10))
        for name, value in module.state_dict().items():
            if value.is_floating_point():
                self.values[name].lerp_(value, 1.0 - decay)
            else:
                self.values[name].copy_(value)


def save_checkpoint(path: Path, state: dict) -> None:
    """Write atomically: a killed run leaves the previous checkpoint. Of several processes only the first writes."""
    if parallel.rank():
        return
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_suffix(".tmp")
    torch.save(state, temporary)
    os.replace(temporary, path)


def load_checkpoint(path: Path) -> dict:
    """Tensors and plain values only; FileError when missing or damaged."""
    try:
        return torch.load(path, map_location="cpu", weights_only=True)
    except (OSError, RuntimeError, EOFError, KeyError) as error:
        raise FileError(
            f"{path}: not a checkpoint of this program.", "Run the earlier stage again."
        ) from error


@dataclass
class StageState:
    """A stage's module with its optimiser and moving average, saved and restored together."""

    module: nn.Module
    optimizer: torch.optim.Optimizer
    average: MovingAverage
    step: int = 0

    def restore(self, path: Path) -> bool:
        """Go on from a checkpoint when there is one."""
        if not path.exists():
            return False
        saved = load_checkpoint(path)
        self.module.load_state_dict(saved["module"])
        self.optimizer.load_state_dict(saved["optimizer"])
        self.average.values = {k: v.to(self.average.values[k]) for k, v in saved["average"].items()}
        self.step = int(saved["step"])
        return True

    def save(self, path: Path) -> None:
        save_checkpoint(
            path,
            {
                "module": self.module.state_dict(),
                "optimizer": self.optimizer.state_dict(),
                "average": self.average.values,
                "step": self.step,
            },
        )


Losses = dict[str, Tensor]


def train(
    session: Session,
    name: str,
    state: StageState,
    batches: Iterator,
    losses: Callable[[object, int], Losses],
    steps: int,
    learning_rate: Callable[[int], float],
    batch_size: int,
    max_minutes: float | None = None,
) -> None:
    """Optimise until `steps` (or `max_minutes`); `losses` returns named terms of which "total" is minimised.

    Logs samples/s and the time left, writes TensorBoard scalars, and a checkpoint `name.pt` every two minutes.
    """
    checkpoint = session.out / f"{name}.pt"
    if state.restore(checkpoint):
        log.info("%s: resumed at step %d", name, state.step)
    parallel.same_weights(state.module)
    if parallel.rank():
        torch.manual_seed(torch.initial_seed() + parallel.rank())  # noise of its own
    leads = parallel.rank() == 0
    (session.out / "logs").mkdir(parents=True, exist_ok=True)
    writer = _writer(session.out / "logs" / name) if leads else None
    started = saved = shown = time.monotonic()
    first = state.step
    sums: dict[str, float] = {}
    state.module.train()
    while state.step < steps:
        for group in state.optimizer.param_groups:
            group["lr"] = learning_rate(state.step)
        with session.autocast():  # type: ignore[attr-defined]
            terms = losses(next(batches), state.step)
        state.optimizer.zero_grad(set_to_none=True)
        terms["total"].backward()
        parallel.average_gradients(state.module.parameters())
        nn.utils.clip_grad_norm_(state.module.parameters(), 1.0)
        state.optimizer.step()
        state.average.update(state.module, state.step)
        state.step += 1
        for key, value in terms.items():
            sums[key] = 0.98 * sums.get(key, float(value.detach())) + 0.02 * float(value.detach())
        now = time.monotonic()
        if writer is not None and (now - shown > 15.0 or state.step == steps):
            shown = now
            rate = (state.step - first) / (now - started)
            left = (steps - state.step) / rate / 60
            text = "  ".join(f"{k} {v:.4f}" for k, v in sums.items())
            log.info(
                "%s %d/%d  %.0f samples/s  %.1f min left  %s",
                name,
                state.step,
                steps,
                rate * batch_size * parallel.workers(),
                left,
                text,
            )
            for key, value in sums.items():
                writer(key, value, state.step)
            last = f"step {state.step} of {steps}, losses {text}\n"
            (session.out / "logs" / f"{name}.txt").write_text(last, encoding="utf-8")
        if now - saved > session.checkpoint_seconds:
            saved = now
            state.save(checkpoint)
        if max_minutes is not None and parallel.anyone(now - started > 60 * max_minutes):
            log.info("%s: stopped after %.1f minutes at step %d", name, max_minutes, state.step)
            break
    state.save(checkpoint)


def _writer(folder: Path) -> Callable[[str, float, int], None]:
    try:
        from torch.utils.tensorboard import SummaryWriter
    except ImportError:
        log.info("tensorboard is not installed: curves are only logged as text")
        return lambda key, value, step: None
    return SummaryWriter(str(folder)).add_scalar
