"""Settings of the language model: endpoint, key and time limits."""

from __future__ import annotations

import math
import os
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NoReturn
from urllib.parse import urlsplit

from runtime.errors import UsageError

OPENAI_URL = "https://api.openai.com/v1"
DEFAULT_MODEL = "gpt-4o-mini"
KEY, URL, MODEL, TIMEOUT = "OPENAI_API_KEY", "OPENAI_BASE_URL", "SPORT_GPT_MODEL", "SPORT_GPT_TIMEOUT"
MAX_SECONDS = 600.0
HIDDEN = "***"


class Secret:
    """A key that prints as asterisks and refuses to be pickled, copied or written as JSON."""

    __slots__ = ("_value",)

    def __init__(self, value: str = "") -> None:
        self._value = value.strip()

    def reveal(self) -> str:
        """Return the key itself; use it only for the request's header."""
        return self._value

    def hide_in(self, text: str) -> str:
        """Return `text` with the key replaced by asterisks."""
        return text.replace(self._value, HIDDEN) if self._value else text

    def __bool__(self) -> bool:
        return bool(self._value)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Secret) and self._value == other._value

    def __hash__(self) -> int:
        return hash(self._value)

    def __repr__(self) -> str:
        return f"Secret({HIDDEN if self._value else ''})"

    def __reduce__(self) -> NoReturn:
        raise TypeError("a key is never written")


@dataclass(frozen=True)
class GptSettings:
    """Settings of an endpoint with OpenAI's chat completions API; UsageError names an invalid field.

    `timeout_s` limits one request, `deadline_s` all requests for one prompt: retries, waits and the repair. After a
    failure that took more than `costly_s`, the endpoint is not asked for `pause_s`.
    """

    api_key: Secret = field(default_factory=Secret)
    base_url: str = OPENAI_URL
    model: str = DEFAULT_MODEL
    timeout_s: float = 10.0
    deadline_s: float = 15.0
    attempts: int = 3  # requests for one answer, retries included
    backoff_s: float = 0.5  # before the first retry; doubles with each
    longest_wait_s: float = 5.0  # an endpoint that asks for a longer wait is given up
    costly_s: float = 1.0
    pause_s: float = 30.0

    def __post_init__(self) -> None:
        if not re.fullmatch(r"[!-~]*", self.api_key.reveal()):
            raise UsageError(
                f"API key ({KEY}): contains invalid characters.",
                "Copy the key again, without line breaks.",
            )
        _check_url(self.base_url)
        if not 0 < len(self.model) <= 200 or not self.model.isprintable():
            raise UsageError(f"{MODEL}: expected the name of a model.", f"Write {MODEL}={DEFAULT_MODEL}.")
        for name in ("timeout_s", "deadline_s", "backoff_s", "longest_wait_s", "costly_s", "pause_s"):
            value = getattr(self, name)
            if not 0.0 <= value <= MAX_SECONDS:  # also rejects NaN
                raise UsageError(f"{name} {value}: expected 0 to {MAX_SECONDS:.0f} seconds.", "Try 10.")
        if self.timeout_s <= 0.0 or not 1 <= self.attempts <= 10:
            raise UsageError("timeout_s and attempts must be above 0, attempts at most 10.", "Try 10 and 3.")

    @classmethod
    def from_environment(cls, environment: Mapping[str, str] | None = None) -> GptSettings:
        """Read settings from OPENAI_API_KEY, OPENAI_BASE_URL, SPORT_GPT_MODEL and SPORT_GPT_TIMEOUT (seconds).

        Raises UsageError if neither key nor base URL is set, or a value is invalid.
        """
        env = os.environ if environment is None else environment
        if not gpt_configured(env):
            raise UsageError(
                "No language model is configured.",
                f"Set {KEY}, or {URL} and {MODEL} for an endpoint of your own.",
            )
        timeout = _seconds(env.get(TIMEOUT, ""), cls.timeout_s)
        return cls(
            Secret(env.get(KEY, "")),
            env.get(URL, "").strip() or OPENAI_URL,
            env.get(MODEL, "").strip() or DEFAULT_MODEL,
            timeout,
            min(1.5 * timeout, MAX_SECONDS),
        )

    @classmethod
    def chosen(
        cls,
        base_url: str = "",
        model: str = "",
        timeout_s: float | None = None,
        key: str = "",
        environment: Mapping[str, str] | None = None,
    ) -> GptSettings:
        """Return settings chosen by the user; empty ones come from the environment.

        A key from the environment is only sent to the environment's address. Raises UsageError if there is neither a
        key nor an address, or if a value is invalid.
        """
        env = dict(os.environ if environment is None else environment)
        url = base_url.strip()
        if url and url.rstrip("/") != (env.get(URL, "").strip() or OPENAI_URL).rstrip("/"):
            env[KEY] = ""
        given = {URL: url, MODEL: model.strip(), KEY: key.strip()}
        env.update({name: value for name, value in given.items() if value})
        if not gpt_configured(env):
            raise UsageError(
                "The language model has neither a key nor an address of its own.",
                f"Type one of them, or set {KEY} or {URL}.",
            )
        if timeout_s is not None:
            env[TIMEOUT] = repr(float(timeout_s))
        return cls.from_environment(env)

    @property
    def host(self) -> str:
        """Host and port of the endpoint for messages, without credentials or query."""
        parts = urlsplit(self.base_url)
        return f"{parts.hostname}:{parts.port}" if parts.port else str(parts.hostname)


def gpt_configured(environment: Mapping[str, str] | None = None) -> bool:
    """Return whether the environment sets a key or an endpoint."""
    env = os.environ if environment is None else environment
    return bool(env.get(KEY, "").strip() or env.get(URL, "").strip())


def has_credentials(url: str) -> bool:
    """Return whether a URL may contain a key or password (user@host, or a query), so that it must not be stored."""
    try:
        parts = urlsplit(url.strip())
    except ValueError:  # unbalanced brackets
        return True
    return "@" in parts.netloc or bool(parts.query or parts.fragment)


def _check_url(url: str) -> None:
    try:
        parts = urlsplit(url)
        usable = parts.scheme in ("http", "https") and bool(parts.hostname) and parts.port != 0
    except ValueError:  # an invalid port, unbalanced brackets
        usable = False
    if not usable or not url.isprintable() or len(url) > 2000:
        # the address itself may hold credentials, so it is not repeated
        raise UsageError(f"Base URL ({URL}): not an http or https address.", f"Write it as {OPENAI_URL}.")


def _seconds(text: str, default: float) -> float:
    if not text.strip():
        return default
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 0.0 < value <= MAX_SECONDS:
        raise UsageError(
            f"{TIMEOUT}={text.strip()[:20]}: expected seconds, up to {MAX_SECONDS:.0f}.", "Write 30."
        )
    return value
