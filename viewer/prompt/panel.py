"""The prompt panel: the words, who answered, six editable descriptions, a blend, and prompts to choose from."""

from __future__ import annotations

from collections.abc import Callable

from sport.viewer.actions import Actions
from sport.viewer.gl_bindings import imgui
from sport.viewer.gui import theme, widgets
from sport.viewer.gui.theme import ICON
from sport.viewer.gui.widgets import px
from sport.viewer.prompt import (
    answer_panel as prompt_answer,
)
from sport.viewer.prompt import (
    blend_panel as prompt_blend,
)
from sport.viewer.prompt import (
    expander_panel as expander,
)
from sport.viewer.prompt import (
    field_panel as prompt_field,
)
from sport.viewer.prompt import (
    parts_panel as prompt_parts,
)
from sport.viewer.prompt.prompting import Prompting
from sport.viewer.state import AppState, PromptState

BLEND_RANGE_S = (0.1, 5.0)
HINT = "How should the character move?\nFor example: an exhausted soldier"
NEAREST_ROWS = 3  # in a tall panel, else one
TALL = 620.0  # pixels at scale 1
MIN_LIST_HEIGHT = 150.0  # pixels at scale 1
TOOLS_WIDTH = 3 * 26.0 + 2 * 4.0  # pixels at scale 1


def tools(state: AppState, actions: Actions) -> None:
    """Undo, redo and who answers, beside the panel's title."""
    prompting, stack = actions.prompting, actions.prompting.history
    undoing, redoing = stack.undo_label or bool(state.prompt.asked), stack.redo_label
    if widgets.icon_button(
        ICON.undo, "undo", f"Undo {stack.undo_label} (Ctrl+Z)", theme.TEXT, bool(undoing), 26.0
    ):
        prompting.undo()
    imgui.same_line(0, px(4))
    if widgets.icon_button(ICON.redo, "redo", f"Redo {redoing} (Ctrl+Y)", theme.TEXT, bool(redoing), 26.0):
        prompting.redo()
    imgui.same_line(0, px(4))
    wrong = bool(state.expander.problem)
    hint = state.expander.problem or f"Who answers prompts: {state.expander.language_model or 'the library'}"
    if widgets.icon_button(ICON.gear, "who", hint, theme.WARNING if wrong else theme.TEXT, size=26.0):
        imgui.open_popup(expander.POPUP)
    corner = imgui.ImVec2(
        imgui.get_window_pos().x + imgui.get_window_width() + px(8), imgui.get_window_pos().y
    )
    expander.draw(state, actions.expanders, corner)


def draw(state: AppState, actions: Actions) -> None:
    """Contents of the panel."""
    prompt, prompting = state.prompt, actions.prompting
    _prompt_box(prompt, actions)
    _apply(state, actions)
    rows = NEAREST_ROWS if imgui.get_window_height() >= px(TALL) else 1
    near = prompt_answer.draw(prompt.edit.a, "a" in prompt.asked, state, rows)
    if near is not None:
        prompting.submit_prompt(near)
    if not imgui.begin_tab_bar("prompt tabs"):
        return
    if imgui.begin_tab_item("Body parts")[0]:
        _scrolling("parts", lambda: prompt_parts.draw(prompt, prompting))
        imgui.end_tab_item()
    blended = " •" if prompt.edit.blended else ""
    wanted = imgui.TabItemFlags_.set_selected if prompt.tab_requested == "blend" else 0
    if imgui.begin_tab_item(f"Blend{blended}###blend", None, wanted)[0]:
        prompt.tab_requested = ""
        _scrolling("blend", lambda: prompt_blend.draw(state, prompting, actions.suggester))
        imgui.end_tab_item()
    if imgui.begin_tab_item("Ready prompts")[0]:
        _ready(state, prompting)
        imgui.end_tab_item()
    imgui.end_tab_bar()


def _prompt_box(prompt: PromptState, actions: Actions) -> None:
    applied = "" if prompt.edit.a is None else prompt.edit.a.prompt
    button = imgui.get_frame_height_with_spacing()  # stays in reach while the list is open
    chosen = prompt_field.draw(
        "##prompt", prompt.box, HINT, actions.suggester, actions.prompting, applied, below=button
    )
    if chosen is not None:
        actions.prompting.submit_prompt(chosen)


def _apply(state: AppState, actions: Actions) -> None:
    """The button, how long the change takes and how far it goes."""
    width = imgui.get_content_region_avail().x
    hint = "Enter in the box does the same; Ctrl+Enter begins a new line"
    if (
        widgets.button(f"{ICON.wand} Apply", width * 0.4, hint, primary=True)
        and state.prompt.box.text.strip()
    ):
        actions.prompting.submit_prompt(state.prompt.box.text)
    imgui.same_line(0, px(6))
    widgets.full_width()
    low, high = BLEND_RANGE_S
    seconds = state.settings.blend_seconds
    changed, value = widgets.slider("##seconds", seconds, low, high, "change over %.1f s", True)
    if changed:
        state.settings.blend_seconds = value
    widgets.tooltip("How long the character takes to change from one style to the next")
    widgets.full_width()
    percent = 100.0 * state.settings.strength
    changed, value = widgets.slider("##strength", percent, 0.0, 150.0, "strength %.0f %%")
    if changed:
        actions.scene.set_strength(round(value) / 100.0)
    widgets.tooltip(
        "How far the style goes from plain walking: 0 leaves it out, more than 100 exaggerates it"
    )


def _scrolling(name: str, contents: Callable[[], None]) -> None:
    """Contents that scroll in the height that is left, or with the whole panel where that is too little."""
    if imgui.get_content_region_avail().y < px(MIN_LIST_HEIGHT):
        contents()
        return
    if imgui.begin_child(name, imgui.ImVec2(0, 0)):
        contents()
    imgui.end_child()


def _ready(state: AppState, prompting: Prompting) -> None:
    """The person's last prompts and one for each style that the model knows."""
    prompt = state.prompt
    widgets.full_width()
    _, prompt.search = imgui.input_text_with_hint("##search", f"{ICON.search} Search", prompt.search)
    words = prompt.search.lower().split()

    def found(texts: tuple[str, ...]) -> list[str]:
        return [text for text in texts if all(word in text.lower() for word in words)]

    recent, ready = found(tuple(state.settings.prompt_history)), found(prompt.ready)
    height = max(imgui.get_content_region_avail().y, px(MIN_LIST_HEIGHT))
    if imgui.begin_child("ready list", imgui.ImVec2(0, height)):
        if not recent and not ready:
            widgets.muted("No prompt has these words. Type it above: any prompt works.", wrap=True)
        for title, texts in (("Your last prompts", recent), ("One for each style of the model", ready)):
            if texts:
                widgets.label(title)
                _choices(title, texts, prompt, prompting)
    imgui.end_child()


def _choices(name: str, texts: list[str], prompt: PromptState, prompting: Prompting) -> None:
    imgui.indent(px(6))  # the highlight of a row begins left of its words
    width = imgui.get_content_region_avail().x
    shown = "" if prompt.edit.a is None else prompt.edit.a.prompt
    for text in texts:
        if imgui.selectable(f"{widgets.elided(text, width)}##{name}{text}", text == shown)[0]:
            prompting.submit_prompt(text)
        if imgui.calc_text_size(text).x > width:
            widgets.tooltip(text)
    imgui.unindent(px(6))
