"""Fixtures that several test files share."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from gpt_endpoint import endpoint, expander_of, settings_of  # noqa: F401  (fixtures)
from slow_model import asking, model  # noqa: F401  (fixtures)


@pytest.fixture
def start(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., Any]]:
    """Opens the viewer offscreen on flat ground with a fake model; closes what the test leaves open.

    `start(real_renderer=False, services={}, **options)`: `services` are loaders in place of the fakes, by name.
    """
    import dataclasses

    from app_driver import InjectedPads
    from viewer_fakes import fake_services

    from sport.viewer.app import App
    from sport.viewer.options import ViewOptions

    for name in ("OPENAI_API_KEY", "OPENAI_BASE_URL", "SPORT_GPT_MODEL", "SPORT_GPT_TIMEOUT"):
        monkeypatch.delenv(name, raising=False)
    apps: list[App] = []

    def open_app(real_renderer: bool = False, services: dict[str, Any] | None = None, **options: Any) -> App:
        chosen = {"offscreen": True, "terrain": "flat", **options}
        loaders = dataclasses.replace(fake_services(real_renderer), **(services or {}))
        app = App(ViewOptions(**chosen), loaders, InjectedPads(), tmp_path / "config")
        apps.append(app)
        return app

    yield open_app
    for app in apps:
        app.close()
