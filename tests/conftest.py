"""Fixtures that several test files share."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import settings

from tests.helpers.browser import browser  # noqa: F401  (fixture)
from tests.helpers.gpt_endpoint import endpoint, expander_of, settings_of  # noqa: F401  (fixtures)
from tests.helpers.slow_model import asking, model  # noqa: F401  (fixtures)

# every run has the same few examples; `pytest --hypothesis-profile long` looks for more
settings.register_profile("quick", max_examples=20, deadline=None, derandomize=True)
settings.register_profile("long", max_examples=1000, deadline=None)
settings.load_profile("quick")


@pytest.fixture(scope="session", autouse=True)
def home(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A home folder for every test and the processes that it starts, so that none writes into the user's own."""
    folder = tmp_path_factory.mktemp("home")
    with pytest.MonkeyPatch.context() as patch:
        for name in ("HOME", "USERPROFILE"):
            patch.setenv(name, str(folder))
        for name in (
            "XDG_CONFIG_HOME",
            "XDG_CACHE_HOME",
            "XDG_STATE_HOME",
            "SPORT_CONFIG_DIR",
            "SPORT_CACHE_DIR",
        ):
            patch.delenv(name, raising=False)
        yield folder


def opened(config: Path, options: dict[str, Any], services: Any, drawn: bool) -> Any:
    """The viewer offscreen on flat ground; panels are laid out, and put into the picture only where `drawn`."""
    from tests.helpers.app_driver import InjectedPads
    from viewer.app import App
    from viewer.options import ViewOptions

    chosen = {"offscreen": True, "terrain": "flat", **options}
    app = App(ViewOptions(**chosen), services, InjectedPads(), config)
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


@pytest.fixture(scope="module")
def desk(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    """One such viewer for every test of a file; each test clears what it needs."""
    from tests.helpers.viewer_fakes import fake_services

    app = opened(tmp_path_factory.mktemp("config"), {}, fake_services(drawn=False), False)
    yield app
    app.close()


@pytest.fixture
def quick_blends(monkeypatch: pytest.MonkeyPatch) -> None:
    """The change within a pair of styles is measured on a third of a second in place of six."""
    from runtime.motion import perceptual_weights

    monkeypatch.setattr(perceptual_weights, "LEAD_IN", 5)
    monkeypatch.setattr(perceptual_weights, "FRAMES", 15)


@pytest.fixture(scope="session")
def exported_tiny(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of `tiny_model.tiny_trained()`; a test that changes it copies it.

    It is exported once, also where several processes run the tests: the first does it, the others wait.
    """
    pytest.importorskip("onnxscript")
    from runtime.file_lock import open_locked
    from tests.helpers.tiny_model import tiny_trained
    from training.export.model import export_model

    base = tmp_path_factory.getbasetemp()
    folder = (base.parent if "PYTEST_XDIST_WORKER" in os.environ else base) / "exported_tiny"
    lock = open_locked(folder.with_suffix(".lock"), create=True, wait=True)
    assert lock is not None
    try:
        if not (folder / "README.md").exists():  # written last
            export_model(tiny_trained(), folder)
    finally:
        os.close(lock)
    return folder
