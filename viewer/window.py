"""One glfw window (or PLATFORM_NULL with EGL), its OpenGL context, ImGui, and the application's framebuffer."""

import ctypes
import logging
import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.errors import DisplayError
from viewer.gl_bindings import glfw, imgui, implot, moderngl
from viewer.render.gl import shown_size
from viewer.render.quality import is_software

_LOG = logging.getLogger("sport.viewer")
_OFFSCREEN_HINT = "Without a display, `sport view --offscreen --screenshot out.png` renders into a file."

TITLE = "SPORT viewer"
# Mesa draws on a thread of its own without reporting it
DRIVER_OPTIONS = {"mesa_glthread": "true", "MESA_DEBUG": "silent"}
MAX_PASSES = 60  # of the panels in one frame
PASS_SECONDS = 1e-4
MIN_FRAME_S = 1e-6  # of a frame
TEXT_WAITS_FRAMES = 4  # for which characters wait for their field
MAX_WAITING_CHARACTERS = 4096  # that ImGui has not delivered yet

_PLAIN_KEYS = (
    "SPACE", "ENTER", "ESCAPE", "BACKSPACE", "TAB", "LEFT", "RIGHT", "UP", "DOWN", "HOME", "END", "PAGE_UP", "PAGE_DOWN",
    "EQUAL", "MINUS", "COMMA", "PERIOD", "DELETE",
)  # fmt: skip
KEY_NAMES: dict[int, str] = {
    **{glfw.KEY_A + i: chr(ord("a") + i) for i in range(26)},
    **{glfw.KEY_0 + i: str(i) for i in range(10)},
    **{glfw.KEY_F1 + i: f"f{i + 1}" for i in range(12)},
    **{getattr(glfw, f"KEY_{name}"): name.lower() for name in _PLAIN_KEYS},
    **{glfw.KEY_KP_0 + i: f"kp_{i}" for i in (0, 1, 3, 7)}, glfw.KEY_KP_DECIMAL: "kp_decimal",
    glfw.KEY_KP_ENTER: "enter", glfw.KEY_LEFT_ALT: "alt",
    **{getattr(glfw, f"KEY_{side}_SHIFT"): "shift" for side in ("LEFT", "RIGHT")},
    **{getattr(glfw, f"KEY_{side}_CONTROL"): "ctrl" for side in ("LEFT", "RIGHT")},
}  # fmt: skip
_LETTERS = frozenset(chr(ord("a") + i) for i in range(26))
# keys that type text
_TYPING = _LETTERS | frozenset("0123456789") | {"space", "equal", "minus", "comma", "period"}
REPEATED_KEYS = frozenset({"left", "right", "comma", "period"})  # repeat from frame to frame while held
_MODIFIERS = {"ctrl": imgui.Key.mod_ctrl, "shift": imgui.Key.mod_shift, "alt": imgui.Key.mod_alt}
KEY_CODES: dict[str, int] = {name: code for code, name in reversed(KEY_NAMES.items())}


@dataclass
class WindowEvents:
    """Callbacks for window events, set before the window opens."""

    key: Callable[[str, bool], bool]  # name, pressed; whether it acts: its character is not text then
    mouse_press: Callable[[float, float], None]  # where, in screen units
    focus: Callable[[bool], None]
    drop: Callable[[list[Path]], None]


