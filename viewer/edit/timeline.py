"""The timeline: tracks of a take under a ruler, with marks of all kinds drawn and dragged by the same code.

Drawings are cached until a track, the available space or the frame range changes.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from viewer.edit.selection import Selection
from viewer.edit.timeline_look import (
    Part,
    Range,
    Row,
    Shapes,
    Track,
    base_of,
    dim,
    draw_mark,
    draw_ruler,
    hit_in,
    previewed,
)
from viewer.edit.tracks import Item, Items, Mark
from viewer.gl_bindings import imgui
from viewer.gui import theme, widgets
from viewer.gui.widgets import px
from viewer.session.playback import Playback

RULER_PX, SPACING_PX = 26.0, 3.0  # at scale 1, like all lengths here
USUAL_TRACKS, USUAL_HEIGHT_PX = 8, 109.0  # tracks of every take, and their height
MAX_HEIGHT_RATIO = 1.6  # maximum growth of a track's height
NAMES_WIDTH_PX, NAMES_FROM_PX = 70.0, 420.0  # in a narrower bar the tracks have no names
EDGE_PX = 4.0  # outside both ends of a row, for half a handle
SCROLL_STEP_FRACTION = 0.1  # of the range shown
BUTTON_WIDTH_PX = 30.0
NAME_SIZE_PX = theme.FONT_SIZE_PX * 0.87  # letter size
SNAP_REACH_PX = 6.0  # snapping distance
MIN_BOX_PX = 4.0  # a shorter drag is a click
TRIM_HINT = "Drag: only what lies between the handles plays and is exported"


@dataclass(frozen=True)
class Held:
    """A mark being dragged since frame `grabbed`, with the items that move along and the frames to snap to."""

    key: str
    mark: Mark
    part: Part
    grabbed: int
    items: Items
    snaps: tuple[int, ...] = ()
    snapped: int | None = None
    by: int = 0
    moved: bool = False


@dataclass
class Timeline:
    """State of the timeline: the frames in view, the drag in progress, and cached drawings."""

    trim: Callable[[int | None, int | None], None]  # first and last frame, while a handle is dragged
    selection: Selection
    held: Held | None = None
    box: tuple[float, float] | None = None  # corner where a selection box begins
    shown: Range = field(default_factory=lambda: Range(0.0, 1.0, 1.0))
    _of: tuple[int, int] = (-1, 0)  # the take and frame shown last
    _zero: int = 0  # the frame that is numbered 0
    _bar: float = 0.0  # width of the scrollbar in the last frame
    _scrolling: bool = False  # the middle button drags the tracks
    _menu: tuple[str, int] = ("", 0)  # track and frame of a right click
    _kept: dict[str, tuple[Any, Shapes]] = field(default_factory=dict)

    def fit(self, selection: tuple[int, int] | None = None) -> None:
        """Show the whole take, or the given frames with a margin."""
        first, last = selection or (0, self.shown.end)
        around = 0.0 if selection is None else 0.05 * (last - first)
        self.shown = self.shown.fitted(first - around, last + around)

    @property
    def whole(self) -> bool:
        return self.shown.frames >= self.shown.end

    def _follow(self, playback: Playback) -> None:
        """Keep the range within the take, and the shown frame within it while playing or seeking."""
        (take, before), end, now = self._of, max(playback.frames - 1.0, 1.0), playback.frame
        dragger = self.selection.editing.takes.editor.dragger
        if take != playback.number or (self.held is not None and dragger is not self):
            self.held = self.box = None
        if take != playback.number or (end != self.shown.end and self.whole):
            self.shown, self._zero = Range(0.0, end, end), playback.take.numbered_from
            if playback.take.numbered_from:
                self.fit((playback.first, playback.last))
        shown = self.shown = replace(self.shown, end=end).fitted(self.shown.first, self.shown.last)
        seen = before in shown or not playback.playing
        if now != before and seen and now not in shown:
            self.shown = shown.scrolled(now - shown.first - 0.1 * shown.frames)
        self._of = playback.number, now

    def draw(self, tracks: Sequence[Track], playback: Playback, selection: tuple[int, int]) -> None:
        """Draw the tracks to fit the available height, with scrolling if they need more. A button zooms to the `selection`."""
        self._follow(playback)
        room = imgui.get_content_region_avail()
        tracks, tall = _fitting(tracks, room.y / px(1.0))
        imgui.push_style_var(imgui.StyleVar_.item_spacing, imgui.ImVec2(0, px(SPACING_PX)))
        corner = imgui.get_cursor_screen_pos()
        names = px(NAMES_WIDTH_PX) if room.x >= px(NAMES_FROM_PX) else 0.0
        # the ruler above the tracks has their width, also when they scroll
        self._rows("ruler", [self._ruler(playback)], playback, 1.0, self._bar)
        below = imgui.get_cursor_pos()
        if names:
            self._fit_buttons(corner, selection)
        imgui.set_cursor_pos(below)
        over_names = imgui.get_io().mouse_pos.x < corner.x + names
        flags = 0 if over_names else imgui.WindowFlags_.no_scroll_with_mouse
        if imgui.begin_child("tracks", imgui.ImVec2(0, 0), window_flags=flags):
            self._rows("tracks", tracks, playback, tall, 0.0)
            self._draw_box()
            self._bar = imgui.get_style().scrollbar_size * (imgui.get_scroll_max_y() > 0.0)
        imgui.end_child()
        imgui.pop_style_var()

    def _rows(self, name: str, tracks: Sequence[Track], playback: Playback, tall: float, bar: float) -> None:
        """Draw tracks with a line at the frame shown."""
        corner, width = imgui.get_cursor_screen_pos(), imgui.get_content_region_avail().x - bar
        place = corner.x, corner.y, width, bar, tall, px(1.0)
        kept, chosen = (playback.first, playback.last), self.selection
        state = tracks, place, self.shown, (chosen.keys, chosen.preview), kept, self._zero
        known = self._kept.get(name)
        if known is None or known[0] != state:
            known = self._kept[name] = state, self._shapes(tracks, place, kept)
        rows = known[1].rows
        for row in rows:
            self._row(row, playback)
        at = rows[0].x(min(max(playback.time_s * playback.clip.fps, 0.0), playback.frames - 1.0))
        # below the ruler's numbers
        half, top = (px(1.5), base_of(rows[0]) - px(4)) if name == "ruler" else (px(0.5), rows[0].top)
        low, high = imgui.ImVec2(at - half, top), imgui.ImVec2(at + half, rows[-1].top + rows[-1].height)
        inside = rows[0].left - half <= at <= rows[0].right + half
        lines = [(low, high, widgets.packed(theme.TEXT), 0.0)] if inside else []
        if self.held is not None and self.held.snapped is not None:
            x = rows[0].x(self.held.snapped)
            low, high = imgui.ImVec2(x - px(1), low.y), imgui.ImVec2(x + px(1), high.y)
            lines.append((low, high, widgets.packed(theme.ACCENT), 0.0))
        known[1].draw(*lines)

    def _fit_buttons(self, corner: imgui.ImVec2, selection: tuple[int, int]) -> None:
        imgui.set_cursor_screen_pos(corner)
        size = imgui.ImVec2(px(BUTTON_WIDTH_PX), px(RULER_PX - 4))
        imgui.push_style_var(imgui.StyleVar_.frame_padding, imgui.ImVec2(0, 0))
        imgui.push_font(None, NAME_SIZE_PX)
        if imgui.button("Fit##all", size):
            self.fit()
        widgets.tooltip("Show the whole take (Z)\nWheel zooms; Shift+wheel or a middle drag scrolls")
        imgui.same_line(0, px(3))
        if imgui.button("Sel##fit selection", size):
            self.fit(selection)
        widgets.tooltip("Show the selected pin, or the trimmed range (Z)")
        imgui.pop_font()
        imgui.pop_style_var()

    def _row(self, row: Row, playback: Playback) -> None:
        """Let a row receive the mouse, including a margin outside its ends."""
        edge, key = (row.outer - row.width) / 2, row.track.key
        imgui.set_cursor_screen_pos(imgui.ImVec2(row.left - edge, row.top))
        imgui.invisible_button(f"##{key}", imgui.ImVec2(max(row.outer, 1.0), max(row.height, 1.0)))
        self._navigate(row)
        used = imgui.is_item_active() or imgui.is_item_hovered() or imgui.is_item_deactivated()
        if used or self._holds(row.track):
            self._use_mouse(row, playback)
        if self._menu[0] == key and imgui.begin_popup(f"menu of {key}"):
            for text, act in row.track.more:
                if widgets.item(text):
                    act(self._menu[1])
            self.selection.menu()
            imgui.end_popup()

    def _holds(self, track: Track) -> Held | None:
        return self.held if self.held is not None and self.held.key == track.key else None

    def _navigate(self, row: Row) -> None:
        """Zoom and scroll with the wheel and the middle button over the row of the last item."""
        io, per_pixel = imgui.get_io(), self.shown.frames / max(row.width, 1.0)
        hovered, shown = imgui.is_item_hovered(), self.shown
        begins = imgui.is_mouse_clicked(2)  # the movement before the press is not part of the drag
        self._scrolling = (self._scrolling or (begins and hovered)) and imgui.is_mouse_down(2)
        if self._scrolling and row.track.key == "timeline":  # once per frame
            shown = shown.scrolled(-io.mouse_delta.x * per_pixel * (not begins))
        wheel = (io.mouse_wheel or io.mouse_wheel_h) * hovered  # Shift turns it sideways in some systems
        if wheel and io.key_shift:
            shown = shown.scrolled(-wheel * SCROLL_STEP_FRACTION * shown.frames)
        elif wheel:
            at = shown.first + (io.mouse_pos.x - row.left) * per_pixel
            shown = shown.zoomed(min(max(at, shown.first), shown.last), wheel)
        self.shown = shown

    # --- drawing

    def _shapes(self, tracks: Sequence[Track], place: tuple[float, ...], kept: tuple[int, int]) -> Shapes:
        x, top, width, bar, tall, unit = place
        names = unit * NAMES_WIDTH_PX if width + bar >= unit * NAMES_FROM_PX else 0.0
        edge, shapes = unit * EDGE_PX, Shapes()
        for track in tracks:
            inner, height = width - names - 2 * edge, unit * track.height * tall
            row = Row(track, x + names + edge, top, inner, height, inner + 2 * edge, self.shown)
            shapes.rows.append(row)
            if names and track.name:
                shapes.text(x, row, track.name, theme.MUTED, names - 4 * unit, NAME_SIZE_PX)
            if track.key == "timeline":
                draw_ruler(shapes, row, self._zero)
            else:
                self._draw_track(shapes, row)
                dim(shapes, row, kept)
            top += row.height + unit * SPACING_PX
        return shapes

    def _draw_track(self, shapes: Shapes, row: Row) -> None:
        track, bottom = row.track, row.top + row.height
        if not track.adjacent:
            shapes.rect(row.left, row.top, row.right, bottom, theme.FIELD, px(3))
        marks = list(enumerate(self._moved(track)))
        if track.adjacent:  # short ones overlap their neighbours
            marks.sort(key=lambda each: each[1].start - each[1].end)
        for i, mark in marks:
            tint, (left, right) = track.tints[i % len(track.tints)], row.ends(mark)
            if left <= row.right and right >= row.left:
                chosen = mark.item is not None and mark.item.key in self.selection.keys
                draw_mark(shapes, row, mark, tint, i == track.lit, chosen)

    def _moved(self, track: Track) -> Sequence[Mark]:
        """Return the marks; of an adjacent track as they would be after the current drag or resimulation."""
        preview = self.selection.preview
        shown = preview is not None and track.adjacent and bool(track.marks)
        return previewed(track, *preview[1:]) if preview and shown else track.marks

    def _ruler(self, playback: Playback) -> Track:
        """Return the track of frame numbers, with trim handles draggable in its lower half."""

        def move(mark: Mark, start: int) -> None:
            self.trim(*((start, None) if mark.of == "first" else (None, start)))

        first, last = playback.first, playback.last
        marks = (Mark(first, first, hint=TRIM_HINT, of="first"), Mark(last, last, hint=TRIM_HINT, of="last"))
        known = self._kept.get("ruler")
        if known is not None and known[1].rows[0].track.marks == marks:
            return known[1].rows[0].track
        return Track("timeline", "", RULER_PX, marks, (theme.ACCENT,), move=move)

    # --- the mouse

    def _use_mouse(self, row: Row, playback: Playback) -> None:
        """Use the mouse on the row of the last item; on the ruler the shown frame follows it."""
        track, mouse = row.track, imgui.get_io().mouse_pos
        frame, hit = row.frame_at(mouse.x), hit_in(row, mouse)
        if imgui.is_item_activated():
            self._press(track, hit, frame, playback)
        held = self._holds(track)
        if held is not None:
            self._carry(held, row, frame, playback)
        elif imgui.is_item_active() and self.box is None:
            playback.seek(frame)
        elif imgui.is_item_hovered():
            self._hover(track, hit, frame)
        if imgui.is_item_deactivated():
            self._let_go(track, frame, playback)

    def _press(self, track: Track, hit: tuple[Mark, Part] | None, frame: int, playback: Playback) -> None:
        """Take a mark together with the selection, or begin a box; Shift extends the selection."""
        selection, io = self.selection, imgui.get_io()
        if hit is None:
            self.box = None if track.key == "timeline" else (io.mouse_pos.x, io.mouse_pos.y)
            return
        mark, part = hit
        item = mark.item
        if item is None:
            items: Items = selection.items
        else:
            if io.key_shift or item.key not in selection.keys:
                selection.pick([item], extend=io.key_shift)
            items = selection.items if part is Part.BODY else [item]
        if item is not None or track.move is not None:
            selection.editing.takes.editor.begin_drag(self)
            self.held = Held(track.key, mark, part, frame, items, self._snaps(playback))

    def _snaps(self, playback: Playback) -> tuple[int, ...]:
        """Return the frames that a drag snaps to: the shown one, the trim, and the ends of unselected marks."""
        rows = self._kept["tracks"][1].rows if self._kept else []
        marks = [mark for row in rows for mark in row.track.marks]
        free = [m for m in marks if m.item is None or m.item.key not in self.selection.keys]
        ends = {frame for mark in free for frame in (mark.start, mark.end)}
        return tuple(sorted({playback.frame, playback.first, playback.last, *ends}))

    def _carry(self, held: Held, row: Row, frame: int, playback: Playback) -> None:
        track, by = row.track, frame - held.grabbed
        if track.fixed or not (by or held.moved):
            return
        imgui.set_mouse_cursor(imgui.MouseCursor_.resize_ew)
        if track.move is not None:
            self.held = replace(held, moved=True)
            track.move(held.mark, min(max(held.mark.start + by, 0), round(row.shown.end)))
            return
        by, snapped = self._snapped(held, by, row)
        if by != held.by or not held.moved:
            self._move(held, by, playback, held=True)
        self.held = replace(held, moved=True, by=by, snapped=snapped)

    def _snapped(self, held: Held, by: int, row: Row) -> tuple[int, int | None]:
        """Return the frames to move by, and the frame snapped to: the nearest one in reach; Alt disables snapping."""
        ends = {held.mark.start} if held.part is not Part.END else set[int]()
        ends |= {held.mark.end} if held.part is not Part.START else set()
        reach = px(SNAP_REACH_PX) / row.width * row.shown.frames
        near = [(abs(snap - end - by), snap, snap - end) for snap in held.snaps for end in ends]
        away, snap, to = min(near, default=(math.inf, 0, 0))
        if away > reach or imgui.get_io().key_alt:
            return by, None
        return to, snap

    def _move(self, grip: Held, by: int, playback: Playback, **how: bool) -> None:
        """Move the held items by frames from their original places, or one end of an item."""
        selection, item = self.selection, grip.mark.item
        if grip.part is Part.BODY or item is None:
            made = selection.moved(grip.items, by)
        else:
            made = [selection.resized(item, by, grip.part is Part.START)]
        selection.replace("move", grip.items, made, **how)
        if item is not None and item.start == item.end:
            playback.seek(item.start + by)

    def _let_go(self, track: Track, frame: int, playback: Playback) -> None:
        held, box, self.held, self.box = self.held, self.box, None, None
        if box is not None:
            self._end_box(box, frame, playback)
        elif held is None or (held.mark.item is None and held.moved):
            return
        elif held.moved:
            self._move(held, held.by, playback)
        elif not imgui.get_io().key_shift:
            self._click(track, held.mark, frame, playback)

    def _end_box(self, box: tuple[float, float], frame: int, playback: Playback) -> None:
        """Select the items touched by the box; without a box deselect, and show the frame."""
        mouse = imgui.get_io().mouse_pos
        if math.hypot(mouse.x - box[0], mouse.y - box[1]) < px(MIN_BOX_PX):
            self.selection.let_go()
            playback.seek(frame)
        else:
            self.selection.pick(self._inside(box, mouse), extend=imgui.get_io().key_shift)

    def _click(self, track: Track, mark: Mark, frame: int, playback: Playback) -> None:
        """Select a single mark, and show its frame unless a pin or footplant is there."""
        if mark.item is not None:
            self.selection.pick([mark.item])
        if not track.key.startswith(("foot", "pins")):
            playback.seek(mark.start if mark.start == mark.end else frame)

    def _inside(self, corner: tuple[float, float], mouse: imgui.ImVec2) -> list[Item]:
        (left, right), (top, bottom) = sorted((corner[0], mouse.x)), sorted((corner[1], mouse.y))
        return [
            mark.item
            for row in self._kept["tracks"][1].rows
            for mark in row.track.marks
            if mark.item is not None and row.top <= bottom and row.top + row.height >= top
            and row.ends(mark)[0] <= right and row.ends(mark)[1] >= left
        ]  # fmt: skip

    def _draw_box(self) -> None:
        if self.box is not None:
            drawing, mouse = imgui.get_window_draw_list(), imgui.get_io().mouse_pos
            corner = imgui.ImVec2(*self.box)
            drawing.add_rect_filled(corner, mouse, widgets.packed((*theme.ACCENT[:3], 0.15)))
            drawing.add_rect(corner, mouse, widgets.packed(theme.ACCENT))

    def _hover(self, track: Track, hit: tuple[Mark, Part] | None, frame: int) -> None:
        if hit is None:
            hint = ""
        else:
            mark, part = hit
            hint = mark.hint or mark.text
            if not track.fixed and (part is not Part.BODY or mark.start == mark.end):
                imgui.set_mouse_cursor(imgui.MouseCursor_.resize_ew)
        widgets.tooltip(track.hint or hint)
        if imgui.is_mouse_clicked(1) and track.key != "timeline":
            self._open_menu(track, None if hit is None else hit[0], frame)

    def _open_menu(self, track: Track, mark: Mark | None, frame: int) -> None:
        if mark is None:
            self.selection.let_go()
        elif mark.item is not None and mark.item.key not in self.selection.keys:
            self.selection.pick([mark.item])
        self._menu = track.key, frame
        imgui.open_popup(f"menu of {track.key}")


def _fitting(tracks: Sequence[Track], room: float) -> tuple[Sequence[Track], float]:
    """Return the tracks that fit, and the factor on their height.

    The factor does not depend on their number, so that no track moves when another one appears.
    """
    fits = (room - RULER_PX - (USUAL_TRACKS + 1) * SPACING_PX) / USUAL_HEIGHT_PX
    if fits < 1.0:
        return [track for track in tracks if not track.optional], 1.0
    return tracks, min(fits, MAX_HEIGHT_RATIO)
