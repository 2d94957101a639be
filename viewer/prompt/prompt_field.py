"""A text field for a prompt: suggestions while typing, the last prompts by arrow keys, and undo of the session."""

from collections.abc import Iterable, Sequence

from runtime.session.prompt_blend import Side
from viewer.editor import Editor
from viewer.gl_bindings import imgui
from viewer.gui import theme, widgets
from viewer.gui.panels import FIXED
from viewer.gui.theme import ICON
from viewer.gui.widgets import px
from viewer.prompt.prompt_controller import PromptController
from viewer.prompt.suggestions import PromptText, Suggester, Suggestion

_SENTENCE = imgui.InputTextFlags_.enter_returns_true | imgui.InputTextFlags_.ctrl_enter_for_new_line
WRAPPED = _SENTENCE | imgui.InputTextFlags_.word_wrap
_FLAGS = imgui.WindowFlags_
_LIST = (FIXED & ~_FLAGS.no_bring_to_front_on_focus) | _FLAGS.no_nav | _FLAGS.no_scrollbar
_CTRL = int(imgui.Key.mod_ctrl)
_UNDO = _CTRL | int(imgui.Key.z)
_REDO = _CTRL | int(imgui.Key.y), _UNDO | int(imgui.Key.mod_shift)
_REPEATED = (imgui.Key.down_arrow, imgui.Key.up_arrow)
# keys of the list; Enter, the last one, only while a line is selected
_TAKEN = (*_REPEATED, imgui.Key.tab, imgui.Key.escape, imgui.Key.enter, imgui.Key.keypad_enter)


def draw(
    controller: PromptController,
    suggester: Suggester,
    side: Side,
    hint: str,
    lines: int = 2,
    below: float = 0.0,
) -> None:
    """Draw the prompt field of a side; a prompt that is entered or chosen is submitted, an emptied prompt B ends the blend.

    `below` is the space under the field that the suggestion list must not cover, in screen units.
    """
    box, name = controller.boxes[side], f"##prompt {side.name}"
    if box.focus_requested:
        imgui.set_keyboard_focus_here()
    field_id, chosen = imgui.get_id(name), None
    found: Sequence[Suggestion] = ()
    active = is_active(field_id)
    if active:
        found = suggester.suggestions(box) if box.suggesting else ()
        chosen = _keys(box, found, suggester, field_id)
        unchanged = chosen is None and box.text == controller.prompt.prompt(side)
        undo_keys(field_id, unchanged, controller.editor)
    before, corner = box.text, imgui.get_cursor_screen_pos()
    entered, box.text, size = wrapped_text(name, box.text, lines)
    left, width = imgui.is_item_deactivated(), size.x
    _follow(box, before, field_id, hint)
    if found and chosen is None:  # also in the frame in which a click on the list took the keyboard focus
        position = imgui.ImVec2(corner.x, corner.y + size.y + below + px(3))
        chosen = _list(name, found, box, position, width)
    if chosen is not None:
        box.text, box.suggesting = chosen, False
        imgui.internal.clear_active_id()
    _submit(controller, side, chosen is not None or entered, left)


def wrapped_text(name: str, text: str, lines: int = 2) -> tuple[bool, str, imgui.ImVec2]:
    """Draw a multi-line text field; return whether Enter was pressed, its text, and its size."""
    height = imgui.get_text_line_height() * lines + 2 * imgui.get_style().frame_padding.y
    size = imgui.ImVec2(imgui.get_content_region_avail().x, height)
    return *imgui.input_text_multiline(name, text, size, WRAPPED), size


def _submit(controller: PromptController, side: Side, entered: bool, left: bool) -> None:
    text = controller.boxes[side].text
    if entered and text.strip():
        controller.submit_prompt(text, side)
    elif left and side is Side.B and not text.strip():
        controller.drop_blend()


def is_active(field_id: int) -> bool:
    return bool(imgui.internal.get_active_id() == field_id)


