"""The session with all its tools: assembled once; loads what the options request, and opens files."""

import io
import os
import time
from collections.abc import Callable
from pathlib import Path

from runtime.assets import character_file
from runtime.atomic import sweep
from runtime.interrupts import undo_when_ended
from runtime.pose import Pose
from runtime.safe_read import expanded
from runtime.session import library
from runtime.takes.input_recording import InputRecorder
from viewer.compare import panel as compare_panel
from viewer.compare.compare_view import CompareView
from viewer.edit.camera_keys import CameraKeys
from viewer.edit.cutting import Cutting
from viewer.edit.graph_editor import GraphEditor
from viewer.edit.opening import FileOpener
from viewer.edit.path import PathTool
from viewer.edit.pins import Pins
from viewer.edit.posing import Posing
from viewer.edit.reference import References
from viewer.edit.reference_card import ReferenceCard
from viewer.edit.resimulation import Resimulation
from viewer.edit.transport import Transport
from viewer.edit.view_overlays import ViewOverlays
from viewer.editor import Editor
from viewer.exports import panel as exports_panel
from viewer.exports.bvh_export import BvhExport
from viewer.exports.exporting import Exporting
from viewer.gui.defects import Defects
from viewer.gui.dialogs import Dialogs
from viewer.gui.panels import Panel
from viewer.gui.theme import load_fonts
from viewer.input.bindings import Action
from viewer.jobs import Jobs, Slot
from viewer.messages import Messages
from viewer.options import ViewOptions
from viewer.panels import guide, take_prompt_panel, takes_panel
from viewer.panels.guide import Guide
from viewer.panels.recovery import CutOffWindow, defect_panel
from viewer.panels.scene_panel import ScenePanel
from viewer.panels.session_bar import SessionBar
from viewer.panels.settings_panel import SettingsWindow
from viewer.panels.takes_panel import TakesPanel
from viewer.prompt.language_model import LanguageModel
from viewer.prompt.prompt_controller import PromptController
from viewer.prompt.prompt_panel import PromptPanel
from viewer.prompt.suggestions import Suggester
from viewer.scene import joint_mapping
from viewer.scene.scene import MANNEQUIN, SHIPPED, WALKER, Scene
from viewer.screenshots import Screenshots
from viewer.services import Services
from viewer.session.opening import open_file
from viewer.session.sessions import Sessions
from viewer.session.takes import Takes
from viewer.settings import Settings
from viewer.shell import Shell, ShellState
from viewer.window import Window

PICTURE_WIDTH = 256  # pixels
LEAVE_S = 0.7  # to write a session's data if the process ends before its main loop


