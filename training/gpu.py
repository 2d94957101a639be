"""Avoiding GPU synchronisation: cached constants, row selection without counting, and CUDA graphs of whole steps.

On a CPU no graph is recorded, and only the selected rows are computed.
"""

from collections import Counter
from collections.abc import Callable, Hashable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache

import torch
from torch import Tensor, nn

Losses = dict[str, Tensor]
WARM_STEPS = 4  # of each variant before recording, which initialise libraries and constants


def constant(values: Iterable[float], device: torch.device, dtype: torch.dtype | None = None) -> Tensor:
    """Return a cached constant tensor on `device`; a list or array would be copied there in every step."""
    return _constant(tuple(values), device, dtype)


@lru_cache
def _constant(values: tuple[float, ...], device: torch.device, dtype: torch.dtype | None) -> Tensor:
    return torch.tensor(values, dtype=dtype, device=device)


def rows_of(chosen: Tensor) -> Tensor | slice:
    """Return the `chosen` `(B,)` rows, or all rows on a GPU, where counting them would synchronise."""
    return slice(None) if chosen.is_cuda else chosen.nonzero()[:, 0]


@contextmanager
def own_stream(device: torch.device, recorded: bool) -> Iterator[None]:
    """Use a separate stream for steps to be `recorded`: work on the default stream cannot be captured."""
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
    """CUDA graph of a step with its inputs and outputs, at fixed memory addresses."""

    graph: torch.cuda.CUDAGraph
    item: Tensor
    terms: Losses
    gradients: list[Tensor | None]


class GradientStep:
    """Computes the losses of a batch and their gradients for the parameters of `module`.

    `losses` must read and write the same memory in every step of a variant, and draw random numbers on the device. When
    a variant differs from an earlier one in more than its first entry, the earlier one does not occur again.
    """

    def __init__(self, module: nn.Module, losses: Callable[[Tensor], Losses], recorded: bool) -> None:
        self._parameters, self._losses, self._recorded = list(module.parameters()), losses, recorded
        self._done: Counter[Hashable] = Counter()
        self._recordings: dict[tuple, _Recording] = {}

    def __call__(self, item: Tensor, variant: tuple) -> Losses:
        """Return the losses of `item`; the next step of this variant overwrites them."""
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
        # allows other threads, such as NCCL's, to run meanwhile
        with torch.cuda.graph(graph, stream=torch.cuda.current_stream(), capture_error_mode="thread_local"):
            terms = self._computed(item)
        recording = _Recording(graph, item, terms, [p.grad for p in self._parameters])
        self._recordings[variant] = recording
        return recording
