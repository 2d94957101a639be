"""What keys, buttons, dropped files and options do: each action named in one table."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from pathlib import Path

from sport.runtime.errors import SportError
from sport.runtime.prompts.expander import DEFAULT_PROMPT
from sport.runtime.terrain.files import SUFFIXES as GROUNDS
from sport.viewer.input.bindings import Action
from sport.viewer.jobs import Jobs
from sport.viewer.options import ViewOptions
from sport.viewer.prompt.expanders import Expanders
from sport.viewer.prompt.prompting import Prompting
from sport.viewer.prompt.suggester import Suggester
from sport.viewer.render.capture import screenshot_path
from sport.viewer.stage.camera_control import CameraControl
from sport.viewer.stage.loading import Scene
from sport.viewer.state import AppState
from sport.viewer.takes.takes import Takes
from sport.viewer.window import Window

_GLTF = (".glb", ".gltf")  # characters, or grounds as in GROUNDS


@dataclass
class Actions:
    """Everything the person can ask for, from wherever."""

    state: AppState
    jobs: Jobs
    scene: Scene
    takes: Takes
    prompting: Prompting
    expanders: Expanders
    suggester: Suggester
    camera: CameraControl
    window: Window
    screenshot_wanted: Path | None = None

    def start(self, options: ViewOptions) -> None:
        """Load what the options and the settings ask for."""
        state, scene = self.state, self.state.scene
        services = self.scene.services
        scene.terrain_names, scene.quality_names = services.terrain_names(), services.quality_names()
        scene.quality = self.scene.renderer.quality.name
        try:
            state.prompt.ready = services.ready_prompts()
        except SportError as error:
            state.messages.error(error)
        self.jobs.submit("library", services.library_prompts, self._take_library)
        state.panels_open = options.panels
        self.camera.use(options.camera or state.settings.camera)
        self.scene.renderer.set_terrain(state.terrain)
        self.scene.load_character(options.character)
        self.scene.load_terrain(options.terrain or state.settings.terrain)
        self.scene.load_model(options.model, options.seed)
        if options.prompt is None:
            self.prompting.submit_prompt(DEFAULT_PROMPT, remembered=False)
        else:
            self.prompting.submit_prompt(options.prompt)
        if options.blend is not None:
            state.prompt.edit = dataclasses.replace(state.prompt.edit, weights=options.blend_weights)
            state.prompt.tab_requested = "blend"
            self.prompting.submit_prompt(options.blend, "b")
        if options.clip is not None:
            self.takes.open(options.clip)

    def _take_library(self, prompts: tuple[str, ...]) -> None:
        self.state.prompt.library = prompts

    def open_files(self, paths: list[Path]) -> None:
        """Open dropped files by what their names say they are."""
        for path in paths:
            suffix = path.suffix.lower()
            if suffix == ".bvh":
                self.takes.open(path)
            elif suffix in _GLTF:
                self._open_gltf(path)
            elif suffix in GROUNDS:
                self.scene.load_terrain(str(path))
            else:
                self.state.messages.error(
                    f"{path.name}: nothing here opens {suffix or 'a file without an ending'}."
                    " Drop a BVH clip, a GLB character, or a PNG, NPY or mesh ground."
                )

    def _open_gltf(self, path: Path) -> None:
        """A mesh with a skin is a character, one without is a ground."""

        def load(skinned: bool) -> None:
            if skinned:
                self.scene.load_character(path)
            else:
                self.scene.load_terrain(str(path))

        self.jobs.submit(f"open {path}", lambda: has_skin(path), load)

    def perform(self, pressed: tuple[Action, ...]) -> None:
        """Do what was pressed in this frame; held actions and gaits are no business of this table."""
        table = {
            Action.RECORD: self.takes.toggle_recording,
            Action.SAVE_LAST: self.takes.save_last,
            Action.PLAY: self.takes.play_or_pause,
            Action.RESET: self.scene.reset_character,
            Action.CAMERA: self.switch_camera,
            Action.HELP: self.toggle_help,
            Action.TRAJECTORY: lambda: self._toggle("show_trajectory"),
            Action.SKELETON: lambda: self._toggle("show_skeleton"),
            Action.CONTACTS: lambda: self._toggle("show_contacts"),
            Action.GRID: lambda: self._toggle("show_grid"),
            Action.PANELS: self._toggle_panels,
            Action.FULLSCREEN: self.window.toggle_full_screen,
            Action.SCREENSHOT: self.take_screenshot,
            Action.PROMPT: self._focus_prompt,
            Action.CANCEL: self._cancel,
        }
        for action in pressed:
            if action in table:
                table[action]()

    def switch_camera(self) -> None:
        """Follow or orbit."""
        self.camera.use("orbit" if self.camera.mode == "follow" else "follow")
        self.state.settings.camera = self.camera.mode

    def toggle_help(self) -> None:
        """Open or close the help overlay."""
        self.state.help_open = not self.state.help_open

    def take_screenshot(self) -> None:
        """Save the next picture beside the clips."""
        self.screenshot_wanted = screenshot_path(self.state.settings.export_folder)

    def _toggle(self, name: str) -> None:
        setattr(self.state.settings, name, not getattr(self.state.settings, name))

    def _toggle_panels(self) -> None:
        self.state.panels_open = not self.state.panels_open

    def _focus_prompt(self) -> None:
        self.state.panels_open = self.state.prompt.box.focus_requested = True

    def _cancel(self) -> None:
        """Leave the innermost thing that is open."""
        if self.state.help_open:
            self.state.help_open = False
        else:
            self.takes.close_playback()


def has_skin(path: Path) -> bool:
    """Whether a glTF file holds a skin; FileError when it cannot be read."""
    from sport.runtime.character.read import open_gltf

    return bool(open_gltf(path).gltf.skins)