class Window:
    """The window, its `ctx` (moderngl), and the `framebuffer` for scene and panels."""

    def __init__(
        self,
        size: tuple[int, int],
        events: WindowEvents,
        offscreen: bool = False,
        vsync: bool = True,
        ui_scale: float = 0.0,
        kept: bool = False,
    ) -> None:
        """`kept`: the frame is read after it was shown, when a window may have discarded it."""
        self._events = events
        self._offscreen = offscreen
        self.wanted_scale = ui_scale
        self._mouse = 0.0, 0.0
        self._early: list[tuple[int, int]] = []  # characters without a field, and for how many frames
        self._typed: list[tuple[int, bool]] = []  # those not yet delivered by ImGui; whether they are text
        self._acting: set[str] = set()  # keys pressed for an action, until they are released
        self._acts = False  # the last key event was one of them: its character comes next
        self._injected: set[str] = set()  # modifiers held by `inject_key`
        self._windowed: tuple[int, int, int, int] | None = None
        self._texture: Any = None
        self._depth: Any = None
        self.framebuffer: Any = None
        if not offscreen:
            for name, value in DRIVER_OPTIONS.items():
                os.environ.setdefault(name, value)
        self.handle: Any = _open(*size, offscreen)
        try:
            glfw.make_context_current(self.handle)
            # known from events: querying waits for the display, several times per frame
            self.size: tuple[int, int] = glfw.get_window_size(self.handle)
            self.pixels: tuple[int, int] = glfw.get_framebuffer_size(self.handle)
            self._content_scale: float = glfw.get_window_content_scale(self.handle)[0]
            self._iconified = False
            self.ctx = _context()
            flush: Any = glfw.get_proc_address("glFlush")
            self._flush = ctypes.CFUNCTYPE(None)(flush)
            # software drawing on other cores continues meanwhile; it would copy every pixel once more
            self.draws_aside = is_software(self.ctx) and not (offscreen or kept)
            glfw.swap_interval(1 if vsync and not offscreen else 0)
            self._install_callbacks()
            self._start_imgui()
        except BaseException:
            glfw.terminate()
            raise

    # --- state of the window

    @property
    def minimised(self) -> bool:
        """Whether the window has no area to draw on."""
        return 0 in self.pixels or self._iconified

    @property
    def close_requested(self) -> bool:
        return bool(glfw.window_should_close(self.handle))

    @property
    def ui_scale(self) -> float:
        """Scale of the interface relative to 96 dpi, in screen units."""
        return self.wanted_scale if self.wanted_scale > 0.0 else self._monitor_scale

    @property
    def unscaled_size(self) -> tuple[int, int]:
        """The window size without the monitor's scale, to store for the next start."""
        width, height = self.size if self._windowed is None else self._windowed[2:]
        return round(width / self._monitor_scale), round(height / self._monitor_scale)

    @property
    def _monitor_scale(self) -> float:
        scale, width, pixels = self._content_scale, self.size[0], self.pixels[0]
        return min(max(scale * width / pixels, 0.5), 4.0) if width > 0 and pixels > 0 else 1.0

    def use_scale(self, scale: float) -> None:
        """Set the interface scale from the next frame on; 0 uses the monitor's."""
        self.wanted_scale = scale

    # --- one frame

    def poll(self, wait_seconds: float = 0.0) -> None:
        """Process events, waiting up to `wait_seconds` for one."""
        try:
            if wait_seconds > 0.0:
                glfw.wait_events_timeout(wait_seconds)
            else:
                glfw.poll_events()
        except UnicodeDecodeError:  # glfw decodes only the names of dropped files here
            _LOG.warning("A dropped file's name is not UTF-8. Rename it, or open it from the command line.")

    @property
    def input_waits(self) -> bool:
        """Whether events are left that ImGui did not process in this frame."""
        return len(imgui.get_current_context().input_events_queue) > 0

    def begin_frame(self, dt: float | None = None) -> None:
        """Match the framebuffer to the window and begin an ImGui frame; `dt` overrides the clock."""
        self._match_framebuffer()
        imgui.backends.opengl3_new_frame()
        imgui.backends.glfw_new_frame()
        if dt is not None:
            imgui.get_io().delta_time = max(dt, MIN_FRAME_S)  # it asserts that time has passed
        imgui.new_frame()
        self._keep_text_for_field()

    def _keep_text_for_field(self) -> None:
        """Deliver characters typed before their field had the focus: ImGui drops those of that frame."""
        queue = imgui.get_io().input_queue_characters
        text = self._text([queue[i] for i in range(queue.size())])
        queue.clear()
        waiting = [*self._early, *((code, 0) for code in text)]
        if imgui.internal.get_input_text_state(imgui.internal.get_active_id()) is None:
            self._early = [(code, age + 1) for code, age in waiting if age < TEXT_WAITS_FRAMES]
        else:
            self._early = []
            for code, _ in waiting:
                queue.push_back(code)

    def _text(self, codes: list[int]) -> list[int]:
        """Return the characters delivered by ImGui that no acting key typed: a held W repeats itself."""
        text = []
        for code in codes:
            at = next((i for i, (typed, _) in enumerate(self._typed) if typed == code), None)
            if at is None or self._typed[at][1]:
                text.append(code)
            del self._typed[: 0 if at is None else at + 1]
        return text

    def take_input(self, draw: Callable[[float], None]) -> None:
        """Process all events of a slow frame, since ImGui handles one key per frame; `draw` draws the panels invisibly."""
        for _ in range(MAX_PASSES):
            if not self.input_waits:
                return
            draw(self.ui_scale)
            imgui.end_frame()
            self.begin_frame(PASS_SECONDS)

    def begin_drawing(self) -> None:
        """Flush the OpenGL commands so that drawing starts now."""
        self._flush()

    def draw_interface(self) -> None:
        """Draw the panels over the framebuffer; call `imgui.render()` before."""
        self.framebuffer.use()
        imgui.backends.opengl3_render_draw_data(imgui.get_draw_data())

    def end_frame(self) -> None:
        """End an ImGui frame left open by an internal error, if any."""
        if self.handle is not None and imgui.get_current_context().within_frame_scope:
            imgui.end_frame()

    def present(self) -> None:
        """Show the framebuffer; without a display, only finish drawing."""
        if self._offscreen:
            self.ctx.finish()  # like a swap: the library keeps the buffers of every frame until it is drawn
            return
        if not self.draws_aside:
            self.ctx.copy_framebuffer(self.ctx.screen, self.framebuffer)
        glfw.swap_buffers(self.handle)

    def read_pixels(self) -> NDArray[np.uint8]:
        """Return the framebuffer as `(height, width, 3)`, top row first."""
        width, height = shown_size(self.framebuffer)
        data = self.framebuffer.read((0, 0, width, height), components=3, alignment=1)
        return np.frombuffer(data, np.uint8).reshape(height, width, 3)[::-1].copy()

    # --- requests

    def hide(self) -> None:
        """Hide the window while the program finishes its work."""
        if self.handle is not None:
            glfw.hide_window(self.handle)

    def close(self) -> None:
        glfw.set_window_should_close(self.handle, True)

    def toggle_full_screen(self) -> None:
        """Toggle full screen, on the monitor under the window's corner."""
        if self._offscreen:
            return
        if self._windowed is not None:
            x, y, width, height = self._windowed
            glfw.set_window_monitor(self.handle, None, x, y, width, height, 0)  # type: ignore[arg-type]
            self._windowed = None
            return
        monitor = glfw.get_primary_monitor()
        if monitor:
            mode = glfw.get_video_mode(monitor)
            self._windowed = (*glfw.get_window_pos(self.handle), *self.size)
            glfw.set_window_monitor(self.handle, monitor, 0, 0, *mode.size, mode.refresh_rate)

    def inject_key(self, name: str, down: bool) -> None:
        """Simulate a key press or release, for scripts and tests."""
        code, action = KEY_CODES[name], glfw.PRESS if down else glfw.RELEASE
        if name in _MODIFIERS:
            (self._injected.add if down else self._injected.discard)(name)
        elif self._injected and name in _LETTERS:
            # the backend would query the real keyboard, where no modifier is held
            self._on_key(None, code, 0, action, 0)
            imgui.get_io().add_key_event(getattr(imgui.Key, name), down)
            return
        imgui.backends.glfw_key_callback(self.address, code, 0, action, 0)
        # the backend checks modifiers on the real keyboard, at each key and button
        for modifier in self._injected:
            imgui.get_io().add_key_event(_MODIFIERS[modifier], True)

    def destroy(self) -> None:
        """Release everything; further calls do nothing."""
        if self.handle is None:
            return
        imgui.backends.opengl3_shutdown()
        imgui.backends.glfw_shutdown()
        implot.destroy_context()
        imgui.destroy_context()
        self._release_framebuffer()
        self.ctx.release()
        glfw.destroy_window(self.handle)
        self.handle = None
        glfw.terminate()

    # --- internals

    def _install_callbacks(self) -> None:
        # before ImGui's, which chain to these; a callback set later would replace ImGui's
        glfw.set_key_callback(self.handle, self._on_key)
        glfw.set_char_callback(self.handle, self._on_character)
        glfw.set_cursor_pos_callback(self.handle, lambda _, *place: setattr(self, "_mouse", place))
        glfw.set_mouse_button_callback(self.handle, self._on_mouse_button)
        glfw.set_window_focus_callback(self.handle, lambda _, focused: self._events.focus(bool(focused)))
        glfw.set_window_size_callback(self.handle, lambda _, *size: setattr(self, "size", size))
        glfw.set_framebuffer_size_callback(self.handle, lambda _, *size: setattr(self, "pixels", size))
        glfw.set_window_content_scale_callback(
            self.handle, lambda _, across, __: setattr(self, "_content_scale", across)
        )
        glfw.set_window_iconify_callback(self.handle, lambda _, on: setattr(self, "_iconified", bool(on)))
        drop: Any = lambda _, paths: self._events.drop([Path(path) for path in paths])  # noqa: E731  # its stub is wrong
        glfw.set_drop_callback(self.handle, drop)

    def _on_key(self, _window: Any, code: int, _scancode: int, action: int, _mods: int) -> None:
        name = KEY_NAMES.get(code)
        if name is not None and (action != glfw.REPEAT or name in REPEATED_KEYS):
            acts = self._events.key(name, action != glfw.RELEASE)
            if action != glfw.REPEAT:
                (self._acting.add if acts else self._acting.discard)(name)
        self._acts = action != glfw.RELEASE and name in self._acting & _TYPING

    def _on_character(self, _window: Any, code: int) -> None:
        self._typed = [*self._typed[-MAX_WAITING_CHARACTERS:], (code, not self._acts)]
        self._acts = False

    def _on_mouse_button(self, _window: Any, button: int, action: int, _mods: int) -> None:
        # the middle button scrolls a panel, without moving the keyboard focus
        if action == glfw.PRESS and (button != 2 or not imgui.get_io().want_capture_mouse):
            self._events.mouse_press(*self._mouse)

    def _start_imgui(self) -> None:
        imgui.create_context()
        implot.create_context()
        io = imgui.get_io()
        io.set_ini_filename(None)  # the layout follows the window; there is nothing to store
        # otherwise one exception between begin and end makes every later frame fail
        io.config_error_recovery_enable_assert = False
        io.config_flags |= imgui.ConfigFlags_.nav_enable_keyboard
        context = imgui.get_current_context()
        # F6 cycles through the panels; Ctrl+Tab would bypass the window
        context.config_nav_windowing_key_next = context.config_nav_windowing_key_prev = 0
        io.config_error_recovery_enable_tooltip = False  # it is logged; the user cannot fix it
        self.address = ctypes.cast(self.handle, ctypes.c_void_p).value or 0  # as ImGui's backend needs it
        imgui.backends.glfw_init_for_opengl(self.address, True)
        imgui.backends.opengl3_init("#version 330")

    def _match_framebuffer(self) -> None:
        size = self.pixels
        if 0 in size or (self.framebuffer is not None and shown_size(self.framebuffer) == size):
            return
        self._release_framebuffer()
        if self.draws_aside:
            self.framebuffer = self.ctx.screen
            self.framebuffer.viewport = (0, 0, *size)
            return
        self._texture = self.ctx.texture(size, 4)
        self._depth = self.ctx.depth_renderbuffer(size)
        self.framebuffer = self.ctx.framebuffer([self._texture], self._depth)

    def _release_framebuffer(self) -> None:
        if self.framebuffer is None:
            return
        self.ctx.screen.use()  # a bound framebuffer must not be released
        for resource in () if self.draws_aside else (self.framebuffer, self._texture, self._depth):
            resource.release()
        self.framebuffer = None


