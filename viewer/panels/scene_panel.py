"""The scene panel: ground, camera, overlays, and rendering."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from runtime.assets import character_file
from runtime.character.shape import BodyShape
from runtime.formats.options import ExportOptions
from runtime.options import spec_of
from runtime.safe_read import expanded, printable
from viewer.edit.camera_keys import CameraKeys
from viewer.edit.path import PathTool
from viewer.gl_bindings import imgui
from viewer.gui import theme, widgets
from viewer.gui.layout import Rect
from viewer.gui.panels import Panel, PanelPlace
from viewer.gui.theme import ICON
from viewer.gui.widgets import px
from viewer.live.link import LiveLink
from viewer.scene.scene import Scene
from viewer.session.takes import Takes
from viewer.settings import CAMERAS, LOOKS, QUALITIES, VIEWS, Settings

_SHAPES = {"height": "Height", "legs": "Legs", "shoulders": "Shoulders"}
_SHAPE_RANGE = (60.0, 150.0)  # percent of the default measure
_SHOWN = ("show_trajectory", "show_skeleton", "show_contacts", "show_grid", "show_ghosts", "show_trails")


@dataclass
class ScenePanel:
    scene: Scene
    takes: Takes
    path: PathTool
    cameras: CameraKeys
    open_files: Callable[[list[Path]], None]
    browse: Callable[[], None]  # asks for a file to open
    draw_pins: Callable[[float], None]  # draws the button, of a width, for pins of the live character

    def panel(self) -> Panel:
        return Panel("Scene", PanelPlace.RIGHT_TOP, self._draw, ICON.scene, actions=self.scene.actions)

    def _draw(self, _: Rect) -> None:
        scene = self.scene
        _terrain(scene, self.takes)
        with widgets.section("Files, body, links") as opened:
            if opened:
                self._open_file()
                _character(scene)
                self._links()
        self._camera()
        _views(scene)
        _toggles(scene.settings)
        _drawing(scene)
        self.path.draw(self.draw_pins)

    def _links(self) -> None:
        """Draw where poses are sent."""
        _links(self.scene.live, self.scene.vmc)
        if imgui.begin_popup_context_item("vmc root"):
            widgets.setting_toggle(self.scene.settings, "vmc_root", px(160))
            imgui.end_popup()

    def _camera(self) -> None:
        """Draw the camera mode; for a take with camera keys also the keyed camera."""
        now = "keyed" if self.cameras.through else self.scene.camera.mode
        options = [*CAMERAS.items(), ("keyed", "Keyed")]
        mode = widgets.segmented("camera", options, now, () if self.cameras.keys else ("keyed",))
        if mode == "keyed" != now:
            self.cameras.toggle()
        elif mode != now:
            self.scene.use_camera(mode)

    def _open_file(self) -> None:
        scene = self.scene
        load_width = px(60)
        imgui.set_next_item_width(-load_width - imgui.get_frame_height() - px(8))
        entered, scene.file_path = widgets.input_text("##path", scene.file_path, "PNG, OBJ, GLB, VRM, BVH")
        widgets.same_line()
        if widgets.icon_button(ICON.folder, "browse file", "Browse…", theme.TEXT):
            self.browse()
        widgets.same_line()
        hint = "A ground (PNG, NPY, mesh), a character (GLB, VRM) or a clip (BVH), as when dropping a file"
        load = widgets.button("Open", load_width, hint)
        path = scene.file_path.strip().strip('"')
        if (entered or load) and path:
            self.open_files([expanded(path)])


def _terrain(scene: Scene, takes: Takes) -> None:
    spec = printable(takes.ground_to_show().spec)
    widgets.label("Ground")
    reset_width = imgui.get_frame_height() + px(4)
    imgui.set_next_item_width(imgui.get_content_region_avail().x - reset_width - px(4))
    shown = f"Loading {printable(scene.loading)}…" if scene.loading else _short(spec)
    if imgui.begin_combo("##terrain", shown, imgui.ComboFlags_.height_largest):
        for name in scene.grounds:
            if imgui.selectable(_short(name), name == spec)[0] and name != spec:
                scene.load_terrain(name)
        imgui.end_combo()
    widgets.tooltip(spec)
    widgets.same_line()
    if widgets.button(ICON.reset, reset_width, "Back to the start of the ground (Home)"):
        scene.reset_character()


def _character(scene: Scene) -> None:
    half = widgets.column_width(2)
    imgui.set_next_item_width(half)
    widgets.setting_drag(scene.settings, "height_map_cell_m")
    widgets.same_line()
    imgui.set_next_item_width(half)
    widgets.setting_drag(scene.settings, "height_map_height_m")
    name = scene.character_name
    chosen = widgets.segmented("character", [("mannequin", "Mannequin"), ("walker", "Walker")], name)
    if chosen != name:
        scene.open_character(None if chosen == "mannequin" else character_file(chosen))
    look = widgets.segmented("look", list(LOOKS.items()), scene.settings.look)
    if look != scene.settings.look:
        scene.set_look(look)
    if chosen == "mannequin":
        _shape(scene)
        if scene.editor.session.character.shape != BodyShape() and widgets.button("Its own shape", -1):
            scene.set_shape(BodyShape())
    elif not chosen and scene.character_path is not None:
        if widgets.button("Joints…", px(80), "Map this character's joints to the SPORT skeleton"):
            scene.joints.begin(scene.character_path)
        widgets.same_line()
        widgets.setting_toggle(scene.settings, "fit_to_motion", -1)
        _unit(scene)


def _unit(scene: Scene) -> None:
    character, choices = (
        scene.editor.session.character,
        spec_of(ExportOptions, "character_unit").choices or {},
    )
    imgui.set_next_item_width(-1)
    options = [(u or "", f"Unit: {text.lower()}") for u, text in choices.items()]
    chosen = widgets.combo("##character unit", options, character.unit)
    widgets.tooltip("Of lengths in the character's file")
    if chosen != character.unit:
        made = replace(character, unit=str(chosen))
        scene.editor.do("unit of the character", lambda session: replace(session, character=made))


def _shape(scene: Scene) -> None:
    """Draw the mannequin's measures; it is rebuilt when the mouse is released."""
    shape = scene.editor.session.character.shape
    for name, text in _SHAPES.items():
        percent = 100.0 * getattr(shape, name)
        imgui.set_next_item_width(-1)
        moved, percent = widgets.slider(f"##shape {name}", percent, *_SHAPE_RANGE, f"{text} %.0f %%")
        if moved:
            low, high = _SHAPE_RANGE  # a number can be typed
            percent = min(max(round(percent), low), high)
            scene.set_shape(replace(shape, **{name: percent / 100.0}), held=True)
        widgets.tooltip(f"The mannequin's {text.lower()}. Ctrl+click types a number")


