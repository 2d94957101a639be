"""Panels and their windows: tools make panels, the shell draws them."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from enum import Enum, auto

from viewer.gl_bindings import imgui
from viewer.gui import theme, widgets
from viewer.gui.focus import OVER
from viewer.gui.layout import STATUS_HEIGHT_PX, Rect
from viewer.gui.theme import ICON, Fonts
from viewer.gui.widgets import px
from viewer.input.bindings import Action

WINDOW_TOP_PX = 60.0  # of a window that grows with its contents
CARD_MARGIN_PX = 10.0  # to the edges of the view, pixels at scale 1
_FLAGS = imgui.WindowFlags_
_KEPT = _FLAGS.no_move | _FLAGS.no_saved_settings
FIXED = (
    _KEPT | _FLAGS.no_title_bar | _FLAGS.no_resize | _FLAGS.no_collapse | _FLAGS.no_bring_to_front_on_focus
    | _FLAGS.no_focus_on_appearing
)  # fmt: skip
FITTED = _KEPT | _FLAGS.no_title_bar | _FLAGS.always_auto_resize
_BEHIND = _KEPT | _FLAGS.no_decoration | _FLAGS.no_focus_on_appearing
_CARD = _BEHIND & ~_FLAGS.no_move


class PanelPlace(Enum):
    """Where a panel is placed; `draw` receives that rectangle."""

    LEFT = auto()
    RIGHT_TOP = auto()
    RIGHT_BOTTOM = auto()
    BELOW = auto()  # under the view
    VIEW = auto()  # over the view, while panels are shown
    SIGN = auto()  # over the view, also without panels
    WINDOW = auto()  # over everything


IN_PLACE = (PanelPlace.LEFT, PanelPlace.RIGHT_TOP, PanelPlace.RIGHT_BOTTOM, PanelPlace.BELOW)


@dataclass(frozen=True)
class Panel:
    """A panel: its name, place, drawing function, and what else the shell needs."""

    name: str
    place: PanelPlace
    draw: Callable[[Rect], None]
    icon: str = ""
    shown: Callable[[], bool] = lambda: True
    width: float = 0.0  # of a centred window, at scale 1; 0: it draws its own window
    height: float = 0.0  # fixed height of such a window; 0: as high as its contents
    modal: bool = False  # while it is shown, everything behind it ignores mouse and keys
    light: bool = False  # a click beside it closes it
    tools: Callable[[], None] | None = None  # buttons in the title line
    tools_width: float = 0.0  # pixels at scale 1
    actions: Mapping[Action, Callable[[], None]] = field(default_factory=dict)
    begin_typing: Callable[[], None] | None = None  # Enter in the view goes to its field
    keys: Callable[[], None] | None = None  # handles Ctrl combinations, once per frame
    close: Callable[[], object] | None = None  # Escape closes it while it is shown
    # how much of the view's left side it covers, in screen units
    covers: Callable[[Rect], float] = lambda _: 0.0


def draw_window(name: str, rect: Rect, contents: Callable[[], None], flags: int = FIXED) -> None:
    """Draw a window that fills a rectangle; nothing if there is no room."""
    if rect.width < 1 or rect.height < 1:
        return
    imgui.set_next_window_pos(imgui.ImVec2(rect.x, rect.y))
    imgui.set_next_window_size(imgui.ImVec2(rect.width, rect.height))
    # a scrollbar fits into the padding: nothing gets narrower when it appears
    inside = rect.width - 2 * imgui.get_style().window_padding.x
    imgui.set_next_window_content_size(imgui.ImVec2(max(inside, 1.0), 0))
    imgui.begin(name, None, flags)
    try:
        contents()
    finally:
        imgui.end()


def draw_titled(panel: Panel, rect: Rect, fonts: Fonts) -> None:
    top, start = imgui.get_cursor_pos(), imgui.get_content_region_avail().x
    widgets.heading(fonts, panel.icon, panel.name)
    _tools(panel, imgui.ImVec2(top.x, top.y - px(3)), start)
    panel.draw(rect)


def draw_tabs(panels: Sequence[Panel], rect: Rect) -> None:
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
    """Draw a panel's own buttons at the right end of its title or tabs."""
    if panel.tools is None or width < px(panel.tools_width):
        return
    after = imgui.get_cursor_pos()
    imgui.set_cursor_pos(imgui.ImVec2(top.x + width - px(panel.tools_width), top.y))
    panel.tools()
    imgui.set_cursor_pos(after)


