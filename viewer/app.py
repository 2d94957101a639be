"""The application: one window, one loop. Poll, control, step at 60 Hz, interpolate, draw, panels, swap."""

import time
from pathlib import Path

from runtime.assets import state_directory
from runtime.controls import Controls
from runtime.interrupts import exit_code, forget, say
from runtime.motion.control_scripts import parse_stick
from runtime.pose import Pose
from runtime.session.prompt_blend import Side
from viewer.gl_bindings import glfw, imgui
from viewer.gui.focus import KeyRouter
from viewer.input.bindings import Action, Intent, to_controls
from viewer.input.devices import Devices, KeyScript
from viewer.input.gamepad import GamepadSource, GlfwGamepads
from viewer.jobs import Slot
from viewer.messages import Messages
from viewer.options import ViewOptions
from viewer.process import Ending, MemoryWatch, give_back_large_blocks
from viewer.prompt.prompt_controller import CLOSE_SECONDS
from viewer.render.offscreen import save_png
from viewer.render.overlays import Overlays
from viewer.scene.simulation import STEP_SECONDS
from viewer.services import Services
from viewer.settings import MAPPINGS_NAME, KeptSettings, Settings, config_directory, load_settings
from viewer.window import KEY_CODES, Window, WindowEvents
from viewer.workspace import Workspace

__all__ = ["App", "ViewOptions", "run"]

# slow frames are dropped and the motion keeps its time; a longer gap is a pause (a suspended laptop)
MAX_FRAME_S = 1.0
MINIMISED_WAIT_S = 0.1
LOADING_FPS = 20.0
FRAMES_PER_MEMORY_LOOK = 60  # between two checks of the memory in use
# also with a modal window
OVER_EVERYTHING = {Action.HELP, Action.NEXT_PANEL, Action.FULLSCREEN, Action.SCREENSHOT}
PROMPT_PATIENCE_S = 0.2  # grace period for a prompt's encoder when the program ends
# Time limits from closing on. What is not written by then is kept for the next start or dropped: exports first, settings last.
END_S, SESSION_S, SETTINGS_S = 1.6, 1.4, 0.1
LATE_S = 0.25  # after that, a process ended by a signal is killed


def run(options: ViewOptions, services: Services | None = None, config: Path | None = None) -> int:
    """Run the viewer until it is closed, or for the frames of the options; return the exit code.

    `services` replaces the project's loaders, `config` the settings folder. Raises SportError for an unusable option,
    or if no window can be opened.
    """
    app = App(options, services, config=config)
    ending = Ending(app.interrupt, END_S + LATE_S)
    with ending.handled():
        try:
            try:
                while not app.finished:
                    app.frame()
            except Exception:
                ending.saving.set()
                # repeated internal errors must not cost the recording
                app.sessions.finish(keep=True, until=app.until(), ended=False)
                raise
            ending.saving.set()
            code = app.end()
        finally:
            app.close()
        if ending.number:
            say(ending.number, "sport")
            return exit_code(ending.number)
    return code


