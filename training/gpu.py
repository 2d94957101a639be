"""Steps that a GPU does without waiting: constants made once, rows that need not be counted, whole steps as CUDA graphs.

On a CPU nothing is recorded, and rows that nothing is done to are left out.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Hashable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache

import torch
from torch import Tensor, nn

Losses = dict[str, Tensor]
WARM_STEPS = 4  # of each variant before it is recorded: libraries and constants are ready by then


def constant(values: Iterable[float], device: torch.device, dtype: torch.dtype | None = None) -> Tensor:
    """Numbers or an index on `device`, copied there once: a list or an array in its place is copied in every step."""
    return _constant(tuple(values), device, dtype)


@lru_cache
def _constant(values: tuple[float, ...], device: torch.device, dtype: torch.dtype | None) -> Tensor:
    return torch.tensor(values, dtype=dtype, device=device)


def rows_of(chosen: Tensor) -> Tensor | slice:
    """Rows to compute where only the `chosen` `(B,)` count: these, or all of them on a GPU, which would have to count."""
    return slice(None) if chosen.is_cuda else chosen.nonzero()[:, 0]


@contextmanager
def own_stream(device: torch.device, recorded: bool) -> Iterator[None]:
    """A stream for steps that will be `recorded`: what has run on the default stream cannot be."""
    if not recorded:
        yield
        return
    stream, default = torch.cuda.Stream(device), torch.cuda.current_stream(device)
    stream.wait_stream(default)
    with torch.cuda.stream(stream):
        yield
    default.wait_stream(stream)


@dataclass
class _Recording:
    """A step's graph, what it reads and what it leaves: all stay where they are in memory."""

    graph: torch.cuda.CUDAGraph
    item: Tensor
    terms: Losses
    gradients: list[Tensor | None]


class GradientStep:
    """Losses of a batch, and their gradients in the parameters of `module`.

    `losses` must read and write the same memory in every step of a variant, and draw its random numbers on the device. Of
    two variants that differ in more than their first entry only the later one is needed again.
    """

    def __init__(self, module: nn.Module, losses: Callable[[Tensor], Losses], recorded: bool) -> None:
        self._parameters, self._losses, self._recorded = list(module.parameters()), losses, recorded
        self._done: Counter[Hashable] = Counter()
        self._recordings: dict[tuple, _Recording] = {}

    def __call__(self, item: Tensor, variant: tuple) -> Losses:
        """Of `item`; the terms are overwritten in the next step of this variant."""
        recording = self._recordings.get(variant)
        if recording is None:
            self._done[variant] += 1
            if not self._recorded or self._done[variant] <= WARM_STEPS:
                return self._computed(item)
            recording = self._record(item, variant)
        recording.item.copy_(item)
        recording.graph.replay()
        for parameter, gradient in zip(self._parameters, recording.gradients, strict=True):
            parameter.grad = gradient
        return recording.terms

    def _computed(self, item: Tensor) -> Losses:
        for parameter in self._parameters:
            parameter.grad = None
        terms = self._losses(item)
        terms["total"].backward()
        return {name: value.detach() for name, value in terms.items()}

    def _record(self, item: Tensor, variant: tuple) -> _Recording:
        self._recordings = {k: r for k, r in self._recordings.items() if k[1:] == variant[1:]}
        graph, item = torch.cuda.CUDAGraph(), item.clone()
        # other threads, such as those of NCCL, may go on meanwhile
        with torch.cuda.graph(graph, stream=torch.cuda.current_stream(), capture_error_mode="thread_local"):
            terms = self._computed(item)
        recording = _Recording(graph, item, terms, [p.grad for p in self._parameters])
        self._recordings[variant] = recording
        return recording
