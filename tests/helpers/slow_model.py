"""A language model on loopback that thinks until a test lets it answer, and the application that asks it."""

from __future__ import annotations

import json
import threading
from collections.abc import Callable, Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from runtime.prompts.parts import PartDescriptions
from runtime.prompts.service import PromptWorker
from runtime.skeleton import PART_NAMES
from viewer.jobs import Slot

if TYPE_CHECKING:
    from tests.helpers.app_driver import Start
    from viewer.app import App
    from viewer.services import Loaded

ANSWER = PartDescriptions(*(f"{part} as the model says" for part in PART_NAMES))


class Model(ThreadingHTTPServer):
    """A chat completion endpoint that answers once `released`, with `status`; repeats the key in what it refuses."""

    daemon_threads = True
    block_on_close = False

    def __init__(self) -> None:
        super().__init__(("127.0.0.1", 0), Handler)
        self.released = threading.Event()
        self.status = 200
        self.asked: list[dict[str, Any]] = []
        self.keys: set[str] = set()

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self.server_port}/v1"


class Handler(BaseHTTPRequestHandler):
    server: Model

    def do_POST(self) -> None:
        body = json.loads(self.rfile.read(int(self.headers["Content-Length"])))
        self.server.keys.add(self.headers["Authorization"])
        self.server.asked.append(body)
        self.server.released.wait(30.0)
        said: dict[str, Any] = {
            "choices": [{"index": 0, "message": {"role": "assistant", "content": ANSWER.to_json()}}]
        }
        if self.server.status != 200:
            said = {"error": {"message": f"refused {self.headers['Authorization']}", "code": None}}
        data = json.dumps({"id": "1", "object": "chat.completion", "model": "m", **said}).encode()
        try:
            self.send_response(self.server.status)
            self.send_header("Content-Type", "application/json")
            self.send_header("Content-Length", str(len(data)))
            self.end_headers()
            self.wfile.write(data)
        except OSError:
            self.close_connection = True  # the client went away, as it may

    def log_message(self, *_: Any) -> None:
        pass


@pytest.fixture
def model(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[Model]:
    """The endpoint, without a proxy and with a cache of its own."""
    pytest.importorskip("openai")
    monkeypatch.setenv("SPORT_CACHE_DIR", str(tmp_path / "cache"))
    for name in ("HTTP_PROXY", "HTTPS_PROXY", "ALL_PROXY"):
        monkeypatch.delenv(name, raising=False)
        monkeypatch.delenv(name.lower(), raising=False)
    server = Model()
    threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.01}, daemon=True).start()
    yield server
    server.released.set()
    server.shutdown()
    server.server_close()


def load_model(directory: Any, terrain: Any, seed: int, gpt: Any) -> Loaded:
    """The fake model with real workers."""
    from tests.helpers.viewer_fakes import FakeController, FakeEncoder, FakeLibrary
    from viewer.services import Loaded, open_expander

    library, encoder = FakeLibrary(), FakeEncoder()
    expander = library if gpt is None else open_expander(library, gpt)
    workers = PromptWorker(expander, encoder), PromptWorker(expander, encoder)  # type: ignore[arg-type]
    return Loaded(FakeController(terrain), workers, library, "fake", "numpy")


@pytest.fixture
def asking(start: Start, model: Model) -> Callable[[], App]:
    """Opens the application as on a screen, with the language model chosen."""
    from tests.helpers.app_driver import run_until

    def open_app() -> App:
        app = start(services={"load_model": load_model}, prompt="a proud king")
        app.prompting.blocking = app.jobs.blocking = False
        app.settings.gpt_base_url, app.settings.gpt_model = model.url, "m"
        app.language_model.choose("gpt")
        run_until(app, lambda: not app.jobs.busy(Slot("language model")))
        return app

    return open_app


def source(app: App) -> tuple[str, str]:
    """Prompt A and who answered it."""
    answer = app.editor.session.live.prompt.a
    assert answer is not None
    return answer.prompt, answer.source
