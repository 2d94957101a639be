"""The takes panel: recording, list, and export."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from runtime.safe_read import printable
from runtime.session.session import LIVE, MAX_RATING, Take
from viewer.edit.reference_card import ReferenceCard
from viewer.edit.selection import Selection
from viewer.edit.tracks import TAKES
from viewer.exports.bvh_export import EXPORT_ALL, BvhExport
from viewer.gl_bindings import imgui
from viewer.gui import theme, widgets
from viewer.gui.layout import Rect
from viewer.gui.panels import Panel, PanelPlace
from viewer.gui.theme import ICON
from viewer.gui.widgets import px
from viewer.jobs import Slot
from viewer.session.opening import open_file, open_reference
from viewer.session.sessions import OPENING, Sessions
from viewer.session.summaries import describe
from viewer.session.takes import Takes
from viewer.settings import TAKE_ORDERS

ROWS, ROW_PX = 6, 25.0  # minimum rows of the list, and the height of one at scale 1
RENAME_HINT = "Double-click renames it"
MENU = "take menu"
COLORS = ("No color", "Red", "Yellow", "Green", "Blue", "Violet")
TINTS = (theme.CLEAR, (0.85, 0.35, 0.35, 1.0), (0.85, 0.72, 0.3, 1.0), (0.42, 0.75, 0.42, 1.0),
         (0.38, 0.58, 0.88, 1.0), (0.68, 0.48, 0.85, 1.0))  # fmt: skip


@dataclass(frozen=True)
class TakesPanel:
    """The takes panel, with the tools it uses."""

    takes: Takes
    references: ReferenceCard
    sessions: Sessions
    selection: Selection
    bvh: BvhExport
    export_window: Callable[[], None]

    def panel(self) -> Panel:
        takes = self.takes
        return Panel(
            "Takes", PanelPlace.RIGHT_BOTTOM, lambda _: draw(self), ICON.clips, actions=takes.actions
        )


def sign(takes: Takes) -> Panel:
    """Return the panel with the recording sign over the view."""

    def draw_sign(view: Rect) -> None:
        seconds = takes.recorder.take_seconds
        widgets.sign(view, f"{ICON.record} REC {widgets.clock(seconds)}", theme.RECORD)

    return Panel("Recording", PanelPlace.SIGN, draw_sign, shown=lambda: takes.recording)


def draw(panel: TakesPanel) -> None:
    takes = panel.takes
    _record(takes)
    _cut_off(panel.sessions)
    if takes.searchable:
        _search(takes)
    line, room = imgui.get_frame_height_with_spacing(), imgui.get_content_region_avail().y
    # in a low panel the list and the button matter most; rate and unit are in the export window too
    short = room < _export_height(False) + px(ROWS * ROW_PX)
    current = takes.session.current
    height = max(room - (_export_height(short) if current is not None else 0.0), line)
    # also without a scrollbar
    width = imgui.get_content_region_avail().x - imgui.get_style().scrollbar_size
    imgui.set_next_window_content_size(imgui.ImVec2(max(width, 1.0), 0))
    if imgui.begin_child("take list", imgui.ImVec2(0, height)):
        _list(panel)
    imgui.end_child()
    if current is not None:
        _export(panel, current, short)


def _cut_off(sessions: Sessions) -> None:
    left = sessions.cut_off
    if left is None:
        return
    width = imgui.get_content_region_avail().x
    widgets.text(ICON.warning, theme.WARNING)
    imgui.same_line(0, px(5))
    widgets.fitted(f"Cut off: {printable(describe(left))}", width - px(26), theme.TEXT)
    with widgets.disabled(sessions.jobs.busy(OPENING)):
        widgets.buttons(
            ("Reopen", "Reopen it with everything recorded", partial(sessions.open, left.path)),
            ("Discard", "Delete it permanently", partial(sessions.discard, left)),
            primary=0,
        )
    imgui.separator()


def _record(takes: Takes) -> None:
    recording = takes.recording
    half = widgets.column_width(2)
    stop = f"{ICON.stop} {widgets.clock(takes.recorder.take_seconds)}"
    text = stop if recording else f"{ICON.record} Record"
    with (
        widgets.color(imgui.Col_.button, theme.RECORD if recording else theme.FIELD),
        # red text on red would be unreadable
        widgets.color(imgui.Col_.button_hovered, (*theme.RECORD[:3], 0.8 if recording else 0.2)),
        widgets.color(imgui.Col_.text, theme.TEXT if recording else theme.RECORD),
    ):
        if imgui.button(f"{text}###record", imgui.ImVec2(half, 0)):
            takes.toggle_recording()
    widgets.tooltip("Start or stop a take (R)")
    widgets.same_line()
    if widgets.button(
        f"{ICON.history} Last {takes.settings.keep_seconds:.0f} s###keep",
        half,
        f"The last minutes are always in memory ({widgets.clock(takes.recorder.seconds)} now).\n"
        "Keep the last seconds as a take (T). Right-click: how many.",
    ):
        takes.save_last()
    if imgui.begin_popup_context_item("keep seconds"):
        imgui.set_next_item_width(px(180))
        widgets.setting_slider(takes.settings, "keep_seconds")
        imgui.end_popup()


def _list(panel: TakesPanel) -> None:
    takes = panel.takes
    session = takes.session
    if not session.takes:
        empty = "Nothing recorded yet. Record a take with R, keep the last seconds with T, or drop a BVH file here."
        widgets.muted("R ends the take; it appears here." if takes.recording else empty, wrap=True)
        return
    found = takes.found
    if not found:
        widgets.muted("No take has these words in its name, note or prompts.", wrap=True)
    padding = imgui.get_style().frame_padding.x
    imgui.push_style_var(imgui.StyleVar_.item_spacing, imgui.ImVec2(0, px(2)))
    imgui.push_style_var(imgui.StyleVar_.frame_padding, imgui.ImVec2(padding, px(4)))
    for take in found:
        imgui.push_id(take.number)
        _name_field(takes, take) if takes.renaming == take.number else _row(panel, take)
        imgui.pop_id()
    imgui.pop_style_var(2)


def _search(takes: Takes) -> None:
    side = imgui.get_frame_height()
    imgui.set_next_item_width(imgui.get_content_region_avail().x - side - px(4))
    _, takes.search = imgui.input_text_with_hint("##search takes", f"{ICON.search} Search", takes.search)
    widgets.tooltip("Words of names, notes and prompts; *** finds three or more stars")
    widgets.same_line()
    order = takes.settings.takes_order
    tint = theme.ACCENT if order else theme.MUTED
    if widgets.icon_button(ICON.sort, "order of takes", TAKE_ORDERS[order], tint):
        imgui.open_popup("orders")
    if imgui.begin_popup("orders"):
        for name, text in TAKE_ORDERS.items():
            if widgets.item(text, chosen=name == order):
                takes.settings.takes_order = name
        imgui.end_popup()


def _export_all(bvh: BvhExport, width: float) -> None:
    takes = bvh.takes
    busy, count = takes.jobs.busy(EXPORT_ALL), len(takes.found)
    what = "Every take" if count == len(takes.session.takes) else "Each take that was found"
    hint = f"{what} as BVH into {printable(takes.settings.export_folder)}"
    text = "…" if busy else f"All {count}"
    if widgets.button(f"{text}###export all", width, hint, enabled=count and not busy):
        bvh.export_all()


def _name_field(takes: Takes, take: Take) -> None:
    """Draw the row as a field for a new name or a note: Enter accepts it, Esc or a click elsewhere cancels."""
    widgets.full_width()
    first = imgui.is_window_appearing() or takes.naming_begins
    if first:
        imgui.set_keyboard_focus_here()
    flags = imgui.InputTextFlags_.enter_returns_true | imgui.InputTextFlags_.auto_select_all
    hint = "A note, then Enter" if takes.noting else ""
    entered, takes.new_name = imgui.input_text_with_hint("##take name", hint, takes.new_name, flags)
    takes.naming_begins = False
    left = not first and imgui.is_item_deactivated()
    if entered:
        (takes.set_note if takes.noting else takes.rename)(take.number, takes.new_name)
    if entered or left:
        takes.renaming = LIVE


def _row(panel: TakesPanel, take: Take) -> None:
    """Draw play button, name, length and remove button; a click anywhere selects."""
    takes = panel.takes
    width, square = imgui.get_content_region_avail().x, imgui.get_frame_height()
    corner, start = imgui.get_cursor_screen_pos(), imgui.get_cursor_pos()
    _row_ground(panel, take, corner, width)
    imgui.set_cursor_pos(start)
    playback = takes.playback
    playing = playback is not None and playback.number == take.number and playback.playing
    icon, hint = (ICON.pause, "Pause") if playing else (ICON.play, "Play (P)")
    if widgets.icon_button(icon, "play take", hint):
        takes.play_or_pause(take.number)
    seconds = _facts(panel, take)
    time_width = imgui.calc_text_size(seconds).x
    imgui.same_line(0, px(2))
    imgui.align_text_to_frame_padding()
    imgui.text_unformatted(widgets.elided(take.title, width - 3 * square - time_width - px(10)))
    imgui.same_line(width - 2 * square - time_width)
    imgui.align_text_to_frame_padding()
    widgets.muted(seconds)
    imgui.same_line(width - 2 * square)
    if widgets.icon_button(ICON.more, "take menu", "Rename, rate, note, mirror, compare, color"):
        imgui.open_popup(MENU)
    imgui.same_line(width - square)
    if widgets.icon_button(ICON.trash, "remove take", "Remove from the list; exported files stay"):
        takes.remove(take.number)
    imgui.push_style_var(imgui.StyleVar_.item_spacing, imgui.ImVec2(px(8), px(7)))
    if imgui.begin_popup(MENU):
        _take_menu(panel, take)
        imgui.end_popup()
    imgui.pop_style_var()


def _facts(panel: TakesPanel, take: Take) -> str:
    """Return rating, marks for a note and a file, and the length."""
    first, last = take.range
    rating = f"{take.rating}{ICON.star}" if take.rating else ""
    marks = rating, ICON.text * bool(take.note), ICON.check * bool(panel.bvh.saved(take))
    return " ".join(filter(None, (*marks, widgets.clock((last - first) / take.made.header.fps))))


def _pick(takes: Takes, selection: Selection, take: Take) -> None:
    """Select a take; with Ctrl add or remove it, with Shift extend the selection to it."""
    io, items = imgui.get_io(), {item.lane: item for item in selection.all([TAKES])}
    if io.key_shift and takes.session.current is not None:
        first, last = sorted((takes.session.index(takes.session.selected), takes.session.index(take.number)))
        selection.pick(item for item in items.values() if first <= item.start <= last)
        return
    selection.pick([items[take.number]], extend=io.key_ctrl)
    if not io.key_ctrl:
        takes.select(take.number)


def _row_ground(panel: TakesPanel, take: Take, corner: imgui.ImVec2, width: float) -> None:
    """Draw the background of a row, which receives the mouse and shows selection and color."""
    takes, selection = panel.takes, panel.selection
    chosen, height = takes.session.selected == take.number, imgui.get_frame_height()
    picked = (TAKES, take.number, 0) in selection.keys
    imgui.set_next_item_allow_overlap()
    if imgui.invisible_button("row", imgui.ImVec2(width, height)):
        _pick(takes, selection, take)
    if chosen and _newly_selected(take):  # of the row that was just drawn
        imgui.set_scroll_here_y(1.0 if corner.y > imgui.get_window_pos().y + height else 0.0)
    hovered = imgui.is_item_hovered()
    if hovered:
        _about(panel.bvh, take)
        _use_row(takes, selection, take, picked)
    drawing, bottom = imgui.get_window_draw_list(), corner.y + height
    ground = theme.ACCENT_DIM if chosen or picked else theme.FIELD if hovered else theme.CLEAR
    end = imgui.ImVec2(corner.x + width, bottom)
    drawing.add_rect_filled(corner, end, widgets.packed(ground), imgui.get_style().frame_rounding)
    tint = widgets.packed(TINTS[take.color % len(TINTS)])
    drawing.add_rect_filled(corner, imgui.ImVec2(corner.x + px(3), bottom), tint)


def _use_row(takes: Takes, selection: Selection, take: Take, picked: bool) -> None:
    """Rename a take by a double click on its row, or open its menu by a right click."""
    if imgui.is_mouse_double_clicked(0):
        takes.begin_rename(take.number)
    elif imgui.is_mouse_clicked(imgui.MouseButton_.right):
        if not picked:
            _pick(takes, selection, take)
        imgui.open_popup(MENU)


def _about(bvh: BvhExport, take: Take) -> None:
    saved, exported = bvh.saved(take), bvh.exported(take)
    lines = [f"Exported as {printable(saved)}" if saved else "Not exported as it is"]
    if exported not in (None, saved):
        lines.append(f"Exported before as {printable(exported)}")
    lines += [take.note, RENAME_HINT, take.made.header.describe()]
    widgets.tooltip("\n".join(filter(None, lines)))


def _newly_selected(take: Take) -> bool:
    """Return whether another take was selected in the last frame."""
    storage, key = imgui.get_state_storage(), 1
    known = storage.get_int(key)
    storage.set_int(key, take.number)
    return bool(known != take.number)


def _take_menu(panel: TakesPanel, take: Take) -> None:
    takes, references, selection, number = panel.takes, panel.references, panel.selection, take.number
    if widgets.item("Rename"):
        takes.begin_rename(number)
    ratings = [ICON.star * stars or "No rating" for stars in range(MAX_RATING + 1)]
    _choice("Rating", ratings, take.rating, partial(takes.rate, number))
    if widgets.item("Note"):
        takes.begin_rename(number, noting=True)
    if widgets.item("Mirror", "A copy of the take with left and right swapped"):
        takes.mirror(number)
    _compare(takes, references, take)
    _animations(takes, references, take)
    _versions(takes, take)
    _choice("Color", COLORS, take.color, partial(takes.set_color, number))
    if (TAKES, number, 0) not in selection.keys:
        selection.pick(item for item in selection.all([TAKES]) if item.lane == number)
    selection.menu()


def _versions(takes: Takes, take: Take) -> None:
    """Draw the earlier motions of a take, to restore or compare with."""
    versions = takes.versions(take.number)
    if len(versions) < 2 or not imgui.begin_menu("Versions"):
        return
    for number, (label, version) in enumerate(versions, 1):
        current = version.motion == take.motion
        now = " (now)" if current else ""
        if imgui.begin_menu(widgets.named(f"{number}. {label}", f"version {number}", now)):
            if widgets.item("Restore it", enabled=not current):
                takes.go_back_to(version)
            if widgets.item("Compare with it", enabled=not current):
                takes.compare_with(version)
            imgui.end_menu()
    imgui.end_menu()


def _choice(name: str, choices: Sequence[str], chosen: int, choose: Callable[[int], None]) -> None:
    if imgui.begin_menu(name):
        for number, text in enumerate(choices):
            if widgets.item(text, chosen=number == chosen):
                choose(number)
        imgui.end_menu()


def _compare(takes: Takes, references: ReferenceCard, take: Take) -> None:
    """Draw the references for the playing take; for another take, whether it is one."""
    playback = takes.playback
    if playback is not None and playback.number == take.number:
        if imgui.begin_menu("Compare with"):
            references.menu()
            imgui.end_menu()
    elif widgets.item("Compare", "", references.reference.take == take, playback):
        references.reference.show(take.number)
    widgets.tooltip("Play another take to compare it with" if playback is None else "")


def _animations(takes: Takes, references: ReferenceCard, take: Take) -> None:
    """Draw the animations of the take's file; a chosen one becomes another take, compared if this one is."""
    path, names = takes.animations.get(take.number, (None, ()))
    if path is None or len(names) < 2 or not imgui.begin_menu("Animations"):
        return
    for number, name in enumerate(names):
        if widgets.item(widgets.named(name, f"animation {number}")):
            compared = references.reference.take == take
            (open_reference if compared else open_file)(takes, path, animation=name)
    imgui.end_menu()


