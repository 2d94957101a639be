"""The scene panel: ground, camera, what is shown, and how it is drawn."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from runtime.character.shape import BodyShape
from runtime.safe_read import printable
from viewer.edit.path import PathTool
from viewer.gl_bindings import imgui
from viewer.gui import setting_widgets, theme, widgets
from viewer.gui.panels import Panel, PanelPlace
from viewer.gui.theme import ICON
from viewer.gui.widgets import px
from viewer.live import panel as live_panel
from viewer.scene.scene import Scene
from viewer.session.takes import Takes
from viewer.settings import CAMERAS, QUALITIES, VIEWS, Settings

_SHAPES = {"height": "Height", "legs": "Legs", "shoulders": "Shoulders"}
_SHAPE_RANGE = (60.0, 150.0)  # % of its own
_SHOWN = ("show_trajectory", "show_skeleton", "show_contacts", "show_grid", "show_ghosts", "show_trails")


def panel(
    scene: Scene,
    takes: Takes,
    path: PathTool,
    open_files: Callable[[list[Path]], None],
    browse: Callable[[], None],
    draw_pins: Callable[[float], None],
) -> Panel:
    """The scene panel; `draw_pins` is its button, of a width, for pins of the live character."""
    return Panel(
        "Scene",
        PanelPlace.RIGHT_TOP,
        lambda _: draw(scene, takes, path, open_files, browse, draw_pins),
        ICON.scene,
        actions=scene.actions,
    )


def draw(
    scene: Scene,
    takes: Takes,
    path: PathTool,
    open_files: Callable[[list[Path]], None],
    browse: Callable[[], None],
    draw_pins: Callable[[float], None],
) -> None:
    """Contents of the panel; `browse` asks for a file to open."""
    _terrain(scene, takes)
    _open_file(scene, open_files, browse)
    mode = widgets.segmented("camera", list(CAMERAS.items()), scene.camera.mode)
    if mode != scene.camera.mode:
        scene.use_camera(mode)
    _views(scene)
    path.draw(draw_pins)
    _toggles(scene.settings)
    _drawing(scene)
    live_panel.draw(scene.live, scene.vmc)


def _terrain(scene: Scene, takes: Takes) -> None:
    spec = printable(takes.ground_to_show().spec)
    widgets.label("Ground")
    reset_width = imgui.get_frame_height() + px(4)
    imgui.set_next_item_width(imgui.get_content_region_avail().x - reset_width - px(4))
    shown = f"Loading {printable(scene.loading)}…" if scene.loading else _short(spec)
    if imgui.begin_combo("##terrain", shown, imgui.ComboFlags_.height_largest):
        for name in scene.terrain_names:
            if imgui.selectable(_short(name), name == spec)[0] and name != spec:
                scene.load_terrain(name)
        imgui.end_combo()
    widgets.tooltip(spec)
    imgui.same_line(0, px(4))
    if widgets.button(ICON.reset, reset_width, "Back to the start of the ground (Home)"):
        scene.reset_character()


def _open_file(scene: Scene, open_files: Callable[[list[Path]], None], browse: Callable[[], None]) -> None:
    if not imgui.tree_node_ex("Open a file, shape the body", imgui.TreeNodeFlags_.span_avail_width):
        return
    imgui.unindent(imgui.get_style().indent_spacing)
    load_width = px(60)
    imgui.set_next_item_width(-load_width - imgui.get_frame_height() - px(8))
    entered, scene.file_path = imgui.input_text_with_hint(
        "##path", "PNG, OBJ, GLB, VRM, BVH", scene.file_path, imgui.InputTextFlags_.enter_returns_true
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
    path = scene.file_path.strip().strip('"')
    if (entered or load) and path:
        open_files([Path(path).expanduser()])
    half = (imgui.get_content_region_avail().x - px(4)) / 2
    imgui.set_next_item_width(half)
    setting_widgets.drag(scene.settings, "height_map_cell_m")
    imgui.same_line(0, px(4))
    imgui.set_next_item_width(half)
    setting_widgets.drag(scene.settings, "height_map_height_m")
    if scene.is_mannequin:
        _shape(scene)
        if scene.shape != BodyShape() and widgets.button("Its own shape", -1):
            scene.set_shape(BodyShape())
    elif scene.character_path is not None:
        if widgets.button("Joints…", px(80), "Which joint of this character plays which of ours"):
            scene.joints.begin(scene.character_path)
        imgui.same_line(0, px(4))
        if widgets.button("Back to the mannequin", -1):
            scene.open_character(None)
        setting_widgets.toggle(scene.settings, "fit_to_motion", -1)
    imgui.indent(imgui.get_style().indent_spacing)
    imgui.tree_pop()


def _shape(scene: Scene) -> None:
    """The mannequin's measures; it is made again when the mouse lets go, and its steps adapt to its size."""
    shape = scene.shape
    for name, text in _SHAPES.items():
        share = 100.0 * getattr(shape, name)
        imgui.set_next_item_width(-1)
        moved, share = widgets.slider(f"##shape {name}", share, *_SHAPE_RANGE, f"{text} %.0f %%")
        if moved:
            low, high = _SHAPE_RANGE  # a number can be typed
            percent = min(max(round(share), low), high)
            scene.set_shape(replace(shape, **{name: percent / 100.0}), held=True)
        widgets.tooltip(f"The mannequin's {text.lower()}. Ctrl+click types a number")


def _views(scene: Scene) -> None:
    spacing = px(4)
    texts = [(text, f"The character from there ({key})") for key, text in enumerate(VIEWS.values(), 1)]
    width = (imgui.get_content_region_avail().x - spacing * len(texts)) / (len(texts) + 1)
    for name, (text, hint) in zip(VIEWS, texts, strict=True):
        if widgets.button(f"{text}##view {name}", width, hint):
            scene.view(name)
        imgui.same_line(0, spacing)
    if widgets.button("Frame##frame", width, "Bring the whole character into the middle (0)"):
        scene.frame_character()


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


def _drawing(scene: Scene) -> None:
    spacing = px(4)
    room = imgui.get_content_region_avail().x - 2 * spacing
    wide, slider = 0.42 * room, 0.29 * room  # the list holds "Automatic" and an arrow
    top, chosen = imgui.get_cursor_pos(), scene.settings.quality
    widgets.label("Quality")
    imgui.set_next_item_width(wide)
    shown = QUALITIES.get(chosen or scene.quality, QUALITIES[""])
    if imgui.begin_combo("##quality", shown):
        for name, text in QUALITIES.items():
            if imgui.selectable(text, name == chosen)[0] and name != chosen:
                scene.set_quality(name)
        imgui.end_combo()
    widgets.tooltip("How the scene is drawn" if chosen else "How the scene is drawn; chosen for this machine")
    for number, (text, name) in enumerate((("Variety", "temperature"), ("Response", "response"))):
        imgui.set_cursor_pos(imgui.ImVec2(top.x + wide + spacing + number * (slider + spacing), top.y))
        imgui.begin_group()
        widgets.label(text)
        imgui.set_next_item_width(slider)
        setting_widgets.slider(scene.settings, name)
        imgui.end_group()


def _short(spec: str) -> str:
    """A name as it is, a path by its last part."""
    name = spec.replace("\\", "/").rsplit("/", 1)[-1]
    return name if "." in name else name.replace("_", " ").capitalize()