def dim_behind(name: str) -> bool:
    """Dim everything behind a window and block the mouse there; return whether the dimmed area was clicked."""
    imgui.set_next_window_pos(imgui.ImVec2(0, 0))
    imgui.set_next_window_size(imgui.get_io().display_size)
    imgui.push_style_var(imgui.StyleVar_.window_rounding, 0.0)
    imgui.push_style_var(imgui.StyleVar_.window_border_size, 0.0)
    with widgets.color(imgui.Col_.window_bg, (0.0, 0.0, 0.0, 0.5)):
        imgui.begin(f"behind {name}", None, _BEHIND)
    if imgui.is_window_appearing():
        imgui.internal.bring_window_to_display_front(imgui.internal.get_current_window())
    clicked = imgui.is_window_hovered() and any(map(imgui.is_mouse_clicked, range(3)))
    imgui.end()
    imgui.pop_style_var(2)
    return bool(clicked)


def draw_centred(panel: Panel, rect: Rect, fonts: Fonts) -> None:
    """Draw a panel in a window above everything but the status line, with a close button.

    It opens centred and grows downwards; dragging its title moves it.
    """
    size = imgui.get_io().display_size
    beside = dim_behind(panel.name) if panel.modal else False
    free = max(size.y - px(STATUS_HEIGHT_PX), 1.0)
    wide, high = min(px(panel.width), size.x - px(20)), free - px(20)
    top = (free - min(px(panel.height), high)) / 2 if panel.height else px(WINDOW_TOP_PX)
    imgui.set_next_window_pos(imgui.ImVec2(size.x / 2, top), imgui.Cond_.appearing, imgui.ImVec2(0.5, 0.0))
    low = min(px(panel.height), high)
    imgui.set_next_window_size_constraints(imgui.ImVec2(wide, low), imgui.ImVec2(wide, max(low or high, 64)))
    with widgets.color(imgui.Col_.window_bg, (*theme.PANEL[:3], 1.0)):
        imgui.begin(f"{panel.name}{OVER}", None, FITTED & ~_FLAGS.no_move)
        try:
            _keep_inside(size.x, free)
            top_left = imgui.get_cursor_pos()
            imgui.set_cursor_pos_x(top_left.x + imgui.get_content_region_avail().x - imgui.get_frame_height())
            closed = widgets.icon_button(ICON.close, f"close {panel.name}", "Close (Esc)", theme.TEXT)
            imgui.set_cursor_pos(top_left)
            widgets.heading(fonts, panel.icon, panel.name)
            imgui.dummy(imgui.ImVec2(0, px(2)))
            panel.draw(rect)
        finally:
            imgui.end()
    if (closed or (beside and panel.light)) and panel.close is not None:
        panel.close()


def _keep_inside(width: float, height: float) -> None:
    """Move a window back that was dragged off the screen, or grew over its edge."""
    at, size = imgui.get_window_pos(), imgui.get_window_size()
    x = max(min(at.x, width - size.x), 0.0)
    y = max(min(at.y, height - size.y), 0.0)
    if (x, y) != (at.x, at.y):
        imgui.set_window_pos(imgui.ImVec2(x, y))


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
    """Draw a small window in a corner of `view`, as tall as its contents.

    It is at the left or `right`, at the top (lowered by `below`) or `bottom`, until it is dragged or the view changes.
    `width` and `below` are pixels at scale 1; `behind` keeps it behind other windows when clicked.
    """
    x = view.x + (view.width - px(CARD_MARGIN_PX) if right else px(CARD_MARGIN_PX))
    y = view.y + (view.height - px(CARD_MARGIN_PX) if bottom else px(CARD_MARGIN_PX + below))
    known, place = imgui.internal.find_window_by_name(name), (x, y)
    storage, keys = None if known is None else known.state_storage, (1, 2)
    moved = storage is None or place != tuple(storage.get_float(key) for key in keys)
    for key, value in zip(keys, place, strict=True):
        if storage is not None:
            storage.set_float(key, value)
    imgui.set_next_window_pos(
        imgui.ImVec2(x, y),
        imgui.Cond_.always if moved else imgui.Cond_.appearing,
        imgui.ImVec2(float(right), float(bottom)),
    )
    imgui.set_next_window_size(imgui.ImVec2(px(width), 0))
    imgui.push_style_var(imgui.StyleVar_.window_padding, imgui.ImVec2(px(10), px(8)))
    imgui.begin(name, None, _CARD | (_FLAGS.no_bring_to_front_on_focus if behind else 0))
    imgui.pop_style_var()
    try:
        yield
    finally:
        imgui.end()


def card_title(text: str, close: str, remove: str = "") -> str:
    """Draw a card's title line with a close button and, with a hint, a `remove …` button. Returns which of the two was pressed."""
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
