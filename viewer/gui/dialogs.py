"""File dialogs: the system's own if it has a program for them, else a built-in one with folders and files to click or type."""

import os
import shutil
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from enum import Enum
from fnmatch import fnmatch
from pathlib import Path
from typing import Any

from runtime.safe_read import expanded, printable
from viewer.gl_bindings import imgui
from viewer.gui import widgets
from viewer.gui.panels import Panel, PanelPlace
from viewer.gui.theme import ICON
from viewer.gui.widgets import px
from viewer.messages import Messages

LINUX_PROGRAMS = ("zenity", "kdialog", "matedialog", "qarma")
DIALOG_WIDTH_PX, LIST_HEIGHT_PX = 520.0, 240.0  # pixels at scale 1
MAX_ENTRIES = 500  # of a folder
Filters = Sequence[str]  # alternating names and patterns: ["Projects", "*.sport"]


class DialogKind(Enum):
    OPEN = "Open"
    SAVE = "Save"
    FOLDER = "Choose"


@dataclass
class PendingDialog:
    kind: DialogKind
    title: str
    start: Path  # folder, or proposed file
    filters: Filters
    done: Callable[[Path], None]
    native: Any = None  # the system's dialog
    typed: str = ""
    shown: bool = False
    replacing: str = ""  # an existing file, once the user was warned
    # a folder with its entries, read when the folder changes
    listed: tuple[Path, list[Path]] = (Path(), [])

    @property
    def folder(self) -> Path:
        """The folder typed, or the one containing the typed file."""
        path = expanded(self.typed.strip().strip('"').replace("\0", "") or "~")
        return path if os.path.isdir(path) else path.parent  # also of a name that is too long

    def entries(self) -> list[Path]:
        """Return the folders, then the files matching the filters, of the folder shown."""
        folder = self.folder
        if self.listed[0] != folder:
            endings = [pattern for patterns in self.filters[1::2] for pattern in patterns.split()]
            self.listed = folder, _entries(folder, [] if self.kind is DialogKind.FOLDER else endings or ["*"])
        return self.listed[1]

    def would_replace(self, path: str) -> bool:
        """Return whether saving to a path, with or without the ending, would overwrite a file."""
        if self.kind is not DialogKind.SAVE or not path:
            return False
        target = expanded(path)
        ending = self.filters[-1].removeprefix("*") if self.filters else ""
        return os.path.isfile(target) or os.path.isfile(f"{target}{ending}")

    def accept(self) -> str | None:
        """Return the typed path; None if it is empty, or if the user must confirm overwriting first."""
        path = self.typed.strip().strip('"').replace("\0", "")
        if self.kind is DialogKind.SAVE and not Path(path).name:
            return None  # a folder alone
        if path != self.replacing and self.would_replace(path):
            self.replacing = path
            return None
        return path or None


def _entries(folder: Path, patterns: Sequence[str]) -> list[Path]:
    """Return the folders in a folder, then the files whose name fits a pattern; hidden ones are left out."""
    try:
        found = sorted((p for p in folder.iterdir() if p.name[:1] != "."), key=lambda p: p.name.casefold())
    except OSError:  # an unreadable folder shows nothing
        return []
    files = [
        p for p in found if not os.path.isdir(p) and any(fnmatch(p.name.lower(), one) for one in patterns)
    ]
    return [*filter(os.path.isdir, found), *files][:MAX_ENTRIES]


def has_native_dialogs() -> bool:
    """Return whether the system provides file dialogs."""
    return sys.platform in ("win32", "darwin") or any(map(shutil.which, LINUX_PROGRAMS))


def open_native(question: PendingDialog) -> Any:
    """Open the system's file dialog: an object with `ready(milliseconds)` and `result()`."""
    from imgui_bundle import portable_file_dialogs as dialogs

    start, filters = str(question.start), list(question.filters) or None
    if question.kind is DialogKind.FOLDER:
        return dialogs.select_folder(question.title, start)
    if question.kind is DialogKind.SAVE:
        return dialogs.save_file(question.title, start, filters)
    return dialogs.open_file(question.title, start, filters)


