"""What every stage needs: device and precision, moving-average weights, resumable checkpoints, progress."""

from __future__ import annotations

import json
import logging
import os
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

import torch
from torch import Tensor, nn

from runtime.atomic import write_atomic
from runtime.errors import FileError
from training import parallel

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
    checkpoint_seconds: float = 240.0

    def __post_init__(self) -> None:
        # a processor without bf16 products computes them many times slower than those of single precision
        if self.device.type == "cpu" and not torch.ops.mkldnn._is_mkldnn_bf16_supported():
            self.half = False

    def autocast(self) -> AbstractContextManager[object]:
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


class Resumable(Protocol):
    """What a stage draws its samples from, kept in its checkpoints."""

    def state_dict(self) -> Mapping[str, Any]: ...

    def load_state_dict(self, state: Any) -> object: ...


@dataclass(frozen=True)
class StageLength:
    """How long a stage trains: `steps` of `batch` samples in each process, and no longer than `max_minutes`."""

    steps: int
    batch: int
    max_minutes: float | None = None


@dataclass
class TrainingState:
    """All that the next step of a stage depends on, saved and restored together.

    `sources` are what samples are drawn from: a stage resumed from a checkpoint gives the same bytes as one without a
    break.
    """

    module: nn.Module
    optimizer: torch.optim.Optimizer
    average: MovingAverage
    sources: Mapping[str, Resumable] = field(default_factory=dict)
    step: int = 0

    def restore(self, path: Path) -> bool:
        """Continue from a checkpoint when there is one, random numbers included."""
        if not path.exists():
            return False
        saved = load_checkpoint(path)
        self.module.load_state_dict(saved["module"])
        self.optimizer.load_state_dict(saved["optimizer"])
        self.average.values = {k: v.to(self.average.values[k]) for k, v in saved["average"].items()}
        self.step = int(saved["step"])
        for name, part in self.sources.items():
            part.load_state_dict(saved["kept"][name])
        torch.set_rng_state(saved["random"])
        if torch.cuda.is_available():
            torch.cuda.set_rng_state_all(saved["random_cuda"])
        return True

    def save(self, path: Path) -> None:
        """Write a checkpoint."""
        save_checkpoint(
            path,
            {
                "module": self.module.state_dict(),
                "optimizer": self.optimizer.state_dict(),
                "average": self.average.values,
                "step": self.step,
                "kept": {name: part.state_dict() for name, part in self.sources.items()},
                "random": torch.get_rng_state(),
                "random_cuda": torch.cuda.get_rng_state_all() if torch.cuda.is_available() else [],
            },
        )


Losses = dict[str, Tensor]


class TrainingProgress:
    """Running means of a stage's losses: in the log every 15 seconds, and the last as a text file.

    Of several processes only the first writes.
    """

    def __init__(self, folder: Path, name: str, length: StageLength, first: int) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self._leads = parallel.rank() == 0
        self._text_file, self._name, self._length, self._first = folder / f"{name}.txt", name, length, first
        self._started = self._shown = time.monotonic()
        self._means: dict[str, float] = {}

    def add(self, terms: Losses, step: int) -> None:
        """The losses of a step; `step` have been done."""
        for key, value in terms.items():
            now = float(value.detach())
            self._means[key] = 0.98 * self._means.get(key, now) + 0.02 * now
        if self._leads and (time.monotonic() - self._shown > 15.0 or step == self._length.steps):
            self._show(step)

    def _show(self, step: int) -> None:
        self._shown = time.monotonic()
        rate = (step - self._first) / (self._shown - self._started)
        text = "  ".join(f"{k} {v:.4f}" for k, v in self._means.items())
        log.info(
            "%s %d/%d  %.0f samples/s  %.1f min left  %s",
            self._name,
            step,
            self._length.steps,
            rate * self._length.batch * parallel.workers(),
            (self._length.steps - step) / rate / 60,
            text,
        )
        self._text_file.write_text(f"step {step} of {self._length.steps}, losses {text}\n", encoding="utf-8")


def _optimise(state: TrainingState, total: Tensor) -> None:
    """One step of the optimiser and of the moving average."""
    state.optimizer.zero_grad(set_to_none=True)
    total.backward()
    parallel.average_gradients(state.module.parameters())
    nn.utils.clip_grad_norm_(state.module.parameters(), 1.0)
    state.optimizer.step()
    state.average.update(state.module, state.step)
    state.step += 1


def train(
    session: Session,
    name: str,
    state: TrainingState,
    batches: Iterator,
    losses: Callable[[Any, int], Losses],
    learning_rate: Callable[[int], float],
    length: StageLength,
) -> None:
    """Optimise for `length`; `losses` of a batch and a step returns named terms of which "total" is minimised.

    Logs samples/s and the time left, and writes a checkpoint `name.pt` every four minutes.
    """
    checkpoint = session.out / f"{name}.pt"
    if state.restore(checkpoint):
        log.info("%s: resumed at step %d", name, state.step)
    parallel.same_weights(state.module)
    if parallel.rank():
        torch.manual_seed(torch.initial_seed() + parallel.rank())  # noise of its own
    progress = TrainingProgress(session.out / "logs", name, length, state.step)
    started = saved = time.monotonic()
    state.module.train()
    while state.step < length.steps:
        for group in state.optimizer.param_groups:
            group["lr"] = learning_rate(state.step)
        with session.autocast():
            terms = losses(next(batches), state.step)
        _optimise(state, terms["total"])
        progress.add(terms, state.step)
        now = time.monotonic()
        if now - saved > session.checkpoint_seconds:
            state.save(checkpoint)
            _add_hours(session.out, name, now - saved)
            saved = now
        if length.max_minutes is not None and parallel.anyone(now - started > 60 * length.max_minutes):
            log.info("%s: stopped after %.1f minutes at step %d", name, length.max_minutes, state.step)
            break
    state.save(checkpoint)
    _add_hours(session.out, name, time.monotonic() - saved)


def _add_hours(out: Path, name: str, seconds: float) -> None:
    """Sum up what each stage has taken, over all its interruptions, in `hours.json`."""
    if parallel.rank():
        return
    path = out / "hours.json"
    hours = json.loads(path.read_text("utf-8")) if path.exists() else {}
    hours[name] = round(hours.get(name, 0.0) + seconds / 3600, 4)
    write_atomic(path, json.dumps(hours, indent=1) + "\n")
