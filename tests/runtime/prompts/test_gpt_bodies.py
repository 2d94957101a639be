"""Whatever a language model's endpoint sends, and wherever it sends the prompt on: little memory, a sentence, no open line."""

from __future__ import annotations

import gzip
import threading
import time
import tracemalloc
import zlib
from collections.abc import Callable
from typing import Any

import pytest

from runtime.prompts.gpt.client import MAX_BODY_BYTES, ChatClient, EndpointError
from tests.helpers.gpt_endpoint import PROUD, Endpoint, completion, say

MAX_GROWTH = 20e6  # bytes held at once by client and server together; asked are 50 MB
ASKED = [{"role": "user", "content": "a proud walk"}]


def endless(status: int, closed: list[bool]) -> Callable[[Any], None]:
    """A body without end, until the client hangs up."""

    def behave(handler: Any) -> None:
        handler.start(status, {"Content-Length": str(1 << 40)})
        try:
            while not handler.server.released.is_set():
                handler.wfile.write(b" " * 65_536)
        except OSError:
            closed.append(True)
            raise

    return behave


def packed(status: int, data: bytes, coding: str = "gzip") -> Callable[[Any], None]:
    def behave(handler: Any) -> None:
        handler.start(status, {"Content-Length": str(len(data)), "Content-Encoding": coding})
        handler.wfile.write(data)

    return behave


def gzip_bomb(megabytes: int) -> bytes:
    packer = zlib.compressobj(9, wbits=31)
    return b"".join(packer.compress(b" " * 1_000_000) for _ in range(megabytes)) + packer.flush()


def ask(settings: Any, seconds: float = 10.0) -> str:
    client = ChatClient(settings)
    client.prepare()
    return client.complete(ASKED, None, time.monotonic() + seconds, threading.Event())


def threads() -> int:
    return sum(thread.name == "language model" for thread in threading.enumerate())


@pytest.mark.parametrize("status", [200, 400, 401, 404, 429, 500, 503])
def test_a_body_without_end_has_one_limit_for_every_status(
    status: int, endpoint: Endpoint, settings_of: Callable[..., Any]
) -> None:
    closed: list[bool] = []
    endpoint.script = [endless(status, closed)]
    settings = settings_of(endpoint, attempts=1)
    ChatClient(settings).prepare()
    tracemalloc.start()
    try:
        with pytest.raises(EndpointError, match="without end"):
            ask(settings)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < MAX_GROWTH
    end = time.monotonic() + 5.0
    while (not closed or threads()) and time.monotonic() < end:
        time.sleep(0.01)
    assert closed
    assert threads() == 0
    assert len(endpoint.requests) == 1


@pytest.mark.parametrize("status", [200, 500])
def test_what_is_packed_counts_by_what_it_becomes(
    status: int, endpoint: Endpoint, settings_of: Callable[..., Any]
) -> None:
    bomb = gzip_bomb(300)
    assert len(bomb) < MAX_BODY_BYTES  # so that only what it becomes is too large
    endpoint.script = [packed(status, bomb)]
    settings = settings_of(endpoint, attempts=1)
    tracemalloc.start()
    try:
        with pytest.raises(EndpointError, match="without end"):
            ask(settings)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < MAX_GROWTH


def test_packed_answers_of_a_usual_size_are_read(endpoint: Endpoint, settings_of: Callable[..., Any]) -> None:
    body = completion(PROUD.to_json()).encode()
    endpoint.script = [packed(200, gzip.compress(body)), packed(200, zlib.compress(body), "deflate")]
    for _ in range(2):
        assert ask(settings_of(endpoint)) == PROUD.to_json()
    assert all(request[2]["accept-encoding"] == "identity" for request in endpoint.requests)


@pytest.mark.parametrize(("data", "coding"), [(b"no gzip", "gzip"), (b"x", "br"), (b"x", "zstd, gzip")])
def test_codings_that_cannot_be_read_are_a_sentence(
    data: bytes, coding: str, endpoint: Endpoint, settings_of: Callable[..., Any]
) -> None:
    endpoint.script = [packed(200, data, coding)]
    with pytest.raises(EndpointError, match="answers"):
        ask(settings_of(endpoint, attempts=1))


def test_a_withdrawn_prompt_ends_its_thread_and_line(
    endpoint: Endpoint, settings_of: Callable[..., Any]
) -> None:
    closed: list[bool] = []

    def slow(handler: Any) -> None:
        handler.start(200, {"Content-Length": "900000"})
        try:
            while not handler.server.released.wait(0.02):
                handler.wfile.write(b" ")
        except OSError:
            closed.append(True)
            raise

    endpoint.script = [slow]
    stop = threading.Event()
    threading.Timer(0.2, stop.set).start()
    client = ChatClient(settings_of(endpoint))
    with pytest.raises(Exception, match="withdrawn"):
        client.complete(ASKED, None, time.monotonic() + 20.0, stop)
    end = time.monotonic() + 5.0
    while (not closed or threads()) and time.monotonic() < end:
        time.sleep(0.01)
    assert closed
    assert threads() == 0


@pytest.mark.parametrize("status", [301, 302, 303, 307, 308])
def test_prompts_go_to_no_other_host(
    status: int, endpoint: Endpoint, settings_of: Callable[..., Any]
) -> None:
    other = Endpoint()
    thread = threading.Thread(target=other.serve_forever, kwargs={"poll_interval": 0.01}, daemon=True)
    thread.start()
    try:
        place = {"Location": f"{other.url}/chat/completions"}
        endpoint.script = [lambda handler: handler.reply(status, "", place)]
        with pytest.raises(EndpointError, match=f"127.0.0.1:{other.server_port}, which is another address"):
            ask(settings_of(endpoint, attempts=1))
        assert other.requests == []
        assert len(endpoint.requests) == 1
    finally:
        other.shutdown()
        other.server_close()


def test_redirects_on_the_same_host_are_followed_a_few_times(
    endpoint: Endpoint, settings_of: Callable[..., Any]
) -> None:
    there = lambda handler: handler.reply(307, "", {"Location": "/v2/chat/completions"})  # noqa: E731
    endpoint.script = [there, say(PROUD.to_json())]
    assert ask(settings_of(endpoint)) == PROUD.to_json()
    assert [request[1] for request in endpoint.requests] == ["/v1/chat/completions", "/v2/chat/completions"]
    assert endpoint.bodies[0] == endpoint.bodies[1]
    endpoint.script = [there]
    with pytest.raises(EndpointError, match="again and again"):
        ask(settings_of(endpoint, attempts=1))
