"""The application: one window, one loop. Poll, control, step at 60 Hz, interpolate, draw, panels, swap."""

from __future__ import annotations

import dataclasses
import logging
import os
import sys
import time
from pathlib import Path

from runtime.atomic import sweep
from runtime.controls import Controls
from runtime.errors import SportError
from runtime.motion.stick_script import parse_stick
from runtime.open_files import allow_many_files
from runtime.pose import Pose
from runtime.prompts.expander import DEFAULT_PROMPT
from runtime.takes.drive import DriveRecorder
from runtime.takes.recorder import ClipRecorder
from runtime.terrain.height_map import Terrain
from viewer.desk import bar, guide, settings_panel
from viewer.desk.desk import Desk
from viewer.desk.undo import Undo
from viewer.exports import panel as exports_panel
from viewer.gl_bindings import glfw, imgui
from viewer.gui.panels import Panel
from viewer.gui.theme import Fonts, load_fonts
from viewer.input.bindings import Action, Intent, to_controls
from viewer.input.devices import Devices, KeyScript
from viewer.input.gamepad import GamepadSource, GlfwGamepads
from viewer.jobs import Jobs, Slot
from viewer.memory import give_back_freed, give_back_large_blocks, resident_mb
from viewer.options import ViewOptions
from viewer.prompt import panel as prompt_panel
from viewer.prompt.even_blends import EvenBlends
from viewer.prompt.expanders import Expanders
from viewer.prompt.prompting import CLOSE_SECONDS, Prompting
from viewer.prompt.room import PromptRoom
from viewer.prompt.style_edit import Side
from viewer.prompt.suggester import Suggester
from viewer.render.offscreen import save_png
from viewer.render.overlays import Overlays
from viewer.screenshots import Screenshots
from viewer.services import ControllerLike, Services
from viewer.settings import (
    MAPPINGS_NAME,
    config_directory,
    load_settings,
    save_settings,
    state_directory,
)
from viewer.shell import Shell
from viewer.signals import Ending
from viewer.stage import joint_panel
from viewer.stage import panel as scene_panel
from viewer.stage.overlays import make_overlays
from viewer.stage.simulation import STEP_SECONDS, Simulation
from viewer.stage.stage import Stage
from viewer.stage.state import StageState
from viewer.state import AppState
from viewer.takes import panel as clips_panel
from viewer.takes import pin_panel, transport, words_panel
from viewer.takes.editing import TakeEditing
from viewer.takes.ghosts import Trails, ghosts
from viewer.takes.pinning import Pinning
from viewer.takes.reference_panel import References
from viewer.takes.take_camera import TakeCamera
from viewer.takes.takes import Takes
from viewer.takes.way_editing import WayEditing
from viewer.wall import labels
from viewer.wall import panel as wall_panel
from viewer.wall.wall import Wall
from viewer.window import KEY_CODES, Window, WindowEvents

__all__ = ["App", "ViewOptions", "run"]

TITLE = "SPORT viewer"
# A pause (a dragged window, a suspended laptop) is not simulated, but frames that are always long are: pictures are
# dropped and the motion keeps its time.
LONGEST_PAUSE_S, LONGEST_FRAME_S = 0.25, 1.0
MINIMISED_WAIT_S = 0.1
MEMORY_FRAMES = 60  # between two looks at the memory
GROWN_MB = 24.0  # after which what was freed is given back
PATIENCE_S = 0.2  # with the encoder of a prompt, after which the process ends with it
END_S = 1.0  # what is written when the program ends may take so long; what is kept otherwise is then given up


def run(options: ViewOptions, services: Services | None = None, config: Path | None = None) -> int:
    """Open the viewer and stay until it is closed, or for the frames asked for; the exit code.

    `services` replaces the project's own loaders, `config` the directory of the settings. SportError when an option
    cannot be used or no window can be opened.
    """
    app = App(options, services, config=config)
    ending = Ending(app.interrupt)
    with ending.handled():
        try:
            try:
                while not app.finished:
                    app.frame()
            except KeyboardInterrupt:
                app.interrupt()  # a frame that did not end
            except Exception:
                ending.saving = True
                app.takes.rescue()  # a defect must not cost what was recorded
                raise
            ending.saving = True
            code = app.end()
        finally:
            app.close()
    if app.jobs.abandoned and not options.offscreen:
        logging.shutdown()
        sys.stdout.flush()
        os._exit(code)  # threads that still run would take the interpreter down while it ends
    return code


