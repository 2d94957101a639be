"""Small building blocks of the panels, and widgets for settings; lengths in pixels at scale 1 go through `px`."""

import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

from runtime.options import spec_of
from runtime.safe_read import printable
from viewer.gl_bindings import imgui
from viewer.gui import theme
from viewer.gui.layout import Rect
from viewer.gui.theme import Color
from viewer.settings import Settings

GAP_PX = 4.0  # between items side by side, pixels at scale 1
LABEL_WIDTH_PX = 150.0  # of a row's label, at scale 1
TOOLTIP_WIDTH_PX, TOOLTIP_MIN_WIDTH_PX = 290.0, 180.0  # at scale 1
MAX_TOOLTIP = 360  # characters
TOOLTIP_EDGE_PX = 40.0  # maximum distance of a column from the edge of the window


_PRIMARY: dict[int, Color] = {
    imgui.Col_.button: theme.ACCENT,
    imgui.Col_.button_hovered: theme.ACCENT_HOVER,
    imgui.Col_.button_active: theme.ACCENT,
    imgui.Col_.text: theme.ON_ACCENT,
}
_HOVER: Color = (1.0, 1.0, 1.0, 0.05)
_RESTING = imgui.HoveredFlags_.delay_normal | imgui.HoveredFlags_.allow_when_disabled
_BARE_SLIDER: dict[int, Color] = {
    imgui.Col_.frame_bg: theme.CLEAR,
    imgui.Col_.frame_bg_hovered: _HOVER,
    imgui.Col_.frame_bg_active: _HOVER,
    imgui.Col_.slider_grab: theme.CLEAR,
    imgui.Col_.slider_grab_active: theme.CLEAR,
}


def px(length: float) -> float:
    """Return a length given at scale 1, in screen units."""
    return length * imgui.get_style().font_scale_dpi


class colors:  # entered seventy times a frame: a generator takes four times as long
    """Draw with other colours for some ImGui roles within the block."""

    def __init__(self, values: Mapping[int, Color]) -> None:
        self._values = values

    def __enter__(self) -> None:
        for role, value in self._values.items():
            imgui.push_style_color(role, imgui.ImVec4(*value))

    def __exit__(self, *_: object) -> None:
        imgui.pop_style_color(len(self._values))


def color(role: int, value: Color) -> colors:
    return colors({role: value})


def text(words: str, tint: Color, wrap: bool = False) -> None:
    with color(imgui.Col_.text, tint):
        imgui.text_wrapped(words) if wrap else imgui.text_unformatted(words)


def muted(words: str, wrap: bool = False) -> None:
    text(words, theme.MUTED, wrap)


def fitted(words: str, width: float, tint: Color = theme.MUTED, lines: float = 1.0) -> None:
    """Draw text shortened to `lines` lines of a width, with the full text as tooltip."""
    shown = elided(words, lines * width)
    if lines > 1.0:
        imgui.push_text_wrap_pos(imgui.get_cursor_pos_x() + width)
    text(shown, tint)
    if lines > 1.0:
        imgui.pop_text_wrap_pos()
    tooltip(words if shown != words else "")


def label(text: str, tint: Color = theme.MUTED) -> None:
    """Draw a field's label above it."""
    imgui.push_font(None, theme.FONT_SIZE_PX * 0.87)
    with color(imgui.Col_.text, tint):
        imgui.text_unformatted(text)
    imgui.pop_font()


def heading(fonts: theme.Fonts, icon: str, text: str) -> None:
    imgui.push_font(fonts.bold, theme.FONT_SIZE_PX * 1.1)
    with color(imgui.Col_.text, theme.ACCENT):
        imgui.text_unformatted(icon)
    imgui.same_line(0, px(7))
    imgui.text_unformatted(text)
    imgui.pop_font()
    imgui.dummy(imgui.ImVec2(0, px(1)))


def tooltip(text: str) -> None:
    """Show a tooltip for the previous item, placed beside its panel so that it covers no field."""
    if text and imgui.is_item_hovered(_RESTING):
        text = text if len(text) <= MAX_TOOLTIP else text[: MAX_TOOLTIP - 1].rstrip() + "…"
        width = _place_in_view()
        imgui.begin_tooltip()
        imgui.push_text_wrap_pos(width)
        imgui.text_unformatted(text)
        imgui.pop_text_wrap_pos()
        imgui.end_tooltip()