def _open(width: int, height: int, offscreen: bool) -> Any:
    """Return a hidden or shown window with a 3.3 core context; DisplayError with the remedy when there can be none."""
    glfw.ERROR_REPORTING = "raise"  # a refused context would otherwise be a null window
    try:
        glfw.init_hint(glfw.PLATFORM, glfw.PLATFORM_NULL if offscreen else glfw.ANY_PLATFORM)
        glfw.init()
    except glfw.GLFWError as error:
        raise DisplayError(
            f"No window can be opened: {_reason(error)}.", _display_remedy(offscreen)
        ) from error
    try:
        glfw.default_window_hints()
        glfw.window_hint(glfw.CONTEXT_VERSION_MAJOR, 3)
        glfw.window_hint(glfw.CONTEXT_VERSION_MINOR, 3)
        glfw.window_hint(glfw.OPENGL_PROFILE, glfw.OPENGL_CORE_PROFILE)
        glfw.window_hint(glfw.OPENGL_FORWARD_COMPAT, True)
        if offscreen:
            glfw.window_hint(glfw.CONTEXT_CREATION_API, glfw.EGL_CONTEXT_API)
        else:
            glfw.window_hint(glfw.SCALE_TO_MONITOR, True)
            width, height = _fitting_screen(width, height)
        handle = glfw.create_window(width, height, TITLE, None, None)
    except glfw.GLFWError as error:
        glfw.terminate()
        remedy = "Install OpenGL 3.3 (for example Mesa: libgl1, libegl1) or update the graphics driver."
        raise DisplayError(f"No OpenGL 3.3 context can be made: {_reason(error)}.", remedy) from error
    # from here on an error of glfw is a refused request (a cursor, a clipboard, a position): logged, not fatal
    glfw.ERROR_REPORTING = "log"
    return handle


