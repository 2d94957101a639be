"""A window of its own in the middle, over everything: for settings and exports."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager

from viewer.gl_bindings import imgui
from viewer.gui import theme, widgets
from viewer.gui.focus import OVER
from viewer.gui.layout import STATUS_HEIGHT
from viewer.gui.theme import ICON, Fonts
from viewer.gui.widgets import px

LABEL_WIDTH = 150.0  # pixels at scale 1


@contextmanager
def window(fonts: Fonts, name: str, icon: str, width: float) -> Iterator[list[bool]]:
    """Draw within it; the list's first entry is whether the window was closed. `width` in pixels at scale 1."""
    size = imgui.get_io().display_size
    free = max(size.y - px(STATUS_HEIGHT), 1.0)  # what is said there belongs to what is done here
    center = imgui.ImVec2(size.x / 2, free / 2)
    wide = min(px(width), size.x - px(20))
    imgui.set_next_window_pos(center, imgui.Cond_.always, imgui.ImVec2(0.5, 0.5))
    imgui.set_next_window_size_constraints(imgui.ImVec2(wide, 0), imgui.ImVec2(wide, max(free - px(20), 64)))
    flags = (
        imgui.WindowFlags_.always_auto_resize
        | imgui.WindowFlags_.no_title_bar
        | imgui.WindowFlags_.no_move
        | imgui.WindowFlags_.no_saved_settings
    )
    imgui.push_style_color(imgui.Col_.window_bg, imgui.ImVec4(*theme.PANEL[:3], 1.0))
    imgui.begin(f"{name}{OVER}", None, flags)
    closed = [_title(fonts, name, icon)]
    try:
        yield closed
    finally:
        imgui.end()
        imgui.pop_style_color()


def _title(fonts: Fonts, name: str, icon: str) -> bool:
    top, side = imgui.get_cursor_pos(), imgui.get_frame_height()
    imgui.set_cursor_pos_x(top.x + imgui.get_content_region_avail().x - side)
    closed = widgets.icon_button(ICON.close, f"close {name}", "Close (Esc)", theme.TEXT)
    imgui.set_cursor_pos(top)
    widgets.heading(fonts, icon, name)
    imgui.dummy(imgui.ImVec2(0, px(2)))
    return closed


def row(label: str, hint: str = "") -> None:
    """The name of what comes next, on its left; the next item takes the rest of the line."""
    imgui.align_text_to_frame_padding()
    widgets.muted(label)
    widgets.tooltip(hint)
    imgui.same_line(px(LABEL_WIDTH))
    widgets.full_width()


def combo(name: str, options: Sequence[tuple[object, str]], value: object) -> object:
    """A list of (value, text); the chosen value."""
    shown = next((text for option, text in options if option == value), str(value))
    if imgui.begin_combo(name, shown, imgui.ComboFlags_.height_large):
        for option, text in options:
            if imgui.selectable(f"{text}{name}{option}", option == value)[0]:
                value = option
        imgui.end_combo()
    return value


def toggles(entries: Sequence[tuple[str, bool, str, Callable[[bool], None]]], columns: int = 2) -> None:
    """Buttons that stay lit, side by side: (text, on, hint, what takes the new state)."""
    gap = px(4)
    width = (imgui.get_content_region_avail().x - gap * (columns - 1)) / columns
    for number, (text, on, hint, take) in enumerate(entries):
        if number % columns:
            imgui.same_line(0, gap)
        now = widgets.toggle(text, on, width, hint)
        if now != on:
            take(now)
