"""The export window: format, path, options of motion or film, progress."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from runtime.formats.engines import ENGINES
from runtime.options import spec_of
from viewer.exports.exporting import Exporting
from viewer.exports.state import ExportState
from viewer.gl_bindings import imgui
from viewer.gui import overlay, theme, widgets
from viewer.gui.panels import Panel, PanelPlace
from viewer.gui.theme import ICON, Fonts
from viewer.gui.widgets import px

WIDTH = 470.0  # pixels at scale 1
LISTS = ("fps", "unit", "euler_order", "engine", "ground", "film_fps", "size", "camera")
SLIDERS = (("distance", 0.5, "%.1f m"), ("fov_degrees", 15.0, "%.0f degrees"))  # the least value, the text
TOGGLES = (
    "in_place", "ground_root", "at_origin", "rest_frame", "animation_only", "humanoid_names", "captions", "quality",
    "loop", "trimmed", "own_character",
)  # fmt: skip


def panel(exporting: Exporting, fonts: Fonts) -> Panel:
    """The export window."""

    def close() -> bool:
        was_open = exporting.state.open
        exporting.state.open = False
        return was_open

    return Panel("Export", PanelPlace.WINDOW, lambda _: draw(exporting, fonts), close=close)


def draw(exporting: Exporting, fonts: Fonts) -> None:
    """The window, when it is open."""
    state, take = exporting.state, exporting.takes.session.current
    if not state.open or take is None:
        state.open = False
        return
    with overlay.window(fonts, "Export", ICON.save, WIDTH) as closed:
        header = take.made.header
        first, last = take.range if state.form.trimmed else (0, take.frames - 1)
        length = f"{(last - first + 1) / header.fps:.1f} s, on {header.terrain.rsplit('/', 1)[-1]}"
        widgets.muted(widgets.elided(f"{take.title}: {length}", imgui.get_content_region_avail().x))
        imgui.begin_disabled(exporting.busy)
        _target(exporting)
        _lists_and_sliders(state)
        _toggles(exporting, take.trimmed)
        imgui.end_disabled()
        _end(exporting)
    exporting.remember()
    if closed[0]:
        state.open = False


def _target(exporting: Exporting) -> None:
    state = exporting.state
    chosen = _list(state, "suffix", "##export format")
    if chosen != state.form.suffix:
        exporting.choose_format(str(chosen))
    overlay.row("File")
    side = imgui.get_frame_height()
    imgui.set_next_item_width(imgui.get_content_region_avail().x - side - px(4))
    flags = imgui.InputTextFlags_.elide_left
    state.path = imgui.input_text("##export file", state.path, flags)[1]
    imgui.same_line(0, px(4))
    if widgets.icon_button(ICON.folder, "browse export", "Choose by a dialog", theme.TEXT):
        exporting.browse()


def _list(state: ExportState, name: str, widget: str) -> object:
    """A row with the choices of an option; the chosen one."""
    spec = spec_of(state.form, name)
    overlay.row(spec.label, spec.hint)
    choices = [
        (value, text)
        for value, text in (spec.choices or {}).items()
        if value != "inside" or state.form.has("with_ground")
    ]
    return overlay.combo(widget, choices, getattr(state.form, name))


def _lists_and_sliders(state: ExportState) -> None:
    """The options that the format has, but for those that are on or off."""
    if state.form.ground == "inside" and not state.form.has("with_ground"):
        state.choose(ground="")
    for name in filter(state.form.has, LISTS):
        state.choose(**{name: _list(state, name, f"##export {name}")})
    for name, least, text in SLIDERS:
        if state.form.has(name):
            spec, value = spec_of(state.form, name), getattr(state.form, name)
            overlay.row(spec.label, spec.hint)
            moved, value = widgets.slider(
                f"##export {name}", value, spec.low, spec.high, text if value else "as usual"
            )
            if moved:
                state.choose(**{name: value if value >= least else 0.0})


def _toggles(exporting: Exporting, trimmed: bool) -> None:
    """What is on or off, and the strides of a loop."""
    state, form = exporting.state, exporting.state.form
    own = exporting.scene.character_path
    hidden = {
        "humanoid_names": not (form.engine and ENGINES[form.engine].bones),
        "trimmed": not trimmed,
        "own_character": own is None,
    }
    entries: list[tuple[str, bool, str, Callable[[bool], None]]] = []
    for name in filter(form.has, TOGGLES):
        spec, value = spec_of(form, name), getattr(form, name)
        if hidden.get(name):
            continue
        hint = f"{own.name} in the place of the mannequin" if own and name == "own_character" else spec.hint
        entries.append((spec.label, value in (True, "high"), hint, partial(_set, state, name)))
    if entries:
        overlay.toggles(entries)
    if state.form.loop and state.form.has("loop"):
        spec = spec_of(form, "strides")
        overlay.row(spec.label, spec.hint)
        state.choose(strides=widgets.segmented("strides", list((spec.choices or {}).items()), form.strides))


def _set(state: ExportState, name: str, on: bool) -> None:
    state.choose(**{name: ("high" if on else "software") if name == "quality" else on})


def _end(exporting: Exporting) -> None:
    """Progress and the buttons, and what became of the last export."""
    state = exporting.state
    imgui.separator()
    if exporting.busy:
        done, total = state.progress
        share, text = (done / total, f"{done} of {total} frames") if total else (0.0, "Exporting…")
        imgui.progress_bar(share, imgui.ImVec2(-px(90), 0), text)
        imgui.same_line(0, px(4))
        if widgets.button("Cancel##cancel export", -1, "Cancel; no file is kept"):
            exporting.cancel()
    elif state.missing:
        with widgets.color(imgui.Col_.text, theme.ERROR):
            imgui.text_wrapped(state.missing)
    elif widgets.button(f"{ICON.save} Export##export now", -1, primary=True):
        exporting.export()
    if state.report:
        with widgets.color(imgui.Col_.text, theme.TEXT if state.report_good else theme.ERROR):
            imgui.text_wrapped(state.report)
        if state.report != state.shown_report:  # in a low window it lies below the edge
            imgui.set_scroll_here_y(1.0)
    state.shown_report = state.report
