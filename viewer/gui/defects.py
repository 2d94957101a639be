"""Internal errors cost an action, not the program: exceptions within a frame are caught, reported, and the tool is closed."""

import logging
import os
import platform
import time
import traceback
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from runtime.atomic import write_atomic
from runtime.errors import FileError
from viewer.gl_bindings import imgui
from viewer.gui import widgets
from viewer.gui.layout import Rect
from viewer.gui.panels import IN_PLACE, Panel

MAX_DEFECTS_PER_S = 3  # as many within a second end the program
PACKAGES = ("sport-viewer", "numpy", "onnxruntime", "imgui-bundle", "glfw", "moderngl")
_LOG = logging.getLogger("sport.viewer")


@dataclass(frozen=True)
class Defect:
    """An internal error: what the program was doing, the report, and the report's file (None: not written)."""

    doing: str
    report: str
    path: Path | None


@dataclass
class Defects:
    """Catches internal errors within a frame; when inactive, as without a display, they are raised."""

    folder: Path  # of the reports
    device: str  # the rendering device, for the report
    keep_work: Callable[[], None]  # saves the session
    active: bool = True
    shown: Defect | None = None  # until the user has read it
    _times_s: deque[float] = field(default_factory=lambda: deque(maxlen=MAX_DEFECTS_PER_S))

    @contextmanager
    def guarded(self, doing: str, close: Callable[[], object] = lambda: None) -> Iterator[None]:
        """Catch errors in the block and `close` the tool concerned; the third within a second is raised.

        `doing` completes "while …": "drawing the panel Scene". ImGui's stacks are restored.
        """
        stacks, in_frame = imgui.internal.ErrorRecoveryState(), _in_frame()
        if in_frame:
            imgui.internal.error_recovery_store_state(stacks)
        try:
            yield
        except Exception as error:
            self._times_s.append(time.monotonic())
            often = len(self._times_s) == MAX_DEFECTS_PER_S and self._times_s[-1] - self._times_s[0] < 1.0
            if not self.active or often:
                raise
            _LOG.exception("a defect while %s", doing)
            if in_frame and _in_frame():  # otherwise ImGui does so at the end of the frame
                imgui.internal.error_recovery_try_to_recover_state(stacks)
            imgui.get_style().alpha = 1.0  # a block of disabled items may have changed it
            self._report(doing, error)
            with self.guarded(f"closing after {doing}"):
                close()
            with self.guarded("writing the session"):
                self.keep_work()

    def _report(self, doing: str, error: Exception) -> None:
        text = report(doing, error, self.device)
        path = self.folder / f"report-{time.strftime('%Y%m%d-%H%M%S')}-{os.getpid()}.txt"
        written = True
        try:
            write_atomic(path, text)
        except FileError:
            written = False  # the text can still be copied
        # the first error has caused those after it
        self.shown = self.shown or Defect(doing, text, path if written else None)

    def dismiss(self) -> None:
        """Close the report."""
        self.shown = None


def _in_frame() -> bool:
    return bool(imgui.get_current_context().within_frame_scope)


def safe_panel(panel: Panel, defects: Defects) -> Panel:
    """Return the panel with all its functions guarded: an internal error closes it.

    A panel in a column offers to be reopened; any other reappears when the report is closed.
    """
    failed: set[str] = set()
    in_place = panel.place in IN_PLACE

    def close() -> None:
        failed.add(panel.name)
        if panel.close is not None:
            panel.close()

    def guard(do: Callable[..., Any] | None, what: str, usual: Any = None) -> Any:
        def guarded(*given: Any) -> Any:
            if do is not None and not failed:
                with defects.guarded(f"{what} the panel {panel.name}", close):
                    return do(*given)
            return usual

        return do and guarded

    draw, shown = guard(panel.draw, "drawing"), guard(panel.shown, "looking for", False)

    def draw_or_offer(rect: Rect) -> None:
        if not failed:
            draw(rect)
        elif in_place:
            widgets.muted("An internal error closed this panel.", wrap=True)
            if widgets.button(f"Open it again##{panel.name}"):
                failed.clear()

    def shown_or_failed() -> bool:
        if defects.shown is None and not in_place:
            failed.clear()
        return panel.shown() if failed and in_place else bool(shown())

    return replace(
        panel, draw=draw_or_offer, shown=shown_or_failed, tools=guard(panel.tools, "drawing the buttons of"),
        keys=guard(panel.keys, "reading keys for"), close=guard(panel.close, "closing"),
        begin_typing=guard(panel.begin_typing, "typing into"),
        covers=guard(panel.covers, "measuring", 0.0),
    )  # fmt: skip


def report(doing: str, error: Exception, device: str) -> str:
    """Return the text of an error report: time, versions and traceback."""
    versions = []
    for name in PACKAGES:
        with suppress(PackageNotFoundError):
            versions.append(f"{name} {version(name)}")
    lines = (
        f"SPORT viewer, report of {time.strftime('%Y-%m-%d %H:%M:%S')}",
        f"While {doing}: {type(error).__name__}: {error}",
        "",
        f"Python {platform.python_version()}, {platform.platform()}",
        f"Drawn by {device}",
        ", ".join(versions),
        "",
    )
    return "\n".join(lines) + "\n" + "".join(traceback.format_exception(error))