def _fitting_screen(width: int, height: int) -> tuple[int, int]:
    """Return the size to request, limited to the first monitor's free area: a stored one may come from a larger monitor."""
    monitor = glfw.get_primary_monitor()
    if not monitor:
        return width, height
    room, scale = glfw.get_monitor_workarea(monitor)[2:], glfw.get_monitor_content_scale(monitor)
    fits = (max(int(side / max(by, 1.0)), 1) for side, by in zip(room, scale, strict=True))
    across, up = (min(side, most) for side, most in zip((width, height), fits, strict=True))
    return across, up


def _context() -> Any:
    try:
        return moderngl.create_context(require=330)
    except Exception as error:  # moderngl raises bare Exception
        raise DisplayError(
            f"OpenGL 3.3 cannot be used: {error}.",
            "Update the graphics driver or install Mesa (libgl1, libegl1).",
        ) from error


def _reason(error: Exception) -> str:
    return str(error).removesuffix("'").rstrip(".").replace("b'", "").split(") ", 1)[-1]


def _display_remedy(offscreen: bool) -> str:
    if offscreen:
        return "Install libegl1 (Mesa) for rendering without a display."
    missing = not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))
    start = "Start it in a desktop session (DISPLAY and WAYLAND_DISPLAY are unset). " if missing else ""
    return start + _OFFSCREEN_HINT
