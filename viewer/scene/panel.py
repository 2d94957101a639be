"""The scene panel: ground, camera, what is shown, and how it is drawn."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from runtime.character.shape import BodyShape
from runtime.safe_read import printable
from viewer.gl_bindings import imgui
from viewer.gui import setting_widgets, theme, widgets
from viewer.gui.panels import Panel, PanelPlace
from viewer.gui.theme import ICON
from viewer.gui.widgets import px
from viewer.live import panel as live_panel
from viewer.settings import CAMERAS, QUALITIES, VIEWS, Settings
from viewer.stage import path_panel
from viewer.stage.stage import Stage

_SHAPES = {"height": "Height", "legs": "Legs", "shoulders": "Shoulders"}
_SHAPE_RANGE = (60.0, 150.0)  # % of its own
_SHOWN = ("show_trajectory", "show_skeleton", "show_contacts", "show_grid", "show_ghosts", "show_trails")


def panel(
    stage: Stage,
    open_files: Callable[[list[Path]], None],
    browse: Callable[[], None],
    draw_pins: Callable[[float], None],
) -> Panel:
    """The scene panel; `draw_pins` is its button, of a width, for pins of the live character."""
    return Panel(
        "Scene",
        PanelPlace.RIGHT_TOP,
        lambda _: draw(stage, open_files, browse, draw_pins),
        ICON.scene,
        actions=stage.actions,
    )


def draw(
    stage: Stage,
    open_files: Callable[[list[Path]], None],
    browse: Callable[[], None],
    draw_pins: Callable[[float], None],
) -> None:
    """Contents of the panel; `browse` asks for a file to open."""
    _terrain(stage)
    _open_file(stage, open_files, browse)
    mode = widgets.segmented("camera", list(CAMERAS.items()), stage.camera.mode)
    if mode != stage.camera.mode:
        stage.use_camera(mode)
    _views(stage)
    path_panel.draw(stage, draw_pins)
    _toggles(stage.settings)
    _drawing(stage)
    live_panel.draw(stage.live, stage.vmc)


def _terrain(stage: Stage) -> None:
    state, spec = stage.state, printable(stage.state.terrain_spec)
    widgets.label("Ground")
    reset_width = imgui.get_frame_height() + px(4)
    imgui.set_next_item_width(imgui.get_content_region_avail().x - reset_width - px(4))
    shown = f"Loading {printable(state.loading)}…" if state.loading else _short(spec)
    if imgui.begin_combo("##terrain", shown, imgui.ComboFlags_.height_largest):
        for name in state.terrain_names:
            if imgui.selectable(_short(name), name == spec)[0] and name != spec:
                stage.load_terrain(name)
        imgui.end_combo()
    widgets.tooltip(spec)
    imgui.same_line(0, px(4))
    if widgets.button(ICON.reset, reset_width, "Back to the start of the ground (Home)"):
        stage.reset_character()


def _open_file(stage: Stage, open_files: Callable[[list[Path]], None], browse: Callable[[], None]) -> None:
    if not imgui.tree_node_ex("Open a file, shape the body", imgui.TreeNodeFlags_.span_avail_width):
        return
    imgui.unindent(imgui.get_style().indent_spacing)
    state, load_width = stage.state, px(60)
    imgui.set_next_item_width(-load_width - imgui.get_frame_height() - px(8))
    entered, state.file_path = imgui.input_text_with_hint(
        "##path", "PNG, OBJ, GLB, VRM, BVH", state.file_path, imgui.InputTextFlags_.enter_returns_true
    )
    imgui.same_line(0, px(4))
    if widgets.icon_button(ICON.folder, "browse file", "Choose by a dialog", theme.TEXT):
        browse()
    imgui.same_line(0, px(4))
    load = widgets.button(
        "Open",
        load_width,
        "A ground (PNG, NPY, mesh), a character (GLB, VRM) or a clip (BVH); dropping a file does the same",
    )
    path = state.file_path.strip().strip('"')
    if (entered or load) and path:
        open_files([Path(path).expanduser()])
    half = (imgui.get_content_region_avail().x - px(4)) / 2
    imgui.set_next_item_width(half)
    setting_widgets.drag(stage.settings, "height_map_cell_m")
    imgui.same_line(0, px(4))
    imgui.set_next_item_width(half)
    setting_widgets.drag(stage.settings, "height_map_height_m")
    if stage.is_mannequin:
        _shape(stage)
        if stage.character_path is not None and widgets.button("Its own shape", -1):
            stage.shape_mannequin(BodyShape())
    elif stage.character_path is not None:
        if widgets.button("Joints…", px(80), "Which joint of this character plays which of ours"):
            stage.joints.begin(stage.character_path)
        imgui.same_line(0, px(4))
        if widgets.button("Back to the mannequin", -1):
            stage.shape_mannequin(stage.state.shape)
        setting_widgets.toggle(stage.settings, "fit_to_motion", -1)
    imgui.indent(imgui.get_style().indent_spacing)
    imgui.tree_pop()


def _shape(stage: Stage) -> None:
    """The mannequin's measures; it is made again when the mouse lets go, and its steps adapt to its size."""
    shape = stage.state.shape
    for name, text in _SHAPES.items():
        share = 100.0 * getattr(shape, name)
        imgui.set_next_item_width(-1)
        moved, share = widgets.slider(f"##shape {name}", share, *_SHAPE_RANGE, f"{text} %.0f %%")
        if moved:
            stage.state.shape = replace(shape, **{name: round(share) / 100.0})
        if imgui.is_item_deactivated_after_edit():
            stage.shape_mannequin(stage.state.shape)
        widgets.tooltip(f"The mannequin's {text.lower()}. Ctrl+click types a number")