def undo_keys(field_id: int, unchanged: bool, editor: Editor) -> None:
    """Make Ctrl+Z undo session edits while the field's text is unchanged; otherwise it is the field's own undo."""
    if not unchanged:
        return
    undo, redo = pressed_undo()
    if undo or redo:
        _lock((imgui.Key.z, imgui.Key.y), field_id)
        imgui.internal.clear_active_id()
        (editor.undo if undo else editor.redo)()


def undo_buttons(editor: Editor, name: str, gap: float, size: float = 0.0, waits: bool = False) -> None:
    """Draw undo and redo buttons; `waits` enables undo for a prompt that is waiting for its answer."""
    undo, redo = editor.undo_label, editor.redo_label
    hint, active = f"Undo {undo} (Ctrl+Z)", bool(undo) or waits
    if widgets.icon_button(ICON.undo, f"{name}undo", hint, theme.TEXT, active, size):
        editor.undo()
    imgui.same_line(0, gap)
    hint = f"Redo {redo} (Ctrl+Y)"
    if widgets.icon_button(ICON.redo, f"{name}redo", hint, theme.TEXT, bool(redo), size):
        editor.redo()


def pressed_undo() -> tuple[bool, bool]:
    """Return whether the keys for undo and for redo were pressed in this frame."""
    redo = any(imgui.is_key_chord_pressed(chord) for chord in _REDO)
    return bool(imgui.is_key_chord_pressed(_UNDO)), redo


def _keys(box: PromptText, found: Sequence[Suggestion], suggester: Suggester, field_id: int) -> str | None:
    """Use arrow keys, Tab, Enter and Esc over the list of suggestions; return the prompt that was chosen, else None."""
    if _recall(box, suggester.settings.prompt_history, field_id) or not found:
        return None
    # a locked key is not delivered to anyone
    pressed = {key for key in _TAKEN if imgui.is_key_pressed(key, key in _REPEATED)}
    picked = box.picked + (imgui.Key.down_arrow in pressed) - (imgui.Key.up_arrow in pressed)
    box.picked = min(max(picked, -1), len(found) - 1)
    _lock(_TAKEN if box.picked >= 0 else _TAKEN[:-2], field_id)
    if imgui.Key.tab in pressed:
        _put(box, found[max(box.picked, 0)].text, field_id)
    elif imgui.Key.escape in pressed:
        box.suggesting, box.picked = False, -1
    elif box.picked >= 0 and pressed.intersection(_TAKEN[-2:]):
        return found[box.picked].text
    return None


def _recall(box: PromptText, history: Sequence[str], field_id: int) -> bool:
    """Recall previous prompts in an empty field with Up and Down; return whether a key was used."""
    by = int(imgui.is_key_pressed(imgui.Key.up_arrow)) - int(imgui.is_key_pressed(imgui.Key.down_arrow))
    begins = by > 0 and not box.text and box.picked < 0
    if not history or not by or not (begins or box.recalled >= 0):
        return False
    recalled = min(box.recalled + by, len(history) - 1)
    _put(box, history[recalled] if recalled >= 0 else "", field_id)
    box.recalled = recalled
    _lock(_REPEATED, field_id)
    return True


def _put(box: PromptText, text: str, field_id: int) -> None:
    box.text, box.suggesting, box.picked, box.recalled = text, False, -1, -1
    state = imgui.internal.get_input_text_state(field_id)
    if state is not None:
        state.reload_user_buf_and_move_to_end()


def _lock(keys: Iterable[imgui.Key], field_id: int) -> None:
    """Withhold keys from the text field and the focus navigation in this frame."""
    owner = field_id ^ 1  # anyone but the field
    for key in keys:
        imgui.internal.set_key_owner(key, owner, imgui.internal.InputFlagsPrivate_.lock_this_frame)


