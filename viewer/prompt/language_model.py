"""The choice of who answers prompts, the library or a language model at a compatible endpoint: settings, test, and popup."""

import threading
from dataclasses import dataclass, field

from runtime.errors import SportError
from runtime.prompts.english.library import LibraryExpander
from runtime.prompts.expander import Expander
from runtime.prompts.gpt.settings import (
    DEFAULT_MODEL,
    OPENAI_URL,
    GptSettings,
    gpt_configured,
    has_credentials,
)
from viewer.gl_bindings import imgui
from viewer.gui import theme, widgets
from viewer.gui.theme import ICON
from viewer.gui.widgets import px
from viewer.jobs import Jobs, Slot
from viewer.prompt.prompt_controller import PromptController
from viewer.services import Loaded, Services
from viewer.settings import Settings


@dataclass
class LanguageModel:
    """The choice between library and language model. The key is only kept in memory."""

    settings: Settings
    jobs: Jobs
    services: Services
    controller: PromptController
    library: LibraryExpander | None = None  # the loaded model's library expander
    key: str = field(default="", repr=False)  # typed here: in memory only, never written
    problem: str = ""  # why the chosen language model cannot be used
    testing: bool = False
    report: str = ""  # result of the last test
    report_good: bool = False
    _stop: threading.Event = field(default_factory=threading.Event)

    @property
    def name(self) -> str:
        """Language model in use as "model at host", or "" for the library alone."""
        return self.controller.language_model

    @property
    def kind(self) -> str:
        """Who answers prompts, "library" or "gpt": the user's choice, or else that of the environment."""
        return self.settings.expander or ("gpt" if gpt_configured() else "library")

    def choose(self, kind: str) -> None:
        """Choose the library alone, or a language model with the library as fallback."""
        self.settings.expander = kind
        self.apply()

    def chosen(self) -> GptSettings | None:
        """Return the settings of the chosen language model, or None for the library; an error goes into `problem`."""
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
        """Apply the choice and settings, from the next prompt on."""
        self.report = ""
        settings, library = self.chosen(), self.library
        if library is None:
            return  # the model being loaded brings its library, and `use` checks the choice again

        def work() -> Expander:
            return library if settings is None else self.services.open_expander(library, settings)

        self.jobs.submit(Slot("language model"), work, self.controller.use_expander)

    def use(self, loaded: Loaded, given: GptSettings | None, again: bool = True) -> None:
        """Use the prompt workers of a newly loaded model, opened with the settings `given`, which may have changed since.

        `again`: codes of the session must be encoded anew for this model.
        """
        self.library = loaded.library
        changed = self.chosen() != given
        if changed:
            # prompts waiting for the model must not go to an endpoint that is no longer chosen
            for worker in loaded.prompts:
                worker.use(loaded.library)
        self.controller.use(loaded.prompts, again)
        if changed:
            self.apply()

    def test(self) -> None:
        if self.testing:
            return
        self.report, self.testing = "", True
        self.jobs.submit(Slot("test of the language model"), self._check, self._report)

    def _check(self) -> tuple[str, bool]:
        try:
            return self.services.check_endpoint(self._settings(), self._stop), True
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
        """Whether the environment has a key for the chosen address."""
        chosen = self.settings
        try:
            return bool(GptSettings.chosen(chosen.gpt_base_url, chosen.gpt_model).api_key)
        except SportError:
            return False

    def close(self) -> None:
        """Cancel a running test."""
        self._stop.set()


POPUP = "who answers"
WIDTH_PX = 340.0  # pixels at scale 1


def draw(model: LanguageModel, corner: imgui.ImVec2) -> None:
    """Draw the popup opened by `imgui.open_popup(POPUP)`, with its upper left corner at `corner`."""
    space = imgui.get_io().display_size
    width = min(px(WIDTH_PX), space.x - px(16))
    left = max(min(corner.x, space.x - width - px(8)), px(8))
    imgui.set_next_window_pos(imgui.ImVec2(left, corner.y), imgui.Cond_.appearing)
    imgui.set_next_window_size_constraints(
        imgui.ImVec2(width, 0), imgui.ImVec2(width, max(space.y - corner.y - px(8), px(60)))
    )
    if not imgui.begin_popup(POPUP):
        return
    widgets.label("Prompts are answered by")
    options = (("library", "Library"), ("gpt", "Language model"))
    kind = widgets.segmented("kind", options, model.kind)
    if kind != model.kind:
        model.choose(kind)
    if kind == "library":
        widgets.muted("On this machine, without a key or a network.", wrap=True)
    else:
        widgets.muted(
            "Prompts are sent to the endpoint. The library answers at once and whenever it fails.", wrap=True
        )
        _fields(model)
        _test(model)
    imgui.end_popup()


def _fields(model: LanguageModel) -> None:
    settings = model.settings
    settings.gpt_base_url, other_url = _text("Base URL", "##url", OPENAI_URL, settings.gpt_base_url)
    if has_credentials(settings.gpt_base_url):
        widgets.label("It may contain a key or a password, so it is not saved.", theme.WARNING)
    settings.gpt_model, other_model = _text("Model", "##model", DEFAULT_MODEL, settings.gpt_model)
    none = "none (endpoints of your own may need none)"
    hint = "from OPENAI_API_KEY" if model.key_from_environment else none
    model.key, other_key = _text("API key", "##key", hint, model.key, imgui.InputTextFlags_.password)
    widgets.label("The key stays in memory; it is never written to a file, log or take.")
    widgets.full_width()
    widgets.setting_slider(settings, "gpt_timeout_s")
    if other_url or other_model or other_key or imgui.is_item_deactivated_after_edit():
        model.apply()


def _text(label: str, name: str, hint: str, value: str, flags: int = 0) -> tuple[str, bool]:
    """Draw a field under its label; return its text, and whether it was left after an edit."""
    widgets.label(label)
    widgets.full_width()
    _, value = widgets.input_text(name, value, hint, flags)
    return value, bool(imgui.is_item_deactivated_after_edit())


def _test(model: LanguageModel) -> None:
    text = f"{ICON.clock} Asking…" if model.testing else f"{ICON.check} Test"
    if widgets.button(f"{text}###test", -1, "Ask the language model for one prompt", True, not model.testing):
        model.test()
    said, good = model.report or model.problem, model.report_good and bool(model.report)
    if not said and model.name:
        said, good = f"{model.name}, from the next prompt on", True
    if said:
        icon, tint = (ICON.check, theme.ACCENT) if good else (ICON.warning, theme.WARNING)
        widgets.text(f"{icon} {said}", tint, wrap=True)
