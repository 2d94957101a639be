"""Fixtures that several test files share."""

import dataclasses
import gc
import os
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import settings

from tests.helpers.browser import browser  # noqa: F401  (fixture)
from tests.helpers.gpt_endpoint import endpoint, expander_of, settings_of  # noqa: F401  (fixtures)
from tests.helpers.skips import (  # noqa: F401  (hooks)
    pytest_addoption,
    pytest_pycollect_makemodule,
    pytest_runtest_setup,
    pytest_terminal_summary,
)
from tests.helpers.slow_model import asking, language_model  # noqa: F401  (fixtures)

# every run has the same few examples; `pytest --hypothesis-profile long` looks for more
settings.register_profile("quick", max_examples=20, deadline=None, derandomize=True)
settings.register_profile("long", max_examples=1000, deadline=None)
settings.load_profile("quick")


def pytest_configure() -> None:
    """One thread in each process: those of several that train at a time would wait for each other.

    Compiled modules are kept: tests start some hundred processes, which would all compile the program anew.
    """
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
    sys.dont_write_bytecode = False
    gc.disable()  # until everything is imported: a quarter of that time goes into looking for what may be freed


def pytest_collection_finish() -> None:
    """What is imported by now stays, and need not be looked through again."""
    gc.enable()
    gc.freeze()


@pytest.fixture(scope="session", autouse=True)
def home(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A home folder for every test and the processes that it starts, so that none writes into the user's own."""
    folder = tmp_path_factory.mktemp("home")
    with pytest.MonkeyPatch.context() as patch:
        for name in ("HOME", "USERPROFILE"):
            patch.setenv(name, str(folder))
        folders = (
            "XDG_CONFIG_HOME",
            "XDG_CACHE_HOME",
            "XDG_STATE_HOME",
            "SPORT_CONFIG_DIR",
            "SPORT_CACHE_DIR",
        )
        for name in folders:
            patch.delenv(name, raising=False)
        yield folder


@pytest.fixture(scope="session", autouse=True)
def remembered() -> Iterator[None]:
    """Networks answer from memory what they were asked before; exports have the mannequin from memory too."""
    from runtime.character.character import load_character
    from runtime.motion.model_files import run_graph
    from tests.helpers import shipped
    from tests.helpers.remembering import Memory

    def character(path: Path, *options: Any) -> Any:
        usual = path == shipped.MANNEQUIN and not any(options)
        return shipped.mannequin() if usual else load_character(path, *options)

    memory = Memory(run_graph)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("runtime.formats.glb.load_character", character)
        for module in ("motion.model", "prompts.content", "prompts.text_encoder"):
            patch.setattr(f"runtime.{module}.run_graph", memory)
        yield


def opened(config: Path, options: dict[str, Any], services: Any, drawn: bool) -> Any:
    """The viewer offscreen on flat ground; panels are laid out, and put into the picture only where `drawn`."""
    from tests.helpers.app_driver import InjectedPads
    from viewer.app import App
    from viewer.options import ViewOptions

    chosen = {"offscreen": True, "terrain": "flat", **options}
    app = App(ViewOptions(**chosen), services, InjectedPads(), config)
    app.sessions.dialogs.available = lambda: False  # whatever programs this system has
    if not drawn:
        app.window.draw_interface = lambda: None  # type: ignore[method-assign]
    return app


@pytest.fixture
def start(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., Any]]:
    """Opens the viewer offscreen on flat ground with a fake model; closes what the test leaves open.

    `start(real_renderer=False, drawn=real_renderer, services={}, **options)`: `services` are loaders in place of the
    fakes, by name.
    """
    from tests.helpers.viewer_fakes import fake_services

    for name in ("OPENAI_API_KEY", "OPENAI_BASE_URL", "SPORT_GPT_MODEL", "SPORT_GPT_TIMEOUT"):
        monkeypatch.delenv(name, raising=False)
    apps: list[Any] = []

    def open_app(
        real_renderer: bool = False,
        services: dict[str, Any] | None = None,
        drawn: bool | None = None,
        **options: Any,
    ) -> Any:
        drawn = real_renderer if drawn is None else drawn
        loaders = dataclasses.replace(fake_services(real_renderer, drawn=drawn), **(services or {}))
        apps.append(opened(tmp_path / "config", options, loaders, drawn))
        return apps[-1]

    yield open_app
    for app in apps:
        app.close()


