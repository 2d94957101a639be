"""Source of a prompt's answer, the nearest prompts with similarity bars, and remarks."""

from runtime.prompts.answer import Answer
from runtime.session.prompt_blend import PromptBlend, Side
from viewer.gl_bindings import imgui
from viewer.gui import theme, widgets
from viewer.gui.theme import ICON
from viewer.gui.widgets import px
from viewer.prompt.prompt_controller import PromptController, named

NEAR_COSINE = 0.6  # similarity above which a library prompt is near
BAR_WIDTH_PX = 46.0  # at scale 1
_ANSWERED = {  # by source of an answer
    "library": ("Library", "Composed from the shipped library's nearest prompts"),
    "gpt": ("GPT", "Written by the language model"),
    "explicit": ("Explicit", "The prompt itself describes the parts"),
}


def draw_answer(
    controller: PromptController, blend: PromptBlend, side: Side, rows: int, lines: int = 2
) -> str:
    """Draw an answer with up to `rows` nearest prompts and `lines` of remarks; return a clicked prompt, or ""."""
    answer, pending = blend.answers[side], side in controller.pending
    missing = _missing(controller, answer, pending)
    if missing or answer is None:
        widgets.muted(missing, wrap=True)
        return ""
    _who(answer, pending, controller.language_model, rows)
    chosen = ""
    if answer.source != "gpt":
        for text, similarity in answer.nearest[: min(rows, 1) if answer.note else rows]:
            chosen = text if _near(text, similarity) else chosen
    if answer.note:
        far = bool(answer.nearest) and answer.nearest[0][1] < NEAR_COSINE
        _note(answer.note, far or answer.note.startswith("Language model"), lines)
    return chosen


def _missing(controller: PromptController, answer: Answer | None, pending: bool) -> str:
    """Return the text shown instead of a missing answer; "" if there is an answer."""
    if not controller.available:
        return f"{ICON.warning} Prompts need a motion model."
    if answer is None:
        if controller.loading:
            return f"{ICON.clock} Loading…"
        return f"{ICON.clock} Preparing the style…" if pending else f"{ICON.note} Type a prompt."
    if pending or not answer.prompt or any(box.text.strip() for box in controller.boxes):
        return ""
    return f"{ICON.note} Type a prompt; “{answer.prompt}” stays in force until then."


def _who(answer: Answer, pending: bool, model: str, rows: int) -> None:
    name, hint = _ANSWERED.get(answer.source, (answer.source, ""))
    widgets.tag(name)
    widgets.tooltip(f"{hint}, in {answer.milliseconds:.0f} ms")
    if answer.edited:
        widgets.same_line()
        widgets.tag("edited", theme.MUTED)
        widgets.tooltip(f"Words of {', '.join(map(named, answer.edited))} are yours")
    imgui.same_line(0, px(7))
    widgets.fitted(_summary(answer, pending, model, rows), imgui.get_content_region_avail().x)


def _summary(answer: Answer, pending: bool, model: str, rows: int) -> str:
    if pending:
        return f"{ICON.clock} asking {model or 'for the next'}…"
    if answer.source == "gpt":
        return model or "language model"
    if answer.source == "explicit":
        return "your own words"
    if answer.nearest and not rows:
        text, similarity = answer.nearest[0]
        return f"{max(similarity, 0.0):.0%} like “{text}”"
    return "nearest prompts" if answer.nearest else "no style named"


def _near(text: str, similarity: float) -> bool:
    """Draw one of the nearest prompts with a bar of its similarity; return whether it was clicked."""
    width, height = imgui.get_content_region_avail().x, imgui.get_text_line_height() + px(2)
    corner = imgui.get_cursor_screen_pos()
    imgui.push_style_var(imgui.StyleVar_.item_spacing, imgui.ImVec2(0, px(1)))
    clicked = imgui.invisible_button(f"near {text}", imgui.ImVec2(width, height))
    imgui.pop_style_var()
    hovered = imgui.is_item_hovered()
    widgets.tooltip(f"Cosine similarity {similarity:.2f} with “{text}”. Click to use it.")
    drawing, fraction = imgui.get_window_draw_list(), min(max(similarity, 0.0), 1.0)
    percent, top = f"{fraction:.0%}", corner.y + px(1)
    percent_left = corner.x + width - imgui.calc_text_size(percent).x
    bar_left = corner.x + width - px(38 + BAR_WIDTH_PX)
    words = widgets.packed(theme.TEXT if hovered else theme.MUTED)
    shown = widgets.elided(text, bar_left - corner.x - px(8))
    drawing.add_text(imgui.ImVec2(corner.x, top), words, shown)
    drawing.add_text(imgui.ImVec2(percent_left, top), words, percent)
    middle = corner.y + height / 2
    tint = theme.ACCENT if similarity >= NEAR_COSINE else theme.WARNING
    for end, fill in ((1.0, theme.FIELD_ACTIVE), (fraction, tint)):
        high = imgui.ImVec2(bar_left + px(BAR_WIDTH_PX) * end, middle + px(2))
        drawing.add_rect_filled(imgui.ImVec2(bar_left, middle - px(2)), high, widgets.packed(fill), px(2))
    return bool(clicked)


def _note(text: str, warns: bool, lines: int) -> None:
    widgets.text(ICON.warning if warns else ICON.note, theme.WARNING if warns else theme.ACCENT)
    widgets.same_line()
    widgets.fitted(text, imgui.get_content_region_avail().x, lines=lines - 0.15 * (lines > 1))
