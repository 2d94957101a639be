"""The real application without a display and a language model on loopback: slow, failing, and with a key to be kept."""

from __future__ import annotations

import json
import logging
import threading
from collections.abc import Callable, Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import pytest
from app_driver import Start, click, message, press, run, run_until
from viewer_fakes import FakeController, FakeEncoder, FakeLibrary

from runtime.prompts.blend import BlendedPrompt
from runtime.prompts.parts import PartDescriptions
from runtime.prompts.service import PromptWorker
from runtime.skeleton import PART_NAMES
from viewer.app import App
from viewer.services import Loaded, open_expander
from viewer.settings import load_settings, save_settings

KEY = "sk-0123456789-never-written"
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
    library, encoder = FakeLibrary(), FakeEncoder()
    expander = library if gpt is None else open_expander(library, gpt)
    workers = PromptWorker(expander, encoder), PromptWorker(expander, encoder)  # type: ignore[arg-type]
    return Loaded(FakeController(terrain), workers, library, "fake", "numpy")


@pytest.fixture
def asking(start: Start, model: Model) -> Callable[[], App]:
    """Opens the application as on a screen, with the language model chosen."""

    def open_app() -> App:
        app = start(services={"load_model": load_model}, prompt="a proud king")
        app.prompting.blocking = app.jobs.blocking = False
        app.state.settings.gpt_base_url, app.state.settings.gpt_model = model.url, "m"
        app.expanders.choose("gpt")
        run_until(app, lambda: not app.jobs.busy("language model"))
        return app

    return open_app


def source(app: App) -> tuple[str, str]:
    answer = app.state.prompt.edit.a
    assert answer is not None
    return answer.prompt, answer.source


def styles(app: App) -> int:
    return len(app.state.simulation.controller.styles)  # type: ignore[union-attr]


# a slow endpoint


def test_the_library_answers_at_once_and_the_language_model_when_it_can(
    asking: Callable[[], App], model: Model
) -> None:
    app = asking()
    before = styles(app)
    app.prompting.submit_prompt("a duck")
    run_until(app, lambda: source(app) == ("a duck", "library"))
    assert styles(app) == before + 1
    assert app.state.prompt.asked == {"a"}
    assert "The library answered at once; m at 127.0.0.1" in message(app)
    run_until(app, lambda: bool(model.asked))
    model.released.set()
    run_until(app, lambda: source(app) == ("a duck", "gpt"))
    assert styles(app) == before + 2
    assert app.state.prompt.parts == ANSWER.to_mapping()
    assert "answered: “a duck”" in message(app)
    app.prompting.undo()  # both answers are one step
    assert source(app) == ("a proud king", "library")


def test_newer_words_do_not_get_the_older_answer(asking: Callable[[], App], model: Model) -> None:
    app = asking()
    app.prompting.submit_prompt("a duck")
    run_until(app, lambda: source(app) == ("a duck", "library") and bool(model.asked))
    app.state.prompt.parts["head"] = "head shaking"
    app.prompting.submit_part("head")  # the person goes on with the library's words
    run_until(app, lambda: not app.state.prompt.asked)
    model.released.set()
    for _ in range(20):
        run(app)
    assert source(app) == ("a duck", "library")
    assert app.state.prompt.parts["head"] == "head shaking"


def test_a_blend_can_be_moved_while_the_language_model_thinks(
    asking: Callable[[], App], model: Model
) -> None:
    app = asking()
    app.prompting.submit_prompt("a duck", "b")
    run_until(app, lambda: app.state.prompt.edit.b is not None and bool(model.asked))
    app.prompting.set_all_weights(0.8)
    app.prompting.commit()
    model.released.set()
    run_until(app, lambda: not app.state.prompt.asked)
    edit = app.state.prompt.edit
    assert edit.b is not None
    assert (edit.b.source, edit.weights, source(app)[1]) == ("gpt", (0.8,) * 6, "library")
    kept = edit.replayable()
    assert isinstance(kept, BlendedPrompt)
    assert (kept.a, kept.b) == ("a proud king", ANSWER)  # what a language model said is kept in full


def test_a_failing_language_model_leaves_the_librarys_words(asking: Callable[[], App], model: Model) -> None:
    app = asking()
    model.status = 401
    model.released.set()
    app.prompting.submit_prompt("a duck")
    run_until(app, lambda: not app.state.prompt.asked)
    run(app)
    assert source(app) == ("a duck", "library")
    assert "refuses the key (401)" in message(app)
    assert "The library answered." in app.state.prompt.edit.a.note  # type: ignore[union-attr]
    count = styles(app)
    run(app, 5)
    assert styles(app) == count  # the same words are no new style


# the panel


def open_panel(app: App) -> None:
    click(app, 294, 32)
    run(app, 2)


