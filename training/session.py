"""Training loop shared by all stages: device and precision, averaged weights, resumable checkpoints, progress."""

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
from training.gpu import GradientStep, Losses, own_stream

log = logging.getLogger("sport.train")


@dataclass
class Session:
    """Output folder, device and precision of a stage; the same code runs on CPU and CUDA."""

    out: Path
    device: torch.device = field(
        default_factory=lambda: torch.device("cuda" if torch.cuda.is_available() else "cpu")
    )
    half: bool = True  # bf16 autocast
    recorded: bool = False  # steps run as CUDA graphs (`training.gpu`)
    seed: int = 0
    checkpoint_seconds: float = 240.0

    def __post_init__(self) -> None:
        # without bf16 instructions, a CPU computes bf16 products many times slower than float32
        if self.device.type == "cpu" and not torch.ops.mkldnn._is_mkldnn_bf16_supported():
            self.half = False

    def autocast(self) -> AbstractContextManager[object]:
        """Return the context of bf16 mixed precision, or one without effect."""
        return torch.autocast(self.device.type, torch.bfloat16) if self.half else nullcontext()

    def generator(self, salt: int = 0) -> torch.Generator:
        """Return a seeded CPU generator, equal in all processes that train together."""
        return torch.Generator().manual_seed(self.seed * 7919 + salt)

    def batch_generator(self, salt: int) -> torch.Generator:
        """Return a seeded generator that differs between processes."""
        return self.generator(salt + 1_000_003 * parallel.rank())


class MovingAverage:
    """Exponential moving average of a module's floating parameters and buffers (EMA weights)."""

    def __init__(self, module: nn.Module, decay: float = 0.999) -> None:
        self.decay = decay
        self.values = {n: v.detach().clone() for n, v in module.state_dict().items()}

    @torch.no_grad()
    def update(self, module: nn.Module, step: int) -> None:
        """Update with the module's weights; the decay starts low, so that initial weights are forgotten."""
        decay = min(self.decay, (step + 1) / (step + 10))
        current = module.state_dict()
        names = [name for name, value in current.items() if value.is_floating_point()]
        torch._foreach_lerp_([self.values[n] for n in names], [current[n] for n in names], 1.0 - decay)
        for name in current.keys() - names:
            self.values[name].copy_(current[name])


def save_checkpoint(path: Path, state: dict) -> None:
    """Write atomically, so that a killed run keeps the previous checkpoint; only the first of several processes writes."""
    if parallel.rank():
        return
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_suffix(".tmp")
    torch.save(state, temporary)
    os.replace(temporary, path)


def load_checkpoint(path: Path) -> dict:
    """Load tensors and plain values only; FileError if missing or damaged."""
    try:
        return torch.load(path, map_location="cpu", weights_only=True)
    except (OSError, RuntimeError, EOFError, KeyError) as error:
        raise FileError(
            f"{path}: not a checkpoint of this program.", "Run the earlier stage again."
        ) from error


class Resumable(Protocol):
    """A sample source whose state is part of the checkpoint."""

    def state_dict(self) -> Mapping[str, Any]: ...

    def load_state_dict(self, state: Any) -> object: ...


@dataclass(frozen=True)
class StageLength:
    """The length of a stage: `steps` of `batch` samples in each process.

    With `ends`, in seconds of `time.monotonic`, training stops then, and its schedule runs from 0 to `steps` over time.
    """

    steps: int
    batch: int
    ends: float | None = None


class StageSchedule:
    """Position of a stage on its schedule, 0 to `length.steps`: by step count, or by time."""

    def __init__(self, length: StageLength, begun: float = 0.0) -> None:
        """`begun`: position at which an earlier process stopped, for a schedule by time."""
        self.length, self._begun, self._started = length, begun, time.monotonic()

    def at(self, step: int) -> float:
        """Return the position at a step; of the first process if several train together, which must stop together."""
        if self.length.ends is None:
            return step
        gone = (time.monotonic() - self._started) / max(self.length.ends - self._started, 1e-3)
        return parallel.of_first(self._begun + (self.length.steps - self._begun) * min(gone, 1.0))


@dataclass
class TrainingState:
    """All state that the next step of a stage depends on, saved and restored together.

    `sources` are the sample sources: a resumed stage gives bitwise the same weights as an uninterrupted one.
    """

    module: nn.Module
    optimizer: torch.optim.Optimizer
    average: MovingAverage
    sources: Mapping[str, Resumable] = field(default_factory=dict)
    # called before every step with its schedule position; returns the variant of the step (`GradientStep`)
    prepare: Callable[[float], tuple] = lambda at: ()
    step: int = 0
    at: float = 0.0  # position on the schedule, see `StageSchedule`

    def restore(self, path: Path) -> bool:
        """Restore a checkpoint with its random state, if there is one; returns whether there was."""
        if not path.exists():
            return False
        saved = load_checkpoint(path)
        self.module.load_state_dict(saved["module"])
        self.optimizer.load_state_dict(saved["optimizer"])
        self.average.values = {k: v.to(self.average.values[k]) for k, v in saved["average"].items()}
        self.step, self.at = int(saved["step"]), float(saved["at"])
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
                "at": self.at,
                "kept": {name: part.state_dict() for name, part in self.sources.items()},
                "random": torch.get_rng_state(),
                "random_cuda": torch.cuda.get_rng_state_all() if torch.cuda.is_available() else [],
            },
        )


