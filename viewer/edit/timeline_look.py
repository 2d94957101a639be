"""Drawing of the timeline's tracks: rows on the screen, marks, ruler, and hit tests."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from enum import Enum, auto

from runtime.takes.input_edits import laid
from viewer.edit.tracks import Item, Items, Mark
from viewer.gl_bindings import imgui
from viewer.gui import theme, widgets
from viewer.gui.theme import Color
from viewer.gui.widgets import px

TICK_STEPS = (1, 2, 5, 10, 20, 30, 60, 120, 300, 600, 1200, 3600, 7200, 18000, 36000)
MIN_TICK_PX = 56.0  # minimum distance of two numbers
MIN_SPAN_PX = 9.0  # minimum width of adjacent spans, so that a jump in a long take can be clicked
MIN_SHOWN_FRAMES = 12.0  # in the closest zoom
ZOOM_STEP_FACTOR = 0.8
GRIP_PX = 7.0  # distance at which the mouse takes the end of a mark, or a point
MIN_LETTERS = 3  # of a shortened word, with its dots
MIN_LETTER_PX, TEXT_FRACTION = theme.FONT_SIZE_PX * 0.8, 0.76  # minimum letter size; of a row's height
DIM_TINT = (*theme.PANEL[:3], 0.6)  # over the trimmed frames
SELECTED_TINT = (1.0, 1.0, 1.0, 0.9)


@dataclass(frozen=True)
class Range:
    """The frames in view, of a take whose last frame is `end`."""

    first: float
    last: float
    end: float

    @property
    def frames(self) -> float:
        return self.last - self.first

    def __contains__(self, frame: float) -> bool:
        return self.first <= frame <= self.last

    def fitted(self, first: float, last: float) -> Range:
        """Return the range moved and clamped to lie within the take."""
        frames = min(max(last - first, MIN_SHOWN_FRAMES), self.end)
        first = min(max(first, 0.0), self.end - frames)
        return replace(self, first=first, last=first + frames)

    def scrolled(self, frames: float) -> Range:
        return self.fitted(self.first + frames, self.last + frames)

    def zoomed(self, at: float, steps: float) -> Range:
        """Return the range zoomed by wheel steps around the frame `at`."""
        scale = max(ZOOM_STEP_FACTOR**steps, MIN_SHOWN_FRAMES / max(self.frames, 1.0))
        return self.fitted(at - (at - self.first) * scale, at + (self.last - at) * scale)


class Part(Enum):
    """The part of a mark that is dragged."""

    BODY = auto()
    START = auto()
    END = auto()


@dataclass(frozen=True)
class Track:
    """A row of the timeline.

    Marks with an item belong to the selection. `move` drags a handle of the ruler to another frame. `more` are context
    menu entries for free frames.
    """

    key: str
    name: str
    height: float
    marks: Sequence[Mark]
    tints: Sequence[Color]
    hint: str = ""  # of the whole row, instead of its marks'
    lit: int = -1  # index of the highlighted mark
    adjacent: bool = False  # each mark ends where the next one begins
    optional: bool = False  # shown only if there is room
    fixed: bool = False  # nothing can be dragged
    move: Callable[[Mark, int], None] | None = None
    more: tuple[tuple[str, Callable[[int], None]], ...] = ()


@dataclass(frozen=True)
class Row:
    """A track's screen rectangle, and its mapping from frames to pixels."""

    track: Track
    left: float
    top: float
    width: float
    height: float
    outer: float  # width including the margins that take the mouse
    shown: Range

    @property
    def right(self) -> float:
        return self.left + self.width

    def ends(self, mark: Mark) -> tuple[float, float]:
        """Return the screen positions of a mark's ends, which may be outside the row; adjacent spans have a minimum width."""
        left, right = self.x(mark.start), self.x(min(mark.end, self.shown.end))
        more = (px(MIN_SPAN_PX) - (right - left)) / 2 if self.track.adjacent else 0.0
        return left - max(more, 0.0), right + max(more, 0.0)

    def x(self, frame: float) -> float:
        return self.left + (frame - self.shown.first) / max(self.shown.frames, 1.0) * self.width

    def frame_at(self, x: float) -> int:
        """Return the frame under a screen position, clamped to those in view."""
        along = min(max((x - self.left) / max(self.width, 1.0), 0.0), 1.0)
        return round(self.shown.first + along * self.shown.frames)


