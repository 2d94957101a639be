"""The prompt room as one: its slice of the state, its actions, and the way to a model that is loaded."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from runtime.prompts.gpt.settings import GptSettings
from viewer.jobs import Jobs, Slot
from viewer.prompt.expanders import Expanders
from viewer.prompt.prompting import Prompting
from viewer.prompt.state import PromptState
from viewer.prompt.suggester import Suggester
from viewer.services import Loaded, Services
from viewer.settings import Settings


@dataclass
class PromptRoom:
    """What the prompt panels are drawn from."""

    state: PromptState
    settings: Settings
    prompting: Prompting
    expanders: Expanders
    suggester: Suggester
    compare: Callable[[], None]  # opens the wall

    def load_library(self, jobs: Jobs, services: Services) -> None:
        """Fetch the prompts to choose from and to suggest."""
        jobs.submit(Slot("library"), services.library_prompts, self._take_library)

    def _take_library(self, prompts: tuple[tuple[str, ...], tuple[str, ...]]) -> None:
        self.state.ready, self.state.library = prompts

    def use_model(self, loaded: Loaded, given: GptSettings | None) -> None:
        """Let a loaded model answer, whose workers were opened to ask `given`."""
        self.state.available, self.state.model = True, loaded.name
        if self.prompting.even_blends is not None:
            self.prompting.even_blends.use(loaded.even_shares)
        self.suggester.nearest = loaded.library.nearest
        self.expanders.use(loaded, given)

    def lose_model(self) -> None:
        """There is no model to answer."""
        self.state.available = self.state.loading = False
