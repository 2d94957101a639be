"""The export window: format, path, options of motion or film, progress."""

from runtime.formats.engines import ENGINES
from runtime.options import spec_of
from viewer.exports.exporting import Exporting
from viewer.gl_bindings import imgui
from viewer.gui import theme, widgets
from viewer.gui.layout import Rect
from viewer.gui.panels import Panel, PanelPlace
from viewer.gui.theme import ICON
from viewer.gui.widgets import px

WINDOW_WIDTH_PX, WINDOW_HEIGHT_PX = 470.0, 560.0  # pixels at scale 1
FOOTER_HEIGHT_PX = 100.0  # of the buttons and the last export's result
LISTS = ("part", "fps", "unit", "euler_order", "engine", "ground", "film_fps", "size", "camera")
SLIDERS = (("distance", 0.5, "%.1f m"), ("fov_degrees", 15.0, "%.0f degrees"))  # minimum value, text
TOGGLES = (
    "in_place", "ground_root", "at_origin", "rest_frame", "animation_only", "humanoid_names", "captions", "quality",
    "loop", "own_character",
)  # fmt: skip
VALUES = {"quality": ("software", "high")}  # of toggles other than False and True: off and on


def panel(exporting: Exporting) -> Panel:

    def draw(_: Rect) -> None:
        take = exporting.takes.session.current
        if take is None:
            exporting.close()
            return
        header, (first, last) = take.made.header, exporting.range_of(take)
        part = (
            ""
            if last - first + 1 == take.frames
            else f" (frames {first - take.numbered_from} to {last - take.numbered_from})"
        )
        length = f"{(last - first + 1) / header.fps:.1f} s{part}, on {header.terrain.rsplit('/', 1)[-1]}"
        widgets.muted(widgets.elided(f"{take.title}: {length}", imgui.get_content_region_avail().x))
        with widgets.disabled(exporting.busy):
            _target(exporting)
            # the buttons below stay in place, however many options a format has
            if imgui.begin_child("options", imgui.ImVec2(0, -px(FOOTER_HEIGHT_PX))):
                _lists_and_sliders(exporting)
                _toggles(exporting)
                form = exporting.form
                if form.loop and form.has("loop"):
                    spec = spec_of(form, "strides")
                    widgets.row(spec.label, spec.hint)
                    exporting.choose(
                        strides=widgets.segmented("strides", list((spec.choices or {}).items()), form.strides)
                    )
            imgui.end_child()
        _end(exporting)
        exporting.remember()

    return Panel(
        "Export", PanelPlace.WINDOW, draw, ICON.save, lambda: exporting.shown, WINDOW_WIDTH_PX, WINDOW_HEIGHT_PX,
        close=exporting.close,
    )  # fmt: skip


def _target(exporting: Exporting) -> None:
    chosen = _list(exporting, "suffix", "##export format")
    if chosen != exporting.form.suffix:
        exporting.choose_format(str(chosen))
    widgets.row("File")
    imgui.set_next_item_width(imgui.get_content_region_avail().x - imgui.get_frame_height() - px(4))
    flags = imgui.InputTextFlags_.elide_left
    exporting.path = imgui.input_text("##export file", exporting.path, flags)[1]
    widgets.same_line()
    if widgets.icon_button(ICON.folder, "browse export", "Browse…", theme.TEXT):
        exporting.browse()


def _list(exporting: Exporting, name: str, widget: str) -> object:
    """Draw a row with the choices of an option; return the chosen one."""
    spec = spec_of(exporting.form, name)
    widgets.row(spec.label, spec.hint)
    choices = [
        (value, text)
        for value, text in (spec.choices or {}).items()
        if value != "inside" or exporting.form.has("with_ground")
    ]
    return widgets.combo(widget, choices, getattr(exporting.form, name))


def _lists_and_sliders(exporting: Exporting) -> None:
    if exporting.form.ground == "inside" and not exporting.form.has("with_ground"):
        exporting.choose(ground="")
    hidden = () if exporting.scene.character_path else ("character_unit",)
    for name in (name for name in LISTS if exporting.form.has(name) and name not in hidden):
        exporting.choose(**{name: _list(exporting, name, f"##export {name}")})
    for name, least, text in SLIDERS:
        if exporting.form.has(name):
            _slider(exporting, name, least, text)


def _slider(exporting: Exporting, name: str, least: float, text: str) -> None:
    """Draw a row with the value of an option; a value below `least` stands for its default, 0."""
    spec, value = spec_of(exporting.form, name), getattr(exporting.form, name)
    widgets.row(spec.label, spec.hint)
    shown = text if value else "default"
    moved, value = widgets.slider(f"##export {name}", value, spec.low, spec.high, shown)
    if moved:
        exporting.choose(**{name: value if value >= least else 0.0})


def _toggles(exporting: Exporting) -> None:
    form, own = exporting.form, exporting.scene.character_path
    applies = {
        "humanoid_names": form.engine and ENGINES[form.engine].bones, "own_character": own,
    }  # fmt: skip
    hints = {"own_character": f"{own.name if own else ''} instead of the mannequin"}
    names = [name for name in TOGGLES if form.has(name) and applies.get(name, True)]
    columns = 3 if len(names) == 3 else 2
    width = widgets.column_width(columns)
    for number, name in enumerate(names):
        spec, values = spec_of(form, name), VALUES.get(name, (False, True))
        on = getattr(form, name) == values[1]
        if number % columns:
            widgets.same_line()
        if widgets.toggle(spec.label, on, width, hints.get(name, spec.hint)) != on:
            exporting.choose(**{name: values[not on]})


def _end(exporting: Exporting) -> None:
    """Draw progress, the buttons, and the last export's result."""
    imgui.separator()
    if exporting.busy:
        done, total = exporting.progress
        fraction, text = (done / total, f"{done} of {total} frames") if total else (0.0, "Exporting…")
        imgui.progress_bar(fraction, imgui.ImVec2(-px(90), 0), text)
        widgets.same_line()
        if widgets.button("Cancel##cancel export", -1, "Cancel; no file is kept"):
            exporting.cancel()
    elif exporting.missing:
        widgets.text(exporting.missing, theme.ERROR, wrap=True)
    elif widgets.button(f"{ICON.save} Export##export now", -1, primary=True):
        exporting.export()
    if exporting.report:
        _report(exporting)


def _report(exporting: Exporting) -> None:
    show = "Show in folder"
    room = imgui.get_content_region_avail().x - imgui.calc_text_size(show).x - px(30)
    widgets.fitted(exporting.report, room, theme.TEXT if exporting.report_good else theme.ERROR, lines=1.8)
    if exporting.saved:
        imgui.same_line(imgui.get_cursor_start_pos().x + room + px(8))
        if widgets.button(f"{show}##show export"):
            exporting.messages.show_in_folder(exporting.saved)
