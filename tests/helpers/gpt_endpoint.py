"""An OpenAI-compatible HTTP server on loopback with correct and faulty behaviour, for tests of the expander."""

import contextlib
import json
import socket
import threading
import time
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import numpy as np
import pytest

import runtime.motion.model
import runtime.prompts.content
import runtime.prompts.gpt.expander
from runtime.assets import asset_path
from runtime.prompts.expander import Expansion
from runtime.prompts.gpt.expander import GptExpander
from runtime.prompts.gpt.prompt import load_structured_prompt
from runtime.prompts.gpt.settings import GptSettings, Secret
from runtime.prompts.library_data import load_styles

KEY = "test-0123456789-abcdef"
STYLES = load_styles(asset_path("prompts/styles.json"))
PROUD, DRUNK = STYLES["proud"].descriptions[1], STYLES["drunk"].descriptions[1]
FIVE = {part: text for part, text in PROUD.to_mapping().items() if part != "head"}
INSTRUCTIONS = load_structured_prompt()
UNREACHED_DELAY_S = 60.0  # longer than any test waits
PROSE = "A proud person walks with the chest out and the arms swinging widely."


# --- the test server
def completion(content, **message):
    """Return the body of a chat completion with `content`."""
    choice = {"index": 0, "message": {"role": "assistant", "content": content, **message}}
    return json.dumps({"id": "1", "object": "chat.completion", "model": "m", "choices": [choice]})


def say(content, **message):
    return lambda handler: handler.reply(200, completion(content, **message))


def fail(status, message="no", headers=(), code=None):
    body = json.dumps({"error": {"message": message, "code": code}})
    return lambda handler: handler.reply(status, body, dict(headers))


def raw(text):
    return lambda handler: handler.reply(200, text, {"Content-Type": "text/html"})


def late(seconds):
    """Answer correctly, but too late."""

    def behave(handler):
        handler.server.waited_out += not handler.server.released.wait(seconds)
        handler.reply(200, completion(PROUD.to_json()))

    return behave


def trickle(handler):
    """Send single bytes forever: no single wait is long."""
    handler.start(200, {"Content-Length": "1000000"})
    while not handler.server.released.wait(0.02):
        handler.wfile.write(b" ")


def trickle_headers(handler):
    """Do the same before the body has begun."""
    handler.wfile.write(b"HTTP/1.1 200 OK\r\nX-Slow: ")
    while not handler.server.released.wait(0.02):
        handler.wfile.write(b"a")


def flood(handler):
    handler.start(200, {"Content-Length": str(1 << 40)})
    while not handler.server.released.is_set():
        handler.wfile.write(b" " * 100_000)


def hang_up(handler):
    handler.connection.shutdown(socket.SHUT_RDWR)


class Handler(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"

    def do_POST(self):
        body = json.loads(self.rfile.read(int(self.headers["Content-Length"])))
        script = self.server.script
        with self.server.lock:
            headers = {k.lower(): v for k, v in self.headers.items()}
            self.server.requests.append((time.monotonic(), self.path, headers, body))
            behave = script.pop(0) if len(script) > 1 else script[0]
        try:
            behave(self)
        except OSError:  # the client went away, as it should
            self.close_connection = True

    def start(self, status, headers):
        self.send_response(status)
        for name, value in {"Content-Type": "application/json", **headers}.items():
            self.send_header(name, value)
        self.end_headers()

    def reply(self, status, body, headers=None):
        data = body.encode()
        self.start(status, {"Content-Length": str(len(data)), **(headers or {})})
        self.wfile.write(data)

    def log_message(self, *_):
        pass


class Endpoint(ThreadingHTTPServer):
    """Behaves according to `script`, one entry per request, the last one for all further requests."""

    daemon_threads = True
    block_on_close = False

    def __init__(self):
        super().__init__(("127.0.0.1", 0), Handler)
        self.lock, self.released = threading.Lock(), threading.Event()
        self.waited_out = 0  # requests whose client waited until their end
        self.script, self.requests = [say(PROUD.to_json())], []

    def handle_error(self, request, client_address):
        pass

    @property
    def url(self):
        return f"http://127.0.0.1:{self.server_port}/v1"

    @property
    def bodies(self):
        return [request[3] for request in self.requests]


@contextlib.contextmanager
def serving(server, patch):
    """Run the server on a thread, without a proxy."""
    pytest.importorskip("openai")
    for name in ("HTTP_PROXY", "HTTPS_PROXY", "ALL_PROXY"):
        patch.delenv(name, raising=False)
        patch.delenv(name.lower(), raising=False)
    threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.01}, daemon=True).start()
    yield server
    server.released.set()
    server.shutdown()
    server.server_close()


@pytest.fixture
def endpoint(monkeypatch):
    monkeypatch.setattr(runtime.prompts.gpt.expander, "load_structured_prompt", lambda: INSTRUCTIONS)
    with serving(Endpoint(), monkeypatch) as server:
        yield server


@pytest.fixture
def settings_of():
    """Return settings for a server: short waits between requests, but enough time for answers on a busy machine."""

    def make(server, **changes):
        quick = {
            "timeout_s": 20.0,
            "deadline_s": 20.0,
            "backoff_s": 0.02,
            "longest_wait_s": 1.0,
            "model": "m",
        }
        return GptSettings(Secret(KEY), server.url, **{**quick, **changes})

    return make


@pytest.fixture
def expander_of(settings_of, tmp_path):
    return lambda server, **changes: GptExpander(settings_of(server, **changes), tmp_path)


class Library:
    """A fake prompt library."""

    def expand(self, prompt):
        return Expansion(DRUNK, "library", (("drunk", 0.9),), "Near enough.")


class Encoder:
    """A fake encoder of descriptions to Z^t."""

    def encode(self, descriptions):
        return np.full((6, 64), len(descriptions.head), np.float32)


def wait_for(worker, seconds=60.0):
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        result = worker.poll()
        if result is not None and result.final:
            return result
        time.sleep(0.002)
    raise AssertionError("no answer")
