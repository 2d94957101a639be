"""The tracks of what bends the poses: pins, and when each foot bears; spans are dragged, and taken away with a right click."""

from __future__ import annotations

from dataclasses import replace

from runtime.takes.input_edits import Span
from runtime.takes.pins import Pin
from viewer.edit.pins import Pins, shown_end
from viewer.edit.track_drawing import GRIP, TrackRow, draw_bar, draw_rect, new_row, take_mouse
from viewer.edit.tracks import LabelledSpan
from viewer.gl_bindings import imgui
from viewer.gui import theme, widgets
from viewer.gui.theme import Color
from viewer.gui.widgets import px
from viewer.session.playback import Playback

PIN_TINT: Color = (0.86, 0.48, 0.62, 0.45)
NEW_PLANT_FRAMES = 8
_FEET_HINT = "When a foot bears: the left one above, the right one below.\nDrag a footplant or its ends; right-click adds or removes one"


def draw_pins(pins: Pins, rows: list[list[int]], height: float, playback: Playback) -> None:
    """A row for each lane; a click selects a pin, a drag moves it or one of its ends."""
    for number, lane in enumerate(rows):
        row = new_row("" if number else "Pins", height, playback.frames)
        take_mouse(f"pins {number}", row)
        spans = [(i, _span(pins.pins[i], playback)) for i in lane if i < len(pins.pins)]
        for i, span in spans:
            pin = pins.pins[i]
            text = f"{pin.what}" + (" on a rail" if pin.rail else " along" if pin.along else "")
            draw_bar(row, LabelledSpan(span, text.capitalize()), PIN_TINT, i == pins.selected)
        _drag_pins(pins, row, spans, playback)


def _drag_pins(pins: Pins, row: TrackRow, spans: list[tuple[int, Span]], playback: Playback) -> None:
    mouse, storage = imgui.get_io().mouse_pos, imgui.get_state_storage()
    part_key, frame_key = imgui.get_id("pin part"), imgui.get_id("pin frame")
    frame = row.frame_at(mouse.x)
    over = next(((i, _part(row, span, mouse.x)) for i, span in spans if _within(row, span, mouse.x)), None)
    if imgui.is_item_activated():
        storage.set_int(part_key, -1)
        if over is None:
            playback.seek(frame)
        else:
            pins.selected = over[0]
            storage.set_int(part_key, over[1])
            storage.set_int(frame_key, frame)
    if imgui.is_item_active() and storage.get_int(part_key, -1) >= 0 and pins.pin is not None:
        by, part = (frame - storage.get_int(frame_key)) / playback.clip.fps, storage.get_int(part_key)
        if by:
            storage.set_int(frame_key, frame)
            pins.change(_moved(pins.pin, part, by, playback))
    elif imgui.is_item_hovered():
        if over is not None and over[1]:
            imgui.set_mouse_cursor(imgui.MouseCursor_.resize_ew)
        widgets.tooltip("A click shows the pin's fields; drag it or its ends")


def _moved(pin: Pin, part: int, by: float, playback: Playback) -> Pin:
    """The pin with its body (0), its start (1) or its end (2) moved by seconds, within the clip."""
    last, end = playback.clip.seconds, shown_end(pin, playback.clip)
    if part == 1:
        return replace(pin, start=min(max(pin.start + by, 0.0), end))
    if part == 2:
        return replace(pin, end=min(max(end + by, pin.start), last))
    by = min(max(by, -pin.start), last - end)
    return replace(pin, start=pin.start + by, end=end + by)


def draw_feet(pins: Pins, height: float, playback: Playback) -> None:
    """When the left foot (above) and the right one bear the character."""
    for foot, name in enumerate(("Feet", "")):
        row = new_row(name, height, playback.frames)
        take_mouse(f"foot {foot}", row)
        draw_rect(row.left, row.top, row.left + row.width, row.top + row.height, theme.FIELD, px(1))
        known = pins.footplants(foot)
        for first, end in known:
            right = min(row.x(end), row.left + row.width)
            draw_rect(row.x(first), row.top, right, row.top + row.height, theme.ACCENT, px(1))
        _drag_plant(pins, row, foot, known, playback)


def _drag_plant(
    pins: Pins, row: TrackRow, foot: int, known: list[tuple[int, int]], playback: Playback
) -> None:
    mouse, storage = imgui.get_io().mouse_pos, imgui.get_state_storage()
    keys = [imgui.get_id(f"foot {foot} {name}") for name in ("part", "frame", "first", "end")]
    frame = row.frame_at(mouse.x)
    over = next((p for p in known if _within(row, Span(*p), mouse.x)), None)
    if imgui.is_item_activated():
        part = -1 if over is None or pins.fixed else _part(row, Span(*over), mouse.x)
        for key, value in zip(keys, (part, frame, *(over or (0, 0))), strict=True):
            storage.set_int(key, value)
        if over is None:
            playback.seek(frame)
    part, grabbed, first, end = (storage.get_int(key, -1) for key in keys)
    if imgui.is_item_active() and part >= 0:
        by = frame - grabbed
        if by or pins.editor.dragging:
            new = first + (by if part != 2 else 0), end + (by if part != 1 else 0)
            pins.set_footplant(foot, (first, end), new if new[0] < new[1] else (first, end))
    elif imgui.is_item_hovered():
        if over is not None and _part(row, Span(*over), mouse.x):
            imgui.set_mouse_cursor(imgui.MouseCursor_.resize_ew)
        widgets.tooltip(_FEET_HINT)
    _plant_menu(pins, foot, over, frame)


def _plant_menu(pins: Pins, foot: int, over: tuple[int, int] | None, frame: int) -> None:
    storage = imgui.get_state_storage()
    keys = [imgui.get_id(f"menu {foot} {name}") for name in ("frame", "first", "end")]
    if imgui.is_item_clicked(1):
        for key, value in zip(keys, (frame, *(over or (-1, -1))), strict=True):
            storage.set_int(key, value)
        imgui.open_popup(f"plant menu {foot}")
    if imgui.begin_popup(f"plant menu {foot}"):
        at, first, end = (storage.get_int(key, -1) for key in keys)
        if first >= 0 and imgui.menu_item("Lift the foot here", "", False)[0]:
            pins.set_footplant(foot, (first, end), None)
        if first < 0 and imgui.menu_item("Plant the foot here", "", False)[0]:
            half = NEW_PLANT_FRAMES // 2
            pins.set_footplant(foot, None, (at - half, at + half))
        imgui.end_popup()


def _span(pin: Pin, playback: Playback) -> Span:
    fps, end = playback.clip.fps, shown_end(pin, playback.clip)
    return Span(round(pin.start * fps), max(round(end * fps), round(pin.start * fps) + 1))


def _within(row: TrackRow, span: Span, x: float) -> bool:
    slack = px(GRIP) / 2
    return row.x(span.start) - slack <= x <= row.x(span.end) + slack


def _part(row: TrackRow, span: Span, x: float) -> int:
    """0 for the body, 1 for the start, 2 for the end."""
    left, right = row.x(span.start), row.x(span.end)
    grip = min(px(GRIP), (right - left) / 4)
    return 1 if x - left <= grip else 2 if right - x <= grip else 0
