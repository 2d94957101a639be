"""A worker thread that turns prompts into Z^t, so that no frame ever waits for text."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray
from sport.runtime.errors import SportError
from sport.runtime.prompts.content import PromptEncoder
from sport.runtime.prompts.expander import Expander, Expansion, PromptCancelledError
from sport.runtime.prompts.parts import PartDescriptions

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


@dataclass(frozen=True)
class _Job:
    request: Request
    stop: threading.Event


class PromptWorker:
    """One thread with one latest-wins slot each way; `submit` and `poll` never wait for text or network.

    A prompt goes through `expander`, six descriptions go straight to `encoder`. Newer words, and the end, do not wait
    for a stepped expander's answer to older ones. The worker keeps running after an error.
    """

    def __init__(self, expander: Expander, encoder: PromptEncoder) -> None:
        self._expander = expander
        self._encoder = encoder
        self._condition = threading.Condition()
        self._waiting: _Job | None = None
        self._in_hand: _Job | None = None
        self._result: PromptResult | None = None
        self._closed = False
        self._thread = threading.Thread(target=self._work, name="prompts", daemon=True)
        self._thread.start()

    def submit(self, prompt: Request) -> None:
        """Ask for a prompt or for six descriptions, in place of whatever waits or is in hand; no effect once closed."""
        with self._condition:
            self._stop_job_in_hand()
            self._waiting = None if self._closed else _Job(prompt, threading.Event())
            self._condition.notify()

    def withdraw(self) -> None:
        """Forget whatever waits or is in hand, and an answer that was not polled yet."""
        with self._condition:
            self._stop_job_in_hand()
            self._waiting = self._result = None

    def poll(self) -> PromptResult | None:
        """The newest result not yet polled, or None; what was withdrawn is no result."""
        with self._condition:
            result, self._result = self._result, None
            return result

    def use(self, expander: Expander) -> None:
        """Expand by another expander from the next request on."""
        with self._condition:
            self._expander = expander

    @property
    def busy(self) -> bool:
        """Whether a request waits or is being worked on."""
        with self._condition:
            return self._in_hand is not None or self._waiting is not None

    def close(self, timeout_s: float = 2.0) -> None:
        """Stop the thread after the text in the encoder; waits at most `timeout_s` seconds."""
        with self._condition:
            self._closed = True
            self._waiting = self._result = None
            self._stop_job_in_hand()
            self._condition.notify()
        self._thread.join(timeout_s)

    def _stop_job_in_hand(self) -> None:
        if self._in_hand is not None:
            self._in_hand.stop.set()

    def _work(self) -> None:
        while True:
            with self._condition:
                self._in_hand = None
                self._condition.wait_for(lambda: self._closed or self._waiting is not None)
                if self._waiting is None:
                    return
                job, self._waiting = self._waiting, None
                self._in_hand = job
                expander = self._expander
            for result in self._answers(job, expander):
                with self._condition:
                    if isinstance(result.error, PromptCancelledError):
                        break
                    # an answer to an outdated request is still news: the newer one will replace it
                    self._result = None if self._closed else result

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
