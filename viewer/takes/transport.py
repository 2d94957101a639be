"""The transport bar under the view while a clip plays: scrub, trim, loop, back to live."""

from __future__ import annotations

from sport.viewer.gl_bindings import imgui
from sport.viewer.gui import theme, widgets
from sport.viewer.gui.theme import ICON
from sport.viewer.gui.widgets import px
from sport.viewer.takes.playback import Playback
from sport.viewer.takes.takes import Takes


def draw(takes: Takes) -> None:
    """Contents of the bar."""
    playback = takes.state.playback
    if playback is None:
        return
    _buttons(playback, takes)
    _timeline(playback)


def _buttons(playback: Playback, takes: Takes) -> None:
    square = px(32)
    narrow = imgui.get_content_region_avail().x < px(400)
    if widgets.button(ICON.start, square, "To the first frame kept"):
        playback.seek(playback.first)
    imgui.same_line(0, px(4))
    if widgets.button(
        ICON.pause if playback.playing else ICON.play, square, "Play or pause (P)", primary=True
    ):
        playback.toggle()
    imgui.same_line(0, px(4))
    playback.loop = widgets.toggle(ICON.loop, playback.loop, square, "Begin again at the end")
    imgui.same_line(0, px(14))
    if widgets.button("[ In", px(44), "Keep the clip from this frame"):
        playback.trim_in()
    imgui.same_line(0, px(4))
    if widgets.button("Out ]", px(50), "Keep the clip up to this frame"):
        playback.trim_out()
    live = ICON.person if narrow else f"{ICON.person} Live"
    live_width = imgui.calc_text_size(live).x + 2 * imgui.get_style().frame_padding.x
    right = imgui.get_window_width() - imgui.get_style().window_padding.x - live_width
    imgui.same_line(0, px(14))
    imgui.align_text_to_frame_padding()
    items = takes.state.items
    item = items[playback.index].name if playback.index < len(items) else ""
    time = f"{widgets.clock(playback.time_s)} / {widgets.clock((playback.frames - 1) / playback.clip.fps)}"
    space = right - imgui.get_cursor_pos_x() - px(8)
    full = f"{time}   {item}"
    widgets.muted(widgets.elided(full if imgui.calc_text_size(time).x < space else time, max(space, 0)))
    imgui.same_line(right)
    if widgets.button(live, live_width, "Back to the live character (Esc, or just move)"):
        takes.close_playback()


def _timeline(playback: Playback) -> None:
    """A track with the kept part lit; click or drag anywhere to scrub."""
    width, height = imgui.get_content_region_avail().x, px(22)
    corner = imgui.get_cursor_screen_pos()
    imgui.invisible_button("timeline", imgui.ImVec2(max(width, 1), height))
    last = max(playback.frames - 1, 1)
    if imgui.is_item_active():
        share = (imgui.get_io().mouse_pos.x - corner.x) / max(width, 1)
        playback.seek(round(min(max(share, 0.0), 1.0) * last))

    def x(frame: float) -> float:
        return float(corner.x + frame / last * width)

    top, bottom = corner.y + height * 0.3, corner.y + height * 0.7
    drawing = imgui.get_window_draw_list()

    def bar(left: float, right: float, color: theme.Color) -> None:
        packed = imgui.get_color_u32(imgui.ImVec4(*color))
        drawing.add_rect_filled(
            imgui.ImVec2(left, top), imgui.ImVec2(max(right, left + 1), bottom), packed, px(3)
        )

    shown = min(max(playback.time_s * playback.clip.fps, 0.0), float(last))
    bar(x(0), x(last), theme.FIELD)
    bar(x(playback.first), x(playback.last), theme.FIELD_ACTIVE)
    bar(x(playback.first), x(max(shown, playback.first)), theme.ACCENT)
    handle = imgui.get_color_u32(imgui.ImVec4(*theme.TEXT))
    drawing.add_rect_filled(
        imgui.ImVec2(x(shown) - px(2), corner.y),
        imgui.ImVec2(x(shown) + px(2), corner.y + height),
        handle,
        px(2),
    )
