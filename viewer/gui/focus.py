"""Who has the keys: the view, where single keys drive and act, or a panel or window, where they type and choose."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from viewer.gl_bindings import imgui

TAB_FRAMES = 4
_IMPLICIT = "Debug##"  # ImGui's own window, which is never shown


@dataclass
class Focus:
    """The keyboard's place.

    A press of the mouse decides at once, before ImGui has seen it: keys that follow within a slow frame belong to what
    was pressed. A button that was clicked, a list that was chosen from and a field that was left give the keys back to
    the view; a panel that was only touched keeps them until the view is clicked or Escape is pressed.
    """

    in_view: bool = True
    _chosen: bool = False  # the user chose a panel; ImGui chooses one by itself where a window was closed
    _used: bool = False  # by the mouse, or a field was left: the keys go back when nothing is open any more
    _field: bool = False  # a text field had the keys in the frame before
    _pressed: bool = False  # the mouse was down on an item in the frame before
    _tabbing: int = 0  # frames in which Tab goes from a field to the next item
    _name: str = ""  # of the window that had the keys in the frame before
    _over_view: bool = False  # the window over everything was opened while the view had them

    def press(self, x: float, y: float) -> None:
        """The mouse was pressed at a place on the screen."""
        self.in_view = window_at(x, y) is None
        self._chosen, self._used = not self.in_view, False

    def update(self, panels: Sequence[str]) -> None:
        """Notice what became of the keys in a frame that was drawn; `panels` are the windows that give them back."""
        context = imgui.get_current_context()
        active, window = context.active_id, context.nav_window
        root = None if window is None else window.root_window
        name = "" if root is None or root.name.startswith(_IMPLICIT) else root.name
        self._tabbing = TAB_FRAMES if imgui.is_key_pressed(imgui.Key.tab) else max(self._tabbing - 1, 0)
        if active == 0:
            self._used = self._used or (self._field and not self._tabbing) or self._pressed
        self._chosen = self._chosen or self._field
        self._field = active != 0 and imgui.internal.get_input_text_state(active) is not None
        by_mouse = context.active_id_source == imgui.internal.InputSource.mouse
        background = root is not None and active in (root.move_id, window.move_id)
        self._pressed = active != 0 and by_mouse and not background and not self._field
        self._notice_closing(name, panels)
        self.in_view = not name
        moving = (
            context.nav_move_submitted or context.nav_next_activate_id
        )  # a field is about to have the keys
        self._chosen = self._chosen or bool(moving)
        if active == 0 and not moving and not len(context.open_popup_stack):
            if name in panels and (self._used or not self._chosen):
                self.give_to_view()
            self._used = False

    def _notice_closing(self, name: str, panels: Sequence[str]) -> None:
        """Who opened a window over everything gets the keys when it closes: ImGui gives them to some panel."""
        before, self._name = self._name, name
        if name == before:
            return
        if before and before not in panels and not is_drawn(before):
            self._chosen = self._chosen and not self._over_view
        elif name and name not in panels:
            self._over_view = not before

    def expect_field(self) -> None:
        """A field of a panel is about to be typed into."""
        self.in_view, self._chosen, self._used = False, True, False

    def give_to_view(self) -> None:
        """Take the keys from panels and windows."""
        imgui.set_window_focus(None)
        self.in_view, self._chosen = True, False

    def give_to(self, name: str) -> None:
        """Let the keyboard choose in a window, from its first item on."""
        imgui.set_window_focus(name)
        window = imgui.internal.find_window_by_name(name)
        if window is not None:
            imgui.internal.nav_init_window(window, True)
            imgui.set_nav_cursor_visible(True)
        self.expect_field()


def window_at(x: float, y: float) -> str | None:
    """The window of the last frame at a place on the screen; None for the view."""
    for window in reversed(list(imgui.get_current_context().windows)):
        across = window.pos.x <= x < window.pos.x + window.size.x
        along = window.pos.y <= y < window.pos.y + window.size.y
        takes_mouse = not window.flags & imgui.WindowFlags_.no_mouse_inputs
        shown = window.was_active and not window.hidden and not window.name.startswith(_IMPLICIT)
        if across and along and shown and takes_mouse:
            return str(window.name)
    return None


def is_drawn(name: str) -> bool:
    """Whether a window was drawn in the last frame."""
    window = imgui.internal.find_window_by_name(name)
    return window is not None and window.was_active


def close_innermost() -> bool:
    """Close the list or popup that was opened last; whether there was one."""
    depth = len(imgui.get_current_context().open_popup_stack)
    if depth == 0:
        return False
    imgui.internal.close_popup_to_level(depth - 1, True)
    return True