@dataclass
class Shapes:
    """Draw commands for a group of rows."""

    rows: list[Row] = field(default_factory=list)
    rects: list[tuple[imgui.ImVec2, imgui.ImVec2, int, float]] = field(default_factory=list)
    points: list[tuple[imgui.ImVec2, float, int, int]] = field(default_factory=list)
    # by letter size
    texts: list[tuple[float, imgui.ImVec2, int, str]] = field(default_factory=list)

    def rect(
        self, left: float, top: float, right: float, bottom: float, tint: Color, rounding: float
    ) -> None:
        low, high = imgui.ImVec2(left, top), imgui.ImVec2(right, bottom)
        self.rects.append((low, high, widgets.packed(tint), rounding))

    def text(self, x: float, row: Row, text: str, tint: Color, width: float, size: float = 0.0) -> None:
        """Add vertically centred text, shortened to a width; omitted if fewer than three letters fit."""
        size = size or min(max(TEXT_FRACTION * row.height / px(1.0), MIN_LETTER_PX), theme.FONT_SIZE_PX)
        imgui.push_font(None, size)
        y, shown = row.top + (row.height - imgui.get_text_line_height()) / 2, widgets.elided(text, width)
        if shown == text or len(shown) > MIN_LETTERS:
            self.texts.append((size, imgui.ImVec2(x, y), widgets.packed(tint), shown))
        imgui.pop_font()

    def draw(self, *lines: tuple[imgui.ImVec2, imgui.ImVec2, int, float]) -> None:
        """Draw everything, with `lines` below the texts."""
        drawing = imgui.get_window_draw_list()
        for rect in [*self.rects, *lines]:
            drawing.add_rect_filled(*rect)
        for point in self.points:
            drawing.add_ngon_filled(*point)
        for size, place, tint, text in self.texts:
            imgui.push_font(None, size)
            drawing.add_text(place, tint, text)
            imgui.pop_font()


def draw_mark(shapes: Shapes, row: Row, mark: Mark, tint: Color, lit: bool, chosen: bool) -> None:
    left, right = row.ends(mark)
    bottom, half, adjacent = row.top + row.height, row.height / 2, row.track.adjacent
    if mark.start == mark.end:
        place = imgui.ImVec2(left, row.top + half)
        if chosen:
            shapes.points.append((place, half * 1.2, widgets.packed(SELECTED_TINT), 4))
        shapes.points.append((place, half * 0.95, widgets.packed(tint), 4))
        return
    short = right - left < px(MIN_SPAN_PX) + 1 and adjacent
    left = max(left, row.left)
    right = max(min(right, row.right) - px(1), left + 1)
    if adjacent:
        shapes.rect(left, row.top, right, bottom, theme.FIELD, px(3))
    if chosen:
        shapes.rect(left - px(1), row.top - px(1), right + px(1), bottom + px(1), SELECTED_TINT, px(3))
        shapes.rect(left, row.top, right, bottom, theme.PANEL, px(3))
    fill = (*tint[:3], min(tint[3] + 0.12 * lit + 0.3 * short, 1.0))
    shapes.rect(left, row.top, right, bottom, fill, px(3) if mark.text else px(1))
    if mark.text:
        shapes.text(left + px(5), row, mark.text, theme.TEXT, right - left - px(8))


def base_of(row: Row) -> float:
    """Return the bottom of the ruler's numbers."""
    return row.top + row.height * 0.62


def dim(shapes: Shapes, row: Row, kept: tuple[int, int]) -> None:
    """Darken the frames outside the trim."""
    first, last = (min(max(row.x(frame), row.left), row.right) for frame in kept)
    for left, right in ((row.left, first), (last, row.right)):
        if right - left > 1.0:
            shapes.rect(left, row.top, right, row.top + row.height, DIM_TINT, 0.0)


