"""Places the panels as a pure function of the window size, so that nothing can overlap at any size or scale."""

from dataclasses import dataclass, replace

MARGIN_PX = 10.0  # all lengths at scale 1
STATUS_HEIGHT_PX = 30.0
LEFT_WIDTH_PX, RIGHT_WIDTH_PX = 316.0, 296.0
SCENE_MIN_WIDTH_PX = 240.0  # of the free view between the columns
# two rows of buttons, the ruler and the tracks of every take; further tracks scroll
TIMELINE_HEIGHT_PX = 257.0
TRACKS_HEIGHT_PX = 144.0  # the tracks' part of it
# in views of such heights the tracks grow by this fraction
TALL_FROM_PX, TALL_TO_PX, TALLER_FRACTION = 700.0, 1000.0, 0.6
MAX_TIMELINE_FRACTION = 0.45  # of the height above the status line
SCENE_PANEL_HEIGHT_PX = 350.0  # with its sections folded; they scroll if there is less room
SCENE_FRACTION = 0.53  # of a tall column
TAKES_MIN_HEIGHT_PX = 210.0
PROMPT_MAX_HEIGHT_PX = 770.0  # filled by the six fields
MIN_VIEW_FRACTION = 0.2  # of the window's width; a narrower view does not centre the character


@dataclass(frozen=True)
class Rect:
    x: float
    y: float
    width: float
    height: float


@dataclass(frozen=True)
class Layout:
    """The rectangles of all panels for a window size; None if there is no room.

    `tabs` replaces both columns in a narrow window, `right_tabs` the two right panels in a low one.
    """

    status: Rect
    view: Rect  # the free area for the character
    transport: Rect | None = None
    prompt: Rect | None = None
    scene: Rect | None = None
    clips: Rect | None = None
    tabs: Rect | None = None
    right_tabs: Rect | None = None


def arrange(
    width: float, height: float, scale: float, panels: bool = True, transport: bool = False
) -> Layout:
    """Return the layout for a window of `width` x `height` screen units.

    It does not depend on the panels' contents, so that nothing moves under the mouse.
    """
    m, status_height = MARGIN_PX * scale, STATUS_HEIGHT_PX * scale
    status = Rect(0.0, max(height - status_height, 0.0), width, min(status_height, height))
    column_height = height - status_height - 2 * m
    view = Rect(0.0, 0.0, width, max(height - status_height, 1.0))
    columns: dict[str, Rect] = {}
    if panels and column_height >= 80 * scale:
        narrow = width < (LEFT_WIDTH_PX + RIGHT_WIDTH_PX + SCENE_MIN_WIDTH_PX + 4 * MARGIN_PX) * scale
        left = Rect(m, m, min(LEFT_WIDTH_PX * scale, width - 2 * m), column_height)
        right = Rect(width - m - RIGHT_WIDTH_PX * scale, m, RIGHT_WIDTH_PX * scale, column_height)
        if narrow:
            columns = {"tabs": left}
            x = left.width + 2 * m
            view = Rect(x, 0.0, max(width - x, 1.0), view.height)
        else:
            prompt = replace(left, height=min(column_height, PROMPT_MAX_HEIGHT_PX * scale))
            columns = {"prompt": prompt, **_divided(right, scale)}
            view = Rect(m + left.width, 0.0, right.x - m - left.width, view.height)
    bar = _timeline(view, scale) if transport else None
    return Layout(status, view, bar, **columns)


def _divided(column: Rect, scale: float) -> dict[str, Rect]:
    """Place the panels of the right column: one over the other, or as tabs where it is too low for that."""
    m, least = MARGIN_PX * scale, SCENE_PANEL_HEIGHT_PX * scale
    if column.height - m - TAKES_MIN_HEIGHT_PX * scale < least:
        return {"right_tabs": column}
    scene = replace(column, height=max(SCENE_FRACTION * (column.height - m), least))
    top = scene.y + scene.height + m
    return {"scene": scene, "clips": replace(column, y=top, height=column.y + column.height - top)}


def framing(layout: Layout, covered: float = 0.0) -> tuple[float, float, float]:
    """Return the centre of the free view (-1 left or bottom to 1) and the fraction of the window's height that it fills.

    `covered` is the width taken from the view's left, ignored if too little would be left. The horizontal centre is 0
    if hardly anything is free.
    """
    width, height = layout.status.width, layout.status.y + layout.status.height
    least = MIN_VIEW_FRACTION * width
    covered = covered if layout.view.width - covered >= least else 0.0
    across = (2.0 * layout.view.x + layout.view.width + covered) / max(width, 1.0) - 1.0
    across = across if layout.view.width >= least else 0.0
    if layout.transport is None:
        return across, 0.0, 1.0
    above = layout.transport.y / max(height, 1.0)
    return across, 1.0 - above, above


def _timeline(view: Rect, scale: float) -> Rect | None:
    """Return the place under the view; `framing` shows the character above it."""
    m = MARGIN_PX * scale
    room = min(max((view.height / scale - TALL_FROM_PX) / (TALL_TO_PX - TALL_FROM_PX), 0.0), 1.0)
    wanted = (TIMELINE_HEIGHT_PX + room * TALLER_FRACTION * TRACKS_HEIGHT_PX) * scale
    height = min(wanted, MAX_TIMELINE_FRACTION * view.height)
    width = view.width - 2 * m
    if width < 180 * scale or height < 88 * scale:
        return None
    return Rect(view.x + m, view.y + view.height - height - m, width, height)