@pytest.fixture
def app(start: Callable[..., Any]) -> Any:
    """The viewer of `start()` after its first frames, when everything is laid out."""
    app = start()
    for _ in range(3):
        app.frame()
    return app


@pytest.fixture(scope="module")
def desk(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    """One such viewer for every test of a file; each test clears what it needs."""
    from tests.helpers.viewer_fakes import fake_services

    app = opened(tmp_path_factory.mktemp("config"), {}, fake_services(drawn=False), False)
    yield app
    app.close()


@pytest.fixture(scope="session")
def model() -> Any:
    """The network that the program begins with; a test that changes it loads its own."""
    from tests.helpers.shipped import shipped_model

    return shipped_model()


@pytest.fixture(scope="session")
def prompter() -> Any:
    """From words to the codes of `model`."""
    from tests.helpers.shipped import shipped_prompter

    return shipped_prompter()


@pytest.fixture
def loaded_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Who loads the shipped networks, text encoder and library by their defaults gets those that are loaded already."""
    from runtime.motion.model import load_model
    from runtime.prompts.text_encoder import text_encoder_of
    from tests.helpers import shipped

    def model(folder: Path | None = None, **options: Any) -> Any:
        return load_model(folder, **options) if folder or options else shipped.shipped_model()

    def encoder(metadata: dict[str, Any], folder: Path, chosen: Path | None = None) -> Any:
        usual = chosen is None and folder == shipped.shipped_model().folder
        return shipped.shipped_encoder() if usual else text_encoder_of(metadata, folder, chosen)

    monkeypatch.setattr("runtime.motion.model.load_model", model)
    monkeypatch.setattr("runtime.prompts.prompter.text_encoder_of", encoder)
    monkeypatch.setattr("runtime.prompts.prompter.LibraryExpander", lambda _: shipped.shipped_library())


@pytest.fixture
def quick_clips(monkeypatch: pytest.MonkeyPatch, loaded_once: None) -> None:
    """Clips of the real model begin soon, and a blend is measured on a third of a second in place of six."""
    from runtime.motion import perceptual_weights
    from tests.helpers.walker import settle_soon

    settle_soon(monkeypatch)
    monkeypatch.setattr(perceptual_weights, "LEAD_IN_FRAMES", 5)
    monkeypatch.setattr(perceptual_weights, "FRAMES", 15)


@pytest.fixture
def walker(monkeypatch: pytest.MonkeyPatch) -> None:
    """Clips are generated by a synthetic walker in place of the network."""
    from tests.helpers.walker import generate_by_walker

    generate_by_walker(monkeypatch)


@pytest.fixture(scope="session")
def exported_tiny(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of `tiny_model.tiny_trained()`; a test that changes it copies it.

    It is exported once, also where several processes run the tests: the first does it, the others wait.
    """
    from runtime.file_lock import open_locked
    from tests.helpers.quick_export import export_motion_quickly
    from tests.helpers.tiny_model import tiny_trained
    from training.export.model import export_model

    base = tmp_path_factory.getbasetemp()
    folder = (base.parent if "PYTEST_XDIST_WORKER" in os.environ else base) / "exported_tiny"
    lock = open_locked(folder.with_suffix(".lock"), create=True, wait=True)
    assert lock is not None
    try:
        if not (folder / "README.md").exists():  # written last
            with pytest.MonkeyPatch.context() as patch:
                export_motion_quickly(patch)
                export_model(tiny_trained(), folder)
    finally:
        os.close(lock)
    return folder
