"""The message of the status line: errors stay until they hold no longer, warnings and notes fade, and everything is logged."""

from __future__ import annotations

import logging
import math
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from enum import IntEnum
from pathlib import Path

from runtime.safe_read import printable
from viewer.process import show_in_folder

WARNING_SECONDS = 60.0
SETTLED_SECONDS = 4.0  # what holds no longer is still there to be read
_LOG = logging.getLogger("sport.viewer")


class Level(IntEnum):
    """How a message is meant, as a level of the log."""

    NOTE = logging.INFO
    WARNING = logging.WARNING
    ERROR = logging.ERROR


_SHOWN_S = {Level.NOTE: 8.0, Level.WARNING: WARNING_SECONDS, Level.ERROR: math.inf}


@dataclass(frozen=True)
class Message:
    """One message and the clock's seconds at which it was posted."""

    text: str
    level: Level
    posted: float
    topic: object = None  # what it is about: `settle` ends it
    settled: bool = False
    path: Path | None = None  # of a file that was written, which can be shown in its folder


@dataclass
class Messages:
    """The current message and the recent ones, newest last."""

    clock: Callable[[], float] = time.monotonic
    logged: bool = True  # False while the caller raises what goes wrong, so that it is not shown twice
    recent: deque[Message] = field(default_factory=lambda: deque(maxlen=50))

    def post(
        self, text: str, level: Level = Level.NOTE, topic: object = None, path: Path | None = None
    ) -> None:
        """Show and log `text`; the same error again only refreshes the one shown."""
        last = self.recent[-1] if self.recent else None
        message = Message(printable(" ".join(text.split())), level, self.clock(), topic, path=path)
        if last is not None and (last.text, last.level) == (message.text, level):
            self.recent[-1] = message
            return
        if self.logged:
            _LOG.log(level, "%s", message.text)
        self.recent.append(message)

    def note(self, text: str, path: Path | None = None) -> None:
        """Post something good to know, of a file that was written at `path`."""
        self.post(text, Level.NOTE, path=path)

    def warn(self, text: str, topic: object = None) -> None:
        """Post something the user should look at."""
        self.post(text, Level.WARNING, topic)

    def error(self, problem: BaseException | str, topic: object = None) -> None:
        """Post an error; an exception is shown as its own sentence."""
        self.post(str(problem) or type(problem).__name__, Level.ERROR, topic)

    def show_in_folder(self, path: Path) -> None:
        """Open the system's file manager where a file is."""
        try:
            show_in_folder(path)
            self.note(f"{path.name} is in {path.parent}.")
        except OSError as error:
            self.warn(f"No file manager opens ({error.strerror}); the file is {path}.")

    def settle(self, topic: object) -> None:
        """What was said about a topic holds no longer: it went well since. A note goes at once."""
        if self.recent and self.recent[-1].topic == topic:
            last = self.recent.pop()
            if last.level is not Level.NOTE:
                self.recent.append(replace(last, settled=True))

    @property
    def current(self) -> Message | None:
        """What the status line shows now."""
        if not self.recent:
            return None
        last = self.recent[-1]
        # a film may take minutes
        shown_s = WARNING_SECONDS if last.path is not None else _SHOWN_S[last.level]
        seconds = min(shown_s, SETTLED_SECONDS if last.settled else math.inf)
        return None if self.clock() - last.posted > seconds else last
