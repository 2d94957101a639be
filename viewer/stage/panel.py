"""The scene panel: ground, camera, what is shown, and how it is drawn."""

from __future__ import annotations

from pathlib import Path

from sport.viewer.actions import Actions
from sport.viewer.gl_bindings import imgui
from sport.viewer.gui import widgets
from sport.viewer.gui.theme import ICON
from sport.viewer.gui.widgets import px
from sport.viewer.stage.loading import Scene
from sport.viewer.state import AppState

_TOGGLES = (
    ("show_trajectory", "Trajectory", "The path the character intends, one second back and ahead (F2)"),
    ("show_skeleton", "Skeleton", "Bones through the skin (F3)"),
    ("show_contacts", "Contacts", "Which heels and toes stand on the ground (F4)"),
    ("show_grid", "Grid", "A metre grid on the ground (F5)"),
)


def draw(state: AppState, actions: Actions) -> None:
    """Contents of the panel."""
    scene, camera = actions.scene, actions.camera
    _terrain(state, scene)
    _open_file(state, actions)
    widgets.label("Camera")
    mode = widgets.segmented("camera", (("follow", "Follow"), ("orbit", "Orbit")), camera.mode)
    if mode != camera.mode:
        camera.use(mode)
        state.settings.camera = mode
    widgets.label("Show")
    _toggles(state)
    _drawing(state, scene)


def _terrain(state: AppState, scene: Scene) -> None:
    widgets.label("Ground")
    reset_width = imgui.get_frame_height() + px(4)
    imgui.set_next_item_width(imgui.get_content_region_avail().x - reset_width - px(4))
    spec = state.scene.terrain_spec
    shown = f"Loading {state.scene.loading}…" if state.scene.loading else _short(spec)
    if imgui.begin_combo("##terrain", shown, imgui.ComboFlags_.height_largest):
        for name in state.scene.terrain_names:
            if imgui.selectable(_short(name), name == spec)[0] and name != spec:
                scene.load_terrain(name)
        imgui.end_combo()
    widgets.tooltip(spec)
    imgui.same_line(0, px(4))
    if widgets.button(ICON.reset, reset_width, "Back to the start of the ground (Home)"):
        scene.reset_character()


def _open_file(state: AppState, actions: Actions) -> None:
    if not imgui.tree_node_ex("Open a file", imgui.TreeNodeFlags_.span_avail_width):
        return
    imgui.unindent(imgui.get_style().indent_spacing)
    settings = state.settings
    load_width = px(60)
    imgui.set_next_item_width(-load_width - px(4))
    entered, state.scene.file_path = imgui.input_text_with_hint(
        "##path", "PNG, NPY, OBJ, GLB or BVH", state.scene.file_path, imgui.InputTextFlags_.enter_returns_true
    )
    imgui.same_line(0, px(4))
    load = widgets.button(
        "Open",
        load_width,
        "A ground (PNG, NPY, mesh), a character (GLB) or a clip (BVH); dropping a file does the same",
    )
    path = state.scene.file_path.strip().strip('"')
    if (entered or load) and path:
        actions.open_files([Path(path).expanduser()])
    half = (imgui.get_content_region_avail().x - px(4)) / 2
    flags = imgui.SliderFlags_.always_clamp
    imgui.set_next_item_width(half)
    _, settings.height_map_cell_m = imgui.drag_float(
        "##cell", settings.height_map_cell_m, 0.005, 0.01, 10.0, "Pixel %.2f m", flags
    )
    widgets.tooltip("Distance between neighbouring pixels. Drag, or double-click to type.")
    imgui.same_line(0, px(4))
    imgui.set_next_item_width(half)
    _, settings.height_map_height_m = imgui.drag_float(
        "##height", settings.height_map_height_m, 0.02, 0.01, 100.0, "White %.2f m", flags
    )
    widgets.tooltip("Height of a white pixel; black lies at 0. Drag, or double-click to type.")
    if actions.scene.character_path is not None and widgets.button("Back to the mannequin", -1):
        actions.scene.load_character(None)
    imgui.indent(imgui.get_style().indent_spacing)
    imgui.tree_pop()


def _toggles(state: AppState) -> None:
    spacing = px(4)
    width = (imgui.get_content_region_avail().x - spacing) / 2
    for i, (name, text, hint) in enumerate(_TOGGLES):
        if i % 2:
            imgui.same_line(0, spacing)
        on = getattr(state.settings, name)
        setattr(state.settings, name, widgets.toggle(text, on, width, hint))


def _drawing(state: AppState, scene: Scene) -> None:
    half = (imgui.get_content_region_avail().x - px(4)) / 2
    top = imgui.get_cursor_pos()
    widgets.label("Quality")
    imgui.set_next_item_width(half)
    chosen = state.settings.quality
    shown = (chosen or f"Auto: {state.scene.quality}").capitalize()
    if imgui.begin_combo("##quality", shown):
        for name in ("", *state.scene.quality_names):
            if imgui.selectable(name.capitalize() or "Automatic", name == chosen)[0] and name != chosen:
                scene.set_quality(name)
        imgui.end_combo()
    imgui.set_cursor_pos(imgui.ImVec2(top.x + half + px(4), top.y))
    imgui.begin_group()
    widgets.label("Variety")
    imgui.set_next_item_width(half)
    changed, value = widgets.slider("##temperature", state.settings.temperature, 0.0, 2.0, "%.2f")
    if changed:
        scene.set_temperature(value)
    widgets.tooltip(
        "Temperature of the sampler: 0 always moves alike, 1 as widely as the capture, more is livelier"
    )
    imgui.end_group()


def _short(spec: str) -> str:
    """A name as it is, a path by its last part."""
    name = spec.replace("\\", "/").rsplit("/", 1)[-1]
    return name if "." in name else name.replace("_", " ").capitalize()
