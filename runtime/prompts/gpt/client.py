"""Chat completions of any compatible endpoint, with a time limit on every wait and a message for every failure.

Python package `openai`, imported at the first request. Answers are streamed, so that neither a slow nor an
endless one exceeds its limit, and a prompt is sent to one host only.
"""

from __future__ import annotations

import logging
import re
import threading
import time
from collections.abc import Callable, Sequence
from concurrent.futures import Future, wait
from email.utils import parsedate_to_datetime
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any

from runtime.errors import PromptError
from runtime.prompts.expander import PromptCancelledError
from runtime.prompts.gpt.settings import KEY, MODEL, TIMEOUT, URL, GptSettings
from runtime.safe_read import is_text, parse_json

if TYPE_CHECKING:
    from openai import OpenAI

_log = logging.getLogger(__name__)
Message = dict[str, str]

INSTALL = "Run pip install 'sport-viewer[gpt]'."
MAX_BODY_BYTES = 1_000_000
STOP_SECONDS = 0.02  # delay until a stop is noticed
_RETRIED = (408, 409, 425, 429)  # and 5xx
_TRANSPORT = ("httpx", "httpx2", "httpcore", "httpcore2", "anyio")  # differ between openai 2 and 3


class AnswerError(Exception):
    """Raised if an answer cannot be read completely; the message, which follows the host's name, gives the reason."""


class EndpointError(PromptError):
    """Raised if an endpoint gave no answer; `retry`: asking again may help, `wait_s`: the wait it asked for."""

    def __init__(
        self,
        problem: str,
        remedy: str = "",
        status: int | None = None,
        retry: bool = False,
        wait_s: float | None = None,
    ) -> None:
        super().__init__(problem, remedy)
        self.status = status
        self.retry = retry
        self.wait_s = wait_s


class ChatClient:
    """Client of the endpoint in `settings`; thread-safe."""

    def __init__(self, settings: GptSettings) -> None:
        self._settings = settings
        self._waiting = Waiting()

    def prepare(self) -> None:
        """Import what the first request needs, so that the import does not count towards its time limit."""
        _ = self._client.chat.completions.with_streaming_response

    def complete(
        self,
        messages: Sequence[Message],
        response_format: dict[str, Any] | None,
        until: float,
        stop: threading.Event,
    ) -> str:
        """Return the text of the model's answer, retrying temporary failures until `time.monotonic()` reaches `until`.

        Raises EndpointError if there is none, PromptCancelledError if `stop` is set meanwhile.
        """
        settings, wait = self._settings, self._settings.backoff_s
        begun = time.monotonic()
        for attempt in range(1, settings.attempts + 1):
            seconds = min(settings.timeout_s, until - time.monotonic())
            ask = partial(self._request, messages, response_format, seconds)
            try:
                return self._within(ask, seconds, stop)
            except EndpointError as error:
                failure = error
            except TimeoutError:  # an endpoint that trickles or hangs will do so again
                remedy = f"Try again, choose a faster model, or raise {TIMEOUT}."
                raise self._error(
                    f"gave no answer within {time.monotonic() - begun:.1f} s.", remedy
                ) from None
            pause = wait if failure.wait_s is None else failure.wait_s
            hopeless = pause > settings.longest_wait_s or time.monotonic() + pause >= until
            if not failure.retry or hopeless or attempt == settings.attempts:
                raise failure
            _log.info("%s Asked again in %.1f s.", failure.problem, pause)
            if stop.wait(pause):
                raise PromptCancelledError
            wait *= 2.0
        raise AssertionError("the last attempt returns or raises")

    def _within(self, call: Callable[[], str], seconds: float, stop: threading.Event) -> str:
        """Return the result of `call` in a thread of its own, abandoned after `seconds` (TimeoutError) or at `stop`.

        A waiting socket cannot be interrupted from outside; its own time-out ends the thread soon after.
        """
        result, given_up, end = Future[str](), threading.Event(), time.monotonic() + seconds

        def work() -> None:
            self._waiting.until, self._waiting.given_up = end, given_up
            try:
                result.set_result(call())
            except BaseException as error:  # raised again where the result is awaited
                result.set_exception(error)

        threading.Thread(target=work, name="language model", daemon=True).start()
        try:
            while not stop.is_set():
                if wait([result], STOP_SECONDS).done:
                    return result.result()
                if time.monotonic() >= end:
                    raise TimeoutError
            raise PromptCancelledError
        finally:
            given_up.set()

    def _request(self, messages: Sequence[Message], form: dict[str, Any] | None, seconds: float) -> str:
        import openai

        extra = {} if form is None else {"response_format": form}
        try:
            create: Any = self._client.chat.completions.with_streaming_response.create
            arguments = {"model": self._settings.model, "messages": list(messages), **extra}
            with create(**arguments, timeout=max(seconds, 0.01)) as response:
                body = response.read()  # already read: see `bounded_client`
        except openai.APIStatusError as error:
            raise self._refusal(error) from None  # the request inside has the key in its header
        except openai.OpenAIError as error:
            raise self._broken(error.__cause__ or error) from None
        except AnswerError as error:
            raise self._broken(error) from None
        except Exception as error:
            if isinstance(error, EndpointError) or type(error).__module__.split(".")[0] not in _TRANSPORT:
                raise
            raise self._broken(error) from None
        return self._text(body)

    @cached_property
    def _client(self) -> OpenAI:
        from openai import OpenAI

        # endpoints without keys still require a non-empty header
        key = self._settings.api_key.reveal() or "none"
        client = bounded_client(self._waiting)
        return OpenAI(api_key=key, base_url=self._settings.base_url, max_retries=0, http_client=client)

    def _text(self, body: bytes) -> str:
        try:
            choice = parse_json(body)["choices"][0]
            message = choice["message"]
            content, refusal = message.get("content"), message.get("refusal")
        except (ValueError, KeyError, IndexError, TypeError, AttributeError, RecursionError):
            raise self._error("answers with no chat completion.", f"Check {URL}.") from None
        if refusal:
            raise self._error(f"refuses the prompt: “{self._clean(refusal)}”.", "Ask in other words.")
        if isinstance(content, str) and not is_text(content):
            raise self._error("answers with invalid characters.", "Try again, or choose another model.")
        if not isinstance(content, str):
            raise self._error("answers without text.", f"Choose another model by {MODEL}.")
        return content

    # failures as sentences

    def _error(self, problem: str, remedy: str, **details: Any) -> EndpointError:
        return EndpointError(f"{self._settings.host} {problem}", remedy, **details)

    def _broken(self, cause: BaseException) -> EndpointError | TimeoutError:
        if "Timeout" in type(cause).__name__:
            return TimeoutError()
        if isinstance(cause, AnswerError):
            return self._error(f"{self._clean(cause)}.", f"Check {URL}.")
        reason = self._clean(str(cause) or type(cause).__name__)
        return self._error(f"cannot be reached ({reason}).", f"Check {URL} and the network.", retry=True)

    def _refusal(self, error: Any) -> EndpointError:
        """Return the error for a status other than 200; `error` is an openai.APIStatusError."""
        status = int(error.status_code)
        body = error.body if isinstance(error.body, dict) else {}
        said = self._clean(body.get("message") or error.message)
        key = f"refuses the key ({status}).", f"Check {KEY}."  # its message may repeat the key
        model = f"knows no model {self._settings.model!r} at this address (404).", f"Check {MODEL} and {URL}."
        known = {401: key, 403: key, 404: model}
        if status in known:
            return self._error(*known[status], status=status)
        if status == 429 and error.code == "insufficient_quota":
            return self._error("says that the account's quota is used up (429).", "Top it up.", status=status)
        if status >= 500 or status in _RETRIED:
            wait = retry_after(error.response.headers)
            asks = "" if wait is None else f", and asks to wait {wait:.0f} s"
            what = "gets too many requests" if status == 429 else "fails"
            problem = f"{what} ({status}{asks})."
            return self._error(problem, "Try again later.", status=status, retry=True, wait_s=wait)
        return self._error(f"refuses the request ({status}: {said}).", f"Check {MODEL}.", status=status)

    def _clean(self, text: object, limit: int = 160) -> str:
        """Return foreign text for a message: without the key, on one line, shortened."""
        line = " ".join(self._settings.api_key.hide_in(str(text)).split())
        line = re.sub(r"\bsk-[\w*-]+|//[^/@\s]*@", "***", line)
        return line if len(line) <= limit else line[: limit - 1] + "…"


