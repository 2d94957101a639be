"""A language model on loopback that waits until a test lets it answer, and the application that uses it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from runtime.prompts.parts import PartDescriptions
from runtime.prompts.service import PromptWorker
from runtime.skeleton import PART_NAMES
from tests.helpers.gpt_endpoint import UNREACHED_DELAY_S, Endpoint, Handler, fail, say, serving
from viewer.jobs import Slot

if TYPE_CHECKING:
    from tests.helpers.app_driver import Start
    from viewer.app import App
    from viewer.services import Loaded

ANSWER = PartDescriptions(*(f"{part} as the model says" for part in PART_NAMES))


class Model(Endpoint):
    """A chat completion endpoint that answers with `status` once `released`; refusals repeat the key."""

    def __init__(self) -> None:
        super().__init__()
        self.status, self.script = 200, [self._answer]

    def _answer(self, handler: Handler) -> None:
        self.waited_out += not self.released.wait(UNREACHED_DELAY_S)
        if self.status == 200:
            say(ANSWER.to_json())(handler)
        else:
            fail(self.status, f"refused {handler.headers['Authorization']}")(handler)

    asked = Endpoint.bodies

    @property
    def keys(self) -> set[str]:
        return {headers["authorization"] for _, _, headers, _ in self.requests}


@pytest.fixture
def language_model(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[Model]:
    """Yield the endpoint, with a separate cache."""
    monkeypatch.setenv("SPORT_CACHE_DIR", str(tmp_path / "cache"))
    with serving(Model(), monkeypatch) as server:
        yield server


def load_model(directory: Any, terrain: Any, seed: int, gpt: Any) -> Loaded:
    """Return the fake model with real workers."""
    from tests.helpers.viewer_fakes import FakeController, FakeEncoder, FakeLibrary
    from viewer.services import Loaded, open_expander

    library, encoder = FakeLibrary(), FakeEncoder()
    expander = library if gpt is None else open_expander(library, gpt)
    workers = PromptWorker(expander, encoder), PromptWorker(expander, encoder)  # type: ignore[arg-type]
    return Loaded(FakeController(terrain), workers, library, "fake", "numpy")


@pytest.fixture
def asking(start: Start, language_model: Model) -> Callable[[], App]:
    """Return a function that opens the application as on a screen, with the language model selected."""
    from tests.helpers.app_driver import run_until

    def open_app() -> App:
        app = start(services={"load_model": load_model}, prompt="a proud king")
        app.prompting.blocking = app.jobs.blocking = False
        app.settings.gpt_base_url, app.settings.gpt_model = language_model.url, "m"
        app.language_model.choose("gpt")
        run_until(app, lambda: not app.jobs.busy(Slot("language model")))
        return app

    return open_app


def source(app: App) -> tuple[str, str]:
    """Return prompt A and the source of its answer."""
    answer = app.editor.session.live.prompt.a
    return answer.prompt, answer.source
