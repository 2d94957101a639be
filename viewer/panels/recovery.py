"""Two windows: the report of an internal error, and the offer to restore an interrupted session."""

from dataclasses import dataclass
from functools import partial

from runtime.safe_read import printable
from viewer.gl_bindings import imgui
from viewer.gui import theme, widgets
from viewer.gui.defects import Defects
from viewer.gui.layout import Rect
from viewer.gui.panels import Panel, PanelPlace
from viewer.gui.theme import ICON
from viewer.gui.widgets import px
from viewer.messages import Messages
from viewer.session.sessions import OPENING, Sessions, SessionSummary
from viewer.session.summaries import describe

WIDTH_PX, REPORT_HEIGHT_PX = 560.0, 220.0  # at scale 1


def defect_panel(defects: Defects, sessions: Sessions, messages: Messages) -> Panel:
    """Return the window that reports an internal error."""

    def draw(_: Rect) -> None:
        defect = defects.shown
        if defect is None:
            return
        widgets.muted(
            f"An internal error occurred while {defect.doing}. The affected part was closed; everything else keeps running.",
            wrap=True,
        )
        kept = sessions.editor.file.problem or f"Your work is safe: the session {sessions.name} is written."
        widgets.text(
            printable(kept), theme.ERROR if sessions.editor.file.problem else theme.ACCENT, wrap=True
        )
        where = "It could not be saved." if defect.path is None else printable(defect.path)
        widgets.label(f"Report: {where}")
        room = imgui.ImVec2(-1, px(REPORT_HEIGHT_PX))
        imgui.input_text_multiline("##report", defect.report, room, imgui.InputTextFlags_.read_only)
        copy = partial(imgui.set_clipboard_text, defect.report)
        show = None if defect.path is None else partial(messages.show_in_folder, defect.path)
        widgets.buttons(
            ("Copy the report", "To send it to the developers", copy),
            ("Show in folder##report", "", show),
            ("Continue##defect", "", defects.dismiss),
            primary=2,
        )

    return Panel(
        "Defect", PanelPlace.WINDOW, draw, ICON.error, lambda: defects.shown is not None, WIDTH_PX,
        close=defects.dismiss, modal=True,
    )  # fmt: skip


@dataclass
class CutOffWindow:
    """Offers to restore an interrupted session, once at startup."""

    sessions: Sessions
    left: SessionSummary | None = None  # the offered session, while the window is open

    def begin(self) -> None:
        """Open the window if there is such a session."""
        self.left = self.sessions.find_cut_off()

    def close(self) -> None:
        """Close the window; the session can be restored later."""
        self.left = None

    def panel(self) -> Panel:
        return Panel(
            "Your last session", PanelPlace.WINDOW, self._draw, ICON.warning, lambda: self.left is not None, WIDTH_PX,
            close=self.close, modal=True,
        )  # fmt: skip

    def _draw(self, _: Rect) -> None:
        sessions, left = self.sessions, self.left
        if left is None or left.path == sessions.editor.file.path:  # it has been opened elsewhere
            self.left = None
            return
        imgui.text_wrapped("The program was not closed properly. Your work is safe:")
        widgets.text(printable(describe(left)), theme.ACCENT, wrap=True)

        def reopen() -> None:
            sessions.open(left.path)
            self.left = None

        def discard() -> None:
            sessions.discard(left)
            self.left = None

        # a file that the user named is not deleted here
        named = sessions.cut_off is None or left.path != sessions.cut_off.path
        with widgets.disabled(sessions.jobs.busy(OPENING)):
            widgets.buttons(
                ("Reopen##cut off", "Reopen it with everything recorded", reopen),
                ("Later##cut off", "It stays under Takes and in the session's menu", self.close),
                ("Discard##cut off", "Delete it permanently", None if named else discard),
                primary=0,
            )
