"""Who answers prompts: the library, or a language model at any compatible endpoint."""

from __future__ import annotations

from runtime.prompts.gpt.settings import DEFAULT_MODEL, OPENAI_URL, has_credentials
from viewer.gl_bindings import imgui
from viewer.gui import setting_widgets, theme, widgets
from viewer.gui.theme import ICON
from viewer.gui.widgets import px
from viewer.prompt.language_model import LanguageModel

POPUP = "who answers"
WIDTH = 340.0  # pixels at scale 1
_ENTER = imgui.InputTextFlags_.enter_returns_true


def draw(model: LanguageModel, corner: imgui.ImVec2) -> None:
    """The popup, where it was opened by `imgui.open_popup(POPUP)`; its upper left corner is at `corner`."""
    space = imgui.get_io().display_size
    width = min(px(WIDTH), space.x - px(16))
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
    settings, changed = model.settings, False
    widgets.label("Base URL")
    done, settings.gpt_base_url = _text("##url", OPENAI_URL, settings.gpt_base_url)
    changed |= done
    if has_credentials(settings.gpt_base_url):
        widgets.label("It may hold a key or a password: it is not kept for the next start.", theme.WARNING)
    widgets.label("Model")
    done, settings.gpt_model = _text("##model", DEFAULT_MODEL, settings.gpt_model)
    changed |= done
    widgets.label("API key")
    hint = (
        "from OPENAI_API_KEY" if model.key_from_environment else "none (endpoints of your own may need none)"
    )
    done, model.key = _text("##key", hint, model.key, imgui.InputTextFlags_.password)
    changed |= done
    widgets.label("The key stays in memory: no file, no log, no take has it.")
    widgets.full_width()
    setting_widgets.slider(settings, "gpt_timeout_s")
    changed |= imgui.is_item_deactivated_after_edit()
    if changed:
        model.apply()


def _text(name: str, hint: str, value: str, flags: int = 0) -> tuple[bool, str]:
    widgets.full_width()
    _, value = imgui.input_text_with_hint(name, hint, value, flags | _ENTER)
    return bool(imgui.is_item_deactivated_after_edit()), value


def _test(model: LanguageModel) -> None:
    imgui.begin_disabled(model.testing)
    text = f"{ICON.clock} Asking…" if model.testing else f"{ICON.check} Test"
    if widgets.button(f"{text}###test", -1, "Ask the language model for one prompt", primary=True):
        model.test()
    imgui.end_disabled()
    said, good = model.report or model.problem, model.report_good and bool(model.report)
    if not said and model.name:
        said, good = f"{model.name}, from the next prompt on", True
    if said:
        with widgets.color(imgui.Col_.text, theme.ACCENT if good else theme.WARNING):
            imgui.text_wrapped(f"{ICON.check if good else ICON.warning} {said}".replace("%", "%%"))
