"""Where the panels lie: a pure function of the window, so that nothing can overlap at any size or scale."""

from __future__ import annotations

from dataclasses import dataclass, replace

MARGIN = 10.0  # all lengths at scale 1
STATUS_HEIGHT = 30.0
LEFT_WIDTH, RIGHT_WIDTH = 316.0, 296.0
SCENE_MIN_WIDTH = 240.0  # of the free view between the columns
TIMELINE_HEIGHT = 202.0  # two rows of buttons, the ruler and the tracks
TRACKS_HEIGHT = 89.0  # of that, the tracks
MORE_TRACK_HEIGHT = 18.4  # more, for each track of a body part or of pins
TALL_FROM, TALL_TO, TALLER = 700.0, 1000.0, 0.6  # in views of such heights the tracks grow by this fraction
MAX_TIMELINE_SHARE = 0.45  # of the height above the status line
SCENE_PANEL_HEIGHT = 384.0  # with its sections folded; they scroll where there is no more room
CLIPS_MIN_HEIGHT, CLIPS_MAX_HEIGHT = 210.0, 460.0
PROMPT_MAX_HEIGHT = 770.0  # what the six fields fill
MIN_VIEW_SHARE = 0.2  # of the window's width; in less nothing is centred


@dataclass(frozen=True)
class Rect:
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
    view: Rect  # what stays free for the character
    transport: Rect | None = None
    prompt: Rect | None = None
    scene: Rect | None = None
    clips: Rect | None = None
    tabs: Rect | None = None
    right_tabs: Rect | None = None


def arrange(
    width: float,
    height: float,
    scale: float,
    panels: bool = True,
    transport: bool = False,
    scene_height: float = 0.0,
    more_tracks: int = 0,
    clips_height: float = 0.0,
) -> Layout:
    """Lay the panels out in a window of `width` x `height` screen units.

    `scene_height` is what the scene panel's contents need, 0 before they were measured, `clips_height` what the takes panel
    keeps. They change how the column is divided, never which panels there are: contents look different in another panel.
    """
    m, status_height = MARGIN * scale, STATUS_HEIGHT * scale
    status = Rect(0.0, max(height - status_height, 0.0), width, min(status_height, height))
    column_height = height - status_height - 2 * m
    view = Rect(0.0, 0.0, width, max(height - status_height, 1.0))
    columns: dict[str, Rect] = {}
    if panels and column_height >= 80 * scale:
        narrow = width < (LEFT_WIDTH + RIGHT_WIDTH + SCENE_MIN_WIDTH + 4 * MARGIN) * scale
        left = Rect(m, m, min(LEFT_WIDTH * scale, width - 2 * m), column_height)
        right = Rect(width - m - RIGHT_WIDTH * scale, m, RIGHT_WIDTH * scale, column_height)
        if narrow:
            columns = {"tabs": left}
            x = left.width + 2 * m
            view = Rect(x, 0.0, max(width - x, 1.0), view.height)
        else:
            prompt = replace(left, height=min(column_height, PROMPT_MAX_HEIGHT * scale))
            columns = {"prompt": prompt, **_divided(right, scale, scene_height, clips_height)}
            view = Rect(m + left.width, 0.0, right.x - m - left.width, view.height)
    bar = _timeline(view, scale, more_tracks) if transport else None
    return Layout(status, view, bar, **columns)


def _divided(column: Rect, scale: float, scene_height: float, clips_height: float) -> dict[str, Rect]:
    """The panels of the right column: one over the other, or as tabs where it is too low for that."""
    m = MARGIN * scale
    most = column.height - m - CLIPS_MIN_HEIGHT * scale
    if most < SCENE_PANEL_HEIGHT * scale:
        return {"right_tabs": column}
    most = column.height - m - max(CLIPS_MIN_HEIGHT * scale, clips_height)
    scene = replace(column, height=min(scene_height or SCENE_PANEL_HEIGHT * scale, most))
    rest = column.height - m - scene.height
    clips = Rect(column.x, scene.y + scene.height + m, column.width, min(rest, CLIPS_MAX_HEIGHT * scale))
    return {"scene": scene, "clips": clips}


def framing(layout: Layout, covered: float = 0.0) -> tuple[float, float, float]:
    """Middle of the free view, from -1 (left, bottom of the window) to 1, and the fraction of the height that it fills.

    So much of the view's left side is `covered`, unless hardly anything is left of it. 0 to the side where hardly
    anything is free.
    """
    width, height = layout.status.width, layout.status.y + layout.status.height
    least = MIN_VIEW_SHARE * width
    covered = covered if layout.view.width - covered >= least else 0.0
    across = (2.0 * layout.view.x + layout.view.width + covered) / max(width, 1.0) - 1.0
    across = across if layout.view.width >= least else 0.0
    if layout.transport is None:
        return across, 0.0, 1.0
    above = layout.transport.y / max(height, 1.0)
    return across, 1.0 - above, above


def _timeline(view: Rect, scale: float, more_tracks: int) -> Rect | None:
    """Under the view, which it takes from: `framing` shows the character above it."""
    m = MARGIN * scale
    more = MORE_TRACK_HEIGHT * more_tracks
    room = min(max((view.height / scale - TALL_FROM) / (TALL_TO - TALL_FROM), 0.0), 1.0)
    wanted = (TIMELINE_HEIGHT + more + room * TALLER * (TRACKS_HEIGHT + more)) * scale
    height = min(wanted, MAX_TIMELINE_SHARE * view.height)
    width = view.width - 2 * m
    if width < 180 * scale or height < 88 * scale:
        return None
    return Rect(view.x + m, view.y + view.height - height - m, width, height)
