"""A language model first, the library when it fails, and newer words at once."""

from __future__ import annotations

import dataclasses
import logging
from collections.abc import Mapping

from runtime.errors import SportError
from runtime.prompts.content import PromptEncoder
from runtime.prompts.expander import Expander, Expansion, check_prompt
from runtime.prompts.gpt import GptExpander
from runtime.prompts.gpt_client import PromptCancelledError
from runtime.prompts.gpt_settings import gpt_configured
from runtime.prompts.library import LibraryExpander
from runtime.prompts.service import PromptResult, PromptWorker, Request
from runtime.prompts.text_encoder import TextEncoderLike

_log = logging.getLogger(__name__)


class FallbackExpander:
    """Expands by `primary`, and by `secondary` with a note why when that fails."""

    def __init__(self, primary: GptExpander, secondary: Expander) -> None:
        self._primary = primary
        self._secondary = secondary

    def expand(self, prompt: str) -> Expansion:
        """Descriptions of whichever answers; PromptError when the prompt itself cannot be used or was withdrawn."""
        prompt = check_prompt(prompt)
        try:
            return self._primary.expand(prompt)
        except PromptCancelledError:
            raise
        except SportError as error:
            _log.warning("language model: %s", error)
            reason = error.problem
        expansion = self._secondary.expand(prompt)
        note = f"Language model: {reason} The library answered. {expansion.note}".strip()
        return dataclasses.replace(expansion, note=note)

    def cancel(self) -> None:
        """Withdraw the prompt in hand."""
        self._primary.cancel()


class CancellingWorker(PromptWorker):
    """A prompt worker whose newer words, and whose end, do not wait for a language model's answer to older ones."""

    def __init__(self, expander: FallbackExpander, encoder: PromptEncoder) -> None:
        self._cancel = expander.cancel
        super().__init__(expander, encoder)

    def submit(self, prompt: Request) -> None:
        """Ask for a prompt or six descriptions in place of whatever is in hand."""
        self._cancel()
        super().submit(prompt)

    def poll(self) -> PromptResult | None:
        """The newest result not yet polled, or None; what was withdrawn is no result."""
        result = super().poll()
        return None if result is not None and isinstance(result.error, PromptCancelledError) else result

    def close(self, timeout_s: float = 2.0) -> None:
        """Stop the thread at once, but for the text in the encoder; waits at most `timeout_s` seconds."""
        self._cancel()
        super().close(timeout_s)


def start_prompt_worker(
    text_encoder: TextEncoderLike, encoder: PromptEncoder, environment: Mapping[str, str] | None = None
) -> PromptWorker:
    """The worker that the environment asks for: a language model with the library behind it, or the library alone.

    Takes some tenths of a second with a language model, for its imports.
    """
    library = LibraryExpander(text_encoder)
    if not gpt_configured(environment):
        return PromptWorker(library, encoder)
    gpt = GptExpander()
    gpt.prepare()
    return CancellingWorker(FallbackExpander(gpt, library), encoder)
