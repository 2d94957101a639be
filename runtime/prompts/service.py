"""A worker thread that turns prompts into Z^t, so that no frame waits for text."""

import logging
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Protocol, runtime_checkable

from runtime.errors import SportError
from runtime.prompts.answer import Answer, Request
from runtime.prompts.content import PromptEncoder
from runtime.prompts.expander import Expander, Expansion, PromptCancelledError
from runtime.prompts.parts import PartDescriptions

_log = logging.getLogger(__name__)


@runtime_checkable
class SteppedExpander(Expander, Protocol):
    """An expander that yields preliminary answers before the final one."""

    def steps(self, prompt: str, stop: threading.Event) -> Iterator[tuple[Expansion, bool]]:
        """Yield (expansion, is final), the best last; PromptCancelledError soon after `stop` is set."""
        ...


@dataclass
class _Work:
    """The latest request, until its final answer is polled."""

    request: Request
    stop: threading.Event = field(default_factory=threading.Event)
    begun: bool = False
    answer: Answer | SportError | None = None  # the latest, not yet polled

    @property
    def done(self) -> bool:
        return isinstance(self.answer, SportError) or (self.answer is not None and self.answer.final)


class PromptWorker:
    """A thread that answers the newest prompt request; `submit` and `poll` never block.

    Prompts go through `expander`, six descriptions straight to `encoder`. A newer request or `close` does not wait for
    a stepped expander; its answer is dropped. The thread survives errors.
    """

    def __init__(self, expander: Expander, encoder: PromptEncoder) -> None:
        self._expander = expander
        self._encoder = encoder
        self._condition = threading.Condition()
        self._work: _Work | None = None
        self._closed = False
        self._thread = threading.Thread(target=self._run, name="prompts", daemon=True)
        self._thread.start()

    def submit(self, prompt: Request) -> None:
        """Request a prompt or six descriptions, replacing any older request; no effect once closed."""
        with self._condition:
            self._replace(None if self._closed else _Work(prompt))

    def answer(self, prompt: Request) -> Answer:
        """Return the final answer to a prompt, computed on the caller's thread, or raise its error."""
        with self._condition:
            expander = self._expander
        return _answer_or_raise(list(self._answers(_Work(prompt), expander))[-1])

    def withdraw(self) -> None:
        """Cancel the request and discard its answer."""
        with self._condition:
            self._replace(None)

    def poll(self) -> Answer | None:
        """Return the newest answer to the newest request that was not polled yet, or None; raises the request's error."""
        with self._condition:
            if self._work is None or self._work.answer is None:
                return None
            work, answer = self._work, self._work.answer
            self._work = None if work.done else work
            work.answer = None
        return _answer_or_raise(answer)

    def use(self, expander: Expander) -> None:
        """Use another expander from the next request on."""
        with self._condition:
            self._expander = expander

    @property
    def busy(self) -> bool:
        """Whether the final answer to the request is pending."""
        with self._condition:
            return self._work is not None and not self._work.done

    def close(self, timeout_s: float = 2.0) -> bool:
        """Stop the thread after the text that it is encoding, waiting at most `timeout_s`; return whether it has stopped."""
        with self._condition:
            self._closed = True
            self._replace(None)
        self._thread.join(timeout_s)
        return not self._thread.is_alive()

    def _replace(self, work: _Work | None) -> None:
        if self._work is not None:
            self._work.stop.set()
        self._work = work
        self._condition.notify()

    def _run(self) -> None:
        while True:
            with self._condition:
                self._condition.wait_for(lambda: self._closed or (self._work and not self._work.begun))
                work, expander = self._work, self._expander
                if work is None:
                    return
                work.begun = True
            for answer in self._answers(work, expander):
                with self._condition:
                    work.answer = answer  # never polled when a newer request has taken its place

    def _answers(self, work: _Work, expander: Expander) -> Iterator[Answer | SportError]:
        """Yield every answer to a request, encoded; an error is the last."""
        started = time.perf_counter()
        try:
            for expansion, final in _expansions(work, expander):
                z = self._encoder.encode(expansion.descriptions)
                yield Answer.of(work.request, expansion, z, (time.perf_counter() - started) * 1e3, final)
                if work.stop.is_set():
                    return
        except PromptCancelledError:
            return
        except SportError as error:
            yield error
        except Exception as unexpected:  # the thread must outlive any defect, and the user must see it
            _log.exception("prompt worker")
            yield SportError(f"The prompt failed unexpectedly: {unexpected!r}.", "Try another prompt.")


def _answer_or_raise(answer: Answer | SportError) -> Answer:
    if isinstance(answer, SportError):
        raise answer
    return answer


def _expansions(work: _Work, expander: Expander) -> Iterator[tuple[Expansion, bool]]:
    if isinstance(work.request, PartDescriptions):
        yield Expansion(work.request, "explicit"), True
    elif isinstance(expander, SteppedExpander):
        yield from expander.steps(work.request, work.stop)
    else:
        yield expander.expand(work.request), True
