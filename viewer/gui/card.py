"""A small window in a corner of the view, as high as what is in it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from viewer.gl_bindings import imgui
from viewer.gui import theme, widgets
from viewer.gui.layout import Rect
from viewer.gui.theme import ICON
from viewer.gui.widgets import px

MARGIN = 10.0  # to the edges of the view, pixels at scale 1
GAP = 4.0  # between two fields


@contextmanager
def card(
    name: str,
    view: Rect,
    width: float,
    right: bool = False,
    bottom: bool = False,
    below: float = 0.0,
    behind: bool = False,
) -> Iterator[None]:
    """Draw within it: in the corner of `view` at the `right`, at the `bottom`, `below` so much more at the top.

    `width` and `below` are pixels at scale 1; one `behind` is not brought to the front by a click.
    """  # fmt: skip
    x = view.x + (view.width - px(MARGIN) if right else px(MARGIN))
    y = view.y + (view.height - px(MARGIN) if bottom else px(MARGIN + below))
    pivot = imgui.ImVec2(float(right), float(bottom))
    imgui.set_next_window_pos(imgui.ImVec2(x, y), imgui.Cond_.always, pivot)
    imgui.set_next_window_size(imgui.ImVec2(px(width), 0))
    flags = (
        imgui.WindowFlags_.no_decoration
        | imgui.WindowFlags_.no_move
        | imgui.WindowFlags_.no_saved_settings
        | imgui.WindowFlags_.no_focus_on_appearing
        | (imgui.WindowFlags_.no_bring_to_front_on_focus if behind else 0)
    )
    imgui.push_style_var(imgui.StyleVar_.window_padding, imgui.ImVec2(px(10), px(8)))
    imgui.begin(name, None, flags)
    imgui.pop_style_var()
    try:
        yield
    finally:
        imgui.end()


def title(text: str, close: str, remove: str = "") -> str:
    """The first line: its name, then buttons named `close …` and, with a hint, `remove …`; which of the two was pressed."""
    side, buttons, pressed = imgui.get_frame_height(), 1 + bool(remove), ""
    room = imgui.get_content_region_avail().x
    imgui.align_text_to_frame_padding()
    widgets.label(widgets.elided(text, room - buttons * side), theme.ACCENT)
    imgui.same_line(room + imgui.get_style().window_padding.x - buttons * side)
    if remove:
        if widgets.icon_button(ICON.trash, f"remove {close}", remove, theme.TEXT):
            pressed = "remove"
        imgui.same_line(0, 0)
    if widgets.icon_button(ICON.close, f"close {close}", "Close (Esc)", theme.TEXT):
        pressed = "close"
    return pressed


def share(count: int) -> float:
    """The width of each of `count` fields side by side."""
    return (imgui.get_content_region_avail().x - (count - 1) * px(GAP)) / count


def beside() -> None:
    """The next field goes beside the one before."""
    imgui.same_line(0, px(GAP))
