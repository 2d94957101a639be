"""Answers of language models on disk, so that a prompt is asked once and answers the same ever after."""

from __future__ import annotations

import hashlib
import json
import logging
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from runtime.atomic import write_atomic
from runtime.errors import FileError, PromptError
from runtime.prompts.parts import PartDescriptions
from runtime.safe_read import parse_json, read_bounded

_log = logging.getLogger(__name__)
MAX_BYTES = 50_000


def cache_directory(environment: Mapping[str, str] | None = None) -> Path:
    """$SPORT_CACHE_DIR, else $XDG_CACHE_HOME/sport-viewer, else ~/.cache/sport-viewer."""
    env = os.environ if environment is None else environment
    if env.get("SPORT_CACHE_DIR"):
        return Path(env["SPORT_CACHE_DIR"])
    return Path(env.get("XDG_CACHE_HOME") or "~/.cache").expanduser() / "sport-viewer"


@dataclass(frozen=True)
class AnswerCache:
    """One small JSON file for each prompt, model, endpoint and version of the instructions.

    An entry that is damaged or that cannot be written costs a log line and a question to the model, never an error.
    The address of the endpoint, which may hold credentials, only goes into the file's name, as a hash.
    """

    directory: Path
    model: str
    base_url: str
    version: str

    def get(self, prompt: str) -> PartDescriptions | None:
        """The stored answer, or None."""
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