@dataclass
class Dialogs:
    """Shows file dialogs, at most one at a time."""

    messages: Messages
    available: Callable[[], bool] = has_native_dialogs
    native: Callable[[PendingDialog], Any] = open_native
    question: PendingDialog | None = field(default=None)

    def ask(
        self, kind: DialogKind, title: str, start: Path, done: Callable[[Path], None], filters: Filters = ()
    ) -> None:
        """Ask for a file or folder; `done` is called with the answer in a later frame, or never."""
        if self.question is not None and self.question.native is not None:
            self.messages.warn(f"A dialog is open already: {self.question.title}.")
            return
        self.question = question = PendingDialog(kind, title, start, filters, done)
        question.typed = printable(start)
        if self.available():
            try:
                question.native = self.native(question)
                return
            except Exception as error:  # a foreign program; whatever it does, a path can still be typed
                self.messages.warn(f"The system's dialog failed ({type(error).__name__}): type the path.")
                return

    def poll(self) -> None:
        """Deliver the answer of a system dialog; call once per frame."""
        question = self.question
        if question is None or question.native is None or not question.native.ready(0):
            return
        self.question = None
        result = question.native.result()
        answer = result[0] if isinstance(result, list) and result else result
        if answer:
            question.done(Path(answer))

    def close(self) -> None:
        """Close the dialog without an answer."""
        self.question = None

    def panel(self) -> Panel:
        return Panel(
            "Path", PanelPlace.WINDOW, lambda _: self.draw(), ICON.folder, width=DIALOG_WIDTH_PX, modal=True,
            close=self.close, shown=lambda: self.question is not None and self.question.native is None,
        )  # fmt: skip

    def draw(self) -> None:
        """Draw the built-in dialog, if the system has none."""
        question = self.question
        if question is None or question.native is not None:
            return
        imgui.text_unformatted(question.title)
        clicked = self._browser(question)
        chosen = self._field(question)
        chosen = clicked or chosen
        if chosen is None:
            return
        self.question = None
        if chosen:
            question.done(expanded(chosen))

    def _browser(self, question: PendingDialog) -> str | None:
        """Draw folders and files; return the path of a double-clicked file."""
        answer = None
        if imgui.begin_child("files", imgui.ImVec2(0, px(LIST_HEIGHT_PX))):
            folder = question.folder
            if imgui.selectable(f"{ICON.back} {printable(folder.parent.name or '/')}##up", False)[0]:
                question.typed = printable(folder.parent)
            for number, path in enumerate(question.entries()):
                within = os.path.isdir(path)
                text = f"{ICON.folder if within else '     '} {printable(path.name)}"
                if imgui.selectable(f"{text}##{number}", printable(path) == question.typed)[0]:
                    question.typed = printable(path)
                if not within and imgui.is_item_hovered() and imgui.is_mouse_double_clicked(0):
                    answer = question.accept()
        imgui.end_child()
        return answer

    def _field(self, question: PendingDialog) -> str | None:
        """Draw the field and its buttons; return a path, "" to cancel, None for no answer yet."""
        widgets.full_width()
        if not question.shown:
            imgui.set_keyboard_focus_here()
        question.shown = True
        entered, question.typed = widgets.input_text("##dialog path", question.typed)
        if question.replacing and question.replacing == question.typed.strip():
            widgets.muted("This file exists. Click again to overwrite.")
        half = widgets.column_width(2)
        if widgets.button(f"{question.kind.value}###dialog ok", half, primary=True) or entered:
            return question.accept()
        widgets.same_line()
        # also of the field with the keyboard focus
        escaped = imgui.is_window_focused() and imgui.is_key_pressed(imgui.Key.escape)
        return "" if widgets.button("Cancel###dialog cancel", half) or escaped else None
