"""An HTTP client whose answers are read up to one limit, whatever their status, and which gives a prompt to one host only."""

from __future__ import annotations

import threading
import time
import zlib
from collections.abc import Iterator
from typing import Any

MAX_BODY_BYTES = 1_000_000  # after decompression
MAX_REDIRECTS = 3
_PIECE = 64 * 1024


class AnswerError(Exception):
    """An answer that is not read to its end; the message says why, after the name of the host."""


class Waiting(threading.local):
    """Until when the request of this thread may take, and whether anybody still waits for it."""

    until: float = float("inf")  # time.monotonic() seconds
    given_up: threading.Event | None = None

    def check(self) -> None:
        """TimeoutError when nobody waits any longer."""
        if time.monotonic() > self.until or (self.given_up is not None and self.given_up.is_set()):
            raise TimeoutError


def bounded_client(waiting: Waiting) -> Any:
    """A client for `openai.OpenAI(http_client=...)`, with that library's own defaults; `waiting` bounds each request."""
    from openai import DefaultHttpxClient

    class BoundedClient(DefaultHttpxClient):  # of httpx or httpx2, as the library has it
        def send(self, request: Any, **options: Any) -> Any:
            options |= {"stream": True, "follow_redirects": False}
            for _ in range(MAX_REDIRECTS):
                # an answer that is not compressed needs no trust in what it will become
                request.headers["accept-encoding"] = "identity"
                response = super().send(request, **options)
                try:
                    if response.next_request is None:
                        return _whole(response, waiting)
                    request = _followed(request, response.next_request)
                finally:
                    response.close()
            raise AnswerError("sends the prompt on again and again")

    return BoundedClient()


def _followed(request: Any, following: Any) -> Any:
    """The next request of a redirect; AnswerError where it goes to another host, or would be no question any more."""
    old, new = request.url, following.url
    same = (old.scheme, old.host, old.port) == (new.scheme, new.host, new.port)
    safer = (old.scheme, new.scheme) == ("http", "https") and old.host == new.host and new.port is None
    if following.method != request.method or not (same or safer):
        place = new.host + (f":{new.port}" if new.port else "")
        raise AnswerError(f"sends the prompt on to {place}, which was not asked")
    return following


def _whole(response: Any, waiting: Waiting) -> Any:
    """The same response with its whole body; AnswerError or TimeoutError where it goes on."""
    body = bytearray()
    for piece in _decoded(response, waiting):
        body += piece
        if len(body) > MAX_BODY_BYTES:
            raise AnswerError("answers without end")
    gone = (b"content-encoding", b"content-length", b"transfer-encoding")
    headers = [(name, value) for name, value in response.headers.raw if name.lower() not in gone]
    return type(response)(
        response.status_code, headers=headers, content=bytes(body), request=response.request
    )


def _decoded(response: Any, waiting: Waiting) -> Iterator[bytes]:
    """Pieces of the body: gzip and deflate, which some servers send unasked, are decompressed a bounded piece at a time."""
    coding = response.headers.get("content-encoding", "identity").strip().lower()
    if coding not in ("identity", "", "gzip", "x-gzip", "deflate"):
        raise AnswerError(f"answers in the coding {coding[:20]!r}, which was not asked for")
    stream = None if coding in ("identity", "") else zlib.decompressobj(wbits=47 if "gzip" in coding else 15)
    received = 0
    for piece in response.iter_raw():
        waiting.check()
        received += len(piece)
        if received > MAX_BODY_BYTES:
            raise AnswerError("answers without end")
        if stream is None:
            yield piece
            continue
        while piece:
            try:
                yield stream.decompress(piece, _PIECE)
            except zlib.error as error:
                raise AnswerError("answers with damaged data") from error
            piece = stream.unconsumed_tail
            waiting.check()