class App(Workspace):
    """The workspace in its window, with the main loop."""

    def __init__(
        self,
        options: ViewOptions,
        services: Services | None = None,
        gamepads: GamepadSource | None = None,
        config: Path | None = None,
    ) -> None:
        options.check()
        give_back_large_blocks()
        self.options = options
        keys = KeyScript.parse(options.keys, frozenset(KEY_CODES))
        self._stick = None if options.controls is None else parse_stick(options.controls)
        self.config = config or config_directory()
        settings, complaints = load_settings(self.config)
        self.frames_shown = 0
        self._until = 0.0
        self.interrupted = False  # by a signal or Ctrl+C
        self.memory = MemoryWatch()
        self._intent = Intent()
        self._was_moving = False
        self._interval_s = 0.0  # wall time since the last frame
        self._steps = 0  # simulation steps in this frame
        self._started = False  # the initial model has answered its prompt, or has failed
        self._script_s = 0.0  # playing time of the key and stick scripts
        self._last_s = time.perf_counter()
        window = self._open_window(options, settings)
        try:
            self.devices = Devices(gamepads or GlfwGamepads(glfw), keys, window.inject_key)
            folder = config or state_directory()
            super().__init__(window, options, settings, Messages(), services or Services(), folder)
            box = self.prompting.boxes[Side.A]
            self.keys = KeyRouter(
                self.shell.focus, self.devices, lambda: box.focus_requested, self.shell.refuse_key
            )
            self.kept = KeptSettings(settings, self.config, self.jobs, active=not options.offscreen)
            if isinstance(self.devices.pads, GlfwGamepads):
                complaints.append(self.devices.pads.add_mappings(self.config / MAPPINGS_NAME))
            for complaint in filter(None, complaints):
                self.messages.warn(complaint)
            self.messages.logged = not options.offscreen
            self.load()
            self.messages.logged = True
        except BaseException:
            window.destroy()
            raise

    def _open_window(self, options: ViewOptions, settings: Settings) -> Window:
        default = (1280, 720) if options.offscreen else (settings.width, settings.height)
        events = WindowEvents(
            key=lambda name, down: self.keys.key(name, down),
            mouse_press=lambda x, y: self.shell.focus.press(x, y),
            focus=lambda focused: None if focused else self.keys.lose_window(),
            drop=lambda paths: self.open_files(paths),
        )
        scale = options.ui_scale or (0.0 if options.offscreen else settings.ui_scale)
        size = options.width or default[0], options.height or default[1]
        kept = options.screenshot is not None
        return Window(size, events, options.offscreen, settings.vsync, scale, kept)

    # --- one frame

    def frame(self) -> None:
        """Draw one frame; an internal error closes the tool that caused it."""
        with self.defects.guarded("showing a picture", self.close_tools):
            self._frame()
        self.window.end_frame()

    def _frame(self) -> None:
        """Poll, control, step, interpolate, draw, panels, swap."""
        window = self.window
        dt = self._tick()
        window.poll(MINIMISED_WAIT_S if window.minimised and not self.options.offscreen else 0.0)
        if window.minimised:
            self.jobs.deliver()
            return
        window.begin_frame(dt if self.options.offscreen else None)
        if self.keys.typing or not self.shell.focus.in_view:
            window.take_input(self.shell.draw_at)
        if not window.draws_aside:
            self._control(dt)
        pose, *others = self.compare.shown(not self.options.offscreen) or [self.shown_pose()]
        self.shell.arrange(window.ui_scale)
        self._move_camera(pose, self._intent, dt)

        self.shell.draw()
        self._finish_drag()
        overlays = self._overlays_of(others)
        self.scene.renderer.render(window.framebuffer, self.scene.camera.current, pose, overlays)
        if window.draws_aside:  # the next step is computed while this frame is drawn
            window.begin_drawing()
            window.poll()
            self._control(dt)
        imgui.render()
        window.draw_interface()
        self.screenshots.capture(window, self.frames_shown)
        self._finish_frame()

    def _overlays_of(self, others: list[Pose]) -> Overlays:
        """Return the overlays of the view; `others` stand beside the first of the compared characters."""
        with self.defects.guarded("drawing the overlays", self.close_tools):
            live = None if self.takes.playback is not None or others else self.scene.controller
            return self.overlays(live, others)
        return Overlays()

    def _control(self, dt: float) -> None:
        """Apply keys, sticks and worker results, and advance the character."""
        self.keys.begin_frame()
        self._intent = intent = self._read_devices(dt)
        self._act(intent)
        self._poll(dt, intent)
        with self.defects.guarded("moving the character", self.close_tools):
            self._simulate(dt, intent)

    def _act(self, intent: Intent) -> None:
        self.keys.end_enter()
        modal = self.shell.modal
        for action in intent.pressed:  # held actions and gaits are not in this table
            if modal and action not in OVER_EVERYTHING:
                continue
            with self.defects.guarded(f"doing “{action.name.replace('_', ' ').lower()}”"):
                self.actions.get(action, lambda: None)()
        self.state.crouching = self.devices.mapper.crouching

    def _poll(self, dt: float, intent: Intent) -> None:
        moving = intent.move != (0.0, 0.0)
        for doing, poll, close in (
            ("collecting the results of workers", self.jobs.deliver, None),
            ("reading the answer to a prompt", self.prompting.poll, None),
            ("polling the pins", self.pins.poll, self.pins.close),
            ("polling the path", self.path.poll, self.path.stop),
            ("polling the session", self.sessions.poll, None),
            ("updating the guide", lambda: self.guide.watch(dt, moving), self.guide.skip),
        ):
            with self.defects.guarded(doing, close or (lambda: None)):
                poll()
        if self.kept.active:
            self.settings.width, self.settings.height = self.window.unscaled_size
        self.kept.watch()

    def _finish_drag(self) -> None:
        """Commit a change by the mouse or a typed number as an undo step once it is released."""
        if self.editor.dragging and not (imgui.is_mouse_down(0) or imgui.is_any_item_active()):
            self.editor.finish_drag()

    def _tick(self) -> float:
        """Return the seconds since the last frame; offscreen every frame is one simulation step."""
        now = time.perf_counter()
        self._interval_s, self._last_s = now - self._last_s, now
        return STEP_SECONDS if self.options.offscreen else min(self._interval_s, MAX_FRAME_S)

    def _read_devices(self, dt: float) -> Intent:
        self.devices.play_script(self._scripted_seconds)
        self._script_s += dt
        take, listed = self.takes.playback is not None, self.transport.selection.listed
        intent, changed = self.devices.read(dt, self.keys.typing, self.settings, take, listed)
        self.state.device = self.devices.name
        if changed:
            self.messages.note(changed)
        return intent

    @property
    def _scripted_seconds(self) -> float:
        """Return the time of the scripts; offscreen it is counted in frames, since a sum would drift."""
        return self.frames_shown * STEP_SECONDS if self.options.offscreen else self._script_s

    def _controls_of(self, intent: Intent) -> Controls:
        """Return the devices' controls, or those of the stick's script until it ends."""
        if self._stick is not None and self._scripted_seconds < self._stick.seconds:
            return self._stick(self._scripted_seconds)
        return to_controls(intent, self.scene.camera.current.heading)

    def _simulate(self, dt: float, intent: Intent) -> None:
        self._steps = 0
        playback = self.takes.playback
        moving = intent.move != (0.0, 0.0)
        begins_to_move = self.path.walk_began() or (moving and not self._was_moving)
        self._was_moving = moving
        if begins_to_move and self.transport.selection.listed:
            self.transport.selection.let_go()  # Space jumps again
        if playback is not None and begins_to_move:
            self.takes.close_playback()  # back to the live character
        elif playback is not None:
            self.compare.close()
            playback.advance(dt)
            for link in (self.scene.live, self.scene.vmc):
                link.publish([playback.pose()], dt)
            return
        controls = self.path.controls(self._controls_of(intent), dt)
        if self.compare.advance(dt, controls):
            self._steps = self.compare.steps
            return
        self.takes.before_steps()
        poses = self.scene.advance(dt, controls)
        self._steps = len(poses)
        self.takes.add_poses(poses, controls)

    def _move_camera(self, pose: Pose, intent: Intent, dt: float) -> None:
        camera, ground = self.scene.camera, self.takes.ground_to_show().terrain
        self.scene.draw_ground(ground)
        used = False
        with self.defects.guarded("using the mouse in the view", self.close_tools):
            pinning = self.posing.use_mouse(camera.current) or self.pins.use_mouse(camera.current)
            used = pinning or self.path.use_mouse(camera.current, ground)
        dragging = camera.use_mouse(used, self.settings.navigation)
        moving = intent.move != (0.0, 0.0) and not intent.strafe and not dragging
        camera.update(pose, dt, intent.look, intent.zoom * dt, ground, moving)
        with self.defects.guarded("moving the camera", self.close_tools):
            self.camera_keys.look(pose, ground)
            self.compare.frame_all(camera, self.shell.aspect, dt)
        right, up, fit = self.shell.framing
        if self.camera_keys.through:
            fit = self.camera_keys.fit(fit, self.shell.aspect)
        camera.frame_in((right, up, fit), dt)

    def _finish_frame(self) -> None:
        """Show the frame, record timings, and sleep if vsync does not limit the loop."""
        before = time.perf_counter()
        self.window.present()
        self.frames_shown += 1
        after = time.perf_counter()
        # a GPU's swap waits for the monitor, which is not work; a software renderer works there
        software = self.scene.renderer.quality.name != "high"
        if self.frames_shown > 1:  # the first interval includes loading
            work_s = (after if software else before) - self._last_s
            self.state.stats.add(work_s, self._interval_s, self._steps)
        if self.frames_shown % FRAMES_PER_MEMORY_LOOK == 1:
            self.memory.look()
            self.state.stats.memory_mb = self.memory.mb
        if not self.options.offscreen:
            self.scene.lower_quality(self.state.stats.fps, self._interval_s)
            self.rest()

    def rest(self) -> None:
        """Sleep to limit the frame rate without vsync; at startup a low rate leaves time for the loaders."""
        if not self._started:
            self._started = not self.jobs.busy(Slot("model")) and not any(self.prompting.questions)
        most = self.settings.max_fps if self._started else LOADING_FPS
        spare = 1.0 / most - (time.perf_counter() - self._last_s)
        if spare > 0.0:
            time.sleep(spare)

    # --- the end

    @property
    def finished(self) -> bool:
        wanted = self.options.frames or (1 if self.options.offscreen else None)
        enough = wanted is not None and self.frames_shown >= wanted
        return self.interrupted or self.window.close_requested or enough

    def until(self) -> float:
        """Return the time (`time.monotonic`) by which the program must have ended; the first call starts the countdown."""
        if not self._until:
            self._until = time.monotonic() + END_S
        return self._until

    def interrupt(self) -> None:
        """End the main loop after the current frame."""
        self.interrupted = True
        self.until()

    def end(self) -> int:
        """Save takes, session, settings and screenshot after the last frame; return the exit code.

        The user's work comes first, so that a failing screenshot cannot cost it. An offscreen run that ends normally
        keeps no untitled session. The code is 1 if anything was lost or saved elsewhere.
        """
        until = self.until()
        self.sessions.note_unfinished()
        self.jobs.end()
        lost = not self.jobs.finish("export", until - SESSION_S)
        keep = self.interrupted or not self.options.offscreen
        self.sessions.finish(keep, until - SETTINGS_S)
        lost = lost or self.sessions.incomplete
        lost = not self.kept.finish(until) or lost
        if self.options.screenshot is not None and not self.interrupted:  # of the last frame
            save_png(self.window.read_pixels(), self.options.screenshot)
        return int(lost)

    def close(self) -> None:
        until = self.until()
        forget(self)  # of the session that it began
        self.window.hide()
        self.editor.file.close(max(until - time.monotonic(), 0.0))
        self.jobs.close(until)
        self.language_model.close()
        self.prompting.close(CLOSE_SECONDS if self.options.offscreen else PROMPT_PATIENCE_S)
        self.scene.live.stop()
        self.scene.vmc.stop()
        if self.window.handle is not None:
            self.scene.renderer.release()
        self.window.destroy()
