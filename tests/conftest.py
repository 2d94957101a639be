"""Fixtures that several test files share."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.helpers.browser import browser  # noqa: F401  (fixture)
from tests.helpers.gpt_endpoint import endpoint, expander_of, settings_of  # noqa: F401  (fixtures)
from tests.helpers.slow_model import asking, model  # noqa: F401  (fixtures)


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


@pytest.fixture
def start(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., Any]]:
    """Opens the viewer offscreen on flat ground with a fake model; closes what the test leaves open.

    `start(real_renderer=False, drawn=real_renderer, services={}, **options)`: `services` are loaders in place of the
    fakes, by name; panels are laid out in every frame, but put into the picture, which takes time, only where `drawn`.
    """
    import dataclasses

    from tests.helpers.app_driver import InjectedPads
    from tests.helpers.viewer_fakes import fake_services
    from viewer.app import App
    from viewer.options import ViewOptions

    for name in ("OPENAI_API_KEY", "OPENAI_BASE_URL", "SPORT_GPT_MODEL", "SPORT_GPT_TIMEOUT"):
        monkeypatch.delenv(name, raising=False)
    apps: list[App] = []

    def open_app(
        real_renderer: bool = False,
        services: dict[str, Any] | None = None,
        drawn: bool | None = None,
        **options: Any,
    ) -> App:
        chosen = {"offscreen": True, "terrain": "flat", **options}
        drawn = real_renderer if drawn is None else drawn
        loaders = dataclasses.replace(fake_services(real_renderer, drawn=drawn), **(services or {}))
        app = App(ViewOptions(**chosen), loaders, InjectedPads(), tmp_path / "config")
        if not drawn:
            app.window.draw_interface = lambda: None  # type: ignore[method-assign]
        apps.append(app)
        return app

    yield open_app
    for app in apps:
        app.close()


@pytest.fixture(scope="module")
def desk(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    """One viewer offscreen on flat ground with a fake model for every test of a file; each test clears what it needs."""
    from tests.helpers.app_driver import InjectedPads
    from tests.helpers.viewer_fakes import fake_services
    from viewer.app import App
    from viewer.options import ViewOptions

    options = ViewOptions(offscreen=True, terrain="flat")
    app = App(options, fake_services(drawn=False), InjectedPads(), tmp_path_factory.mktemp("config"))
    app.window.draw_interface = lambda: None  # type: ignore[method-assign]
    yield app
    app.close()


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
