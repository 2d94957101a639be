"""The prompt panel: the words, who answered, six editable descriptions, a blend, and prompts to choose from."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

from runtime.prompts.gpt.settings import GptSettings
from runtime.session.prompt_blend import Side
from viewer.gl_bindings import imgui
from viewer.gui import setting_widgets, theme, widgets
from viewer.gui.panels import Panel, PanelPlace
from viewer.gui.theme import ICON
from viewer.gui.widgets import px
from viewer.prompt import answer_panel, blend_panel, language_model_panel, parts_panel, prompt_field
from viewer.prompt.language_model import LanguageModel
from viewer.prompt.prompt_controller import PromptController
from viewer.prompt.suggestions import Suggester
from viewer.services import Loaded
from viewer.settings import Settings

HINT = "How should the character move?\nFor example: an exhausted soldier"
NEAREST_ROWS = 3  # in a tall panel, else one
TALL = 620.0  # pixels at scale 1
MIN_LIST_HEIGHT = 150.0  # pixels at scale 1
TOOLS_WIDTH = 3 * 26.0 + 2 * 4.0  # pixels at scale 1


@dataclass
class PromptRoom:
    """What the prompt panel is drawn from."""

    settings: Settings
    controller: PromptController
    language_model: LanguageModel
    suggester: Suggester
    compare: Callable[[], None]  # opens the compare view
    model: str = ""  # the loaded one's name
    search: str = ""
    tab_requested: str = ""  # "blend": shown from the next frame on

    def use_model(self, loaded: Loaded, given: GptSettings | None, again: bool = True) -> None:
        """Let a loaded model answer, whose workers were opened to ask `given`.

        `again`: what the session moves by was encoded by another model.
        """
        self.model = loaded.name
        self.controller.even_blends.use(loaded.perceptual_weights)
        self.suggester.nearest = loaded.library.nearest
        self.language_model.use(loaded, given, again)


def panel(room: PromptRoom, shown: Callable[[], bool]) -> Panel:
    """The panel of the live prompt."""
    return Panel(
        "Prompt", PanelPlace.LEFT, lambda _: draw(room), ICON.prompt, shown,
        tools=partial(tools, room), tools_width=TOOLS_WIDTH, begin_typing=partial(_begin_typing, room),
    )  # fmt: skip


def _begin_typing(room: PromptRoom) -> None:
    room.controller.boxes[Side.A].focus_requested = True


def tools(room: PromptRoom) -> None:
    """Undo, redo and who answers, in the line of the panel's title."""
    editor, model = room.controller.editor, room.language_model
    undoing, redoing = editor.undo_label, editor.redo_label
    active = bool(undoing or room.controller.asked)
    if widgets.icon_button(ICON.undo, "undo", f"Undo {undoing} (Ctrl+Z)", theme.TEXT, active, 26.0):
        editor.undo()
    imgui.same_line(0, px(4))
    if widgets.icon_button(ICON.redo, "redo", f"Redo {redoing} (Ctrl+Y)", theme.TEXT, bool(redoing), 26.0):
        editor.redo()
    imgui.same_line(0, px(4))
    hint = model.problem or f"Who answers prompts: {model.name or 'the library'}"
    tint = theme.WARNING if model.problem else theme.TEXT
    if widgets.icon_button(ICON.gear, "who", hint, tint, size=26.0):
        imgui.open_popup(language_model_panel.POPUP)
    corner = imgui.ImVec2(
        imgui.get_window_pos().x + imgui.get_window_width() + px(8), imgui.get_window_pos().y
    )
    language_model_panel.draw(model, corner)


def draw(room: PromptRoom) -> None:
    """Contents of the panel."""
    controller, suggester = room.controller, room.suggester
    # the button below stays in reach while the list is open
    below = imgui.get_frame_height_with_spacing()
    prompt_field.draw(controller, suggester, Side.A, HINT, below=below)
    _apply(room)
    rows = NEAREST_ROWS if imgui.get_window_height() >= px(TALL) else 1
    near = answer_panel.draw(controller, Side.A, rows)
    if near is not None:
        controller.submit_prompt(near)
    if not imgui.begin_tab_bar("prompt tabs"):
        return
    if widgets.tab("Body parts"):
        _scrolling("parts", lambda: parts_panel.draw(controller, room.model))
        imgui.end_tab_item()
    blended = " •" if controller.prompt.blended else ""
    wanted = imgui.TabItemFlags_.set_selected if room.tab_requested == "blend" else 0
    if widgets.tab(f"Blend{blended}###blend", wanted):
        room.tab_requested = ""
        _scrolling("blend", lambda: blend_panel.draw(controller, suggester))
        imgui.end_tab_item()
    if widgets.tab("Ready prompts"):
        _ready(room)
        imgui.end_tab_item()
    imgui.end_tab_bar()


def _apply(room: PromptRoom) -> None:
    """The button, how long the change takes and how far it goes."""
    width, text = imgui.get_content_region_avail().x, room.controller.boxes[Side.A].text
    hint = "Enter in the box does the same; Ctrl+Enter begins a new line"
    if widgets.button(f"{ICON.wand} Apply", width * 0.29, hint, primary=True) and text.strip():
        room.controller.submit_prompt(text)
    imgui.same_line(0, px(4))
    hint = "Seeds, blends or prompts side by side on one stick (V)"
    if widgets.button("Compare", width * 0.27, hint):
        room.compare()
    imgui.same_line(0, px(4))
    widgets.full_width()
    setting_widgets.slider(room.settings, "blend_seconds")
    widgets.full_width()
    setting_widgets.slider(room.settings, "strength")


def _scrolling(name: str, contents: Callable[[], None]) -> None:
    """Contents that scroll in the height that is left, or with the whole panel where that is too little."""
    if imgui.get_content_region_avail().y < px(MIN_LIST_HEIGHT):
        contents()
        return
    if imgui.begin_child(name, imgui.ImVec2(0, 0)):
        contents()
    imgui.end_child()


def _ready(room: PromptRoom) -> None:
    """The user's last prompts and one for each style that the model knows."""
    widgets.full_width()
    _, room.search = imgui.input_text_with_hint("##search", f"{ICON.search} Search", room.search)
    words = room.search.lower().split()

    def found(texts: tuple[str, ...]) -> list[str]:
        return [text for text in texts if all(word in text.lower() for word in words)]

    recent, ready = found(tuple(room.settings.prompt_history)), found(room.suggester.ready)
    height = max(imgui.get_content_region_avail().y, px(MIN_LIST_HEIGHT))
    if imgui.begin_child("ready list", imgui.ImVec2(0, height)):
        if not recent and not ready:
            widgets.muted("No prompt has these words. Type it above: any prompt works.", wrap=True)
        for title, texts in (("Your last prompts", recent), ("One for each style of the model", ready)):
            if texts:
                widgets.label(title)
                _choices(title, texts, room)
    imgui.end_child()


def _choices(name: str, texts: list[str], room: PromptRoom) -> None:
    imgui.indent(px(6))  # the highlight of a row begins left of its words
    width = imgui.get_content_region_avail().x
    shown = room.controller.prompt.prompt(Side.A)
    for text in texts:
        if imgui.selectable(f"{widgets.elided(text, width)}##{name}{text}", text == shown)[0]:
            room.controller.submit_prompt(text)
        if imgui.calc_text_size(text).x > width:
            widgets.tooltip(text)
    imgui.unindent(px(6))
