"""Messages of the status line: the current one, those waiting, and the list of recent ones."""

import logging
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from enum import IntEnum
from pathlib import Path

from runtime.safe_read import printable
from viewer.process import show_in_folder

NOTE_S, WARNING_S, ERROR_S = 8.0, 60.0, 60.0  # display time of each level, if no other message follows
READ_S = 4.0  # for which nothing less severe replaces a warning or an error
SETTLED_S = 4.0  # for which a settled message stays visible
MAX_MESSAGES = 50
_LOG = logging.getLogger("sport.viewer")


class Level(IntEnum):
    """The severity of a message, as a log level."""

    NOTE = logging.INFO
    WARNING = logging.WARNING
    ERROR = logging.ERROR


_SHOWN_S = {Level.NOTE: NOTE_S, Level.WARNING: WARNING_S, Level.ERROR: ERROR_S}


@dataclass(frozen=True)
class Message:
    """A message, and the time (seconds of the clock) from which it is shown."""

    text: str
    level: Level
    begins_s: float
    topic: object = None  # its subject: `settle` ends it
    settled: bool = False
    path: Path | None = None  # of a written file, which can be shown in its folder
    remedy: str = ""  # end of the text: what to do
    holds: bool = False  # reports a lasting state: shown again after others, until it is settled
    told_at: str = ""  # hours, minutes and seconds

    @property
    def problem(self) -> str:
        """The text without its remedy."""
        return self.text.removesuffix(self.remedy).rstrip()

    @property
    def ends_s(self) -> float:
        # a film may take minutes
        shown_s = WARNING_S if self.path is not None else _SHOWN_S[self.level]
        return self.begins_s + min(shown_s, SETTLED_S if self.settled else shown_s)


@dataclass
class Messages:
    """Recent messages, newest last."""

    clock: Callable[[], float] = time.monotonic
    logged: bool = True  # False while the caller raises errors, so that they are not shown twice
    recent: deque[Message] = field(default_factory=lambda: deque(maxlen=MAX_MESSAGES))

    def post(
        self,
        text: str,
        level: Level = Level.NOTE,
        topic: object = None,
        path: Path | None = None,
        remedy: str = "",
        holds: bool = False,
    ) -> None:
        """Show and log `text` once a more severe message was readable; repeating the current message only extends it."""
        last, now = self.recent[-1] if self.recent else None, self.clock()
        text, remedy = (printable(" ".join(words.split())) for words in (text, remedy))
        begins_s = now
        if last is not None and last.level >= level and not last.settled:
            begins_s = max(now, last.begins_s + READ_S * (last.level > level))
        told_at = time.strftime("%H:%M:%S")
        message = Message(text, level, begins_s, topic, False, path, remedy, holds, told_at)
        if last is not None and (last.text, last.level) == (message.text, level):
            self.recent[-1] = message
            return
        if self.logged:
            _LOG.log(level, "%s", message.text)
        self.recent.append(message)

    def note(self, text: str, path: Path | None = None) -> None:
        """Show an informative message; `path` is a file that was written."""
        self.post(text, Level.NOTE, path=path)

    def warn(self, text: str, topic: object = None) -> None:
        """Show a warning; with a topic it stays until that is settled, for a minute at most."""
        self.post(text, Level.WARNING, topic)

    def error(self, problem: BaseException | str, topic: object = None, holds: bool = True) -> None:
        """Show an error; an exception by its own text.

        With a topic it stays until that is settled, unless `holds` is false, as for a failed attempt to read a file.
        """
        text = str(problem) or type(problem).__name__
        remedy = str(getattr(problem, "remedy", ""))
        self.post(text, Level.ERROR, topic, remedy=remedy, holds=holds and topic is not None)

    def show_in_folder(self, path: Path) -> None:
        """Open the system's file manager at a file."""
        try:
            show_in_folder(path)
            self.note(f"{path.name} is in {path.parent}.")
        except OSError as error:
            self.warn(f"No file manager opens ({error.strerror}); the file is {path}.")

    def settle(self, topic: object) -> None:
        """Mark the messages about a topic as settled; notes disappear at once."""
        for at, message in reversed(list(enumerate(self.recent))):
            if message.topic == topic and not message.settled:
                if message.level is Level.NOTE:
                    del self.recent[at]
                else:
                    self.recent[at] = replace(message, settled=True)

    @property
    def current(self) -> Message | None:
        """The message to show now: the newest, or one that still holds."""
        now = self.clock()
        begun = [message for message in self.recent if message.begins_s <= now]
        if begun and now <= begun[-1].ends_s:
            return begun[-1]
        return next((message for message in reversed(begun) if message.holds and not message.settled), None)
