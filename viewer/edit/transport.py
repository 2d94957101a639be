"""The bar under the view while a take plays: buttons over the tracks of the timeline."""

from __future__ import annotations

from runtime.controls import REQUESTS
from runtime.takes.pins import Pinned
from viewer.edit import timeline
from viewer.edit.camera_keys import CameraKeys
from viewer.edit.pins import Pins
from viewer.edit.reference_card import ReferenceCard
from viewer.edit.resimulation import Resimulation
from viewer.gl_bindings import imgui
from viewer.gui import theme, widgets
from viewer.gui.panels import Panel, PanelPlace
from viewer.gui.theme import ICON
from viewer.gui.widgets import px
from viewer.session.playback import Playback

SPEEDS = (0.1, 2.0)
WIDE = 520.0  # pixels at scale 1: words beside the icons
TINY = 400.0  # in less only what has no other way stays
PROMPT_POPUP, GAIT_POPUP, PIN_POPUP = "new prompt", "new gait", "new pin"
BESIDE_POPUP = "beside"


def panel(editing: Resimulation, pins: Pins, camera: CameraKeys, references: ReferenceCard) -> Panel:
    """The bar; Escape in the view leaves the take."""

    def close() -> bool:
        was_open = editing.playback is not None
        editing.takes.close_playback()
        return was_open

    return Panel(
        "Transport", PanelPlace.BELOW, lambda _: draw(editing, pins, camera, references), close=close
    )


def draw(editing: Resimulation, pins: Pins, camera: CameraKeys, references: ReferenceCard) -> None:
    """Contents of the bar."""
    playback = editing.playback
    if playback is None:
        return
    width = imgui.get_content_region_avail().x
    wide, tiny = width >= px(WIDE), width < px(TINY)
    if not wide:
        editing.part_tracks = False  # its button is not there
    _playing(playback, editing, wide, tiny)
    _editing(playback, editing, pins, camera, references, wide, tiny)
    timeline.draw(editing, pins, camera, playback)


def _playing(playback: Playback, editing: Resimulation, wide: bool, tiny: bool) -> None:
    """Time: play, single steps, loop, speed, the frame, and back to live."""
    square, gap = px(30), px(4)
    if widgets.button(ICON.start, square, "To the first frame kept (Home)"):
        playback.seek(playback.first)
    imgui.same_line(0, gap)
    if widgets.button(f"{ICON.back}##frame back", square, "One frame back (Left, comma)"):
        playback.step(-1)
    imgui.same_line(0, gap)
    icon = ICON.pause if playback.playing else ICON.play
    if widgets.button(f"{icon}###play", square, "Play or pause (Space, P)", primary=True):
        playback.toggle()
    imgui.same_line(0, gap)
    if widgets.button(f"{ICON.on}##frame on", square, "One frame on (Right, full stop)"):
        playback.step(1)
    if not tiny:
        imgui.same_line(0, gap)
        playback.loop = widgets.toggle(ICON.loop, playback.loop, square, "Begin again at the end")
        imgui.same_line(0, px(8))
        imgui.set_next_item_width(px(96 if wide else 72))
        _, playback.speed = widgets.slider("##speed", playback.speed, *SPEEDS, "%.2f x", logarithmic=True)
        widgets.tooltip("Playback speed; Ctrl+click types it")
    live = f"{ICON.person} Live" if wide else ICON.person
    live_width = imgui.calc_text_size(live).x + 2 * imgui.get_style().frame_padding.x
    right = imgui.get_window_width() - imgui.get_style().window_padding.x - live_width
    imgui.same_line(0, px(8))
    imgui.align_text_to_frame_padding()
    _time(playback, editing, right - imgui.get_cursor_pos_x() - px(8))
    imgui.same_line(right)
    if widgets.button(f"{live}###live", live_width, "Back to the live character (Esc, or just move)"):
        editing.takes.close_playback()


def _time(playback: Playback, editing: Resimulation, space: float) -> None:
    """The frame, then as much more as there is space for; while the take is resimulated, how far that is."""
    if editing.busy and space > px(60):
        imgui.progress_bar(editing.progress, imgui.ImVec2(space, 0), f"Resimulating {editing.progress:.0%}")
        return
    frame = f"{playback.frame} / {playback.frames - 1}"
    clock = widgets.clock(playback.time_s)
    more = "" if editing.take is None else editing.take.title
    choices = (f"{frame}   {clock} s   {more}", f"{frame}   {clock} s", frame)
    fitting = [text for text in choices if imgui.calc_text_size(text).x <= space]
    widgets.muted(fitting[0] if fitting else "")


