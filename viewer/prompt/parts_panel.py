"""The six fields: each can be edited, locked against the next prompt, and set back to what the expander said."""

from __future__ import annotations

from runtime.prompts.expander import DEFAULT_PROMPT
from runtime.prompts.phrasing import HARDLY, adherence_of
from runtime.session.prompt_blend import PromptBlend
from runtime.skeleton import PART_NAMES
from viewer.gl_bindings import imgui
from viewer.gui import theme, widgets
from viewer.gui.theme import ICON
from viewer.gui.widgets import px
from viewer.prompt.prompt_controller import PromptController
from viewer.prompt.prompt_field import WRAPPED, is_active, undo_keys

LABEL_HEIGHT = 17.0  # pixels at scale 1
ROW_GAP = 4.0
MIN_LINES, MAX_LINES = 2, 3


def draw(controller: PromptController, model: str) -> None:
    """The fields share the height that is there; in less than they need, they scroll."""
    free = imgui.get_content_region_avail().y / len(PART_NAMES) - _row_height(0.0)
    height = min(max(free, _field_height(MIN_LINES)), _field_height(MAX_LINES))
    for part in PART_NAMES:
        imgui.push_id(part)
        imgui.push_style_var(
            imgui.StyleVar_.item_spacing, imgui.ImVec2(imgui.get_style().item_spacing.x, px(2))
        )
        _heading(part, controller, model)
        imgui.pop_style_var()
        imgui.push_style_var(
            imgui.StyleVar_.item_spacing, imgui.ImVec2(imgui.get_style().item_spacing.x, px(ROW_GAP))
        )
        _field(part, height, controller)
        imgui.pop_style_var()
        imgui.pop_id()


def _field_height(lines: int) -> float:
    return lines * imgui.get_text_line_height() + 2 * imgui.get_style().frame_padding.y


def _row_height(field: float) -> float:
    return px(LABEL_HEIGHT) + px(2) + field + px(ROW_GAP)


def _heading(part: str, controller: PromptController, model: str) -> None:
    """The part's name and marks on the left, reset and lock on the right."""
    top, width = imgui.get_cursor_pos(), imgui.get_content_region_avail().x
    blend = controller.prompt
    answer, locked = blend.a, part in blend.locked
    widgets.label(part.replace("_", " ").capitalize(), theme.TEXT if locked else theme.MUTED)
    edited = answer is not None and part in answer.edited
    applies = controller.parts[part] == controller.applied(part)
    if not applies:
        imgui.same_line(0, px(6))
        widgets.label("Enter applies", theme.WARNING)
    elif edited:
        imgui.same_line(0, px(6))
        widgets.label("kept" if locked else "edited", theme.ACCENT)
    if applies:
        _mark_weak(weakly_shown(blend, part, model))
    share = blend.weights[PART_NAMES.index(part)]
    if blend.b is not None and share > 0.0:
        imgui.same_line(0, px(6))
        widgets.label(f"{share:.0%} of B")
    side = px(LABEL_HEIGHT + 3)
    imgui.set_cursor_pos(imgui.ImVec2(top.x + width - 2 * side - px(2), top.y - px(2)))
    said = "" if answer is None else getattr(answer.said, part)
    if edited and widgets.icon_button(
        ICON.original, "reset", f"Back to what was said: “{said}”", size=LABEL_HEIGHT + 3
    ):
        controller.reset_part(part)
    imgui.set_cursor_pos(imgui.ImVec2(top.x + width - side, top.y - px(2)))
    hint = (
        "Locked: the next prompt leaves these words alone"
        if locked
        else "Keep these words when the prompt changes"
    )
    tint = theme.ACCENT if locked else theme.MUTED
    if widgets.icon_button(ICON.lock if locked else ICON.unlock, "lock", hint, tint, size=LABEL_HEIGHT + 3):
        controller.toggle_lock(part)
    imgui.set_cursor_pos(imgui.ImVec2(top.x, top.y + px(LABEL_HEIGHT + 2)))


def weakly_shown(blend: PromptBlend, part: str, model: str) -> float | None:
    """Share (0 to 1) of a part's words that a model, by its name, shows on a walk, where that is hardly anything.

    None for the words of the walk that the program begins with: nobody asked for anything that is not shown.
    """
    if blend.a is None or (blend.a.prompt == DEFAULT_PROMPT and part not in blend.a.edited):
        return None
    shown = adherence_of(model).of(getattr(blend.a.words, part), part)
    return shown if shown is not None and shown < HARDLY else None


def _mark_weak(share: float | None) -> None:
    """A mark after the part's name where a walk was measured to show next to nothing of its words."""
    if share is None:
        return
    imgui.same_line(0, px(6))
    widgets.label(f"hardly shown ({share:.0%})", theme.WARNING)
    widgets.tooltip("On a walk the body did this little of what these words say. Other words may do more.")


def _overflows(text: str, height: float) -> bool:
    """Whether a field of this height, which was drawn last, shows less than all of its words."""
    padding = imgui.get_style().frame_padding
    width = imgui.get_item_rect_size().x - 2 * padding.x
    return bool(imgui.calc_text_size(text, False, width).y > height - 2 * padding.y + 1.0)


def _field(part: str, height: float, controller: PromptController) -> None:
    field_id = imgui.get_id("##words")
    active = is_active(field_id)
    if active:
        undo_keys(field_id, controller.parts[part] == controller.applied(part), controller.editor)
    fill = theme.ACCENT_LOCKED if part in controller.prompt.locked else theme.FIELD
    with widgets.color(imgui.Col_.frame_bg, fill):
        _, controller.parts[part] = imgui.input_text_multiline(
            "##words", controller.parts[part], imgui.ImVec2(-1, height), WRAPPED
        )
    left = imgui.is_item_deactivated_after_edit()  # by Enter, or for something else
    if not active and _overflows(controller.parts[part], height):
        widgets.tooltip(controller.parts[part])
    if left and controller.parts[part] != controller.applied(part):
        controller.submit_part(part)