def _place_in_view() -> float:
    """Put the next window into the view next to the item's column; return the width of its text.

    For a bar along the bottom, such as the timeline, it is above the bar. For items outside the left and right columns
    the tooltip stays at the mouse.
    """
    root = imgui.internal.get_current_window().root_window
    space, gap, item = imgui.get_io().display_size, px(6), imgui.get_item_rect_min()
    if root.size.x > 2 * root.size.y and root.pos.y > 0.4 * space.y:
        width = px(TOOLTIP_WIDTH_PX)
        widest = width + 2 * imgui.get_style().window_padding.x
        x = max(min(imgui.get_io().mouse_pos.x, space.x - gap - widest), root.pos.x)
        corner = imgui.ImVec2(x, root.pos.y - gap)
        imgui.set_next_window_pos(corner, imgui.Cond_.always, imgui.ImVec2(0.0, 1.0))
        return width
    right = space.x - (root.pos.x + root.size.x)
    left, width = root.pos.x, px(TOOLTIP_WIDTH_PX)
    if max(left, right) < px(TOOLTIP_MIN_WIDTH_PX) or min(left, right) > px(TOOLTIP_EDGE_PX):
        return width
    padding = 2 * imgui.get_style().window_padding.x
    width = min(width, max(left, right) - padding - 2 * gap)
    to_right = right >= left
    x = root.pos.x + root.size.x + gap if to_right else root.pos.x - gap
    below = item.y > 0.6 * space.y  # grows upwards near the bottom
    y = min(imgui.get_item_rect_max().y, space.y) if below else max(item.y, 0.0)
    pivot = imgui.ImVec2(0.0 if to_right else 1.0, 1.0 if below else 0.0)
    imgui.set_next_window_pos(imgui.ImVec2(x, y), imgui.Cond_.always, pivot)
    return width


def icon_button(
    icon: str, name: str, hint: str, tint: Color = theme.MUTED, enabled: bool = True, size: float = 0.0
) -> bool:
    """Draw an icon button without background until hovered, and return whether it was clicked; `size` is its side at scale 1."""
    side = px(size) if size else imgui.get_frame_height()
    # padding as in a frame of this height, or the line would grow to keep the baselines level
    padding = max((side - imgui.get_text_line_height()) / 2, 0.0)
    imgui.push_style_var(imgui.StyleVar_.frame_padding, imgui.ImVec2(0, padding))
    with colors({imgui.Col_.button: theme.CLEAR, imgui.Col_.text: tint}), disabled(not enabled):
        clicked = bool(imgui.button(f"{icon}##{name}", imgui.ImVec2(side, side)))
    imgui.pop_style_var()
    tooltip(hint)
    return clicked


def tag(text: str, tint: Color = theme.ACCENT) -> None:
    """Draw a short word on a rounded background of its own colour."""
    imgui.push_font(None, theme.FONT_SIZE_PX * 0.87)
    size, pad = imgui.calc_text_size(text), px(6)
    corner = imgui.get_cursor_screen_pos()
    low, high = corner, imgui.ImVec2(corner.x + size.x + 2 * pad, corner.y + size.y + px(2))
    drawing = imgui.get_window_draw_list()
    drawing.add_rect_filled(low, high, packed((*tint[:3], 0.2)), px(4))
    drawing.add_text(imgui.ImVec2(corner.x + pad, corner.y + px(1)), packed(tint), text)
    imgui.dummy(imgui.ImVec2(high.x - low.x, high.y - low.y))
    imgui.pop_font()


def packed(value: Color) -> int:
    """Return a colour in the packed format of draw lists."""
    return int(imgui.get_color_u32(imgui.ImVec4(*value)))


class disabled:
    """Disable items within the block if `when` is true."""

    def __init__(self, when: object = True) -> None:
        self._when = bool(when)

    def __enter__(self) -> None:
        imgui.begin_disabled(self._when)

    def __exit__(self, *_: object) -> None:
        imgui.end_disabled()


def button(
    text: str, width: float = 0.0, hint: str = "", primary: bool = False, enabled: object = True
) -> bool:
    """Draw a button and return whether it was clicked; `primary` uses the accent colour, width -1 fills the line."""
    with colors(_PRIMARY if primary else {}), disabled(not enabled):
        clicked = bool(imgui.button(text, imgui.ImVec2(width, 0)))
    tooltip(hint)
    return clicked


def buttons(*items: tuple[str, str, Callable[[], object] | None], primary: int = -1) -> None:
    """Draw buttons side by side, given by text, hint and action; one without an action is disabled."""
    width = column_width(len(items))
    for number, (text, hint, act) in enumerate(items):
        if number:
            same_line()
        if button(text, width, hint, number == primary, act) and act is not None:
            act()