def draw_ruler(shapes: Shapes, row: Row, zero: int) -> None:
    """Draw the ruler, numbered from frame `zero`, and the trimmed range."""
    base, bottom, shown = base_of(row), row.top + row.height, row.shown
    first, last = (mark.start for mark in row.track.marks)
    within = lambda x: min(max(x, row.left), row.right)  # noqa: E731
    shapes.rect(row.left, base, row.right, bottom, theme.FIELD, 2.0)
    shapes.rect(within(row.x(first)), base, within(row.x(last)), bottom, theme.ACCENT_FILL, 2.0)
    per_frame = row.width / max(shown.frames, 1.0)
    step = next((s for s in TICK_STEPS if s * per_frame >= px(MIN_TICK_PX)), TICK_STEPS[-1])
    numbers = replace(row, height=px(MIN_LETTER_PX) / TEXT_FRACTION)
    for number in range(
        -(-math.ceil(shown.first - zero) // step) * step, math.floor(shown.last) - zero + 1, step
    ):
        x = row.x(number + zero)
        shapes.rect(x, base - px(4), x + 1, base, theme.MUTED, 0.0)
        if x + px(28) < row.right or number == -zero:
            shapes.text(x + px(3), numbers, str(number), theme.MUTED, px(60))
    for frame, side in ((first, 1), (last, -1)):
        left, right = sorted((row.x(frame), row.x(frame) + side * px(5)))
        if row.left - 1 <= row.x(frame) <= row.right + 1:
            shapes.rect(left, base - px(1), right, bottom, theme.ACCENT, px(2))


def previewed(track: Track, gone: Items, put: Items) -> Sequence[Mark]:
    """Return the marks of an adjacent track as they would be after an edit."""
    marks, keys = track.marks, {item.key for item in gone}
    places = [i for i, mark in enumerate(marks) if mark.item is not None and mark.item.key in keys]
    put = [item for item in put if item.kind == track.key]
    of = [*marks, *(_mark_of(marks, item) for item in put)]
    return [replace(of[b.of], start=b.start, end=b.end) for b in laid(marks, places, put)]


def _mark_of(marks: Sequence[Mark], item: Item) -> Mark:
    """Return the mark of an item, whatever its frames; else the first one."""
    return next((m for m in marks if m.item is not None and m.item.value is item.value), marks[0])


def hit_in(row: Row, mouse: imgui.ImVec2) -> tuple[Mark, Part] | None:
    """Return the mark under the mouse and the part of it, or None."""
    track, marks, x = row.track, row.track.marks, mouse.x
    if not marks or (track.key == "timeline" and mouse.y < row.top + 0.5 * row.height):
        return None
    if track.adjacent:
        x = min(max(x, row.ends(marks[0])[0]), row.ends(marks[-1])[1])
    found = [mark for mark in marks if _covers(row, mark, x)]
    if track.adjacent:  # a short one overlaps its neighbours
        found.sort(key=lambda mark: mark.end - mark.start)
    return (found[0], _part(row, found[0], x)) if found else None


def _covers(row: Row, mark: Mark, x: float) -> bool:
    """Return whether the mouse takes a mark at `x`: a point from a distance, a span from just outside its ends."""
    left, right = row.ends(mark)
    slack = 0.0 if row.track.adjacent else px(GRIP_PX) if mark.start == mark.end else px(GRIP_PX) / 2
    return left - slack <= x <= right + slack


def _part(row: Row, mark: Mark, x: float) -> Part:
    """Return the part of a mark at `x`; the first and last of adjacent marks end with the take."""
    (left, right), marks, adjacent = row.ends(mark), row.track.marks, row.track.adjacent
    if mark.start == mark.end:
        return Part.BODY
    grip = min(px(GRIP_PX), (right - left) / 4)
    if x - left <= grip and not (adjacent and mark is marks[0]):
        return Part.START
    return Part.END if right - x <= grip and not (adjacent and mark is marks[-1]) else Part.BODY
