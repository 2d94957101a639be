"""A worker thread that turns prompts into Z^t, so that no frame ever waits for text."""

from __future__ import annotations

import logging
import threading
import time
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from runtime.errors import SportError
from runtime.prompts.content import PromptEncoder
from runtime.prompts.expander import Expander, Expansion
from runtime.prompts.parts import PartDescriptions

_log = logging.getLogger(__name__)
Request = str | PartDescriptions


@dataclass(frozen=True)
class PromptResult:
    """Answer to one request: `expansion` and `z` (6, 64), or `error`; `milliseconds` is the worker's time."""

    request: Request
    expansion: Expansion | None
    z: NDArray[np.float32] | None
    milliseconds: float
    error: SportError | None = None


class PromptWorker:
    """One thread with one latest-wins slot each way; `submit` and `poll` never wait for text or network.

    A prompt goes through `expander`, six descriptions go straight to `encoder`. The worker keeps running after
    an error.
    """

    def __init__(self, expander: Expander, encoder: PromptEncoder) -> None:
        self._expander = expander
        self._encoder = encoder
        self._condition = threading.Condition()
        self._request: Request | None = None
        self._result: PromptResult | None = None
        self._closed = False
        self._busy = False
        self._thread = threading.Thread(target=self._work, name="prompts", daemon=True)
        self._thread.start()

    def submit(self, prompt: Request) -> None:
        """Ask for a prompt or for six descriptions; replaces a request that still waits. No effect once closed."""
        with self._condition:
            self._request = None if self._closed else prompt
            self._condition.notify()

    def poll(self) -> PromptResult | None:
        """The newest result not yet polled, or None."""
        with self._condition:
            result, self._result = self._result, None
            return result

    @property
    def busy(self) -> bool:
        """Whether a request waits or is being worked on."""
        with self._condition:
            return self._busy or self._request is not None

    def close(self, timeout_s: float = 2.0) -> None:
        """Stop the thread after the request in hand; waits at most `timeout_s` seconds."""
        with self._condition:
            self._closed = True
            self._request = None
            self._condition.notify()
        self._thread.join(timeout_s)

    def _work(self) -> None:
        while True:
            with self._condition:
                self._busy = False
                self._condition.wait_for(lambda: self._closed or self._request is not None)
                if self._request is None:
                    return
                request, self._request = self._request, None
                self._busy = True
            result = self._answer(request)
            with self._condition:
                # an answer to an outdated request is still news: the newer one will replace it
                self._result = result

    def _answer(self, request: Request) -> PromptResult:
        started = time.perf_counter()
        expansion, z, error = None, None, None
        try:
            if isinstance(request, PartDescriptions):
                expansion = Expansion(request, "explicit")
            else:
                expansion = self._expander.expand(request)
            z = self._encoder.encode(expansion.descriptions)
        except SportError as known:
            error = known
        except Exception as unexpected:  # the thread must outlive any defect, and the user must see it
            _log.exception("prompt worker")
            error = SportError(f"The prompt failed unexpectedly: {unexpected!r}.", "Try another prompt.")
        return PromptResult(request, expansion, z, (time.perf_counter() - started) * 1e3, error)
