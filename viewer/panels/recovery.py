"""Two windows: what a defect has closed, with its report; and the work of a run that was cut off."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from runtime.safe_read import printable
from viewer.gl_bindings import imgui
from viewer.gui import theme, widgets
from viewer.gui.defects import Defects
from viewer.gui.layout import Rect
from viewer.gui.panels import Panel, PanelPlace
from viewer.gui.theme import ICON
from viewer.gui.widgets import px
from viewer.messages import Messages
from viewer.session.sessions import OPENING, Sessions, SessionSummary, describe

WIDTH_PX, REPORT_HEIGHT_PX = 560.0, 220.0  # pixels at scale 1


def defect_panel(defects: Defects, sessions: Sessions, messages: Messages) -> Panel:
    """The window that says what a defect has cost."""

    def draw(_: Rect) -> None:
        defect = defects.shown
        if defect is None:
            return
        widgets.muted(
            f"The program met a defect while {defect.doing}. What it was about is closed, the rest goes on.",
            wrap=True,
        )
        kept = sessions.editor.file.problem or f"Your work is kept: the session {sessions.name} is written."
        with widgets.color(imgui.Col_.text, theme.ERROR if sessions.editor.file.problem else theme.ACCENT):
            imgui.text_wrapped(printable(kept))
        where = "It could not be written." if defect.path is None else printable(defect.path)
        widgets.label(f"Report: {where}")
        room = imgui.ImVec2(-1, px(REPORT_HEIGHT_PX))
        imgui.input_text_multiline("##report", defect.report, room, imgui.InputTextFlags_.read_only)
        third = widgets.column_width(3)
        if widgets.button("Copy the report", third, "To send it to those who make the program"):
            imgui.set_clipboard_text(defect.report)
        widgets.same_line()
        if widgets.button("Show in folder##report", third, enabled=defect.path) and defect.path is not None:
            messages.show_in_folder(defect.path)
        widgets.same_line()
        if widgets.button("Continue##defect", third, primary=True):
            defects.dismiss()

    return Panel(
        "Defect", PanelPlace.WINDOW, draw, ICON.error, lambda: defects.shown is not None, WIDTH_PX,
        close=defects.dismiss, modal=True,
    )  # fmt: skip


@dataclass
class CutOffWindow:
    """Offers the session that was cut off, once at the start."""

    sessions: Sessions
    left: SessionSummary | None = None  # what is offered, while the window is open

    def begin(self) -> None:
        """Open the window when there is such a session."""
        self.left = self.sessions.find_cut_off()

    def close(self) -> bool:
        """Leave it for later; whether it was open."""
        was, self.left = self.left is not None, None
        return was

    def panel(self) -> Panel:
        return Panel(
            "Your last session", PanelPlace.WINDOW, self._draw, ICON.warning, lambda: self.left is not None, WIDTH_PX,
            close=self.close, modal=True,
        )  # fmt: skip

    def _draw(self, _: Rect) -> None:
        sessions, left = self.sessions, self.left
        if left is None or left.path == sessions.editor.file.path:  # it was opened elsewhere
            self.left = None
            return
        imgui.text_wrapped("The last run ended without being closed. Its work is kept:")
        with widgets.color(imgui.Col_.text, theme.ACCENT):
            imgui.text_wrapped(printable(describe(left)))
        choices: tuple[tuple[str, str, Callable[[], None]], ...] = (
            ("Reopen", "Open it again with all that was recorded", lambda: sessions.open(left.path)),
            ("Later", "It stays under Takes and in the session's menu", lambda: None),
            ("Discard", "Remove it for good", lambda: sessions.discard(left)),
        )
        third = widgets.column_width(len(choices))
        named = sessions.cut_off is None or left.path != sessions.cut_off.path
        for number, (text, hint, act) in enumerate(choices):
            if number:
                widgets.same_line()
            # a file that the user named is not removed from here
            enabled = not sessions.jobs.busy(OPENING) and not (named and text == "Discard")
            if widgets.button(f"{text}##cut off", third, hint, text == "Reopen", enabled):
                act()
                self.left = None
