"""One track of a timeline on the screen: how frames map to it, and how bars and words are drawn on it."""

from __future__ import annotations

from dataclasses import dataclass

from viewer.edit.tracks import LabelledSpan
from viewer.gl_bindings import imgui
from viewer.gui import theme, widgets
from viewer.gui.theme import Color
from viewer.gui.widgets import px
from viewer.session.playback import Playback

NAMES_WIDTH = 70.0  # pixels at scale 1
NAMES_FROM = 420.0  # in a narrower bar the tracks have no names
EDGE = 4.0  # beside both ends of a row, for half a handle
GRIP = 7.0  # how near to an end of a span or to a handle the mouse takes it
NAME_SIZE = theme.FONT_SIZE * 0.87  # letters of the names
SMALL, TEXT_SHARE = theme.FONT_SIZE * 0.8, 0.76  # letters: at least, and of a row's height


@dataclass(frozen=True)
class TrackRow:
    """One track on the screen: where it lies, and how frames map to it."""

    left: float
    top: float
    width: float
    height: float
    frames: int

    def x(self, frame: float) -> float:
        """Screen position of a frame."""
        return self.left + frame / max(self.frames - 1, 1) * self.width

    def frame_at(self, x: float) -> int:
        """The frame under a screen position, within the clip."""
        share = min(max((x - self.left) / max(self.width, 1.0), 0.0), 1.0)
        return round(share * max(self.frames - 1, 1))


def new_row(name: str, height: float, frames: int, less: float = 0.0) -> TrackRow:
    """The next row; its name stands on the left where there is room."""
    width, corner = imgui.get_content_region_avail().x - less, imgui.get_cursor_screen_pos()
    names = px(NAMES_WIDTH) if width + less >= px(NAMES_FROM) else 0.0
    if names and name:
        draw_text(corner.x, corner.y, name, theme.MUTED, names - px(4), px(height), NAME_SIZE)
    edge = px(EDGE)
    return TrackRow(corner.x + names + edge, corner.y, width - names - 2 * edge, px(height), frames)


def take_mouse(name: str, row: TrackRow) -> None:
    """Makes a row take the mouse, and a little beside its ends."""
    edge = px(EDGE)
    imgui.set_cursor_screen_pos(imgui.ImVec2(row.left - edge, row.top))
    imgui.invisible_button(f"##{name}", imgui.ImVec2(max(row.width, 1.0) + 2 * edge, max(row.height, 1.0)))


def shown_at(row: TrackRow, playback: Playback) -> float:
    """Where the time shown lies."""
    return row.x(min(max(playback.time_s * playback.clip.fps, 0.0), playback.frames - 1.0))


def draw_bar(row: TrackRow, bar: LabelledSpan, tint: Color, lit: bool) -> None:
    """A span with its words; lighter where it is the one shown."""
    left, right = row.x(bar.span.start), min(row.x(bar.span.end), row.left + row.width)
    right = max(right - px(1), left + 1)
    fill = (*tint[:3], min(tint[3] + (0.12 if lit else 0.0), 1.0))
    draw_rect(left, row.top, right, row.top + row.height, theme.FIELD, px(3))
    draw_rect(left, row.top, right, row.top + row.height, fill, px(3))
    draw_text(left + px(5), row.top, bar.text, theme.TEXT, right - left - px(8), row.height)


def draw_rect(
    left: float, top: float, right: float, bottom: float, tint: Color, rounding: float = 2.0
) -> None:
    """A filled rectangle in screen units."""
    low, high = imgui.ImVec2(left, top), imgui.ImVec2(right, bottom)
    imgui.get_window_draw_list().add_rect_filled(low, high, widgets.packed(tint), rounding)


def draw_text(
    x: float, top: float, text: str, tint: Color, width: float, height: float, size: float = 0.0
) -> None:
    """Words in the middle of a height and of a size that fits it, cut to a width; none where not even the first fits."""
    if width < px(12):
        return
    size = size or min(max(TEXT_SHARE * height / px(1.0), SMALL), theme.FONT_SIZE)
    imgui.push_font(None, size)
    y = top + (height - imgui.get_text_line_height()) / 2
    imgui.get_window_draw_list().add_text(
        imgui.ImVec2(x, y), widgets.packed(tint), widgets.elided(text, width)
    )
    imgui.pop_font()
