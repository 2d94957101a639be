"""Prompts expanded by a language model, as in the paper (Sec. III-C), with the library until it answers.

Answers are cached on disk, so that a prompt is sent once and always gives the same result.
"""

from __future__ import annotations

import contextlib
import hashlib
import importlib.util
import json
import logging
import os
import threading
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

from runtime.atomic import temporary_folder, write_atomic
from runtime.errors import FileError, PromptError, SportError, UsageError
from runtime.prompts.expander import Expander, Expansion, PromptCancelledError, check_prompt
from runtime.prompts.gpt.client import INSTALL, ChatClient, EndpointError
from runtime.prompts.gpt.prompt import (
    Message,
    StructuredPrompt,
    answer_schema,
    load_structured_prompt,
    repair_messages,
)
from runtime.prompts.gpt.settings import MODEL, GptSettings
from runtime.prompts.parts import PartDescriptions
from runtime.safe_read import expanded, parse_json, read_bounded

_log = logging.getLogger(__name__)
MAX_BYTES = 50_000  # of a stored answer
TEST_PROMPT = "an exhausted soldier, left arm hanging"
_SCHEMA_REFUSED = (400, 404, 415, 422, 501)  # statuses of endpoints without response_format


class GptExpander:
    """Asks a language model for the six descriptions; `expand` blocks, so call it in a worker thread.

    Without `settings` the environment configures it at the first prompt. `cache` is the folder of stored answers, by
    default the user's cache directory.
    """

    def __init__(self, settings: GptSettings | None = None, cache: Path | None = None) -> None:
        self._given_settings = settings
        self._cache_directory = cache
        self._schema_refused = False
        self._left_alone_until = 0.0  # monotonic seconds
        self._last_failure: EndpointError | None = None

    def expand(self, prompt: str, stop: threading.Event | None = None) -> Expansion:
        """Return the language model's descriptions, with source "gpt"; known prompts are answered from the cache.

        Raises PromptError for an unusable prompt or if the model gives no usable answer even after one repair,
        PromptCancelledError if `stop` is set meanwhile, UsageError if it is not configured.
        """
        prompt, stop = check_prompt(prompt), threading.Event() if stop is None else stop
        stored = self._cache.get(prompt)
        if stored is not None:
            return Expansion(stored, "gpt")
        self._check_ready()
        self._client.prepare()
        started = time.monotonic()
        try:
            descriptions = self._ask(prompt, started + self._settings.deadline_s, stop)
        except EndpointError as failure:
            if time.monotonic() - started > self._settings.costly_s:
                self._left_alone_until = time.monotonic() + self._settings.pause_s
                self._last_failure = failure
            raise
        self._cache.put(prompt, descriptions)
        return Expansion(descriptions, "gpt")

    def stored(self, prompt: str) -> Expansion | None:
        """Return a cached answer without asking the model, or None."""
        try:
            descriptions = self._cache.get(check_prompt(prompt))
        except UsageError:  # the first `expand` reports the problem
            return None
        return None if descriptions is None else Expansion(descriptions, "gpt")

    def prepare(self) -> None:
        """Import and open what the first prompt needs, since importing would stall frames for tens of milliseconds.

        Problems are not reported here but by the first `expand`.
        """
        with contextlib.suppress(SportError):
            self._check_ready()
            self._client.prepare()
            _ = self._cache.version

    def _check_ready(self) -> None:
        if importlib.util.find_spec("openai") is None:
            raise PromptError(
                "The language model needs the Python package 'openai', which is not installed.", INSTALL
            )
        seconds = self._left_alone_until - time.monotonic()
        if self._last_failure is not None and seconds > 0.0:
            problem = f"{self._last_failure.problem} It is asked again in {seconds:.0f} s."
            raise PromptError(problem, self._last_failure.remedy)

    def _ask(self, prompt: str, until: float, stop: threading.Event) -> PartDescriptions:
        """Ask the model, and once more with the reason if the answer is unusable."""
        messages = self._instructions.messages(prompt)
        answer = self._complete(messages, until, stop)
        try:
            return self._instructions.read(answer)
        except PromptError as reason:
            _log.info("answer of %s cannot be used: %s", self._settings.model, reason.problem)
            repair = repair_messages(answer, str(reason))
        answer = self._complete([*messages, *repair], until, stop)
        try:
            return self._instructions.read(answer)
        except PromptError as reason:
            raise PromptError(
                f"The answer of {self._settings.model} cannot be used: {reason.problem}",
                f"Try other words, or another model by {MODEL}.",
            ) from reason

    def _complete(self, messages: list[Message], until: float, stop: threading.Event) -> str:
        """Return the model's answer, with a schema if the endpoint takes one."""
        if not self._schema_refused:
            try:
                return self._client.complete(messages, answer_schema(), until, stop)
            except EndpointError as error:
                if error.status not in _SCHEMA_REFUSED:
                    raise
        answer = self._client.complete(messages, None, until, stop)
        self._schema_refused = True
        return answer

    @cached_property
    def _settings(self) -> GptSettings:
        return self._given_settings or GptSettings.from_environment()

    @cached_property
    def _instructions(self) -> StructuredPrompt:
        return load_structured_prompt()

    @cached_property
    def _client(self) -> ChatClient:
        return ChatClient(self._settings)

    @cached_property
    def _cache(self) -> AnswerCache:
        settings, version = self._settings, self._instructions.version
        return AnswerCache(
            self._cache_directory or cache_directory(), settings.model, settings.base_url, version
        )


