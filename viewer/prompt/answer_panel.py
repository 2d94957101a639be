"""Who answered a prompt, how near it was, and what there is to say about it."""

from __future__ import annotations

from runtime.prompts.answer import Answer
from runtime.session.prompt_blend import Side
from viewer.gl_bindings import imgui
from viewer.gui import theme, widgets
from viewer.gui.theme import ICON
from viewer.gui.widgets import px
from viewer.prompt.prompt_controller import PromptController

GOOD_MATCH = 0.6  # cosine similarity from which a library prompt is near
_ANSWERED = {"library": "Library", "gpt": "GPT", "explicit": "Explicit"}
_HINTS = {
    "library": "Composed from the shipped library's nearest prompts",
    "gpt": "Written by the language model",
    "explicit": "The prompt itself says what the parts do",
}
BAR_WIDTH = 46.0  # pixels at scale 1


def draw(controller: PromptController, side: Side, rows: int, lines: int = 2) -> str | None:
    """A side's answer with at most `rows` of the nearest prompts and `lines` of remarks; a prompt that was clicked."""
    answer, asked = controller.prompt.answers[side], side in controller.asked
    if not controller.available:
        widgets.muted(f"{ICON.warning} Prompts need a motion model.")
        return None
    if answer is None:
        waiting = f"{ICON.clock} {'Loading' if controller.loading else 'Preparing the style'}…"
        widgets.muted(waiting if asked or controller.loading else f"{ICON.note} Type a prompt.")
        return None
    if answer.prompt and not asked and not any(box.text.strip() for box in controller.boxes):
        widgets.muted(f"{ICON.note} Type a prompt; “{answer.prompt}” goes on until then.")
        return None
    _who(answer, asked, controller.language_model, rows)
    chosen = None
    if answer.source != "gpt":
        for text, similarity in answer.nearest[: min(rows, 1) if answer.note else rows]:
            if _near(text, similarity):
                chosen = text
    if answer.note:
        far = bool(answer.nearest) and answer.nearest[0][1] < GOOD_MATCH
        _note(answer.note, far or answer.note.startswith("Language model"), lines)
    return chosen


def _who(answer: Answer, asked: bool, model: str, rows: int) -> None:
    widgets.tag(_ANSWERED.get(answer.source, answer.source))
    widgets.tooltip(f"{_HINTS.get(answer.source, '')}, in {answer.milliseconds:.0f} ms")
    if answer.edited:
        imgui.same_line(0, px(4))
        widgets.tag("edited", theme.MUTED)
        widgets.tooltip(
            "Words of " + ", ".join(part.replace("_", " ") for part in answer.edited) + " are yours"
        )
    text = _summary(answer, asked, model, rows)
    imgui.same_line(0, px(7))
    shown = widgets.elided(text, imgui.get_content_region_avail().x)
    with widgets.color(imgui.Col_.text, theme.MUTED):
        imgui.text_unformatted(shown)
    if shown != text:
        widgets.tooltip(text)


def _summary(answer: Answer, asked: bool, model: str, rows: int) -> str:
    if asked:
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
    """One of the nearest prompts with a bar of its similarity; whether it was clicked."""
    width, height = imgui.get_content_region_avail().x, imgui.get_text_line_height() + px(2)
    corner = imgui.get_cursor_screen_pos()
    imgui.push_style_var(imgui.StyleVar_.item_spacing, imgui.ImVec2(0, px(1)))
    clicked = imgui.invisible_button(f"near {text}", imgui.ImVec2(width, height))
    imgui.pop_style_var()
    hovered = imgui.is_item_hovered()
    widgets.tooltip(f"Cosine similarity {similarity:.2f} with “{text}”. Click: take this prompt.")
    drawing, share = imgui.get_window_draw_list(), min(max(similarity, 0.0), 1.0)
    percent, top = f"{share:.0%}", corner.y + px(1)
    percent_left = corner.x + width - imgui.calc_text_size(percent).x
    bar_left = corner.x + width - px(38 + BAR_WIDTH)
    words = widgets.packed(theme.TEXT if hovered else theme.MUTED)
    shown = widgets.elided(text, bar_left - corner.x - px(8))
    drawing.add_text(imgui.ImVec2(corner.x, top), words, shown)
    drawing.add_text(imgui.ImVec2(percent_left, top), words, percent)
    middle = corner.y + height / 2
    tint = theme.ACCENT if similarity >= GOOD_MATCH else theme.WARNING
    for end, fill in ((1.0, theme.FIELD_ACTIVE), (share, tint)):
        high = imgui.ImVec2(bar_left + px(BAR_WIDTH) * end, middle + px(2))
        drawing.add_rect_filled(imgui.ImVec2(bar_left, middle - px(2)), high, widgets.packed(fill), px(2))
    return bool(clicked)


def _note(text: str, warns: bool, lines: int) -> None:
    """A remark on the answer, on at most so many lines."""
    with widgets.color(imgui.Col_.text, theme.WARNING if warns else theme.ACCENT):
        imgui.text_unformatted(ICON.warning if warns else ICON.note)
    imgui.same_line(0, px(4))
    width = imgui.get_content_region_avail().x
    imgui.begin_group()
    with widgets.color(imgui.Col_.text, theme.MUTED):
        imgui.push_text_wrap_pos(imgui.get_cursor_pos_x() + width)
        shown = widgets.elided(text, (lines - 0.15 * (lines > 1)) * width)
        imgui.text_unformatted(shown)
        imgui.pop_text_wrap_pos()
    imgui.end_group()
    if shown != text:
        widgets.tooltip(text)
