"""Who answers prompts: the library or a language model, its settings, and whether it can be reached."""

from __future__ import annotations

import threading
from dataclasses import dataclass, field

from runtime.errors import SportError
from runtime.prompts.expander import Expander
from runtime.prompts.gpt.settings import GptSettings, gpt_configured
from viewer.jobs import Jobs, Slot
from viewer.prompt.prompt_controller import PromptController
from viewer.services import LibraryLike, Loaded, Services
from viewer.settings import Settings


@dataclass
class LanguageModel:
    """The choice of who answers. The key is held in memory, handed on, and kept nowhere else."""

    settings: Settings
    jobs: Jobs
    services: Services
    controller: PromptController
    library: LibraryLike | None = None  # the loaded model's library expander
    key: str = field(default="", repr=False)  # typed here: in memory only, never written
    problem: str = ""  # why no language model can be asked though one was chosen
    testing: bool = False
    report: str = ""  # what the last test said
    report_good: bool = False
    _stop: threading.Event = field(default_factory=threading.Event)

    @property
    def name(self) -> str:
        """ "model at host" while one is asked, "" when the library answers alone."""
        return self.controller.language_model

    @property
    def kind(self) -> str:
        """ "library" or "gpt": as chosen, else as the environment says."""
        return self.settings.expander or ("gpt" if gpt_configured() else "library")

    def choose(self, kind: str) -> None:
        """Let the library alone answer, or a language model with the library behind it."""
        self.settings.expander = kind
        self.apply()

    def chosen(self) -> GptSettings | None:
        """The language model to ask, None for the library alone; what is wrong with its settings is the `problem`."""
        self.problem = self.controller.language_model = ""
        if self.kind != "gpt":
            return None
        try:
            settings = self._settings()
        except SportError as error:
            self.problem = str(error)
            return None
        self.controller.language_model = f"{settings.model} at {settings.host}"
        return settings

    def apply(self) -> None:
        """Put the choice and the settings into force, from the next prompt on."""
        self.report = ""
        settings, library = self.chosen(), self.library
        if library is None:
            return  # the model that is being loaded brings its library, and `use` looks at the choice again

        def work() -> Expander:
            return library if settings is None else self.services.open_expander(library, settings)

        self.jobs.submit(Slot("language model"), work, self.controller.use_expander)

    def use(self, loaded: Loaded, given: GptSettings | None, again: bool = True) -> None:
        """Let a loaded model's workers answer; they were opened to ask `given`, which may no longer be the choice.

        `again`: what the session moves by was encoded by another model.
        """
        self.library = loaded.library
        changed = self.chosen() != given
        if changed:
            # what waits for the model must not be sent where it was chosen not to go
            for worker in loaded.prompts:
                worker.use(loaded.library)
        self.controller.use(loaded.prompts, again)
        if changed:
            self.apply()

    def test(self) -> None:
        """Ask the language model one question and report."""
        if self.testing:
            return
        self.report = ""
        try:
            settings = self._settings()
        except SportError as error:
            self.report, self.report_good = str(error), False
            return
        self.testing = True
        self.jobs.submit(Slot("test of the language model"), lambda: self._check(settings), self._report)

    def _check(self, settings: GptSettings) -> tuple[str, bool]:
        try:
            return self.services.check_endpoint(settings, self._stop), True
        except SportError as error:
            return str(error), False

    def _report(self, outcome: tuple[str, bool]) -> None:
        self.testing = False
        self.report, self.report_good = outcome

    def _settings(self) -> GptSettings:
        chosen = self.settings
        return GptSettings.chosen(chosen.gpt_base_url, chosen.gpt_model, chosen.gpt_timeout_s, self.key)

    @property
    def key_from_environment(self) -> bool:
        """Whether the environment has a key for the address chosen."""
        chosen = self.settings
        try:
            return bool(GptSettings.chosen(chosen.gpt_base_url, chosen.gpt_model).api_key)
        except SportError:
            return False

    def close(self) -> None:
        """Do not wait for a test that is under way."""
        self._stop.set()
