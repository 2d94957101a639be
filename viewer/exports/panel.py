"""The export window: format, path, options of motion or film, progress."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

from runtime.formats.engines import ENGINES
from runtime.formats.prepare import ROTATION_ORDERS
from runtime.formats.table import FORMATS
from runtime.takes.clip import VIDEO_RATES
from viewer.exports.exporting import Exporting
from viewer.exports.state import GROUNDS, SIZES, ExportForm
from viewer.filming.shots import CAMERAS, KEYED, VIEW
from viewer.gl_bindings import imgui
from viewer.gui import overlay, theme, widgets
from viewer.gui.panels import Panel, PanelPlace
from viewer.gui.theme import ICON, Fonts
from viewer.gui.widgets import px

WIDTH = 470.0  # pixels at scale 1
MOTION_RATES = (*((rate, f"{rate:.4g} fps") for rate in VIDEO_RATES),)
FILM_RATES = ((15.0, "15 fps"), *((rate, f"{rate:.4g} fps") for rate in VIDEO_RATES if rate <= 60.0))
MAX_DISTANCE_M = 20.0
LEAST_FOV_DEGREES, MAX_FOV_DEGREES = 15.0, 90.0


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
        length = f"{header.seconds:.1f} s, on {header.terrain.rsplit('/', 1)[-1]}"
        widgets.muted(widgets.elided(f"{take.title}: {length}", imgui.get_content_region_avail().x))
        imgui.begin_disabled(exporting.busy)
        _target(exporting)
        form = state.form
        _film(form) if form.format.film else _motion(form)
        _common(exporting, form, take.trimmed)
        imgui.end_disabled()
        _end(exporting)
    if closed[0]:
        state.open = False


def _rate(label: str, rates: Sequence[tuple[float, str]], chosen: float) -> float:
    return float(str(overlay.combo(label, rates, chosen)))


def _set(form: ExportForm, name: str, value: Any) -> None:
    setattr(form, name, value)


def _target(exporting: Exporting) -> None:
    state = exporting.state
    overlay.row("Format")
    chosen = str(
        overlay.combo("##export format", [(f.suffix, f.name) for f in FORMATS.values()], state.form.suffix)
    )
    if chosen != state.form.suffix:
        exporting.choose_format(chosen)
    overlay.row("File")
    side = imgui.get_frame_height()
    imgui.set_next_item_width(imgui.get_content_region_avail().x - side - px(4))
    flags = imgui.InputTextFlags_.elide_left
    state.path = imgui.input_text("##export file", state.path, flags)[1]
    imgui.same_line(0, px(4))
    if widgets.icon_button(ICON.folder, "browse export", "Choose by a dialog", theme.TEXT):
        exporting.browse()


TOGGLES = (
    ("In place", "in_place", "The way over the ground is taken out; the heading stays"),
    ("Root on the ground", "ground_root", "A root joint on the ground, above the hips"),
    ("At the origin", "at_origin", "Begin at the origin on height 0, facing +Z"),
    ("Rest pose first", "rest_frame", "Frame 0 is the rest pose"),
    ("Animation only", "animation_only", "The skeleton and its motion, without meshes"),
    ("Humanoid names", "humanoid_names", "Bones named as in the humanoid of that program"),
)


def _motion(form: ExportForm) -> None:
    """The options that the format has."""
    has = form.format.options
    if "fps" in has:
        overlay.row("Frames a second")
        form.fps = _rate("##export rate", ((0.0, "as the take"), *MOTION_RATES), form.fps)
    if "unit" in has:
        overlay.row("Unit")
        units = (("cm", "Centimetres"), ("m", "Metres"))
        form.unit = str(overlay.combo("##export unit", units, form.unit))
    if "euler_order" in has:
        overlay.row(
            "Rotations", "YXZ at hips and root keeps a reader that interpolates angles steady in any heading"
        )
        orders = (("", "YXZ at the hips, ZYX else"), *((order, order) for order in ROTATION_ORDERS))
        form.euler_order = str(overlay.combo("##export order", orders, form.euler_order))
    if "engine" in has:
        overlay.row("For", "Unit, scale, root joint and names of takes as that program expects them")
        engines = (("", "any program"), *((name, name.capitalize()) for name in ENGINES))
        form.engine = str(overlay.combo("##export engine", engines, form.engine))
    if form.format.keeps_motion or "with_ground" in has:
        overlay.row("Ground", "As a second node of the file, or as a file beside it, in the same coordinates")
        inside = "with_ground" in has
        grounds = [(key, text) for key, text in GROUNDS.items() if inside or key != "inside"]
        form.ground = form.ground if inside or form.ground != "inside" else ""
        form.ground = str(overlay.combo("##export ground", grounds, form.ground))


def _switches(form: ExportForm) -> list[tuple[str, bool, str, Callable[[bool], None]]]:
    """What the format can leave out or add."""
    has = () if form.format.film else form.format.options
    return [
        (text, getattr(form, name), hint, partial(_set, form, name))
        for text, name, hint in TOGGLES
        if name in has and (name != "humanoid_names" or (form.engine and ENGINES[form.engine].bones))
    ]


def _film(form: ExportForm) -> None:
    overlay.row("Frames a second")
    form.film_fps = _rate("##film rate", FILM_RATES, form.film_fps)
    overlay.row("Size")
    form.size = str(overlay.combo("##film size", [(size, size) for size in SIZES], form.size))
    overlay.row("Camera")
    cameras = [
        (VIEW, "As in the window, going along"),
        (KEYED, "Keyed on the timeline"),
        *((name, name.capitalize()) for name in CAMERAS),
    ]
    form.camera = str(overlay.combo("##film camera", cameras, form.camera))
    overlay.row("Distance")
    text = "%.1f m" if form.distance else "as usual"
    moved, distance = widgets.slider("##film distance", form.distance, 0.0, MAX_DISTANCE_M, text)
    if moved:
        form.distance = distance if distance >= 0.5 else 0.0
    overlay.row("Field of view", "From the bottom to the top; wider shows more around")
    text = "%.0f degrees" if form.fov_degrees else "as usual"
    moved, degrees = widgets.slider("##film fov", form.fov_degrees, 0.0, MAX_FOV_DEGREES, text)
    if moved:
        form.fov_degrees = degrees if degrees >= LEAST_FOV_DEGREES else 0.0
    overlay.toggles(
        (
            ("Captions", form.captions, "The prompts under the film", partial(_set, form, "captions")),
            (
                "High quality",
                form.quality == "high",
                "Off: faster without a graphics card",
                lambda on: _set(form, "quality", "high" if on else "software"),
            ),
        )
    )


def _common(exporting: Exporting, form: ExportForm, trimmed: bool) -> None:
    entries = _switches(form)
    if "loop" in form.format.options:
        hint = "Only the best cycle of a steady walk; its seam is reported"
        entries.append(("Loop", form.loop, hint, partial(_set, form, "loop")))
    if trimmed:
        hint = "Only what lies between the trim marks of the timeline"
        entries.append(("Trimmed range", form.trimmed, hint, partial(_set, form, "trimmed")))
    own = exporting.scene.character_path
    if own is not None and "character" in form.format.options:
        hint = f"{own.name} in the place of the mannequin"
        entries.append(("My character", form.own_character, hint, partial(_set, form, "own_character")))
    if entries:
        overlay.toggles(entries)
    if form.loop and "loop" in form.format.options:
        overlay.row("Strides of the loop", "A stride is a step with each foot")
        form.strides = int(widgets.segmented("strides", [(n, str(n)) for n in (1, 2, 3, 4, 8)], form.strides))


def _end(exporting: Exporting) -> None:
    """Progress and the buttons, and what became of the last export."""
    state = exporting.state
    imgui.separator()
    if exporting.busy:
        done, total = state.progress
        share, text = (done / total, f"{done} of {total} frames") if total else (0.0, "Exporting…")
        imgui.progress_bar(share, imgui.ImVec2(-px(90), 0), text)
        imgui.same_line(0, px(4))
        imgui.begin_disabled(not state.form.format.film)
        if widgets.button("Cancel##cancel export", -1, "Give it up; nothing of it stays"):
            exporting.cancel()
        imgui.end_disabled()
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