class TrainingProgress:
    """Running means of a stage's losses, logged every 15 seconds; the last ones are written to a text file.

    Only the first of several processes writes.
    """

    def __init__(self, folder: Path, name: str, length: StageLength, state: TrainingState) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self._text_file, self._name, self._length = folder / f"{name}.txt", name, length
        self._first = state.step, state.at
        self._started = self._shown = time.monotonic()
        self._names: list[str] = []

    def add(self, terms: Losses, state: TrainingState) -> None:
        """Add the losses of a finished step; the device is synchronised only when they are shown."""
        values = torch.stack([value.float() for value in terms.values()])
        if self._names != list(terms):  # some losses start later
            self._names, self._means = list(terms), values
        self._means.lerp_(values, 0.02)
        if time.monotonic() - self._shown > 15.0:
            self.show(state)

    def show(self, state: TrainingState) -> None:
        """Log and write the progress of the stage."""
        if parallel.rank() or not self._names:
            return
        self._shown, steps = time.monotonic(), self._length.steps
        seconds = self._shown - self._started
        rate, pace = (state.step - self._first[0]) / seconds, (state.at - self._first[1]) / seconds
        left = f"{(steps - state.at) / pace / 60:.1f} min left" if pace > 0.0 else "starting"
        means = zip(self._names, self._means.tolist(), strict=True)
        text = "  ".join(f"{name} {mean:.4f}" for name, mean in means)
        log.info(
            "%s %d  %.0f samples/s  %s  %s",
            self._name,
            state.step,
            rate * self._length.batch * parallel.workers(),
            left,
            text,
        )
        whole = state.step if self._length.ends is not None else steps
        self._text_file.write_text(f"step {state.step} of {whole}, losses {text}\n", encoding="utf-8")


def _optimise(state: TrainingState) -> None:
    """Do one step of the optimiser and of the moving average."""
    parallel.average_gradients(state.module.parameters())
    nn.utils.clip_grad_norm_(state.module.parameters(), 1.0)
    state.optimizer.step()
    state.average.update(state.module, state.step)
    state.step += 1


def train(
    session: Session,
    name: str,
    state: TrainingState,
    batches: Iterator[Tensor],
    losses: Callable[[Tensor], Losses],
    learning_rate: Callable[[float], float],
    length: StageLength,
) -> None:
    """Optimise for `length`; `losses` maps a batch to named terms, of which "total" is minimised.

    `learning_rate` maps a schedule position, 0 to `length.steps`, to a rate. Logs samples/s and the time left, and writes
    a checkpoint `name.pt` every four minutes.
    """
    checkpoint = session.out / f"{name}.pt"
    if state.restore(checkpoint):
        log.info("%s: resumed at step %d", name, state.step)
    parallel.same_weights(state.module)
    if parallel.rank():
        torch.manual_seed(torch.initial_seed() + parallel.rank())  # different noise in each process

    def terms_of(item: Tensor) -> Losses:
        with session.autocast():
            return losses(item)

    progress = TrainingProgress(session.out / "logs", name, length, state)
    gradients = GradientStep(state.module, terms_of, session.recorded)
    saved = time.monotonic()
    schedule = StageSchedule(length, state.at)
    state.module.train()
    with own_stream(session.device, session.recorded):
        while (at := schedule.at(state.step)) < length.steps:
            for group in state.optimizer.param_groups:
                group["lr"] = learning_rate(at)
            variant = state.prepare(at)
            terms = gradients(next(batches), variant)
            _optimise(state)
            state.at = at
            progress.add(terms, state)
            now = time.monotonic()
            if now - saved > session.checkpoint_seconds:
                state.save(checkpoint)
                _add_hours(session.out, name, now - saved)
                saved = now
    state.at = float(length.steps)
    progress.show(state)
    state.save(checkpoint)
    _add_hours(session.out, name, time.monotonic() - saved)


def _add_hours(out: Path, name: str, seconds: float) -> None:
    """Add to the total time of a stage in `hours.json`, over all interruptions."""
    if parallel.rank():
        return
    path = out / "hours.json"
    hours = json.loads(path.read_text("utf-8")) if path.exists() else {}
    hours[name] = round(hours.get(name, 0.0) + seconds / 3600, 4)
    write_atomic(path, json.dumps(hours, indent=1) + "\n")
