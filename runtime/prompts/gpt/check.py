"""Whether a language model answers as it should: one real question, past the stored answers."""

from __future__ import annotations

import tempfile
import threading
import time
from pathlib import Path

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
