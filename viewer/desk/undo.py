"""Ctrl+Z and Ctrl+Y wherever nothing is typed: the take that plays, takes that came or went, or the prompt."""

from __future__ import annotations

from dataclasses import dataclass

from viewer.gl_bindings import imgui
from viewer.prompt.field_panel import pressed_undo
from viewer.prompt.prompting import Prompting
from viewer.takes.editing import TakeEditing
from viewer.takes.state import ClipItem


@dataclass
class Undo:
    """What the keys take back: the newest of a removed take, a take that was just kept, and a change of the prompt."""

    prompting: Prompting
    editing: TakeEditing
    _removed: int = 0  # takes that can be brought back
    _counted: int = 0  # takes that were kept so far
    _top: object = None  # the prompt's last change when a take came or went last
    _kept: ClipItem | None = None  # the take that came last, while nothing else happened since
    _taken_back: bool = False  # Ctrl+Z took that one out of the list

    def keys(self) -> None:
        """Watch the list of takes, and act on the keys; call once a frame."""
        self._watch()
        if imgui.get_io().want_text_input:
            return
        undo, redo = pressed_undo()
        if self.editing.state.playback is not None:
            if undo:
                self.editing.undo()
            elif redo:
                self.editing.redo()
        elif undo and not self._undo_of_list():
            self.prompting.undo()
        elif redo and self._taken_back and self.editing.state.removed:
            self.editing.takes.restore()
        elif redo:
            self.prompting.redo()

    def _watch(self) -> None:
        state, top = self.editing.state, self.prompting.history.top
        if len(state.removed) != self._removed:
            self._removed, self._top, self._kept = len(state.removed), top, None
            self._taken_back = False
        if state.counter != self._counted:
            self._counted, self._top = state.counter, top
            self._kept = state.items[-1] if state.items else None

    def _undo_of_list(self) -> bool:
        """Whether the last thing that happened was a take that came or went, which is taken back now."""
        takes, state = self.editing.takes, self.editing.state
        if self._top is not self.prompting.history.top:
            return False
        if self._kept is not None and self._kept.saved is None and self._kept in state.items:
            takes.remove(state.items.index(self._kept))
            self._watch()
            self._taken_back = True
        elif state.removed and not self._taken_back:
            takes.restore()
        else:
            return False
        return True
