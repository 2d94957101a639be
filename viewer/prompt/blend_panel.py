"""Blending with a second prompt: a share of it for each body part, and one slider for all."""

from __future__ import annotations

from runtime.prompts.answer import Answer
from runtime.session.prompt_blend import PromptBlend, Side
from runtime.skeleton import PART_NAMES
from viewer.gl_bindings import imgui
from viewer.gui import theme, widgets
from viewer.gui.theme import ICON
from viewer.gui.widgets import px
from viewer.prompt import answer_panel, prompt_field
from viewer.prompt.prompt_controller import PromptController
from viewer.prompt.suggestions import Suggester

NAME_WIDTH = 70.0  # pixels at scale 1
HINT = "A second prompt to blend with"


def draw(controller: PromptController, suggester: Suggester) -> None:
    """Prompt B, who answered it, and the sliders."""
    widgets.label("Prompt B")
    prompt_field.draw(controller, suggester, Side.B, HINT, lines=1)
    blend, waits = controller.prompt, bool(controller.asked)
    if blend.b is None:
        if Side.B in controller.asked:
            answer_panel.draw(controller, Side.B, rows=0)
        else:
            widgets.muted("Type a second prompt: each body part then takes its share of it.", wrap=True)
        return
    answer_panel.draw(controller, Side.B, rows=0, lines=1)
    imgui.dummy(imgui.ImVec2(0, px(1)))
    _ends()
    _all(blend, controller)
    imgui.separator()
    for part, share in zip(PART_NAMES, blend.weights, strict=True):
        _part(part, share, blend, controller)
    imgui.dummy(imgui.ImVec2(0, px(1)))
    _buttons(waits, controller)


def _ends() -> None:
    """What the two ends of the sliders are."""
    width = imgui.get_content_region_avail().x
    left, right = px(NAME_WIDTH), width - imgui.calc_text_size("Prompt B").x * 0.87
    imgui.set_cursor_pos_x(imgui.get_cursor_pos_x() + left)
    widgets.label("Prompt A")
    imgui.same_line(imgui.get_cursor_start_pos().x + right)
    widgets.label("Prompt B")


def _all(blend: PromptBlend, controller: PromptController) -> None:
    imgui.begin_disabled(len(blend.locked) == len(PART_NAMES))
    moved, share = _slider("All", "all", blend.master_weight, px(NAME_WIDTH))
    if moved:
        controller.set_all_weights(share)
    imgui.end_disabled()
    widgets.tooltip("Every part that is not locked")


def _part(part: str, share: float, blend: PromptBlend, controller: PromptController) -> None:
    name, locked = part.replace("_", " "), part in blend.locked
    imgui.begin_disabled(locked)
    moved, value = _slider(name.capitalize(), part, share, px(NAME_WIDTH), imgui.get_frame_height() + px(2))
    imgui.end_disabled()
    if moved:
        controller.set_weight(part, value)
    widgets.tooltip(f"A: {_words(blend.a, part)}\nB: {_words(blend.b, part)}")
    imgui.same_line(0, px(4))
    hint = (
        "Locked: no prompt and no slider changes this part" if locked else "Hold this part's words and share"
    )
    icon, tint = (ICON.lock, theme.ACCENT) if locked else (ICON.unlock, theme.MUTED)
    if widgets.icon_button(icon, f"lock {part}", hint, tint):
        controller.toggle_lock(part)


def _slider(text: str, name: str, share: float, left: float, spare: float = 0.0) -> tuple[bool, float]:
    start = imgui.get_cursor_pos_x()
    imgui.align_text_to_frame_padding()
    widgets.muted(text)
    imgui.same_line(start + left)
    imgui.set_next_item_width(imgui.get_content_region_avail().x - spare)
    moved, percent = widgets.slider(f"##{name}", 100.0 * share, 0.0, 100.0, "%.0f%% B")
    return moved, min(max(percent / 100.0, 0.0), 1.0)


def _buttons(waits: bool, controller: PromptController) -> None:
    half = (imgui.get_content_region_avail().x - px(4)) / 2
    imgui.begin_disabled(waits)
    hint = "Prompt B becomes prompt A, whose words can be edited; the character moves on as it does"
    if widgets.button(f"{ICON.exchange} Swap A and B", half, hint):
        controller.swap()
    imgui.end_disabled()
    imgui.same_line(0, px(4))
    if widgets.button(f"{ICON.close} No blend", half, "Back to prompt A alone"):
        controller.drop_blend()


def _words(answer: Answer | None, part: str) -> str:
    return "" if answer is None else str(getattr(answer.words, part))
