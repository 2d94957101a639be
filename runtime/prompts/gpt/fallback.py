"""A language model first, the library until it answers and when it fails."""

from __future__ import annotations

import dataclasses
import logging
import tempfile
import threading
import time
from collections.abc import Iterator
from pathlib import Path

from runtime.errors import SportError
from runtime.prompts.expander import Expander, Expansion, PromptCancelledError, check_prompt
from runtime.prompts.gpt.expander import GptExpander
from runtime.prompts.gpt.settings import GptSettings

TEST_PROMPT = "an exhausted soldier, left arm hanging"


def check_endpoint(settings: GptSettings, stop: threading.Event) -> str:
    """Ask the endpoint of `settings` for one prompt and say how it went, without the key.

    Waits for the answer: call it in a worker thread. SportError says what is wrong, PromptCancelledError that `stop`
    was set meanwhile.
    """
    with tempfile.TemporaryDirectory(prefix="sport-check-") as empty_cache:
        expander = GptExpander(settings, Path(empty_cache))
        expander.prepare()
        started = time.monotonic()
        expander.expand(TEST_PROMPT, stop)
        seconds = time.monotonic() - started
    return f"{settings.model} at {settings.host} answered in {seconds:.1f} s."


_log = logging.getLogger(__name__)


class FallbackExpander:
    """Expands by `primary`, and by `secondary` with a note why when that fails."""

    def __init__(self, primary: GptExpander, secondary: Expander) -> None:
        self._primary = primary
        self._secondary = secondary

    def expand(self, prompt: str) -> Expansion:
        """Descriptions of whichever answers; PromptError when the prompt itself cannot be used or was withdrawn."""
        *_, (expansion, _) = self.steps(prompt, threading.Event())
        return expansion

    def steps(self, prompt: str, stop: threading.Event) -> Iterator[tuple[Expansion, bool]]:
        """The library's answer at once and the language model's when it comes: (expansion, whether it is final).

        What the language model has answered before is there at once. PromptCancelledError soon after `stop` is set.
        """
        prompt = check_prompt(prompt)
        stored = self._primary.stored(prompt)
        if stored is not None:
            yield stored, True
            return
        quick = self._secondary.expand(prompt)
        yield quick, False
        try:
            answer = self._primary.expand(prompt, stop)
        except PromptCancelledError:
            raise
        except SportError as error:
            _log.warning("language model: %s", error)
            note = f"Language model: {error.problem} The library answered. {quick.note}".strip()
            answer = dataclasses.replace(quick, note=note)
        yield answer, True


def open_expander(library: Expander, settings: GptSettings) -> FallbackExpander:
    """The language model of `settings` with the library behind it.

    Takes some tenths of a second, for its imports: call it in a worker thread.
    """
    gpt = GptExpander(settings)
    gpt.prepare()
    return FallbackExpander(gpt, library)