def type_key(app: App, key: str) -> None:
    click(app, 450, 254)
    app.window.inject_text(key)
    run(app, 3)
    press(app, "enter")
    run(app, 2)


def test_the_key_is_typed_used_and_written_nowhere(
    asking: Callable[[], App], model: Model, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.DEBUG)
    app = asking()
    app.state.settings.export_folder = str(tmp_path / "clips")
    model.released.set()
    open_panel(app)
    type_key(app, KEY)
    assert app.state.expander.key == KEY
    run_until(app, lambda: not app.jobs.busy("language model"))
    app.takes.toggle_recording()
    app.prompting.submit_prompt("a duck")
    run_until(app, lambda: source(app) == ("a duck", "gpt"))
    model.status = 401  # an endpoint that repeats the key in its refusal
    for ask in (lambda: app.prompting.submit_prompt("a goose"), app.expanders.test):
        ask()
        run_until(app, lambda: not app.state.prompt.asked and not app.state.expander.testing)
        run(app, 2)
    assert model.keys == {f"Bearer {KEY}"}
    app.takes.toggle_recording()
    run(app)
    app.takes.rescue()
    save_settings(app.state.settings, app.config)
    told = "\n".join([caplog.text, repr(app.state), *(m.text for m in app.state.messages.recent)])
    assert "refuses the key" in told
    assert KEY not in told
    events = app.state.clips.items[0].clip.prompts
    assert KEY not in "".join(event.prompt for event in events)
    written = [path for path in tmp_path.rglob("*") if path.is_file()]
    assert {"settings.json", "take-1.bvh"} <= {path.name for path in written}
    assert list((tmp_path / "cache").rglob("*.json"))  # the answers are kept, too
    for path in written:
        assert KEY.encode() not in path.read_bytes(), path


def test_the_test_button_reports(asking: Callable[[], App], model: Model) -> None:
    app = asking()
    app.expanders.test()
    run(app, 2)
    assert app.state.expander.testing
    model.released.set()
    run_until(app, lambda: not app.state.expander.testing)
    assert app.state.expander.report_good
    assert "m at 127.0.0.1" in app.state.expander.report
    model.status = 401
    app.expanders.test()
    run_until(app, lambda: not app.state.expander.testing)
    assert not app.state.expander.report_good
    assert "refuses the key" in app.state.expander.report


def test_the_end_does_not_wait_for_a_test(asking: Callable[[], App], model: Model) -> None:
    app = asking()
    app.state.settings.gpt_timeout_s = 120.0
    app.expanders.test()
    run_until(app, lambda: bool(model.asked))
    app.close()  # would take as long as the model


def test_without_a_key_or_an_address_the_library_answers_and_the_panel_says_why(start: Start) -> None:
    app = start(services={"load_model": load_model})
    run(app)
    assert app.expanders.kind == "library"
    open_panel(app)
    app.expanders.choose("gpt")
    run(app, 2)
    assert "neither a key nor an address" in app.state.expander.problem
    app.prompting.submit_prompt("a duck")
    assert source(app) == ("a duck", "library")
    app.expanders.test()
    assert "neither a key nor an address" in app.state.expander.report
    app.state.settings.gpt_base_url = "not an address"
    app.expanders.apply()
    assert "Base URL" in app.state.expander.problem


def test_the_choice_is_remembered_but_no_address_with_credentials(start: Start) -> None:
    app = start(services={"load_model": load_model})
    settings = app.state.settings
    app.expanders.choose("gpt")
    settings.gpt_model, settings.gpt_timeout_s = "llama3", 30.0
    for url, kept in (("http://localhost:11434/v1", True), (f"http://me:{KEY}@localhost/v1", False)):
        settings.gpt_base_url = url
        save_settings(settings, app.config)
        loaded, complaints = load_settings(app.config)
        assert (loaded.expander, loaded.gpt_model, loaded.gpt_timeout_s) == ("gpt", "llama3", 30.0)
        assert loaded.gpt_base_url == (url if kept else "")
        assert complaints == []
    assert KEY not in (app.config / "settings.json").read_text(encoding="utf-8")


def test_the_environment_chooses_the_language_model_at_the_start(
    start: Start, model: Model, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("OPENAI_BASE_URL", model.url)
    monkeypatch.setenv("SPORT_GPT_MODEL", "m")
    given: list[Any] = []

    def spy(directory: Any, terrain: Any, seed: int, gpt: Any) -> Loaded:
        given.append(gpt)
        return load_model(directory, terrain, seed, None)

    app = start(services={"load_model": spy})
    assert (given[0].model, given[0].base_url) == ("m", model.url)
    assert app.state.expander.language_model.startswith("m at 127.0.0.1")
