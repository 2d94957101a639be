"""The real application without a display and a language model on loopback: slow, failing, and with a key to be kept."""

import logging
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from runtime.session.prompt_blend import Side
from tests.helpers.app_driver import Start, click_on, message, press, run, run_until, texts, type_in
from tests.helpers.slow_model import ANSWER, Model, load_model, source
from viewer.app import App
from viewer.jobs import Jobs, Slot
from viewer.services import Loaded
from viewer.settings import load_settings, save_settings

KEY = "sk-0123456789-never-written"


def styles(app: App) -> int:
    return len(app.scene.simulation.controller.styles)  # type: ignore[union-attr]


# --- a slow endpoint
def test_the_library_answers_at_once_and_the_language_model_when_it_can(
    asking: Callable[[], App], language_model: Model
) -> None:
    app = asking()
    before = styles(app)
    app.prompting.submit_prompt("a duck")
    run_until(app, lambda: source(app) == ("a duck", "library"))
    assert styles(app) == before + 1
    assert app.prompting.pending == {Side.A}
    assert "The library answered at once; waiting for m at 127.0.0.1" in message(app)
    run_until(app, lambda: bool(language_model.asked))
    language_model.released.set()
    run_until(app, lambda: source(app) == ("a duck", "gpt"))
    assert styles(app) == before + 2
    assert app.prompting.parts == ANSWER.to_mapping()
    assert "answered: “a duck”" in message(app)
    app.editor.undo()  # both answers are one step
    assert source(app) == ("a proud king", "library")


def test_newer_words_do_not_get_the_older_answer(asking: Callable[[], App], language_model: Model) -> None:
    app = asking()
    app.prompting.submit_prompt("a duck")
    run_until(app, lambda: source(app) == ("a duck", "library") and bool(language_model.asked))
    app.prompting.parts["head"] = "head shaking"
    app.prompting.submit_part("head")  # the person goes on with the library's words
    run_until(app, lambda: not app.prompting.pending)
    language_model.released.set()
    for _ in range(20):
        run(app)
    assert source(app) == ("a duck", "library")
    assert app.prompting.parts["head"] == "head shaking"


def test_a_failing_language_model_leaves_the_librarys_words(
    asking: Callable[[], App], language_model: Model
) -> None:
    app = asking()
    language_model.status = 401
    language_model.released.set()
    app.prompting.submit_prompt("a duck")
    run_until(app, lambda: not app.prompting.pending)
    run(app)
    assert source(app) == ("a duck", "library")
    assert "refuses the key (401)" in message(app)
    assert "The library answered." in app.editor.session.live.prompt.a.note  # type: ignore[union-attr]
    count = styles(app)
    run(app, 5)
    assert styles(app) == count  # the same words are no new style


# --- the panel
def open_panel(app: App) -> None:
    click_on(app, "##who")


def type_key(app: App, key: str) -> None:
    click_on(app, "##key")
    type_in(app, key)
    press(app, "enter")


def test_the_key_is_typed_used_and_written_nowhere(
    asking: Callable[[], App], language_model: Model, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.DEBUG)
    app = asking()
    app.settings.export_folder = str(tmp_path / "clips")
    language_model.released.set()
    open_panel(app)
    type_key(app, KEY)
    assert app.language_model.key == KEY
    run_until(app, lambda: not app.jobs.busy(Slot("language model")))
    app.takes.toggle_recording()
    app.prompting.submit_prompt("a duck")
    run_until(app, lambda: source(app) == ("a duck", "gpt"))
    language_model.status = 401  # an endpoint that repeats the key in its refusal
    for ask in (lambda: app.prompting.submit_prompt("a goose"), app.language_model.test):
        ask()
        run_until(app, lambda: not app.prompting.pending and not app.language_model.testing)
        run(app, 2)
    assert language_model.keys == {f"Bearer {KEY}"}
    app.takes.toggle_recording()
    run(app)
    app.bvh_export.export()
    run_until(app, lambda: (tmp_path / "clips").exists() and any((tmp_path / "clips").glob("*.bvh")))
    assert app.editor.file.flush(60.0)
    save_settings(app.settings, app.config)
    told = "\n".join([caplog.text, repr(app.language_model), *(m.text for m in app.messages.recent)])
    assert "refuses the key" in told
    assert KEY not in told
    events = app.editor.session.takes[0].clip.prompts
    assert KEY not in "".join(event.prompt for event in events)
    written = [path for path in tmp_path.rglob("*") if path.is_file()]
    assert "settings.json" in {path.name for path in written}
    assert {app.editor.file.path, *(tmp_path / "clips").glob("*.bvh")} <= set(written)
    assert list((tmp_path / "cache").rglob("*.json"))  # the answers are kept, too
    for path in written:
        assert KEY.encode() not in path.read_bytes(), path


