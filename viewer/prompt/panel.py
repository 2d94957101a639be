"""The prompt panel: the words, who answered, six editable descriptions, a blend, and prompts to choose from."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from viewer.gl_bindings import imgui
from viewer.gui import setting_widgets, theme, widgets
from viewer.gui.panels import Panel, PanelPlace
from viewer.gui.theme import ICON
from viewer.gui.widgets import px
from viewer.prompt import answer_panel, blend_panel, expander_panel, field_panel, parts_panel
from viewer.prompt.room import PromptRoom
from viewer.prompt.style_edit import Side

HINT = "How should the character move?\nFor example: an exhausted soldier"
NEAREST_ROWS = 3  # in a tall panel, else one
TALL = 620.0  # pixels at scale 1
MIN_LIST_HEIGHT = 150.0  # pixels at scale 1
TOOLS_WIDTH = 3 * 26.0 + 2 * 4.0  # pixels at scale 1


def panel(room: PromptRoom, shown: Callable[[], bool]) -> Panel:
    """The panel of the live prompt."""
    return Panel(
        "Prompt", PanelPlace.LEFT, lambda _: draw(room), ICON.prompt, shown,
        tools=partial(tools, room), tools_width=TOOLS_WIDTH, begin_typing=partial(_begin_typing, room),
    )  # fmt: skip


def _begin_typing(room: PromptRoom) -> None:
    room.state.boxes[Side.A].focus_requested = True


def tools(room: PromptRoom) -> None:
    """Undo, redo and who answers, beside the panel's title."""
    prompting, stack, expander = room.prompting, room.prompting.history, room.state.expander
    undoing, redoing = stack.undo_label or bool(room.state.asked), stack.redo_label
    if widgets.icon_button(
        ICON.undo, "undo", f"Undo {stack.undo_label} (Ctrl+Z)", theme.TEXT, bool(undoing), 26.0
    ):
        prompting.undo()
    imgui.same_line(0, px(4))
    if widgets.icon_button(ICON.redo, "redo", f"Redo {redoing} (Ctrl+Y)", theme.TEXT, bool(redoing), 26.0):
        prompting.redo()
    imgui.same_line(0, px(4))
    hint = expander.problem or f"Who answers prompts: {expander.language_model or 'the library'}"
    tint = theme.WARNING if expander.problem else theme.TEXT
    if widgets.icon_button(ICON.gear, "who", hint, tint, size=26.0):
        imgui.open_popup(expander_panel.POPUP)
    corner = imgui.ImVec2(
        imgui.get_window_pos().x + imgui.get_window_width() + px(8), imgui.get_window_pos().y
    )
    expander_panel.draw(room.expanders, corner)


def draw(room: PromptRoom) -> None:
    """Contents of the panel."""
    prompt, prompting = room.state, room.prompting
    # the button below stays in reach while the list is open
    field_panel.draw(room, Side.A, HINT, below=imgui.get_frame_height_with_spacing())
    _apply(room)
    rows = NEAREST_ROWS if imgui.get_window_height() >= px(TALL) else 1
    near = answer_panel.draw(prompt.edit.a, Side.A in prompt.asked, prompt, rows)
    if near is not None:
        prompting.submit_prompt(near)
    if not imgui.begin_tab_bar("prompt tabs"):
        return
    if widgets.tab("Body parts"):
        _scrolling("parts", lambda: parts_panel.draw(prompt, prompting))
        imgui.end_tab_item()
    blended = " •" if prompt.edit.blended else ""
    wanted = imgui.TabItemFlags_.set_selected if prompt.tab_requested == "blend" else 0
    if widgets.tab(f"Blend{blended}###blend", wanted):
        prompt.tab_requested = ""
        _scrolling("blend", lambda: blend_panel.draw(room))
        imgui.end_tab_item()
    if widgets.tab("Ready prompts"):
        _ready(room)
        imgui.end_tab_item()
    imgui.end_tab_bar()


def _apply(room: PromptRoom) -> None:
    """The button, how long the change takes and how far it goes."""
    width, text = imgui.get_content_region_avail().x, room.state.boxes[Side.A].text
    hint = "Enter in the box does the same; Ctrl+Enter begins a new line"
    if widgets.button(f"{ICON.wand} Apply", width * 0.29, hint, primary=True) and text.strip():
        room.prompting.submit_prompt(text)
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
    prompt = room.state
    widgets.full_width()
    _, prompt.search = imgui.input_text_with_hint("##search", f"{ICON.search} Search", prompt.search)
    words = prompt.search.lower().split()

    def found(texts: tuple[str, ...]) -> list[str]:
        return [text for text in texts if all(word in text.lower() for word in words)]

    recent, ready = found(tuple(room.settings.prompt_history)), found(prompt.ready)
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
    shown = room.state.edit.prompt(Side.A)
    for text in texts:
        if imgui.selectable(f"{widgets.elided(text, width)}##{name}{text}", text == shown)[0]:
            room.prompting.submit_prompt(text)
        if imgui.calc_text_size(text).x > width:
            widgets.tooltip(text)
    imgui.unindent(px(6))