def _editing(
    playback: Playback,
    editing: Resimulation,
    pins: Pins,
    camera: CameraKeys,
    references: ReferenceCard,
    wide: bool,
    tiny: bool,
) -> None:
    """What lies on the tracks: trim, new spans, undo, and going on from here."""
    gap, fixed = px(4), editing.fixed
    if not tiny:  # the handles of the ruler do the same
        if widgets.button("[ In", px(44), "Keep the clip from this frame"):
            editing.takes.trim(first=playback.frame)
        imgui.same_line(0, gap)
        if widgets.button("Out ]", px(50), "Keep the clip up to this frame"):
            editing.takes.trim(last=playback.frame)
        imgui.same_line(0, px(8))
    imgui.begin_disabled(bool(fixed))
    if widgets.button("+ Prompt", 0.0, fixed or "Another prompt from this frame on"):
        editing.new_prompt = ""
        imgui.open_popup(PROMPT_POPUP)
    imgui.same_line(0, gap)
    if widgets.button(
        "+ Gait", 0.0, fixed or "Another gait from this frame to the end of the one that is there"
    ):
        imgui.open_popup(GAIT_POPUP)
    imgui.end_disabled()
    imgui.same_line(0, gap)
    imgui.begin_disabled(bool(pins.fixed))
    if widgets.button(
        "+ Pin",
        0.0,
        pins.fixed or "Hold a hand, a foot, the look or the pose from this frame on, or key the camera",
    ):
        imgui.open_popup(PIN_POPUP)
    imgui.end_disabled()
    _popups(editing, pins, camera)
    imgui.same_line(0, gap)
    editor = editing.takes.editor
    undo, redo = editor.undo_label, editor.redo_label
    if widgets.icon_button(ICON.undo, "take undo", f"Undo {undo} (Ctrl+Z)", theme.TEXT, bool(undo)):
        editor.undo()
    imgui.same_line(0, 0)
    if widgets.icon_button(ICON.redo, "take redo", f"Redo {redo} (Ctrl+Y)", theme.TEXT, bool(redo)):
        editor.redo()
    if wide:
        imgui.same_line(0, gap)
        hint = "A track for what each body part does"
        editing.part_tracks = widgets.toggle("Parts", editing.part_tracks, px(48), hint)
        imgui.same_line(0, gap)
        _beside(references)
    _go_on(editing, fixed, "Go on from here" if wide else "" if tiny else "Go on")


def _beside(references: ReferenceCard) -> None:
    hint = "Compare with another take, a BVH or a film: next to it or over it"
    shown = references.reference.shown
    if widgets.toggle("Compare…", shown, px(78), hint) != shown:
        imgui.open_popup(BESIDE_POPUP)
    if imgui.begin_popup(BESIDE_POPUP):
        references.menu()
        imgui.end_popup()


def _go_on(editing: Resimulation, fixed: str, words: str) -> None:
    widgets.same_line()
    end = imgui.get_window_width() - imgui.get_style().window_padding.x
    padding, room = 2 * imgui.get_style().frame_padding.x, end - imgui.get_cursor_pos_x()
    texts = [
        f"{ICON.walk} {text}".rstrip()
        for text in dict.fromkeys((words, words.removesuffix(" from here"), ""))
    ]
    text = next((t for t in texts if imgui.calc_text_size(t).x + padding <= room), texts[-1])
    width = imgui.calc_text_size(text).x + padding
    imgui.same_line(end - width)
    imgui.begin_disabled(bool(fixed))
    if widgets.button(
        f"{text}###go on", width, fixed or "Drive the live character from this frame of the take"
    ):
        editing.go_on()
    imgui.end_disabled()


def _popups(editing: Resimulation, pins: Pins, camera: CameraKeys) -> None:
    if imgui.begin_popup(PROMPT_POPUP):
        if imgui.is_window_appearing():
            imgui.set_keyboard_focus_here()
        imgui.set_next_item_width(px(260))
        flags = imgui.InputTextFlags_.enter_returns_true
        entered, editing.new_prompt = imgui.input_text_with_hint(
            "##new prompt", "Prompt from here; Enter resimulates", editing.new_prompt, flags
        )
        if entered:
            editing.insert_prompt(editing.new_prompt)
            imgui.close_current_popup()
        imgui.end_popup()
    if imgui.begin_popup(GAIT_POPUP):
        for gait in REQUESTS:
            if imgui.selectable(f"{gait.label.capitalize()}##gait", False)[0]:
                editing.insert_gait(gait)
        imgui.end_popup()
    if imgui.begin_popup(PIN_POPUP):
        for what in Pinned:
            if imgui.selectable(f"{str(what).capitalize()}##pin", False)[0]:
                pins.add(what)
        imgui.separator()
        camera.menu()
        imgui.end_popup()