def test_the_test_button_reports(asking: Callable[[], App], language_model: Model) -> None:
    app = asking()
    app.language_model.test()
    run(app, 2)
    assert app.language_model.testing
    language_model.released.set()
    run_until(app, lambda: not app.language_model.testing)
    assert app.language_model.report_good
    assert "m at 127.0.0.1" in app.language_model.report
    language_model.status = 401
    app.language_model.test()
    run_until(app, lambda: not app.language_model.testing)
    assert not app.language_model.report_good
    assert "refuses the key" in app.language_model.report


def test_the_end_does_not_wait_for_a_test(asking: Callable[[], App], language_model: Model) -> None:
    app = asking()
    app.settings.gpt_timeout_s = 120.0
    app.language_model.test()
    run_until(app, lambda: bool(language_model.asked))
    app.close()
    assert language_model.waited_out == 0  # it was given two minutes, and does not answer


def test_without_a_key_or_an_address_the_library_answers_and_the_panel_says_why(start: Start) -> None:
    app = start(services={"load_model": load_model})
    run(app)
    assert app.language_model.kind == "library"
    open_panel(app)
    app.language_model.choose("gpt")
    run(app, 2)
    assert "neither a key nor an address" in app.language_model.problem
    app.prompting.submit_prompt("a duck")
    assert source(app) == ("a duck", "library")
    app.language_model.test()
    assert "neither a key nor an address" in app.language_model.report
    app.language_model.report = "100 % sure"
    assert any(text.endswith(" 100 % sure") for text in texts(app))
    app.settings.gpt_base_url = "not an address"
    app.language_model.apply()
    assert "Base URL" in app.language_model.problem


def test_the_choice_is_remembered_but_no_address_with_credentials(start: Start) -> None:
    app = start(services={"load_model": load_model})
    settings = app.settings
    app.language_model.choose("gpt")
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
    start: Start, language_model: Model, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("OPENAI_BASE_URL", language_model.url)
    monkeypatch.setenv("SPORT_GPT_MODEL", "m")
    given: list[Any] = []

    def spy(directory: Any, terrain: Any, seed: int, gpt: Any) -> Loaded:
        given.append(gpt)
        return load_model(directory, terrain, seed, None)

    app = start(services={"load_model": spy})
    assert (given[0].model, given[0].base_url) == ("m", language_model.url)
    assert app.language_model.name.startswith("m at 127.0.0.1")


# --- a choice made while the model is being loaded
@pytest.fixture
def loading(
    start: Start, language_model: Model, monkeypatch: pytest.MonkeyPatch
) -> Callable[[], tuple[App, threading.Event]]:
    """Opens the application as on a screen; the model is there once the event is set."""
    loaded = threading.Event()
    language_model.released.set()
    monkeypatch.setattr("viewer.workspace.Jobs", lambda messages, blocking: Jobs(messages))

    def load(*given: Any) -> Loaded:
        loaded.wait(20.0)
        return load_model(*given)

    def open_app() -> tuple[App, threading.Event]:
        app = start(services={"load_model": load}, prompt="a proud king")
        app.prompting.blocking = False
        return app, loaded

    return open_app


def test_the_library_chosen_while_the_model_loads_sends_nothing(
    loading: Callable[[], tuple[App, threading.Event]], language_model: Model, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("OPENAI_BASE_URL", language_model.url)
    monkeypatch.setenv("SPORT_GPT_MODEL", "m")
    app, loaded = loading()
    assert app.language_model.name.startswith("m at")
    app.language_model.choose("library")
    loaded.set()
    run_until(app, lambda: app.editor.session.live.prompt.a is not None and not app.prompting.pending)
    app.prompting.submit_prompt("a duck")
    run_until(app, lambda: not app.prompting.pending)
    assert source(app) == ("a duck", "library")
    assert app.language_model.name == ""
    assert language_model.asked == []  # not even the prompt that waited for the model


def test_a_language_model_chosen_while_the_model_loads_is_asked(
    loading: Callable[[], tuple[App, threading.Event]], language_model: Model
) -> None:
    app, loaded = loading()
    app.settings.gpt_base_url, app.settings.gpt_model = language_model.url, "m"
    app.language_model.choose("gpt")
    loaded.set()
    live, busy = lambda: app.editor.session.live.prompt.a, lambda: app.jobs.busy(Slot("language model"))
    run_until(app, lambda: live() is not None and not busy())
    app.prompting.submit_prompt("a duck")
    run_until(app, lambda: not app.prompting.pending)
    assert source(app) == ("a duck", "gpt")