def cache_directory(environment: Mapping[str, str] | None = None) -> Path:
    """Return the cache folder: $SPORT_CACHE_DIR, else $XDG_CACHE_HOME/sport-viewer, else ~/.cache/sport-viewer."""
    env = os.environ if environment is None else environment
    if env.get("SPORT_CACHE_DIR"):
        return Path(env["SPORT_CACHE_DIR"])
    return expanded(env.get("XDG_CACHE_HOME") or "~/.cache") / "sport-viewer"


@dataclass(frozen=True)
class AnswerCache:
    """Cache of answers: a small JSON file per prompt, model, endpoint and version of the instructions.

    A damaged or unwritable entry costs a log line and another request, never an error. The endpoint's address, which
    may hold credentials, is only part of the file name, as a hash.
    """

    directory: Path
    model: str
    base_url: str
    version: str

    def get(self, prompt: str) -> PartDescriptions | None:
        """Return the stored answer, or None."""
        path = self._path(prompt)
        try:
            value = parse_json(read_bounded(path, MAX_BYTES))
            if (value["prompt"], value["model"]) != (prompt, self.model):
                raise ValueError("of another prompt or model")
            return PartDescriptions.from_mapping(value["descriptions"])
        except (FileError, ValueError, KeyError, TypeError, AttributeError, PromptError) as error:
            if isinstance(error.__cause__, FileNotFoundError):
                return None
            _log.warning("%s: cached answer ignored (%s)", path, error)
            return None

    def put(self, prompt: str, descriptions: PartDescriptions) -> None:
        """Store an answer."""
        value = {"prompt": prompt, "model": self.model, "descriptions": descriptions.to_mapping()}
        try:
            write_atomic(self._path(prompt), json.dumps(value, ensure_ascii=False, indent=1))
        except FileError as error:
            _log.warning("answer not cached: %s", error.problem)

    def _path(self, prompt: str) -> Path:
        key = json.dumps([prompt, self.model, self.base_url, self.version])
        return self.directory / "gpt" / f"{hashlib.sha256(key.encode('utf-8')).hexdigest()}.json"


def check_endpoint(settings: GptSettings, stop: threading.Event) -> str:
    """Ask the endpoint of `settings` for one prompt and return a sentence about the result, without the key.

    Blocks: call it in a worker thread. Raises SportError, or PromptCancelledError if `stop` is set meanwhile.
    """
    with temporary_folder() as empty_cache:
        expander = GptExpander(settings, empty_cache)
        expander.prepare()
        started = time.monotonic()
        expander.expand(TEST_PROMPT, stop)
        seconds = time.monotonic() - started
    return f"{settings.model} at {settings.host} answered in {seconds:.1f} s."


class FallbackExpander:
    """Expands by `primary`; if that fails, by `secondary`, with a note that says why."""

    def __init__(self, primary: GptExpander, secondary: Expander) -> None:
        self._primary = primary
        self._secondary = secondary

    def expand(self, prompt: str) -> Expansion:
        """Return the descriptions of the first that answers; PromptError if the prompt is unusable or was cancelled."""
        *_, (expansion, _) = self.steps(prompt, threading.Event())
        return expansion

    def steps(self, prompt: str, stop: threading.Event) -> Iterator[tuple[Expansion, bool]]:
        """Yield (expansion, is final): the library's answer at once, then the language model's.

        A cached answer of the language model comes at once. Raises PromptCancelledError soon after `stop` is set.
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
            answer = replace(quick, note=note)
        yield answer, True


def open_expander(library: Expander, settings: GptSettings) -> FallbackExpander:
    """Return an expander with the language model of `settings`, and the library as fallback.

    Imports take some tenths of a second: call it in a worker thread.
    """
    gpt = GptExpander(settings)
    gpt.prepare()
    return FallbackExpander(gpt, library)