def retry_after(headers: Any) -> float | None:
    """Return the seconds that an answer's headers ask to wait (seconds or a date); None if they do not say."""
    for name, unit in (("retry-after-ms", 1e-3), ("retry-after", 1.0)):
        try:
            seconds = float(headers.get(name, "")) * unit
        except ValueError:
            continue
        return seconds if 0.0 <= seconds < float("inf") else None
    try:
        moment = parsedate_to_datetime(headers.get("retry-after", ""))
        return max(moment.timestamp() - time.time(), 0.0)
    except (TypeError, ValueError, IndexError, OverflowError):
        return None


class Waiting(threading.local):
    """Time limit and cancellation of this thread's request."""

    until: float = float("inf")  # time.monotonic() seconds
    given_up: threading.Event | None = None

    def check(self) -> None:
        """Raise TimeoutError if the caller has stopped waiting."""
        if time.monotonic() > self.until or (self.given_up is not None and self.given_up.is_set()):
            raise TimeoutError


def bounded_client(waiting: Waiting) -> Any:
    """Return a client for `openai.OpenAI(http_client=...)` with the library's defaults, each request bounded by `waiting`."""
    from openai import DefaultHttpxClient

    class BoundedClient(DefaultHttpxClient):  # of httpx or httpx2, as the library
        def send(self, request: Any, **options: Any) -> Any:
            # an uncompressed answer cannot expand beyond its limit
            request.headers["accept-encoding"] = "identity"
            response = super().send(request, **options | {"stream": True, "follow_redirects": False})
            try:
                return _whole(response, waiting)
            finally:
                response.close()

    return BoundedClient()


def _whole(response: Any, waiting: Waiting) -> Any:
    """Return the response with its whole body; AnswerError or TimeoutError if it is too long or redirects."""
    if response.next_request is not None:
        url = response.next_request.url
        # without user name, password or query
        place = f"{url.scheme}://{url.netloc.decode('ascii')}{url.path}"
        raise AnswerError(f"sends the prompt on to {place}, which is another address")
    coding = response.headers.get("content-encoding", "identity").strip().lower()
    if coding not in ("identity", ""):
        raise AnswerError(f"answers in the coding {coding[:20]!r}, which was not asked for")
    body = bytearray()
    for piece in response.iter_raw():
        waiting.check()
        body += piece
        if len(body) > MAX_BODY_BYTES:
            raise AnswerError("answers without end")
    gone = (b"content-length", b"transfer-encoding")
    headers = [(name, value) for name, value in response.headers.raw if name.lower() not in gone]
    return type(response)(
        response.status_code, headers=headers, content=bytes(body), request=response.request
    )