def _views(stage: Stage) -> None:
    spacing = px(4)
    texts = [(text, f"The character from there ({key})") for key, text in enumerate(VIEWS.values(), 1)]
    width = (imgui.get_content_region_avail().x - spacing * len(texts)) / (len(texts) + 1)
    for name, (text, hint) in zip(VIEWS, texts, strict=True):
        if widgets.button(f"{text}##view {name}", width, hint):
            stage.view(name)
        imgui.same_line(0, spacing)
    if widgets.button("Frame##frame", width, "Bring the whole character into the middle (0)"):
        stage.frame_character()


def _toggles(settings: Settings) -> None:
    spacing = px(4)
    width = (imgui.get_content_region_avail().x - 2 * spacing) / 3
    for i, name in enumerate(_SHOWN):
        if i % 3:
            imgui.same_line(0, spacing)
        setting_widgets.toggle(settings, name, width)
        if name == "show_ghosts" and imgui.begin_popup_context_item("ghost frames"):
            imgui.set_next_item_width(px(200))
            setting_widgets.slider(settings, "ghost_frames")
            imgui.end_popup()


def _drawing(stage: Stage) -> None:
    spacing = px(4)
    room = imgui.get_content_region_avail().x - 2 * spacing
    wide, slider = 0.42 * room, 0.29 * room  # the list holds "Automatic" and an arrow
    top, chosen = imgui.get_cursor_pos(), stage.settings.quality
    widgets.label("Quality")
    imgui.set_next_item_width(wide)
    shown = QUALITIES.get(chosen or stage.state.quality, QUALITIES[""])
    if imgui.begin_combo("##quality", shown):
        for name, text in QUALITIES.items():
            if imgui.selectable(text, name == chosen)[0] and name != chosen:
                stage.set_quality(name)
        imgui.end_combo()
    widgets.tooltip("How the scene is drawn" if chosen else "How the scene is drawn; chosen for this machine")
    for number, (text, name) in enumerate((("Variety", "temperature"), ("Response", "response"))):
        imgui.set_cursor_pos(imgui.ImVec2(top.x + wide + spacing + number * (slider + spacing), top.y))
        imgui.begin_group()
        widgets.label(text)
        imgui.set_next_item_width(slider)
        setting_widgets.slider(stage.settings, name)
        imgui.end_group()


def _short(spec: str) -> str:
    """A name as it is, a path by its last part."""
    name = spec.replace("\\", "/").rsplit("/", 1)[-1]
    return name if "." in name else name.replace("_", " ").capitalize()
