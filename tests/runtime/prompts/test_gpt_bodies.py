"""Whatever a language model's endpoint sends, and wherever it sends the prompt on: little memory, a sentence, no open line."""

import threading
import time
import tracemalloc
from collections.abc import Callable
from typing import Any

import pytest

from runtime.prompts.gpt.client import ChatClient, EndpointError
from tests.helpers.gpt_endpoint import Endpoint

MAX_GROWTH = 20e6  # bytes held at once by client and server together; asked are 50 MB
ASKED = [{"role": "user", "content": "a proud walk"}]


def endless(
    status: int, closed: list[bool], size: int = 65_536, wait_s: float = 0.0
) -> Callable[[Any], None]:
    """A body without end, until the client hangs up: so many bytes at a time."""

    def behave(handler: Any) -> None:
        handler.start(status, {"Content-Length": str(1 << 40)})
        try:
            while not handler.server.released.wait(wait_s):
                handler.wfile.write(b" " * size)
        except OSError:
            closed.append(True)
            raise

    return behave


def ask(settings: Any, seconds: float = 10.0) -> str:
    client = ChatClient(settings)
    client.prepare()
    return client.complete(ASKED, None, time.monotonic() + seconds, threading.Event())


def threads() -> int:
    return sum(thread.name == "language model" for thread in threading.enumerate())


def check_ended(closed: list[bool]) -> None:
    """The line is closed, and no thread is left."""
    end = time.monotonic() + 60.0
    while (not closed or threads()) and time.monotonic() < end:
        time.sleep(0.01)
    assert closed
    assert threads() == 0


@pytest.mark.parametrize("status", [200, 401, 429, 500])
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
    check_ended(closed)
    assert len(endpoint.requests) == 1


@pytest.mark.parametrize("coding", ["gzip", "br", "zstd, gzip"])
def test_a_packed_answer_that_was_not_asked_for_is_a_sentence(
    coding: str, endpoint: Endpoint, settings_of: Callable[..., Any]
) -> None:
    endpoint.script = [lambda handler: handler.reply(200, "x", {"Content-Encoding": coding})]
    with pytest.raises(EndpointError, match=f"answers in the coding '{coding}'"):
        ask(settings_of(endpoint, attempts=1))
    assert endpoint.requests[0][2]["accept-encoding"] == "identity"


def test_a_withdrawn_prompt_ends_its_thread_and_line(
    endpoint: Endpoint, settings_of: Callable[..., Any]
) -> None:
    closed: list[bool] = []
    endpoint.script = [endless(200, closed, 1, 0.02)]
    stop = threading.Event()
    threading.Timer(0.2, stop.set).start()
    client = ChatClient(settings_of(endpoint))
    with pytest.raises(Exception, match="cancelled"):
        client.complete(ASKED, None, time.monotonic() + 20.0, stop)
    check_ended(closed)


@pytest.mark.parametrize("status", [301, 303, 308])
def test_prompts_go_to_no_other_address(
    status: int, endpoint: Endpoint, settings_of: Callable[..., Any]
) -> None:
    other = Endpoint()
    thread = threading.Thread(target=other.serve_forever, kwargs={"poll_interval": 0.01}, daemon=True)
    thread.start()
    try:
        places = (f"{other.url}/chat", "/v2/chat")
        endpoint.script = [lambda h, to=to: h.reply(status, "", {"Location": to}) for to in places]
        for place in (f"{other.server_port}/v1/chat", f"{endpoint.server_port}/v2/chat"):
            with pytest.raises(EndpointError, match=f"http://127.0.0.1:{place}, which is another address"):
                ask(settings_of(endpoint, attempts=1))
        assert other.requests == []
        assert len(endpoint.requests) == 2
    finally:
        other.shutdown()
        other.server_close()