def item(text: str, hint: str = "", chosen: bool = False, enabled: object = True) -> bool:
    """Draw a menu entry; return whether it was clicked."""
    clicked = bool(imgui.menu_item(text, "", chosen, bool(enabled))[0])
    tooltip(hint)
    return clicked


def drag(
    name: str, value: float, limits: tuple[float, float], text: str, hint: str = "", speed: float = 0.005
) -> tuple[bool, float]:
    """Draw a draggable number, editable by a double click, with the format `text`; return whether it changed, and its value."""
    kind = imgui.drag_int if isinstance(value, int) else imgui.drag_float
    moved, value = kind(name, value, speed, *limits, text)  # type: ignore[arg-type]
    tooltip(hint)
    return bool(moved), value


def input_text(name: str, value: str, hint: str = "", flags: int = 0) -> tuple[bool, str]:
    """Draw a single-line text field; return whether Enter was pressed, and its text."""
    flags |= imgui.InputTextFlags_.enter_returns_true
    return imgui.input_text_with_hint(name, hint, value, flags)


def toggle(text: str, on: bool, width: float, hint: str = "") -> bool:
    """Draw a button that stays lit while `on`; return the new state."""
    ground, ink = (theme.ACCENT_DIM, theme.ACCENT) if on else (theme.FIELD, theme.MUTED)
    with colors({imgui.Col_.button: ground, imgui.Col_.text: ink}):
        clicked = imgui.button(text, imgui.ImVec2(width, 0))
    tooltip(hint)
    return on != bool(clicked)


def slider(
    name: str, value: float, low: float, high: float, text: str, logarithmic: bool = False
) -> tuple[bool, float]:
    """Draw a slider filled up to its value, with the format `text`; Ctrl+click edits it. Returns whether it changed, and its value."""
    flags = imgui.SliderFlags_.always_clamp
    fraction = (value - low) / (high - low)
    if logarithmic:
        flags |= imgui.SliderFlags_.logarithmic
        fraction = math.log(max(value, low) / low) / math.log(high / low)
    corner, width = imgui.get_cursor_screen_pos(), imgui.calc_item_width()
    height, rounding = imgui.get_frame_height(), imgui.get_style().frame_rounding
    drawing = imgui.get_window_draw_list()
    right = corner.x + width * min(max(fraction, 0.0), 1.0)
    for end, fill in ((corner.x + width, theme.FIELD), (right, theme.ACCENT_FILL)):
        if end > corner.x + 1:
            drawing.add_rect_filled(corner, imgui.ImVec2(end, corner.y + height), packed(fill), rounding)
    with colors(_BARE_SLIDER):
        changed, value = imgui.slider_float(name, value, low, high, text, flags)
    return bool(changed), float(value)


def segmented(
    name: str,
    options: Sequence[tuple[Any, str]],
    value: Any,
    unavailable: Sequence[Any] = (),
    room: float = 0.0,
) -> Any:
    """Draw choices side by side and return the chosen value; `options` are (value, text), `room` limits the width."""
    width = column_width(len(options), room)
    imgui.push_id(name)
    for i, (option, text) in enumerate(options):
        if i:
            same_line()
        with disabled(option in unavailable):
            if toggle(f"{text}##{option}", option == value, width) != (option == value):
                value = option
    imgui.pop_id()
    return value


@contextmanager
def section(title: str) -> Iterator[bool]:
    """Draw a collapsible section title; yields whether the section is open."""
    opened = imgui.tree_node_ex(title, imgui.TreeNodeFlags_.span_avail_width)
    if opened:
        imgui.unindent(imgui.get_style().indent_spacing)
    yield opened
    if opened:
        imgui.indent(imgui.get_style().indent_spacing)
        imgui.tree_pop()


def elided(text: str, width: float) -> str:
    """Return `text` shortened with an ellipsis to fit into `width`."""
    if imgui.calc_text_size(text).x <= width:
        return text
    low, high = 0, len(text)
    while low < high:
        middle = (low + high + 1) // 2
        fits = imgui.calc_text_size(text[:middle].rstrip() + "…").x <= width
        low, high = (middle, high) if fits else (low, middle - 1)
    return text[:low].rstrip() + "…"