def _views(scene: Scene) -> None:
    # "top" has a key, but no room for a button
    shown = [(name, text) for name, text in VIEWS.items() if name != "top"]
    widgets.buttons(
        *(
            (f"{text}##view {name}", f"View from this direction ({key})", partial(scene.view, name))
            for key, (name, text) in enumerate(shown, 1)
        ),
        ("Frame##frame", "Frame the whole character (0)", scene.frame_character),
    )


def _toggles(settings: Settings) -> None:
    width = widgets.column_width(3)
    for i, name in enumerate(_SHOWN):
        if i % 3:
            widgets.same_line()
        widgets.setting_toggle(settings, name, width)
        if name == "show_ghosts" and imgui.begin_popup_context_item("ghost frames"):
            imgui.set_next_item_width(px(200))
            widgets.setting_slider(settings, "ghost_frames")
            imgui.end_popup()


def _drawing(scene: Scene) -> None:
    spacing = px(4)
    room = imgui.get_content_region_avail().x - 2 * spacing
    wide, slider = 0.42 * room, 0.29 * room  # the list holds "Automatic" and an arrow
    top, chosen = imgui.get_cursor_pos(), scene.settings.quality
    widgets.label("Quality")
    imgui.set_next_item_width(wide)
    shown = QUALITIES.get(chosen or scene.renderer.quality.name, QUALITIES[""])
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
        widgets.setting_slider(scene.settings, name)
        imgui.end_group()


def _links(*links: LiveLink) -> None:
    """Draw buttons side by side that stay lit while poses are sent."""
    width = widgets.column_width(len(links))
    for number, link in enumerate(links):
        if number:
            widgets.same_line()
        where = "" if link.address.loopback else ", not this computer"
        hint = f"Sends the pose to {link.receivers}, by UDP to {link.address}{where}"
        if link.on:
            hint += f"; {link.sent} poses sent"
        text = f"{link.name} :{link.address.port}" if link.on else link.name
        if widgets.toggle(f"{text}###{link.name.lower()}", link.on, width, hint) != link.on:
            link.switch()


def _short(spec: str) -> str:
    name = spec.replace("\\", "/").rsplit("/", 1)[-1]
    return name if "." in name else name.replace("_", " ").capitalize()
