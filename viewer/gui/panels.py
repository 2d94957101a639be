"""What a panel is, and its window: rooms make panels, the shell draws them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum, auto

from viewer.gl_bindings import imgui
from viewer.gui import widgets
from viewer.gui.layout import Rect
from viewer.gui.theme import Fonts
from viewer.gui.widgets import px
from viewer.input.bindings import Action

FIXED = (
    imgui.WindowFlags_.no_title_bar
    | imgui.WindowFlags_.no_resize
    | imgui.WindowFlags_.no_move
    | imgui.WindowFlags_.no_collapse
    | imgui.WindowFlags_.no_saved_settings
    | imgui.WindowFlags_.no_bring_to_front_on_focus
    | imgui.WindowFlags_.no_focus_on_appearing
)


class PanelPlace(Enum):
    """Where a panel lies; `draw` gets the rectangle of the place."""

    LEFT = auto()
    RIGHT_TOP = auto()
    RIGHT_BOTTOM = auto()
    BELOW = auto()  # under the view
    VIEW = auto()  # over the view, while panels are shown
    SIGN = auto()  # over the view, also without panels
    WINDOW = auto()  # over everything


@dataclass(frozen=True)
class Panel:
    """One panel with everything that the shell has to know of it."""

    name: str
    place: PanelPlace
    draw: Callable[[Rect], None]
    icon: str = ""
    shown: Callable[[], bool] = lambda: True
    tools: Callable[[], None] | None = None  # buttons beside the title
    tools_width: float = 0.0  # pixels at scale 1
    actions: Mapping[Action, Callable[[], None]] = field(default_factory=dict)  # of its room
    begin_typing: Callable[[], None] | None = None  # Enter in the view goes to its field
    keys: Callable[[], None] | None = None  # acts on combinations with Ctrl, once a frame
    close: Callable[[], bool] | None = None  # Escape: close what is open; whether anything was
    covers: Callable[[Rect], float] = lambda _: (
        0.0
    )  # of the view's left side, in screen units: nobody is there


def draw_window(name: str, rect: Rect, contents: Callable[[], None], flags: int = FIXED) -> None:
    """A window that fills a rectangle; nothing where there is no room."""
    if rect.width < 1 or rect.height < 1:
        return
    imgui.set_next_window_pos(imgui.ImVec2(rect.x, rect.y))
    imgui.set_next_window_size(imgui.ImVec2(rect.width, rect.height))
    imgui.begin(name, None, flags)
    try:
        contents()
    finally:
        imgui.end()


def draw_titled(panel: Panel, rect: Rect, fonts: Fonts) -> None:
    """A panel under its title."""
    top, start = imgui.get_cursor_pos(), imgui.get_content_region_avail().x
    widgets.heading(fonts, panel.icon, panel.name)
    _tools(panel, imgui.ImVec2(top.x, top.y - px(3)), start)
    panel.draw(rect)


def draw_tabs(panels: Sequence[Panel], rect: Rect) -> None:
    """Several panels in one place."""
    top, width = imgui.get_cursor_pos(), imgui.get_content_region_avail().x
    if not imgui.begin_tab_bar("panels"):
        return
    for panel in panels:
        if widgets.tab(panel.name):
            imgui.dummy(imgui.ImVec2(0, px(2)))
            _tools(panel, top, width)
            panel.draw(rect)
            imgui.end_tab_item()
    imgui.end_tab_bar()


def _tools(panel: Panel, top: imgui.ImVec2, width: float) -> None:
    """A panel's own buttons at the right end of its title or tabs."""
    if panel.tools is None or width < px(panel.tools_width):
        return
    after = imgui.get_cursor_pos()
    imgui.set_cursor_pos(imgui.ImVec2(top.x + width - px(panel.tools_width), top.y))
    panel.tools()
    imgui.set_cursor_pos(after)
