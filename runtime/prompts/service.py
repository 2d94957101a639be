"""A worker thread that turns prompts into Z^t, so that no frame ever waits for text."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from runtime.errors import SportError
from runtime.prompts.content import PromptEncoder
from runtime.prompts.expander import Expander, Expansion, PromptCancelledError
from runtime.prompts.parts import PartDescriptions

_log = logging.getLogger(__name__)
Request = str | PartDescriptions


@runtime_checkable
class SteppedExpander(Expander, Protocol):
    """An expander that has something to say before its answer is final."""

    def steps(self, prompt: str, stop: threading.Event) -> Iterator[tuple[Expansion, bool]]:
        """(expansion, whether it is the final one), best last; PromptCancelledError soon after `stop` is set."""
        ...


@dataclass(frozen=True)
class PromptResult:
    """Answer to one request, or `error`; a request may get several, the last of them is `final`.

    `expansion` is what the expander said, `z` (6, 64) its code. `milliseconds` have passed since the worker began.
    """

    request: Request
    expansion: Expansion | None
    z: NDArray[np.float32] | None
    milliseconds: float
    error: SportError | None = None
    final: bool = True


@dataclass
class _Job:
    """One request, until its final answer is polled."""

    request: Request
    stop: threading.Event = field(default_factory=threading.Event)
    begun: bool = False
    answer: PromptResult | None = None  # the newest, not yet polled


class PromptWorker:
    """One thread for the newest request; `submit` and `poll` never wait for text or network.

    A prompt goes through `expander`, six descriptions go straight to `encoder`. A newer request, and the end, do not
    wait for a stepped expander's answer to an older one, which is dropped. The worker keeps running after an error.
    """

    def __init__(self, expander: Expander, encoder: PromptEncoder) -> None:
        self._expander = expander
        self._encoder = encoder
        self._condition = threading.Condition()
        self._job: _Job | None = None
        self._closed = False
        self._thread = threading.Thread(target=self._work, name="prompts", daemon=True)
        self._thread.start()

    def submit(self, prompt: Request) -> None:
        """Ask for a prompt or for six descriptions in place of any older request; no effect once closed."""
        with self._condition:
            self._replace(None if self._closed else _Job(prompt))

    def answer(self, prompt: Request) -> PromptResult:
        """The final answer, on the caller's thread and beside what `submit` asked; raises its error."""
        with self._condition:
            expander = self._expander
        result = list(self._answers(_Job(prompt), expander))[-1]
        if result.error is not None:
            raise result.error
        return result

    def withdraw(self) -> None:
        """Forget the request, and an answer that was not polled yet."""
        with self._condition:
            self._replace(None)

    def poll(self) -> PromptResult | None:
        """The newest answer to the newest request that was not polled yet, or None."""
        with self._condition:
            if self._job is None:
                return None
            answer, self._job.answer = self._job.answer, None
            if answer is not None and answer.final:
                self._job = None
            return answer

    def use(self, expander: Expander) -> None:
        """Expand by another expander from the next request on."""
        with self._condition:
            self._expander = expander

    @property
    def busy(self) -> bool:
        """Whether the final answer to the request has yet to be found."""
        with self._condition:
            return self._job is not None and not (self._job.answer and self._job.answer.final)

    def close(self, timeout_s: float = 2.0) -> None:
        """Stop the thread after the text in the encoder; waits at most `timeout_s` seconds."""
        with self._condition:
            self._closed = True
            self._replace(None)
        self._thread.join(timeout_s)

    def _replace(self, job: _Job | None) -> None:
        if self._job is not None:
            self._job.stop.set()
        self._job = job
        self._condition.notify()

    def _work(self) -> None:
        while True:
            with self._condition:
                self._condition.wait_for(lambda: self._closed or (self._job and not self._job.begun))
                job, expander = self._job, self._expander
                if job is None:
                    return
                job.begun = True
            for answer in self._answers(job, expander):
                with self._condition:
                    job.answer = answer  # nobody polls it when a newer request has taken the job's place

    def _answers(self, job: _Job, expander: Expander) -> Iterator[PromptResult]:
        """Every answer to a request, encoded; an error is the last."""
        started = time.perf_counter()

        def since() -> float:
            return (time.perf_counter() - started) * 1e3

        try:
            for expansion, final in _expansions(job, expander):
                z = self._encoder.encode(expansion.descriptions)
                yield PromptResult(job.request, expansion, z, since(), final=final)
                if job.stop.is_set():
                    return
        except PromptCancelledError:
            return
        except SportError as error:
            yield PromptResult(job.request, None, None, since(), error)
        except Exception as unexpected:  # the thread must outlive any defect, and the user must see it
            _log.exception("prompt worker")
            defect = SportError(f"The prompt failed unexpectedly: {unexpected!r}.", "Try another prompt.")
            yield PromptResult(job.request, None, None, since(), defect)


def _expansions(job: _Job, expander: Expander) -> Iterator[tuple[Expansion, bool]]:
    if isinstance(job.request, PartDescriptions):
        yield Expansion(job.request, "explicit"), True
    elif isinstance(expander, SteppedExpander):
        yield from expander.steps(job.request, job.stop)
    else:
        yield expander.expand(job.request), True