def _follow(box: PromptText, before: str, field_id: int, hint: str) -> None:
    """Open and close the list as the field is entered, typed into and left."""
    if imgui.is_item_activated():
        box.suggesting, box.picked, box.recalled = not box.text, -1, -1
        state = imgui.internal.get_input_text_state(field_id)
        if box.focus_requested and state is not None:
            state.select_all()
        box.focus_requested = False
    elif box.text != before:
        box.suggesting, box.picked, box.recalled = True, -1, -1
    if imgui.is_item_deactivated():
        box.suggesting = False
    if not box.text and not is_active(field_id):
        corner, pad = imgui.get_item_rect_min(), imgui.get_style().frame_padding
        color = widgets.packed((*theme.MUTED[:3], 0.8))
        imgui.get_window_draw_list().add_text(imgui.ImVec2(corner.x + pad.x, corner.y + pad.y), color, hint)


def _list(
    name: str, found: Sequence[Suggestion], box: PromptText, position: imgui.ImVec2, width: float
) -> str | None:
    """Draw the list under the field; return the suggestion that was clicked, else None."""
    pad, row = px(5), imgui.get_text_line_height() + px(8)
    heading = row if found[0].recent and not box.text else 0.0
    height = heading + len(found) * row + 2 * pad
    bottom = imgui.get_io().display_size.y
    imgui.set_next_window_pos(imgui.ImVec2(position.x, max(min(position.y, bottom - height), 0.0)))
    imgui.set_next_window_size(imgui.ImVec2(width, height))
    imgui.push_style_var(imgui.StyleVar_.window_padding, imgui.ImVec2(pad, pad))
    imgui.push_style_var(imgui.StyleVar_.item_spacing, imgui.ImVec2(0, 0))
    imgui.push_style_color(imgui.Col_.window_bg, imgui.ImVec4(*theme.POPUP[:3], 1.0))
    imgui.begin(f"suggestions{name}", None, _LIST)
    imgui.internal.bring_window_to_display_front(imgui.internal.get_current_window())
    chosen = None
    if heading:
        imgui.set_cursor_pos(imgui.ImVec2(pad + px(6), pad + px(3)))
        widgets.label("Your last prompts")
        imgui.set_cursor_pos(imgui.ImVec2(pad, pad + heading))
    for i, suggestion in enumerate(found):
        if _row(suggestion, i, box, width - 2 * pad, row):
            chosen = suggestion.text
    imgui.end()
    imgui.pop_style_color()
    imgui.pop_style_var(2)
    return chosen


def _row(suggestion: Suggestion, i: int, box: PromptText, width: float, height: float) -> bool:
    """Draw one suggestion; return whether it was clicked, on button down because the field then loses the focus."""
    corner = imgui.get_cursor_screen_pos()
    imgui.invisible_button(f"##{i}", imgui.ImVec2(width, height))
    hovered = imgui.is_item_hovered(imgui.HoveredFlags_.allow_when_blocked_by_active_item)
    drawing, middle = imgui.get_window_draw_list(), corner.y + px(4)
    if i == box.picked or hovered:
        fill = theme.ACCENT_DIM if i == box.picked else theme.FIELD_HOVER
        high = imgui.ImVec2(corner.x + width, corner.y + height)
        drawing.add_rect_filled(corner, high, widgets.packed(fill), imgui.get_style().frame_rounding)
    left = corner.x + px(6)
    if suggestion.recent:
        drawing.add_text(imgui.ImVec2(left, middle), widgets.packed(theme.MUTED), ICON.history)
        left += px(24)
    right = corner.x + width - px(6)
    if suggestion.similarity is not None:
        fraction = f"{max(suggestion.similarity, 0.0):.0%}"
        right -= imgui.calc_text_size(fraction).x
        drawing.add_text(imgui.ImVec2(right, middle), widgets.packed(theme.MUTED), fraction)
        right -= px(8)
    text = widgets.elided(suggestion.text, right - left)
    drawing.add_text(imgui.ImVec2(left, middle), widgets.packed(theme.TEXT), text)
    return bool(hovered and imgui.is_mouse_clicked(0))
