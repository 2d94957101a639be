"""Words to motion: prompts and edited descriptions go to the worker, its answers to the fields and the controller."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from runtime.errors import SportError
from runtime.prompts.parts import PartDescriptions
from viewer.services import PromptWorkerLike
from viewer.state import AppState

CLOSE_SECONDS = 30.0
BLOCKING_SECONDS = 60.0  # how long an offscreen run waits for an answer


@dataclass
class Prompting:
    """Actions of the prompt panel."""

    state: AppState
    mark: Callable[[str], None] = lambda _: None  # told which prompt came into force, for the recorder
    blocking: bool = False  # offscreen: an answer arrives in the same frame
    worker: PromptWorkerLike | None = None
    first_error: SportError | None = None
    _waiting: str | PartDescriptions | None = None  # asked before the worker was there
    _last: str | PartDescriptions | None = None
    _styled: bool = False

    def use(self, worker: PromptWorkerLike) -> None:
        """Take a model's worker and ask it for what is wanted so far."""
        if self.worker is not None:
            self.worker.close()
        self.worker = worker
        request, self._waiting = self._waiting or self._last, None
        if request is not None:
            self._submit(request)

    def submit_prompt(self, text: str) -> None:
        """Expand a prompt and blend to it; an empty one only says what is expected."""
        self.state.prompt.text = text
        self._submit(text)

    def submit_parts(self) -> None:
        """Encode the six fields as they stand."""
        try:
            descriptions = PartDescriptions.from_mapping(self.state.prompt.parts)
        except SportError as error:
            self.state.messages.error(error)
            return
        self._submit(descriptions)

    def _submit(self, request: str | PartDescriptions) -> None:
        if self.worker is None:
            self._waiting = request
            return
        self._last = request
        self.worker.submit(request)
        if self.blocking:
            deadline = time.monotonic() + BLOCKING_SECONDS
            while not self.poll() and time.monotonic() < deadline:
                time.sleep(0.001)

    def poll(self) -> bool:
        """Take an answer when there is one; call once a frame."""
        prompt = self.state.prompt
        prompt.busy = self.worker is None or self.worker.busy
        result = self.worker.poll() if self.worker is not None else None
        if result is None:
            return False
        if result.request == self._last:  # an answer to an older request must not overwrite newer words
            self._take(result)
        return True

    def _take(self, result: Any) -> None:
        prompt = self.state.prompt
        if result.error is not None:
            self._fail(result.error)
            return
        expansion = result.expansion
        prompt.parts = dict(expansion.descriptions.to_mapping())
        prompt.applied = dict(prompt.parts)
        prompt.nearest, prompt.note = expansion.nearest, expansion.note
        prompt.milliseconds = result.milliseconds
        if isinstance(result.request, str):
            prompt.answered_by, prompt.shown_prompt = expansion.source, result.request
        else:
            prompt.answered_by = "edited"
        self.mark(result.request if isinstance(result.request, str) else result.request.to_json())
        controller = self.state.simulation.controller
        if controller is None:
            return
        seconds = (
            self.state.settings.blend_seconds if self._styled else 0.0
        )  # the first style is there at once
        self._styled = True
        try:
            controller.set_style(result.z, seconds)
        except SportError as error:
            self._fail(error)

    def _fail(self, error: SportError) -> None:
        self.state.messages.error(error)
        self.first_error = self.first_error or error

    def close(self) -> None:
        """Stop the worker, after the text it is at: a thread inside a network must not outlive the interpreter."""
        if self.worker is not None:
            self.worker.close(CLOSE_SECONDS)
