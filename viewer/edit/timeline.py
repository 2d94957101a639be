"""The tracks of the take that plays: a ruler with trim handles, prompts, body parts, gaits, ground and foot contacts."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

from runtime.skeleton import PART_NAMES
from runtime.takes.input_edits import Span, fitted
from viewer.edit import pose_tracks
from viewer.edit.camera_keys import CameraKeys
from viewer.edit.pins import Pins
from viewer.edit.resimulation import Drag, Resimulation
from viewer.edit.track_drawing import (
    GRIP,
    SMALL,
    TEXT_SHARE,
    TrackRow,
    draw_bar,
    draw_rect,
    draw_text,
    new_row,
    shown_at,
    take_mouse,
)
from viewer.edit.tracks import LabelledSpan, lanes
from viewer.gl_bindings import imgui
from viewer.gui import theme, widgets
from viewer.gui.theme import Color
from viewer.gui.widgets import px
from viewer.session.playback import Playback
from viewer.session.takes import Takes

RULER, PROMPTS, ROW, FEET = 26.0, 21.0, 15.0, 8.0  # heights at scale 1, where there is no more room
SPACING = 3.0
TALLEST = 1.6  # of these heights, where there is
TICK_STEPS = (1, 2, 5, 10, 20, 30, 60, 120, 300, 600, 1200, 3600, 7200, 18000, 36000)
TICK_WIDTH = 56.0  # at least, between two numbers
PROMPT_TINTS = (theme.ACCENT_FILL, (0.36, 0.55, 0.78, 0.42))
GAIT_TINT: Color = (0.78, 0.62, 0.34, 0.42)
GROUND_TINT: Color = (0.55, 0.58, 0.62, 0.35)
PART_TINT: Color = (0.36, 0.55, 0.78, 0.28)


def draw(editing: Resimulation, pins: Pins, camera: CameraKeys, playback: Playback) -> None:
    """The tracks, one below the other, as tall as there is room; in less height than they need they scroll."""
    tracks = editing.tracks
    if tracks is None:
        return
    parts = PART_NAMES if editing.part_tracks else ()
    rows = lanes(pins.pins)
    room = _room(len(parts) + len(rows) + bool(camera.keys))
    tall = min(max(room, 1.0), TALLEST)
    imgui.push_style_var(imgui.StyleVar_.item_spacing, imgui.ImVec2(0, px(SPACING)))
    # the ruler above the tracks is as wide as they are, also where they scroll (known from the frame before)
    storage, key = imgui.get_state_storage(), imgui.get_id("tracks scroll")
    _ruler(editing.takes, playback, imgui.get_style().scrollbar_size if storage.get_bool(key) else 0.0)
    scrolls = False
    if imgui.begin_child("tracks", imgui.ImVec2(0, 0)):
        top = imgui.get_cursor_screen_pos().y
        _spans("Prompts", "prompts", tracks.prompts, PROMPTS * tall, editing, playback)
        for part in parts:
            name = part.replace("_", " ").capitalize()
            _still(name, tracks.parts[part], ROW * tall, PART_TINT, playback)
        _spans("Gait", "gaits", tracks.gaits, ROW * tall, editing, playback)
        if room >= 1.0 or len(tracks.grounds) > 1:  # one ground all the way says the least
            _still("Ground", tracks.grounds, ROW * tall, GROUND_TINT, playback)
        if camera.keys:
            camera.draw_track(ROW * tall, playback)
        if rows:
            pose_tracks.draw_pins(pins, rows, ROW * tall, playback)
        pose_tracks.draw_feet(pins, FEET * tall, playback)
        bottom = imgui.get_cursor_screen_pos().y
        row = new_row("", 0.0, playback.frames)
        draw_rect(shown_at(row, playback), top, shown_at(row, playback) + px(1), bottom, theme.TEXT, 0.0)
        scrolls = imgui.get_scroll_max_y() > 0.0
    imgui.end_child()
    storage.set_bool(key, scrolls)
    imgui.pop_style_var()


def _room(more: int) -> float:
    """How many times taller the tracks could be, with so many `more` for body parts and pins."""
    rows = 4 + more
    heights = PROMPTS + (2 + more) * ROW + 2 * FEET + 2.0
    free = imgui.get_content_region_avail().y / px(1.0) - RULER - (rows + 2) * SPACING
    return float(free / heights)


# --- ruler


def _ruler(takes: Takes, playback: Playback, less: float) -> None:
    """Frame numbers, the part that is kept with its handles, and the frame shown; drag to scrub."""
    row = new_row("Frame", RULER, playback.frames, less)
    _scrub(row, takes, playback)
    base = row.top + row.height * 0.62
    bottom = row.top + row.height
    draw_rect(row.x(0), base, row.x(playback.frames - 1), bottom, theme.FIELD)
    draw_rect(row.x(playback.first), base, row.x(playback.last), bottom, theme.ACCENT_FILL)
    per_frame = row.width / max(playback.frames - 1, 1)
    step = next((s for s in TICK_STEPS if s * per_frame >= px(TICK_WIDTH)), TICK_STEPS[-1])
    for number in range(0, playback.frames, step):
        x = row.x(number)
        draw_rect(x, base - px(4), x + 1, base, theme.MUTED, 0.0)
        if x + px(28) < row.left + row.width or not number:
            draw_text(x + px(3), row.top, str(number), theme.MUTED, px(60), px(SMALL) / TEXT_SHARE)
    for frame, side in ((playback.first, 1), (playback.last, -1)):
        x = row.x(frame)
        draw_rect(
            min(x, x + side * px(5)), base - px(1), max(x, x + side * px(5)), bottom, theme.ACCENT, px(2)
        )
    x = shown_at(row, playback)
    draw_rect(x - px(1.5), row.top, x + px(1.5), bottom, theme.TEXT, px(1))


def _scrub(row: TrackRow, takes: Takes, playback: Playback) -> None:
    imgui.push_id("ruler")
    take_mouse("timeline", row)
    held, hovered = imgui.is_item_active(), imgui.is_item_hovered()
    mouse, storage, key = imgui.get_io().mouse_pos, imgui.get_state_storage(), imgui.get_id("held")
    lower = mouse.y >= row.top + row.height * 0.5
    near = 0
    if lower and abs(mouse.x - row.x(playback.first)) <= px(GRIP):
        near = 1
    elif lower and abs(mouse.x - row.x(playback.last)) <= px(GRIP):
        near = 2
    if imgui.is_item_activated():
        storage.set_int(key, near)
    near = storage.get_int(key) if held else near
    if near and (held or hovered):
        imgui.set_mouse_cursor(imgui.MouseCursor_.resize_ew)
    if held:
        frame = row.frame_at(mouse.x)
        if near == 1:
            takes.trim(first=frame, held=True)
        elif near == 2:
            takes.trim(last=frame, held=True)
        else:
            playback.seek(frame)
    elif hovered and near:
        widgets.tooltip("Drag: only what lies between the handles plays and is exported")
    imgui.pop_id()


# --- tracks


def _spans(
    name: str,
    key: str,
    bars: Sequence[LabelledSpan],
    height: float,
    editing: Resimulation,
    playback: Playback,
) -> None:
    """A track whose spans can be dragged; a click goes to its frame."""
    row = new_row(name, height, playback.frames)
    take_mouse(key, row)
    mouse_x, hovered = imgui.get_io().mouse_pos.x, imgui.is_item_hovered()
    frame, grabbed = row.frame_at(mouse_x), _grabbed(row, bars, mouse_x)
    if editing.drag is not None and editing.drag.dropped and not editing.busy:
        editing.drag = None  # the tracks are those of the edit, or it failed
    if imgui.is_item_activated() and grabbed is not None:
        _press(key, bars, *grabbed, frame, editing, playback)
    drag = editing.drag if editing.drag is not None and editing.drag.track == key else None
    if drag is not None and not drag.dropped:
        drag = editing.drag = _carry(drag, frame, bars, editing, playback)
    elif hovered and grabbed is not None:
        widgets.tooltip(bars[grabbed[0]].hint or bars[grabbed[0]].text)
    over_end = hovered and grabbed is not None and grabbed[1] != "body" and not editing.fixed
    if over_end or (drag is not None and drag.moved and not drag.dropped):
        imgui.set_mouse_cursor(imgui.MouseCursor_.resize_ew)
    for i, bar in enumerate(_moved(bars, drag)):
        tint = GAIT_TINT if key == "gaits" else PROMPT_TINTS[i % 2]
        draw_bar(row, bar, tint, bar.span.start <= playback.frame < bar.span.end)


def _press(
    key: str,
    bars: Sequence[LabelledSpan],
    index: int,
    part: str,
    frame: int,
    editing: Resimulation,
    playback: Playback,
) -> None:
    """The mouse was pressed on a part of a span: begin to drag it; while a take is resimulated, go to the frame."""
    if editing.drag is not None and editing.drag.dropped:
        playback.seek(frame)
    else:
        span = bars[index].span
        editing.drag = Drag(key, index, part, frame, span.start, span.end)


def _carry(
    drag: Drag, frame: int, bars: Sequence[LabelledSpan], editing: Resimulation, playback: Playback
) -> Drag | None:
    """The drag after this frame: moved by the mouse, and let go of when its button is."""
    drag = _dragged(drag, frame, [bar.span for bar in bars], bool(editing.fixed))
    if imgui.is_item_deactivated():
        return _drop(drag, frame, bars, editing, playback)
    return drag


def _grabbed(row: TrackRow, bars: Sequence[LabelledSpan], x: float) -> tuple[int, str] | None:
    """Which span is under the mouse, and which part of it."""
    for i, bar in enumerate(bars):
        left, right = row.x(bar.span.start), row.x(bar.span.end)
        if (left <= x or i == 0) and (x < right or i == len(bars) - 1):
            grip = min(px(GRIP), (right - left) / 4)
            if i > 0 and x - left <= grip:
                return i, "start"
            return i, "end" if i < len(bars) - 1 and right - x <= grip else "body"
    return None


def _dragged(drag: Drag, frame: int, spans: Sequence[Span], fixed: bool) -> Drag:
    """The drag with the span where the mouse holds it."""
    by = frame - drag.grabbed
    if fixed or (by == 0 and not drag.moved):
        return drag
    span = spans[drag.index]
    start = span.start + (by if drag.part != "end" else 0)
    end = span.end + (by if drag.part != "start" else 0)
    start, end = fitted(spans, drag.index, start, end)
    return dataclasses.replace(drag, start=start, end=end, moved=True)


def _drop(
    drag: Drag, frame: int, bars: Sequence[LabelledSpan], editing: Resimulation, playback: Playback
) -> Drag | None:
    """Let go of a span; what is shown of the drag while the take is resimulated."""
    span = bars[drag.index].span
    if not drag.moved:
        playback.seek(frame)
    elif (drag.start, drag.end) != (span.start, span.end):
        editing.move(drag.track, drag.index, drag.start, drag.end)
        return dataclasses.replace(drag, dropped=True) if editing.busy else None
    return None


def _moved(bars: Sequence[LabelledSpan], drag: Drag | None) -> list[LabelledSpan]:
    """The spans as they would lie after the drag in hand."""
    shown = list(bars)
    if drag is None or not drag.moved:
        return shown

    def put(i: int, start: int, end: int) -> None:
        if 0 <= i < len(shown):
            shown[i] = dataclasses.replace(shown[i], span=Span(start, end))

    i = drag.index
    put(i, drag.start, drag.end)
    if i > 0:
        put(i - 1, bars[i - 1].span.start, drag.start)
    if i + 1 < len(bars):
        put(i + 1, drag.end, bars[i + 1].span.end)
    return shown


def _still(name: str, bars: Sequence[LabelledSpan], height: float, tint: Color, playback: Playback) -> None:
    """A track that is only looked at."""
    row = new_row(name, height, playback.frames)
    take_mouse(f"track {name}", row)
    if imgui.is_item_hovered():
        found = _grabbed(row, bars, imgui.get_io().mouse_pos.x)
        if found is not None:
            widgets.tooltip(bars[found[0]].hint or bars[found[0]].text)
    for bar in bars:
        draw_bar(row, bar, tint, False)