def named(name: str, key: object, about: str = "", width: float = 220.0) -> str:
    """Return the label of an item for a name of any text: on one line, cut to pixels at scale 1, `about` it, and ImGui's `key`."""
    shown = elided(" ".join(printable(name).split()), px(width))
    return f"{re.sub('#(?=#)', '# ', shown)}{about}##{key}"  # text after ## would be hidden


def sign(view: Rect, text: str, tint: Color) -> None:
    """Draw text on a rounded background at the top of the view."""
    drawing = imgui.get_foreground_draw_list()
    size, pad = imgui.calc_text_size(text), px(10)
    x, y = view.x + (view.width - size.x) / 2, view.y + px(16)
    low, high = imgui.ImVec2(x - pad, y - pad / 2), imgui.ImVec2(x + size.x + pad, y + size.y + pad / 2)
    drawing.add_rect_filled(low, high, packed(theme.PANEL), px(14))
    drawing.add_text(imgui.ImVec2(x, y), packed(tint), text)


def full_width() -> None:
    """Make the next item fill the line."""
    imgui.set_next_item_width(-1)


def clock(seconds: float) -> str:
    """Return seconds as minutes:seconds.tenths."""
    tenths = max(round(float(f"{seconds:.1f}") * 10), 0)  # rounded as in the messages
    return f"{tenths // 600}:{tenths // 10 % 60:02d}.{tenths % 10}"


def tab(label: str, flags: int = 0) -> bool:
    """Begin a tab and return whether it is open; `imgui.end_tab_item` must follow.

    ImGui only accepts a click on a tab if the mouse was over it in the previous frame, which fails at low frame rates.
    """
    storage, key = imgui.get_state_storage(), imgui.get_id(f"{label}/clicked")
    if storage.get_bool(key):
        storage.set_bool(key, False)
        flags |= imgui.TabItemFlags_.set_selected
    is_open: bool = imgui.begin_tab_item(label, None, flags)[0]
    over = imgui.is_item_hovered(imgui.HoveredFlags_.allow_when_overlapped_by_item)
    if over and not is_open and imgui.is_mouse_clicked(imgui.MouseButton_.left):
        storage.set_bool(key, True)
    return is_open


def column_width(count: int, room: float = 0.0) -> float:
    """Return the width of each of `count` items side by side in the rest of the line, or in `room`."""
    return ((room or imgui.get_content_region_avail().x) - (count - 1) * px(GAP_PX)) / count


def same_line() -> None:
    """Put the next item on the same line."""
    imgui.same_line(0, px(GAP_PX))


def row(label: str, hint: str = "") -> None:
    """Draw the label of the next item on its left; the item fills the rest of the line."""
    imgui.align_text_to_frame_padding()
    muted(label)
    tooltip(hint)
    imgui.same_line(px(LABEL_WIDTH_PX))
    full_width()


def combo(name: str, options: Sequence[tuple[object, str]], value: object) -> object:
    """Draw a drop-down list of (value, text); return the chosen value."""
    shown = next((text for option, text in options if option == value), str(value))
    if imgui.begin_combo(name, shown, imgui.ComboFlags_.height_large):
        for option, text in options:
            if imgui.selectable(f"{text}{name}{option}", option == value)[0]:
                value = option
        imgui.end_combo()
    return value


def setting_slider(settings: Settings, name: str) -> None:
    spec = spec_of(settings, name)
    moved, value = slider(
        f"##{name}",
        getattr(settings, name) * spec.factor,
        spec.low * spec.factor,
        spec.high * spec.factor,
        spec.label,
        spec.logarithmic,
    )
    if moved:
        setattr(settings, name, (float(round(value)) if spec.whole else value) / spec.factor)
    tooltip(spec.hint)


def setting_drag(settings: Settings, name: str) -> None:
    """Draw a setting as a draggable number."""
    spec, value, flags = spec_of(settings, name), getattr(settings, name), imgui.SliderFlags_.always_clamp
    _, value = imgui.drag_float(f"##{name}", value, spec.speed, spec.low, spec.high, spec.label, flags)
    setattr(settings, name, value)
    tooltip(spec.hint)


def setting_toggle(settings: Settings, name: str, width: float) -> None:
    spec = spec_of(settings, name)
    setattr(settings, name, toggle(spec.label, getattr(settings, name), width, spec.hint))


def setting_choice(settings: Settings, name: str, room: float = 0.0) -> None:
    """Draw a setting as choices side by side."""
    options = list((spec_of(settings, name).choices or {}).items())
    setattr(settings, name, segmented(name, options, getattr(settings, name), room=room))
