"""The clips panel: record, the list, and export."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from runtime.safe_read import printable
from viewer.gl_bindings import imgui
from viewer.gui import setting_widgets, theme, widgets
from viewer.gui.layout import Rect
from viewer.gui.panels import Panel, PanelPlace
from viewer.gui.theme import ICON
from viewer.gui.widgets import px
from viewer.jobs import Slot
from viewer.settings import Settings
from viewer.takes import recovery_panel
from viewer.takes.reference_panel import References
from viewer.takes.state import ClipItem
from viewer.takes.takes import EXPORT_ALL, Takes

RENAME_HINT = "Double-click renames it"
MENU = "take menu"


Session = Callable[[], recovery_panel.CutOffSession | None]


def panel(
    takes: Takes, references: References, export_window: Callable[[], None], session: Session = lambda: None
) -> Panel:
    """The clips panel; `session` is one that was cut off."""
    return Panel(
        "Clips",
        PanelPlace.RIGHT_BOTTOM,
        lambda _: draw(takes, references, export_window, session),
        ICON.clips,
        actions=takes.actions,
    )


def sign(takes: Takes) -> Panel:
    """What is said over the view while a take is recorded."""

    def draw_sign(view: Rect) -> None:
        widgets.sign(view, f"{ICON.record} REC {widgets.clock(takes.state.recorded_s)}", theme.RECORD)

    return Panel("Recording", PanelPlace.SIGN, draw_sign, shown=lambda: takes.state.recording)


def draw(takes: Takes, references: References, export_window: Callable[[], None], session: Session) -> None:
    """Contents of the panel; `export_window` opens the other formats."""
    _record(takes)
    recovery_panel.draw(takes.journals, session())
    line, room = imgui.get_frame_height_with_spacing(), imgui.get_content_region_avail().y
    below = line if takes.state.removed else 0.0
    # in a low panel the list and the button matter; rate and unit are in the export window too
    short = room - below < 5.0 * line
    export_height = _export_height(short) if takes.state.current is not None else 0.0
    height = max(room - export_height - below, line)
    if imgui.begin_child("clip list", imgui.ImVec2(0, height)):
        _list(takes, references)
    imgui.end_child()
    _below(takes)
    if takes.state.current is not None:
        _export(takes, export_window, short)


def _record(takes: Takes) -> None:
    clips = takes.state
    half = (imgui.get_content_region_avail().x - px(4)) / 2
    text = f"{ICON.stop} {widgets.clock(clips.recorded_s)}" if clips.recording else f"{ICON.record} Record"
    with (
        widgets.color(imgui.Col_.button, theme.RECORD if clips.recording else theme.FIELD),
        # red words on red could not be read
        widgets.color(imgui.Col_.button_hovered, (*theme.RECORD[:3], 0.8 if clips.recording else 0.2)),
        widgets.color(imgui.Col_.text, theme.TEXT if clips.recording else theme.RECORD),
    ):
        if imgui.button(f"{text}###record", imgui.ImVec2(half, 0)):
            takes.toggle_recording()
    widgets.tooltip("Start or stop a take (R)")
    imgui.same_line(0, px(4))
    if widgets.button(
        f"{ICON.history} Last {takes.settings.keep_seconds:.0f} s###keep",
        half,
        f"The last minutes are always in memory ({widgets.clock(clips.memory_s)} now).\n"
        "Keep the last seconds as a clip (T). Right-click: how many.",
    ):
        takes.save_last()
    if imgui.begin_popup_context_item("keep seconds"):
        imgui.set_next_item_width(px(180))
        setting_widgets.slider(takes.settings, "keep_seconds")
        imgui.end_popup()


def _list(takes: Takes, references: References) -> None:
    clips = takes.state
    if not clips.items and not clips.removed:
        empty = "Nothing recorded yet. Record a take with R, keep the last seconds with T, or drop a BVH file here."
        widgets.muted("R ends the take; it appears here." if clips.recording else empty, wrap=True)
        return
    imgui.push_style_var(imgui.StyleVar_.item_spacing, imgui.ImVec2(0, px(2)))
    for i in range(len(clips.items)):
        if i < len(clips.items):  # a row before may just have removed one
            imgui.push_id(i)
            _name_field(takes, i) if clips.renaming == i else _row(takes, references, i)
            imgui.pop_id()
    imgui.pop_style_var()


def _below(takes: Takes) -> None:
    """Bring a removed take back."""
    clips = takes.state
    if clips.removed:
        gone, width = clips.removed[-1].item.name, imgui.get_content_region_avail().x
        text = widgets.elided(f"{ICON.undo} Bring back {gone}", width - px(20))
        if widgets.button(f"{text}###restore", width, f"{gone} was removed"):
            takes.restore()


def _export_all(takes: Takes, width: float) -> None:
    busy = takes.jobs.busy(EXPORT_ALL)
    imgui.begin_disabled(busy)
    hint = f"Every take as BVH into {printable(takes.settings.export_folder)}"
    if widgets.button(f"{'…' if busy else f'All {len(takes.state.items)}'}###export all", width, hint):
        takes.export_all()
    imgui.end_disabled()


def _name_field(takes: Takes, i: int) -> None:
    """The row as a field for another name: Enter takes it, Esc or a click elsewhere leaves it."""
    clips = takes.state
    widgets.full_width()
    first = imgui.is_window_appearing() or clips.naming_begins
    if first:
        imgui.set_keyboard_focus_here()
    flags = imgui.InputTextFlags_.enter_returns_true | imgui.InputTextFlags_.auto_select_all
    entered, clips.new_name = imgui.input_text("##take name", clips.new_name, flags)
    clips.naming_begins = False
    left = not first and imgui.is_item_deactivated()
    if entered:
        takes.rename(i, clips.new_name)
    if entered or left:
        clips.renaming = -1


def _row(takes: Takes, references: References, i: int) -> None:
    """Play, name, length, remove; a click anywhere selects."""
    clips, item = takes.state, takes.state.items[i]
    width, height, square = imgui.get_content_region_avail().x, imgui.get_frame_height(), px(24)
    corner = imgui.get_cursor_screen_pos()
    start = imgui.get_cursor_pos()
    imgui.set_next_item_allow_overlap()
    if imgui.invisible_button("row", imgui.ImVec2(width, height)):
        takes.select(i)
    if i == clips.selected and _newly_selected(item):  # of the row that was just drawn
        imgui.set_scroll_here_y(1.0 if corner.y > imgui.get_window_pos().y + height else 0.0)
    hovered = imgui.is_item_hovered()
    if hovered and imgui.is_mouse_double_clicked(0):
        takes.begin_rename(i)
    if imgui.is_item_clicked(imgui.MouseButton_.right):
        imgui.open_popup(MENU)
    if hovered:
        saved = f"Saved as {printable(item.saved)}" if item.saved else "Not saved as a whole BVH yet"
        if item.exported not in (None, item.saved):
            saved += f"\nExported as {printable(item.exported)}"
        widgets.tooltip("\n".join(filter(None, (saved, RENAME_HINT, item.clip.describe()))))
    if hovered or clips.selected == i:
        fill = theme.ACCENT_DIM if clips.selected == i else theme.FIELD
        low, high = corner, imgui.ImVec2(corner.x + width, corner.y + height)
        packed = imgui.get_color_u32(imgui.ImVec4(*fill))
        imgui.get_window_draw_list().add_rect_filled(low, high, packed, imgui.get_style().frame_rounding)
    imgui.set_cursor_pos(start)
    playing = clips.playback is not None and clips.playback.index == i and clips.playback.playing
    if _small(ICON.pause if playing else ICON.play, square, "Pause" if playing else "Play (P)"):
        takes.play_row(i)
    seconds = widgets.clock(item.clip.seconds)
    if item.saved:
        seconds = f"{ICON.check} {seconds}"
    time_width = imgui.calc_text_size(seconds).x
    imgui.same_line(0, px(2))
    imgui.align_text_to_frame_padding()
    imgui.text_unformatted(widgets.elided(item.name, width - 3 * square - time_width - px(10)))
    imgui.same_line(width - 2 * square - time_width)
    imgui.align_text_to_frame_padding()
    widgets.muted(seconds)
    imgui.same_line(width - 2 * square)
    if _small(f"{ICON.more}##take menu", square, "Rename, mirror, show beside the take that plays"):
        imgui.open_popup(MENU)
    imgui.same_line(width - square)
    if _small(ICON.trash, square, "Remove from the list; exported files stay"):
        takes.remove(i)
        return
    imgui.push_style_var(imgui.StyleVar_.item_spacing, imgui.ImVec2(px(8), px(7)))
    if imgui.begin_popup(MENU):
        _take_menu(takes, references, i)
        imgui.end_popup()
    imgui.pop_style_var()


def _newly_selected(item: ClipItem) -> bool:
    """Whether another take was the selected one in the frame before."""
    storage, key, mark = imgui.get_state_storage(), 1, id(item) & 0x7FFFFFFF
    known = storage.get_int(key)
    storage.set_int(key, mark)
    return bool(known != mark)


def _take_menu(takes: Takes, references: References, i: int) -> None:
    if imgui.menu_item("Rename", "", False)[0]:
        takes.begin_rename(i)
    if imgui.menu_item("Mirror", "", False)[0]:
        takes.mirror(i)
    widgets.tooltip("A second take with left and right exchanged")
    playback = takes.state.playback
    if playback is not None and playback.index == i:
        if imgui.begin_menu("Show beside it"):
            references.menu()
            imgui.end_menu()
    elif imgui.menu_item(
        "Show beside", "", takes.reference.item is takes.state.items[i], playback is not None
    )[0]:
        takes.reference.show(takes.state.items[i])
    widgets.tooltip("Play another take to compare it with" if playback is None else "")
    if imgui.menu_item("Remove", "", False)[0]:
        takes.remove(i)


def _small(icon: str, width: float, hint: str) -> bool:
    with widgets.color(imgui.Col_.button, theme.CLEAR), widgets.color(imgui.Col_.text, theme.MUTED):
        imgui.push_style_var(
            imgui.StyleVar_.frame_padding, imgui.ImVec2(px(3), imgui.get_style().frame_padding.y)
        )
        clicked = imgui.button(icon, imgui.ImVec2(width, 0))
        imgui.pop_style_var()
    widgets.tooltip(hint)
    return bool(clicked)


def _rate_and_unit(settings: Settings) -> None:
    half = (imgui.get_content_region_avail().x - px(10)) / 2
    imgui.begin_group()
    imgui.push_item_width(half)
    if imgui.begin_child("fps", imgui.ImVec2(half, imgui.get_frame_height())):
        setting_widgets.choice(settings, "export_fps")
    imgui.end_child()
    imgui.same_line(0, px(10))
    if imgui.begin_child("unit", imgui.ImVec2(half, imgui.get_frame_height())):
        setting_widgets.choice(settings, "export_unit")
    imgui.end_child()
    imgui.pop_item_width()
    imgui.end_group()


def _export_height(short: bool) -> float:
    return imgui.get_frame_height_with_spacing() * (2 if short else 3) + px(8)


def _export(takes: Takes, export_window: Callable[[], None], short: bool) -> None:
    clips, settings = takes.state, takes.settings
    imgui.separator()
    widgets.full_width()
    entered, clips.export_path = imgui.input_text_with_hint(
        "##export path",
        "~/sport-clips/walk.bvh",
        clips.export_path,
        imgui.InputTextFlags_.enter_returns_true | imgui.InputTextFlags_.elide_left,
    )
    widgets.tooltip(f"Where to write {Path(clips.export_path).name}: type another path if you like")
    if not short:
        _rate_and_unit(settings)
    busy = takes.jobs.busy(Slot("export", clips.current)) if clips.current else False
    imgui.begin_disabled(busy)
    trimmed = clips.playback is not None and clips.playback.trimmed
    several = len(clips.items) > 1
    text = "Exporting…" if busy else "Export trimmed BVH" if trimmed and not several else "Export BVH"
    more, every = px(64), px(52) if several else 0.0
    width = imgui.get_content_region_avail().x - more - px(4) - (every + px(4) if several else 0.0)
    what = "what lies between the trim marks" if trimmed else "the clip"
    hint = f"Write {what} for Blender, Maya, MotionBuilder"
    if widgets.button(f"{ICON.save} {text}###export", width, hint, True) or entered:
        takes.export()
    imgui.end_disabled()
    imgui.same_line(0, px(4))
    if several:
        _export_all(takes, every)
        imgui.same_line(0, px(4))
    if widgets.button("More…###more formats", more, "GLB, FBX, film, loop, root and ground (Ctrl+E)"):
        export_window()
