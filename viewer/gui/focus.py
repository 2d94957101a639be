"""Keyboard focus: the view, where single keys drive and act, or a panel or window, where they type and select."""

from collections.abc import Callable
from dataclasses import dataclass, field
from enum import Enum, auto
from typing import Any

from viewer.gl_bindings import imgui
from viewer.input.devices import Devices

OVER = "##overlay"  # suffix of the names of windows above everything
_IMPLICIT = "Debug##"  # ImGui's own window, which is never shown


class Use(Enum):
    """How the window with the keyboard focus uses a key."""

    NONE = auto()  # nothing there is in use
    OPEN = auto()  # a field is edited, a list or menu is open, a button or slider is held
    UNSURE = auto()  # until the next frame: a press or closed item may open something; keys wait


@dataclass
class Focus:
    """Which window has the keyboard focus.

    Clicking a window gives it the focus. Closing it, or using a button, list or field, returns the focus to the topmost
    open window, or to the view.
    """

    holder: str = ""  # the window with the keyboard focus; "" is the view
    use: Use = Use.NONE
    windows: tuple[str, ...] = ()  # windows above everything, the front one last

    @property
    def in_view(self) -> bool:
        """Return whether the view has the focus, so that single keys drive the character."""
        return not self.holder and self.use is Use.NONE

    def press(self, x: float, y: float) -> None:
        """Focus the window under a mouse press, before ImGui has seen the press."""
        self.holder = window_at(x, y)
        if self.holder or self.use is Use.OPEN:
            self.use = Use.UNSURE

    def update(self) -> None:
        context = imgui.get_current_context()
        drawn = [window.name for window in context.windows if window.active]
        over = tuple(name for name in drawn if name.endswith(OVER))
        opened, self.windows = [name for name in over if name not in self.windows], over
        use = _use_of(context)
        if use is Use.NONE:
            self._settle(context, opened, drawn)
            return
        if not any(map(imgui.is_mouse_clicked, range(3))):  # which ImGui handles at the end of the frame
            self.holder = _owner(context.nav_window) or self.holder
        self.use = use

    def _settle(self, context: Any, opened: list[str], drawn: list[str]) -> None:
        """Focus a newly opened window, and unfocus a closed one, while nothing is in use."""
        if opened:
            self.holder = opened[-1]
        elif self.use is Use.OPEN or (self.holder and self.holder not in drawn):
            self.release()
        waits = self.use is Use.OPEN or len(context.input_events_queue)
        self.use = Use.UNSURE if waits else Use.NONE
        if _owner(context.nav_window) != self.holder:
            imgui.set_window_focus(self.holder or None)

    def release(self) -> None:
        """Return the focus from a panel to the view; an open window on top keeps it."""
        if self.holder not in self.windows:
            self.holder = self.windows[-1] if self.holder.endswith(OVER) and self.windows else ""

    def give_to(self, name: str) -> None:
        """Focus a window and start keyboard navigation at its first item; "" is the view."""
        self.holder, self.use = name, Use.NONE
        imgui.set_window_focus(name or None)
        if name:
            imgui.internal.nav_init_window(imgui.internal.find_window_by_name(name), True)
            imgui.set_nav_cursor_visible(True)


@dataclass
class KeyRouter:
    """Routes keys to the view or to ImGui; keys wait while it is unclear which has the focus."""

    focus: Focus
    devices: Devices
    asks_text: Callable[[], bool]  # a field waits for the keyboard
    refuse: Callable[[], None]  # says that a panel has the focus
    _waiting: list[tuple[str, bool]] = field(default_factory=list)  # name, whether it was pressed
    _ctrl: bool = False  # whether it is down
    # Enter was pressed in the view: letters typed within a slow frame belong to the field
    _field_entered: bool = False

    @property
    def typing(self) -> bool:
        """Return whether keys are text, including the frames before ImGui reports it."""
        entered = imgui.internal.get_input_text_state(imgui.internal.get_active_id()) is not None
        return bool(imgui.get_io().want_text_input or entered or self.asks_text())

    def key(self, name: str, down: bool) -> bool:
        """Handle a key event; return whether it acts in the view."""
        if self._waiting or self.focus.use is Use.UNSURE:
            self._waiting.append((name, down))
            return False
        return self._take(name, down)

    def begin_frame(self) -> None:
        """Handle the waiting keys once the focus is known."""
        if self.focus.use is not Use.UNSURE:
            waiting, self._waiting = self._waiting, []
            for name, down in waiting:
                self._take(name, down)

    def end_enter(self) -> None:
        """Stop waiting for the field opened by Enter."""
        self._field_entered = False

    def lose_window(self) -> None:
        """Release all keys because the window lost the focus."""
        self.devices.keyboard.release_all()
        self._ctrl = False
        self._waiting.clear()

    def _take(self, name: str, down: bool) -> bool:
        """Return whether a key acts: function keys always do, others while the view has the focus."""
        typing, in_view = self.typing or self._field_entered, self.focus.in_view
        self.devices.keyboard.key(name, down, typing or not in_view)
        self._ctrl = down if name == "ctrl" else self._ctrl
        if typing or not down:
            return False
        if in_view:
            self._field_entered |= name == "enter"
        elif not self._ctrl and self.focus.use is Use.NONE and self.devices.acts_alone(name):
            self.refuse()
        return in_view


def _use_of(context: Any) -> Use:
    """Return whether a popup is open, an item is held, or the keyboard focus moves to one, by Tab or for a field."""
    if len(context.open_popup_stack):
        return Use.OPEN
    if context.nav_move_submitted or context.nav_next_activate_id:
        return Use.UNSURE
    pressed = context.active_id_window
    background = pressed is not None and context.active_id == pressed.move_id  # a window being moved
    return Use.OPEN if context.active_id != 0 and not background else Use.NONE


def window_at(x: float, y: float) -> str:
    """Return the window drawn at a screen position, or a menu's parent; "" for the view."""
    for window in reversed(list(imgui.get_current_context().windows)):
        across = window.pos.x <= x < window.pos.x + window.size.x
        along = window.pos.y <= y < window.pos.y + window.size.y
        takes_mouse = not window.flags & imgui.WindowFlags_.no_mouse_inputs
        if across and along and takes_mouse and window.was_active and not window.hidden and _owner(window):
            return _owner(window)
    return ""


def is_drawn(name: str) -> bool:
    """Return whether a window was drawn in the last frame."""
    window = imgui.internal.find_window_by_name(name)
    return window is not None and window.was_active


def _owner(window: Any) -> str:
    """Return the name of the window that a list, a menu or a part of a window belongs to."""
    name = "" if window is None else window.root_window_popup_tree.name
    return "" if name.startswith(_IMPLICIT) else str(name)
