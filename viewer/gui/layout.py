"""Where the panels lie: a pure function of the window, so that nothing can overlap at any size or scale."""

from __future__ import annotations

from dataclasses import dataclass

MARGIN = 10.0  # all lengths at scale 1
STATUS_HEIGHT = 30.0
LEFT_WIDTH, RIGHT_WIDTH = 316.0, 296.0
SCENE_MIN_WIDTH = 240.0  # of the free view between the columns
TRANSPORT_HEIGHT = 88.0
SCENE_PANEL_HEIGHT = 330.0  # before its contents were measured
CLIPS_MIN_HEIGHT, CLIPS_MAX_HEIGHT = 210.0, 460.0
PROMPT_MAX_HEIGHT = 770.0  # what the six fields fill
MIN_VIEW_SHARE = 0.2  # of the window's width; in less nothing is centred


@dataclass(frozen=True)
class Rect:
    """A rectangle in screen units."""

    x: float
    y: float
    width: float
    height: float


@dataclass(frozen=True)
class Layout:
    """Panels of one window size; None where there is no room.

    `tabs` replaces both columns in a narrow window, `right_tabs` the two panels on the right in a low one.
    """

    status: Rect
    prompt: Rect | None
    scene: Rect | None
    clips: Rect | None
    tabs: Rect | None
    right_tabs: Rect | None
    transport: Rect | None
    view: Rect  # what stays free for the character


def arrange(
    width: float,
    height: float,
    scale: float,
    panels: bool = True,
    transport: bool = False,
    scene_height: float = 0.0,
) -> Layout:
    """Lay the panels out in a window of `width` x `height` screen units.

    `scene_height` is what the scene panel's contents need; where the clips would keep too little, the two share tabs.
    """
    m, status_height = MARGIN * scale, STATUS_HEIGHT * scale
    status = Rect(0.0, max(height - status_height, 0.0), width, min(status_height, height))
    column_height = height - status_height - 2 * m
    full = Rect(0.0, 0.0, width, max(height - status_height, 1.0))
    if not panels or column_height < 80 * scale:
        bar = _transport(full, scale) if transport else None
        return Layout(status, None, None, None, None, None, bar, full)
    if width < (LEFT_WIDTH + RIGHT_WIDTH + SCENE_MIN_WIDTH + 4 * MARGIN) * scale:
        tabs_width = min(LEFT_WIDTH * scale, width - 2 * m)
        tabs = Rect(m, m, tabs_width, column_height)
        view = Rect(tabs_width + 2 * m, 0.0, max(width - tabs_width - 2 * m, 1.0), full.height)
        bar = _transport(view, scale) if transport else None
        return Layout(status, None, None, None, tabs, None, bar, view)
    prompt = Rect(m, m, LEFT_WIDTH * scale, min(column_height, PROMPT_MAX_HEIGHT * scale))
    right = width - m - RIGHT_WIDTH * scale
    view = Rect(prompt.x + prompt.width, 0.0, right - prompt.x - prompt.width, full.height)
    bar = _transport(view, scale) if transport else None
    scene_height = scene_height or SCENE_PANEL_HEIGHT * scale
    rest = column_height - m - scene_height
    if rest < CLIPS_MIN_HEIGHT * scale:
        right_tabs = Rect(right, m, RIGHT_WIDTH * scale, column_height)
        return Layout(status, prompt, None, None, None, right_tabs, bar, view)
    scene = Rect(right, m, RIGHT_WIDTH * scale, scene_height)
    clips = Rect(right, m + scene_height + m, RIGHT_WIDTH * scale, min(rest, CLIPS_MAX_HEIGHT * scale))
    return Layout(status, prompt, scene, clips, None, None, bar, view)


def view_centre(layout: Layout) -> float:
    """Middle of the free view from -1 (left edge of the window) to 1; 0 where hardly anything is free."""
    width = layout.status.width
    if layout.view.width < MIN_VIEW_SHARE * width:
        return 0.0
    return 2.0 * (layout.view.x + layout.view.width / 2) / max(width, 1.0) - 1.0


def _transport(view: Rect, scale: float) -> Rect | None:
    m, height = MARGIN * scale, TRANSPORT_HEIGHT * scale
    width = min(view.width - 2 * m, 720 * scale)
    if width < 180 * scale or view.height < height + 2 * m:
        return None
    return Rect(view.x + (view.width - width) / 2, view.y + view.height - height - m, width, height)