class Workspace:
    """The session with all tools; each tool only knows those created before it."""

    def __init__(
        self,
        window: Window,
        options: ViewOptions,
        settings: Settings,
        messages: Messages,
        services: Services,
        state_folder: Path,
    ) -> None:
        self.window, self.options, self.settings, self.messages = window, options, settings, messages
        self.state = ShellState()
        if options.response is not None:
            settings.response = options.response
        self.jobs = jobs = Jobs(messages, blocking=options.offscreen)
        file, problem = library.first_file(state_folder / "sessions", state_folder / "characters")
        if problem:
            messages.warn(problem)
        self.editor = editor = Editor(messages, file)
        undo_when_ended(self, self._leave_session)
        inputs, dialogs = InputRecorder(), Dialogs(messages)
        renderer = services.make_renderer(self.window.ctx, options.quality or settings.quality)
        self.scene = scene = Scene(
            editor, settings, messages, jobs, services, self.window.ctx, renderer, inputs,
            self.shown_pose, state_folder,
        )  # fmt: skip
        self.takes = takes = Takes(editor, settings, messages, scene, jobs, inputs)
        self.prompting = prompting = PromptController(
            editor, settings, messages, jobs, lambda: scene.controller, takes.mark_style, options.offscreen
        )
        self.language_model = LanguageModel(settings, jobs, services, prompting)
        self.editing = editing = Resimulation(takes, prompting)
        self.pins = Pins(editor, editing, scene)
        self.graph = GraphEditor(editor, takes, self.pins)
        self.posing = Posing(editor, takes, scene.camera, self.pins, self.graph.show)
        self.path = PathTool(editor, editing, scene)
        self.camera_keys = CameraKeys(
            editor, takes, scene.camera, lambda: (self.exporting.form.size, self.exporting.form.fov_degrees)
        )
        self.cutting = Cutting(takes)
        self.transport = Transport(
            editing, self.pins, self.posing, self.camera_keys, self.cutting, self.graph
        )
        self.references = References(editor, takes)
        self.compare = CompareView(editor, settings, messages, scene, takes, self.path, prompting)
        self.prompt = PromptPanel(
            settings, prompting, self.language_model, Suggester(settings, jobs), self.compare.toggle
        )
        self.bvh_export = BvhExport(takes)
        self.guide = Guide(settings, editor, self.bvh_export)
        self.sessions = Sessions(
            editor, settings, messages, jobs, dialogs, scene, prompting, takes, self.load_model,
            self._picture, state_folder,
        )  # fmt: skip
        self.exporting = Exporting(
            takes, scene, messages, jobs, dialogs, self.bvh_export, self.transport.shown_frames
        )
        self.settings_window = SettingsWindow(
            settings, messages, jobs, dialogs, scene, self.guide, self.load_model, self.window.use_scale
        )
        self.files = FileOpener(scene, takes, self.references, self.sessions)
        self.open_files = self.files.open
        self.overlays = ViewOverlays(takes, self.path, self.pins, self.references).of
        self.screenshots = Screenshots(settings, messages, jobs, options.frames_directory)
        device = str(window.ctx.info["GL_RENDERER"])
        self.defects = Defects(
            state_folder / "reports", device, self.sessions.keep, active=not options.offscreen
        )
        self.cut_off = CutOffWindow(self.sessions)
        fonts = load_fonts()
        panels = self._panels(dialogs)
        self.shell = Shell(
            self.state, settings, messages, jobs, scene, editing, panels, lambda: prompting.texts, fonts,
            self.defects,
        )  # fmt: skip
        self.transport.in_view = lambda: self.shell.focus.in_view
        self.actions = self._actions(panels)

    def _actions(self, panels: list[Panel]) -> dict[Action, Callable[[], None]]:
        """Return the function of each action: of the panels, the shell and all tools."""
        own = {
            Action.FRAME_SELECTION: self.frame_selection,
            Action.FULLSCREEN: self.window.toggle_full_screen,
            Action.SCREENSHOT: self.screenshots.ask,
        }
        rooms = [*(panel.actions for panel in panels), self.shell.actions, own]
        return {action: do for room in rooms for action, do in room.items()}

    def _leave_session(self) -> None:
        """Release the session's file if the process ends before its main loop; an empty one is removed."""
        until = time.monotonic() + LEAVE_S
        if hasattr(self, "sessions"):
            self.sessions.finish(keep=True, until=until)
        elif self.editor.file.close(LEAVE_S):
            library.remove(self.editor.file.path)

    def _panels(self, dialogs: Dialogs) -> list[Panel]:
        """Return every panel, left to right and back to front."""
        compare, editing, pins, export = self.compare, self.editing, self.pins, self.exporting.open
        references = ReferenceCard(
            self.references,
            self.files.ask,
            self.window.ctx,
            corner_taken=lambda: pins.pin is not None or self.posing.shown,
        )
        bar = SessionBar(self.sessions, self.exporting, self.guide, self.settings_window, self.window.ctx)
        return [
            self.prompt.panel(lambda: not compare.open and editing.playback is None),
            take_prompt_panel.panel(editing),
            compare_panel.panel(compare),
            ScenePanel(
                self.scene, self.takes, self.path, self.camera_keys, self.open_files, self.files.browse,
                lambda width: pins.draw_live(self.camera_keys.add, width),
            ).panel(),
            TakesPanel(
                self.takes, references, self.sessions, self.transport.selection, self.bvh_export, export
            ).panel(),
            self.transport.panel(references),
            compare_panel.names_panel(compare),
            self.camera_keys.panel(),
            takes_panel.sign(self.takes),
            bar.panel(),
            self.path.panel(),
            pins.panel(),
            self.posing.panel(),
            self.graph.panel(),
            references.panel(),
            guide.panel(self.guide, covered=lambda: compare.open),
            self.settings_window.panel(),
            exports_panel.panel(self.exporting),
            joint_mapping.panel(self.scene.joints),
            self.cut_off.panel(),
            dialogs.panel(),
            defect_panel(self.defects, self.sessions, self.messages),
        ]  # fmt: skip

    def load(self) -> None:
        """Start loading what the options and settings ask for."""
        options, settings, scene, prompting = self.options, self.settings, self.scene, self.prompting
        self.state.panels_open, self.state.clocked = options.panels, not options.offscreen
        self.state.bare = options.saves_pictures and not options.panels
        settings.fit_to_motion |= options.fit_to_motion
        scene.begin(options.camera or settings.camera, options.live_link, options.vmc)
        remembered = None if options.offscreen else self.settings_window.chosen_model()
        with self.jobs.together():
            character = options.character or self.remembered_character()
            scene.open_character(character, options.joint_map, step=False)
            self.load_model(options.model or remembered, options.seed)
            scene.load_terrain(options.terrain or settings.terrain)
            self.prompt.suggester.load_library(scene.services.library_prompts)
        prompting.begin(options.prompt, options.blend, options.blend_weights)
        self.prompt.tab_requested = "" if options.blend is None else "blend"
        if options.clip is not None:
            open_file(self.takes, options.clip, keep_ground=options.terrain is not None)
        self.sessions.begin(options.session, looking=not options.offscreen)
        (self._check if options.offscreen else self._begin)()

    def remembered_character(self) -> Path | None:
        """Return the file of the last chosen character, or None for the mannequin."""
        name = self.settings.character
        if name in SHIPPED:
            return None if name == MANNEQUIN else character_file(name)
        if os.path.isfile(name):
            return Path(name)
        self.messages.warn(f"The character {name} is missing: the walker is shown.")
        return character_file(WALKER)

    def _check(self) -> None:
        """Raise errors when there is no display, and therefore no status line."""
        failure = self.jobs.first_error or self.prompting.first_error
        if failure is not None:
            raise failure

    def _begin(self) -> None:
        if self.options.session is None:
            self.cut_off.begin()
        self.jobs.submit(Slot("sweep"), self._sweep, lambda _: None)
        if not self.settings.first_minute_seen:
            self.guide.begin()

    def _sweep(self) -> None:
        """Remove unfinished files of killed programs from the output folders."""
        folders = {expanded(self.settings.export_folder), self.sessions.untitled_folder}
        for folder in folders | {path.parent for path in self.sessions.recent}:
            sweep(folder)

    def _picture(self) -> bytes:
        """Return a small PNG of the view as the session's picture; b"" before there is one."""
        from PIL import Image

        if self.window.framebuffer is None:
            return b""
        picture = Image.fromarray(self.window.read_pixels()[..., :3])
        picture.thumbnail((PICTURE_WIDTH, PICTURE_WIDTH))
        file = io.BytesIO()
        picture.save(file, "PNG")
        return file.getvalue()

    def close_tools(self) -> None:
        """Close everything in progress in the view after an internal error: playback, path, pins, variants."""
        self.settings.show_ghosts = self.settings.show_trails = False
        self.compare.close()
        self.path.stop()
        self.path.active = False
        self.pins.close()
        self.posing.close()
        self.takes.close_playback()

    def frame_selection(self) -> None:
        """Centre the selected pin or joint, or the whole character."""
        point = self.posing.place if self.posing.shown else self.pins.place
        if point is None:
            self.scene.frame_character()
        else:
            self.scene.camera.frame_point(point)
            self.settings.camera = self.scene.camera.mode

    def load_model(self, directory: Path | None, seed: int) -> None:
        """Load a model, the shipped one for None; the current one stays until then."""
        gpt, before = self.language_model.chosen(), self.editor.session.model.sha256
        self.scene.load_model(
            directory, seed, gpt,
            lambda loaded: self.prompt.use_model(loaded, gpt, self.editor.session.model.sha256 != before),
            self.prompting.lose_model,
        )  # fmt: skip

    def shown_pose(self) -> Pose:
        """Return the pose in view, of the playing take or live."""
        if self.takes.playback is not None:
            return self.takes.playback.pose()
        simulation = self.scene.simulation
        pose = simulation.current if self.options.offscreen else simulation.shown()
        return self.scene.bend(pose, self.scene.now)