def _export_height(short: bool) -> float:
    return imgui.get_frame_height_with_spacing() * (2 if short else 3) + px(8)


def _export(panel: TakesPanel, take: Take, short: bool) -> None:
    takes, bvh = panel.takes, panel.bvh
    imgui.separator()
    widgets.full_width()
    flags = imgui.InputTextFlags_.elide_left
    entered, bvh.path = widgets.input_text("##export path", bvh.path, "~/sport-clips/walk.bvh", flags)
    widgets.tooltip(f"Where {Path(bvh.path).name} is written")
    if not short:
        gap = px(10)
        half = (imgui.get_content_region_avail().x - gap) / 2
        widgets.setting_choice(takes.settings, "export_fps", half)
        imgui.same_line(0, gap)
        widgets.setting_choice(takes.settings, "export_unit", half)
    busy, several = takes.jobs.busy(Slot("export", take.number)), len(takes.session.takes) > 1
    text, what = "Export BVH", "the take"
    if take.trimmed:
        text, what = text if several else "Export trimmed BVH", "what lies between the trim handles"
    more = px(64)
    width = imgui.get_content_region_avail().x - more - px(4) - several * px(56)
    hint = f"Write {what} for Blender, Maya, MotionBuilder"
    text = f"{ICON.save} {'Exporting…' if busy else text}###export"
    if widgets.button(text, width, hint, True, not busy) or entered:
        bvh.export()
    widgets.same_line()
    if several:
        _export_all(bvh, px(52))
        widgets.same_line()
    if widgets.button("More…###more formats", more, "GLB, FBX, film, loop, root and ground (Ctrl+E)"):
        panel.export_window()
