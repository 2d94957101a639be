"""The prompt panel: the words, who answered, six editable descriptions, and prompts to choose from."""

from __future__ import annotations

from runtime.skeleton import PART_NAMES
from viewer.gl_bindings import imgui
from viewer.panels import theme, widgets
from viewer.panels.theme import ICON
from viewer.panels.widgets import px
from viewer.prompting import Prompting
from viewer.state import AppState, PromptState

BLEND_RANGE_S = (0.1, 5.0)
GOOD_MATCH = 0.6  # cosine similarity from which the library's answer is near
_SENTENCE = imgui.InputTextFlags_.enter_returns_true | imgui.InputTextFlags_.ctrl_enter_for_new_line
_WRAPPED = _SENTENCE | imgui.InputTextFlags_.word_wrap
_ANSWERED = {
    "library": "Library",
    "gpt": "Language model",
    "explicit": "Your own words",
    "edited": "Edited by you",
}


def draw(state: AppState, prompting: Prompting) -> None:
    """Contents of the panel."""
    prompt = state.prompt
    _prompt_box(prompt, prompting)
    _answer(prompt)
    _blend_time(state)
    imgui.dummy(imgui.ImVec2(0, px(2)))
    if imgui.begin_tab_bar("prompt tabs"):
        if imgui.begin_tab_item("Body parts")[0]:
            _parts(prompt, prompting)
            imgui.end_tab_item()
        if imgui.begin_tab_item("Ready prompts")[0]:
            _ready(prompt, prompting)
            imgui.end_tab_item()
        imgui.end_tab_bar()


def _prompt_box(prompt: PromptState, prompting: Prompting) -> None:
    if prompt.focus_requested:
        imgui.set_keyboard_focus_here()
        prompt.focus_requested = False
    size = imgui.ImVec2(-1, imgui.get_text_line_height() * 2 + px(14))
    entered, prompt.text = imgui.input_text_multiline("##prompt", prompt.text, size, _WRAPPED)
    if not prompt.text and not imgui.is_item_active():
        _hint_over_item("How should the character move?\nFor example: an exhausted soldier")
    apply = widgets.button(
        f"{ICON.wand} Apply", -1, "Enter in the box does the same; Ctrl+Enter begins a new line", primary=True
    )
    if (entered or apply) and prompt.text.strip():
        prompting.submit_prompt(prompt.text)


def _hint_over_item(text: str) -> None:
    corner, pad = imgui.get_item_rect_min(), imgui.get_style().frame_padding
    color = imgui.get_color_u32(imgui.ImVec4(*theme.MUTED[:3], 0.8))
    imgui.get_window_draw_list().add_text(imgui.ImVec2(corner.x + pad.x, corner.y + pad.y), color, text)


def _answer(prompt: PromptState) -> None:
    """One line on who filled the fields, with the nearest library prompts as its tooltip."""
    if not prompt.available:
        widgets.muted(f"{ICON.warning} Prompts need a motion model.")
        return
    if prompt.busy:
        widgets.muted(
            f"{ICON.clock} Preparing the style…"
            if prompt.shown_prompt or prompt.text
            else f"{ICON.clock} Loading…"
        )
        return
    if not prompt.answered_by:
        widgets.muted(f"{ICON.note} Type a prompt, or choose a ready one.")
        return
    near = prompt.nearest[0] if prompt.nearest and prompt.answered_by == "library" else None
    text = _ANSWERED.get(prompt.answered_by, prompt.answered_by)
    good = near is None or near[1] >= GOOD_MATCH
    if prompt.note:
        good, text = False, prompt.note
    elif near is not None:
        text += f", {near[1]:.0%} like “{near[0]}”"
    with widgets.color(imgui.Col_.text, theme.ACCENT if good else theme.WARNING):
        imgui.text_unformatted(ICON.check if good else ICON.warning)
    imgui.same_line(0, px(4))
    with widgets.color(imgui.Col_.text, theme.MUTED):
        imgui.text_unformatted(widgets.elided(text, imgui.get_content_region_avail().x))
    widgets.tooltip(_explain(prompt))


def _explain(prompt: PromptState) -> str:
    lines = [prompt.note] if prompt.note else []
    if prompt.nearest:
        lines.append("Nearest prompts of the library:")
        lines += [f"  {score:.0%}  {text}" for text, score in prompt.nearest[:5]]
    lines.append(f"Answered in {prompt.milliseconds:.0f} ms.")
    return "\n".join(lines)


def _blend_time(state: AppState) -> None:
    widgets.full_width()
    low, high = BLEND_RANGE_S
    changed, value = widgets.slider(
        "##blend", state.settings.blend_seconds, low, high, "Blend over %.1f s", True
    )
    if changed:
        state.settings.blend_seconds = value
    widgets.tooltip("How long the character takes to change from one style to the next")


def _parts(prompt: PromptState, prompting: Prompting) -> None:
    """The six fields share the height that is left, but each shows at least two lines."""
    labels = px(13 + 3)
    spacing = imgui.get_style().item_spacing.y
    free = imgui.get_content_region_avail().y / len(PART_NAMES) - labels - 2 * spacing
    line = imgui.get_text_line_height()
    height = min(max(free, 2 * line + px(12)), 4 * line + px(12))
    for part in PART_NAMES:
        text = prompt.parts[part]
        edited = bool(prompt.applied) and text != prompt.applied.get(part, "")
        widgets.label(part.replace("_", " ").capitalize())
        if edited:
            imgui.same_line()
            widgets.label("Enter applies", theme.ACCENT)
        size = imgui.ImVec2(-1, height)
        entered, prompt.parts[part] = imgui.input_text_multiline(f"##{part}", text, size, _WRAPPED)
        if entered:
            prompting.submit_parts()


def _ready(prompt: PromptState, prompting: Prompting) -> None:
    widgets.full_width()
    _, prompt.search = imgui.input_text_with_hint("##search", f"{ICON.search} Search", prompt.search)
    words = prompt.search.lower().split()
    found = [text for text in prompt.ready if all(word in text.lower() for word in words)]
    if imgui.begin_child("ready list", imgui.ImVec2(0, 0)):
        if not found:
            widgets.muted("No prompt has these words. Type it above: any prompt works.", wrap=True)
        imgui.indent(px(6))  # the highlight of a row begins left of its words
        width = imgui.get_content_region_avail().x
        for text in found:
            chosen = text == prompt.shown_prompt
            if imgui.selectable(f"{widgets.elided(text, width)}##{text}", chosen)[0]:
                prompting.submit_prompt(text)
            if imgui.calc_text_size(text).x > width:
                widgets.tooltip(text)
        imgui.unindent(px(6))
    imgui.end_child()