class App:
    """Owns the window and the state, assembles the rooms, and runs frames."""

    def __init__(
        self,
        options: ViewOptions,
        services: Services | None = None,
        gamepads: GamepadSource | None = None,
        config: Path | None = None,
    ) -> None:
        options.check()
        give_back_large_blocks()
        allow_many_files()
        self.options = options
        keys = KeyScript.parse(options.keys, frozenset(KEY_CODES))
        self._stick = None if options.controls is None else parse_stick(options.controls)
        self.config = config or config_directory()
        self.state_folder = config or state_directory()
        settings, complaints = load_settings(self.config)
        self._settings_before = dataclasses.replace(settings, prompt_history=list(settings.prompt_history))
        ground = Terrain.flat()
        self.state = AppState(settings, StageState(ground, Simulation.standing(ground)))
        self.frames_shown = 0
        self.interrupted = False  # from outside: by a signal or Ctrl+C
        self._trimmed_mb = 0.0  # held after freed memory was last given back
        self._was_moving = False
        self._ctrl = False  # is down
        # Enter was pressed in the view: letters that follow within a slow frame are the field's
        self._field_asked = False
        self._interval_s = 0.0  # since the frame before, by the clock
        self._steps = 0  # of the simulation in this frame
        self._script_s = 0.0  # how long the scripts of keys and stick have been played
        self._last_s = time.perf_counter()
        self.window = self._open_window()
        try:
            self.devices = Devices(gamepads or GlfwGamepads(glfw), keys, self.window.inject_key)
            self._assemble(services or Services())
            if isinstance(self.devices.pads, GlfwGamepads):
                complaints.append(self.devices.pads.add_mappings(self.config / MAPPINGS_NAME))
            for complaint in filter(None, complaints):
                self.state.messages.warn(complaint)
            self.state.messages.logged = not options.offscreen
            self._load()
            self.state.messages.logged = True
        except BaseException:
            self.window.destroy()
            raise

    def _open_window(self) -> Window:
        options, settings = self.options, self.state.settings
        default = (1280, 720) if options.offscreen else (settings.width, settings.height)
        events = WindowEvents(self._on_key, self._on_mouse_press, self._on_focus, self.open_files)
        scale = options.ui_scale or (0.0 if options.offscreen else settings.ui_scale)
        width, height = options.width or default[0], options.height or default[1]
        kept = options.screenshot is not None
        return Window(TITLE, width, height, events, options.offscreen, settings.vsync, scale, kept)

    def _assemble(self, services: Services) -> None:
        """The rooms, each with its slice of the state; they need the window's context."""
        state, options, drives = self.state, self.options, DriveRecorder()
        settings, messages, prompt, stage = state.settings, state.messages, state.prompt, state.stage
        self.jobs = jobs = Jobs(messages, blocking=options.offscreen)
        if options.response is not None:
            settings.response = options.response
        renderer = services.make_renderer(self.window.ctx, options.quality or settings.quality)
        self.stage = Stage(
            stage,
            settings,
            messages,
            jobs,
            services,
            self.window.ctx,
            renderer,
            drives,
            self._shown_pose,
            self.state_folder / "shapes",
        )
        self.takes = Takes(
            state.takes, settings, messages, stage, jobs, ClipRecorder(), drives, self.state_folder,
            self.stage.read_ground, lambda path: services.load_character(path, None),
            is_safe=lambda _: self.desk.projects.kept, is_offered=lambda item: self.desk.projects.offers(item),
            live_pins=self.stage.pins.cut,
        )  # fmt: skip
        self.prompting = Prompting(
            prompt, settings, messages, lambda: stage.controller, self.takes.mark_style,
            blocking=options.offscreen, even_blends=EvenBlends(jobs),
        )  # fmt: skip
        self.expanders = Expanders(prompt.expander, settings, jobs, services, self.prompting)
        self.suggester = Suggester(prompt, settings, jobs)
        self.editing = TakeEditing(self.takes, self.stage, self.prompting)
        self.pinning = Pinning(self.editing, self.stage)
        self.take_camera = TakeCamera(state.takes, self.stage.camera, messages)
        self.way = WayEditing(self.editing, self.stage.path)
        self.wall = Wall(state.wall, settings, messages, self.stage, self.takes, self.prompting)
        self.prompt = PromptRoom(
            prompt, settings, self.prompting, self.expanders, self.suggester, self.wall.toggle
        )
        self.trails = Trails()
        self.references = References(
            self.takes.reference,
            self.takes.opening,
            lambda title, endings, done: self.desk.ask_for(title, endings, done),
            self.window.ctx,
            corner_taken=lambda: self.pinning.pin is not None,
        )
        self.screenshots = Screenshots(settings, messages, jobs, options.frames_directory)
        self.desk = Desk(
            state.desk, settings, messages, jobs, self.takes, self.stage, self.prompting,
            self.load_model, self.window.use_scale, self.state_folder,
        )  # fmt: skip
        fonts = load_fonts()
        panels = self._panels(fonts)
        self.shell = Shell(
            state.shell, settings, messages, jobs, stage, state.takes, panels, lambda: prompt.texts, fonts
        )
        own = {Action.FULLSCREEN: self.window.toggle_full_screen, Action.SCREENSHOT: self.screenshots.ask}
        rooms = [*(panel.actions for panel in panels), self.shell.actions, own]
        self.actions = {action: do for room in rooms for action, do in room.items()}

    def _panels(self, fonts: Fonts) -> list[Panel]:
        """Every panel, from the left to the right and from the back to the front."""
        stage, takes, desk, wall, editing = self.stage, self.takes, self.desk, self.wall, self.editing
        live = lambda: not wall.state.open and editing.state.playback is None  # noqa: E731
        return [
            prompt_panel.panel(self.prompt, live),
            words_panel.panel(editing),
            wall_panel.panel(wall),
            scene_panel.panel(
                stage,
                self.open_files,
                lambda: desk.ask_file(self.open_files),
                lambda width: pin_panel.draw_live(self.pinning, width),
            ),
            clips_panel.panel(takes, self.references, desk.exporting.open, lambda: self.desk.projects.offer),
            transport.panel(editing, self.pinning, self.take_camera, self.references),
            labels.panel(wall),
            clips_panel.sign(takes),
            bar.panel(desk, Undo(self.prompting, editing)),
            pin_panel.panel(self.pinning),
            self.references.panel(),
            guide.panel(desk.guide, covered=lambda: wall.state.open),
            settings_panel.panel(desk, fonts),
            exports_panel.panel(desk.exporting, fonts),
            joint_panel.panel(stage.joints, fonts),
            desk.dialogs.panel(),
        ]

    def _load(self) -> None:
        """Begin to load what the options and the settings ask for."""
        options, state, stage = self.options, self.state, self.stage
        state.stage.terrain_names = stage.services.terrain_names()
        state.stage.quality = stage.renderer.quality.name
        self.prompt.load_library(self.jobs, stage.services)
        state.shell.panels_open, state.shell.clocked = options.panels, not options.offscreen
        saved = options.offscreen or options.screenshot is not None or options.frames_directory is not None
        state.shell.bare = saved and not options.panels
        stage.begin_camera(options.camera or state.settings.camera)
        stage.renderer.set_terrain(state.stage.terrain)
        stage.live.begin(options.live_link)
        stage.vmc.begin(options.vmc)
        state.settings.fit_to_motion = state.settings.fit_to_motion or options.fit_to_motion
        stage.load_character(options.character, options.joint_map)
        stage.load_terrain(options.terrain or state.settings.terrain)
        self.load_model(options.model or self.desk.chosen_model(options.offscreen), options.seed)
        typed = options.prompt
        self.prompting.submit_prompt(DEFAULT_PROMPT if typed is None else typed, remembered=typed is not None)
        if options.blend is not None:
            state.prompt.edit = dataclasses.replace(state.prompt.edit, weights=options.blend_weights)
            state.prompt.tab_requested = "blend"
            self.prompting.submit_prompt(options.blend, Side.B)
        if options.clip is not None:
            self.takes.opening.open(options.clip, keep_ground=options.terrain is not None)
        if not options.offscreen:
            self.jobs.submit(Slot("sweep"), self._sweep, lambda _: None)
            self.takes.journals.look()
        self.desk.begin(options.project, autosaving=not options.offscreen)
        failure = self.jobs.first_error or self.prompting.first_error
        if options.offscreen and failure is not None:
            raise failure  # nobody would read a message

    def _sweep(self) -> None:
        """Remove what a killed program has left half written in the folders that are written to."""
        folders = {Path(self.state.settings.export_folder).expanduser(), self.state_folder / "sessions"}
        for folder in folders | {path.parent for path in self.desk.projects.recent}:
            sweep(folder)

    def load_model(self, directory: Path | None, seed: int) -> None:
        """Load an exported model, the shipped one for None; the one in use stays until it is there."""
        gpt = self.expanders.chosen()
        self.stage.load_model(
            directory, seed, gpt, lambda loaded: self.prompt.use_model(loaded, gpt), self.prompt.lose_model
        )

    def open_files(self, paths: list[Path]) -> None:
        """Open dropped files by what their names say they are."""
        table = {**self.stage.files, **self.takes.files, **self.desk.files}
        for path in paths:
            suffix = path.suffix.lower()
            if suffix in table:
                table[suffix](path)
            else:
                self.state.messages.error(
                    f"{path.name}: nothing here opens {suffix or 'a file without an ending'}."
                    " Drop a project, a BVH clip, a GLB or VRM character, or a PNG, NPY or mesh ground."
                )

    # --- one frame

    def frame(self) -> None:
        """Poll, control, step, interpolate, draw, panels, swap."""
        window, state = self.window, self.state
        dt = self._tick()
        window.poll(MINIMISED_WAIT_S if window.minimised and not self.options.offscreen else 0.0)
        if window.minimised:
            self.jobs.deliver()
            return
        window.begin_frame(dt if self.options.offscreen else None)
        if self._typing or not self.shell.focus.in_view:
            window.take_input(self.shell.draw_at)
        intent = self._read_devices(dt)
        self._field_asked = False
        for action in intent.pressed:  # held actions and gaits are none of this table
            self.actions.get(action, lambda: None)()
        state.shell.crouching = self.devices.mapper.crouching
        self.jobs.deliver()
        self.prompting.poll()
        self.pinning.poll()
        self.way.poll()
        self.desk.poll(dt, intent.move != (0.0, 0.0))
        self._simulate(dt, intent)
        self.takes.watch()
        pose, *others = self.wall.shown(not self.options.offscreen) or [self._shown_pose()]
        self.shell.arrange(window.ui_scale)
        self._move_camera(pose, intent, dt)

        self.shell.draw()
        imgui.render()
        live = None if state.takes.playback is not None or others else state.stage.controller
        overlays = self._overlays(live, others)
        self.stage.renderer.render(window.framebuffer, self.stage.camera.current, pose, overlays)
        window.draw_interface()
        self.screenshots.capture(window, self.frames_shown)
        self._finish_frame()

    def _tick(self) -> float:
        """Seconds since the last frame; offscreen every frame is one simulation step."""
        now = time.perf_counter()
        before, self._interval_s, self._last_s = self._interval_s, now - self._last_s, now
        return STEP_SECONDS if self.options.offscreen else simulated_seconds(self._interval_s, before)

    def _read_devices(self, dt: float) -> Intent:
        self.devices.play_script(self._scripted_seconds)
        self._script_s += dt
        intent, changed = self.devices.read(
            dt, self._typing, self.state.settings, self.state.takes.playback is not None
        )
        self.state.shell.device = self.devices.name
        if changed:
            self.state.messages.note(changed)
        return intent

    @property
    def _scripted_seconds(self) -> float:
        """Time of the scripts; offscreen by frames: exact, where a sum would drift."""
        return self.frames_shown * STEP_SECONDS if self.options.offscreen else self._script_s

    def _asked_of(self, intent: Intent) -> Controls:
        """The devices' controls, or those of the stick's script until it ends."""
        if self._stick is not None and self._scripted_seconds < self._stick.seconds:
            return self._stick(self._scripted_seconds)
        return to_controls(intent, self.stage.camera.current.heading)

    def _simulate(self, dt: float, intent: Intent) -> None:
        self._steps = 0
        playback = self.state.takes.playback
        begins_to_move = intent.move != (0.0, 0.0) and not self._was_moving
        begins_to_move = self.stage.path.walk_began() or begins_to_move
        self._was_moving = intent.move != (0.0, 0.0)
        if playback is not None and begins_to_move:
            self.takes.close_playback()  # back to the live character
        elif playback is not None:
            self.wall.close()
            playback.advance(dt)
            for link in (self.stage.live, self.stage.vmc):
                link.publish([playback.pose()], dt)
            return
        controls = self.stage.controls(self._asked_of(intent), dt)
        if self.wall.advance(dt, controls):
            self._steps = self.wall.steps
            return
        self.takes.before_steps()
        poses = self.stage.advance(dt, controls)
        self._steps = len(poses)
        self.takes.add_poses(poses, controls)

    def _overlays(self, live: ControllerLike | None, others: list[Pose]) -> Overlays:
        settings, playback = self.state.settings, self.state.takes.playback
        frames: list[Pose] = []
        over: list[Pose] = []
        trails = None
        if playback is not None and settings.show_ghosts:
            frames = ghosts(playback, round(settings.ghost_frames))
        if playback is not None and settings.show_trails:
            trails = self.trails.around(playback)
        figure, reference = None, self.takes.reference
        beside = None if playback is None else reference.pose(playback)
        if playback is not None and beside is not None:
            figure = reference.figure(playback, beside)
            if figure is None:
                (over if reference.over else others).append(beside)
        pins = None if others and playback is None else self.pinning.overlay()
        path = self.stage.path.overlay()
        return make_overlays(settings, live, path, others, over, trails, pins, figure, frames)

    def _shown_pose(self) -> Pose:
        playback = self.state.takes.playback
        if playback is not None:
            return self.pinning.shown_pose() or playback.pose()
        simulation = self.state.stage.simulation
        pose = simulation.current if self.options.offscreen else simulation.shown()
        return self.stage.pins.bend(pose, self.pinning.now)

    def _move_camera(self, pose: Pose, intent: Intent, dt: float) -> None:
        camera, ground = self.stage.camera, self.takes.ground_to_show()
        self.stage.draw_ground(ground)
        pinning = self.pinning.use_mouse(camera.current)
        drawing = pinning or self.stage.path.use_mouse(camera.current, ground)
        wheel, dragging = camera.use_mouse(drawing)
        moving = intent.move != (0.0, 0.0) and not intent.strafe and not dragging
        zoom = intent.zoom * dt + wheel
        camera.update(pose, dt, intent.look, zoom, ground, moving)
        self.take_camera.look(pose, ground)
        self.wall.frame_all(camera, self.shell.aspect, dt)
        camera.frame_in(self.shell.framing, dt)

    def _finish_frame(self) -> None:
        """Show the frame, note the times, and sleep where vsync does not hold the loop back."""
        before = time.perf_counter()
        self.window.present()
        self.frames_shown += 1
        after = time.perf_counter()
        # a GPU's swap waits for the monitor, which is no work; a software renderer does its work there
        software = self.stage.renderer.quality.name != "high"
        if self.frames_shown > 1:  # the first interval is the loading
            work_s = (after if software else before) - self._last_s
            self.state.shell.stats.add(work_s, self._interval_s, self._steps)
        if self.frames_shown % MEMORY_FRAMES == 1:
            self._look_at_memory()
        if not self.options.offscreen:
            self.stage.lower_quality(self.state.shell.stats.fps, self._interval_s)
            spare = 1.0 / self.state.settings.max_fps - (after - self._last_s)
            if spare > 0.0:
                time.sleep(spare)

    def _look_at_memory(self) -> None:
        stats, now = self.state.shell.stats, resident_mb()
        if now > self._trimmed_mb + GROWN_MB:
            give_back_freed()
            now = self._trimmed_mb = resident_mb()
        self._trimmed_mb = min(self._trimmed_mb, now)  # what shrinks by itself may not grow back unseen
        stats.memory_mb = now

    # --- events

    def _on_key(self, name: str, down: bool) -> bool:
        """Function keys act always, Escape unless a field is typed into, all others while the view has the keys.

        Whether this one does.
        """
        typing = self._typing or self._field_asked
        acts = self.shell.focus.in_view or (name == "escape" and not typing)
        self.devices.keyboard.key(name, down, typing or not acts)
        self._ctrl = down if name == "ctrl" else self._ctrl
        if down and not acts and not typing and not self._ctrl and self.devices.acts_alone(name):
            self.state.messages.note("A panel has the keys: Esc or a click on the view gives them back.")
        self._field_asked = self._field_asked or (down and acts and not typing and name == "enter")
        return down and acts and not typing

    def _on_mouse_press(self, x: float, y: float) -> None:
        self.shell.focus.press(x, y)

    @property
    def _typing(self) -> bool:
        """Whether keys are words: also in the frames until ImGui says so, in which a slow machine gets several keys."""
        entered = imgui.internal.get_input_text_state(imgui.internal.get_active_id()) is not None
        return bool(
            imgui.get_io().want_text_input or entered or self.state.prompt.boxes[Side.A].focus_requested
        )

    def _on_focus(self, focused: bool) -> None:
        if not focused:
            self.devices.keyboard.release_all()
            self._ctrl = False

    # --- the end

    @property
    def finished(self) -> bool:
        """Whether the main loop should end."""
        wanted = self.options.frames or (1 if self.options.offscreen else None)
        enough = wanted is not None and self.frames_shown >= wanted
        return self.interrupted or self.window.close_requested or enough

    def interrupt(self) -> None:
        """End the main loop after the frame in hand."""
        self.interrupted = True

    def end(self) -> int:
        """After the last frame: keep unsaved takes, remember the settings, write the screenshot; the exit code.

        What the user made comes first: a screenshot that cannot be written must not cost it. A run offscreen that
        comes to its end as planned keeps no takes. The code is 1 when anything was lost or went elsewhere than asked.
        """
        until = time.monotonic() + END_S
        self.jobs.end()
        lost = not self.jobs.finish("export", until)  # what is on its way is not saved a second time
        self.desk.projects.finish(until)
        if self.interrupted or not self.options.offscreen:
            for path in self.takes.rescue(until):
                self.state.messages.note(f"Kept an unsaved take: {path}")
            lost = self.takes.incomplete or lost
        else:
            self.takes.journals.close(discard=True)
        if not self.options.offscreen:
            lost = not self._remember_settings() or lost
        if self.options.screenshot is not None:
            save_png(self.window.read_pixels(), self.options.screenshot)
        return int(lost)

    def _remember_settings(self) -> bool:
        """Whether what was changed could be written."""
        self.state.settings.width, self.state.settings.height = self.window.unscaled_size
        try:
            save_settings(self.state.settings, self.config, self._settings_before)
        except SportError as error:
            self.state.messages.error(error)  # it is in the log; the user is leaving
            return False
        return True

    def close(self) -> None:
        """Stop workers and close the window."""
        self.window.hide()
        self.takes.journals.close()
        self.jobs.close()
        self.expanders.close()
        stopped = self.prompting.close(CLOSE_SECONDS if self.options.offscreen else PATIENCE_S)
        self.jobs.abandoned = self.jobs.abandoned or not stopped
        self.stage.live.stop()
        self.stage.vmc.stop()
        if self.window.handle is not None:
            self.stage.renderer.release()
        self.window.destroy()


def simulated_seconds(interval_s: float, before_s: float) -> float:
    """How much time a frame simulates that comes so long after the last one, which came so long after its own last one."""
    return min(interval_s, max(LONGEST_PAUSE_S, min(1.5 * before_s, LONGEST_FRAME_S)))
