"""Messages of the status line: what is shown now, what waits for its turn, and the list of the last ones."""

from __future__ import annotations

import logging
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from enum import IntEnum
from pathlib import Path

from runtime.safe_read import printable
from viewer.process import show_in_folder

NOTE_S, WARNING_S, ERROR_S = 8.0, 60.0, 60.0  # how long each is shown, when nothing else is said
READ_S = 4.0  # so long, nothing of less weight takes the place of a warning or an error
SETTLED_S = 4.0  # so long, what holds no longer is still there to be read
MAX_MESSAGES = 50
_LOG = logging.getLogger("sport.viewer")


class Level(IntEnum):
    """How a message is meant, as a level of the log."""

    NOTE = logging.INFO
    WARNING = logging.WARNING
    ERROR = logging.ERROR


_SHOWN_S = {Level.NOTE: NOTE_S, Level.WARNING: WARNING_S, Level.ERROR: ERROR_S}


@dataclass(frozen=True)
class Message:
    """One message, and the clock's seconds from which on it is shown."""

    text: str
    level: Level
    begins_s: float
    topic: object = None  # what it is about: `settle` ends it
    settled: bool = False
    path: Path | None = None  # of a file that was written, which can be shown in its folder
    remedy: str = ""  # the end of the text: what can be done
    holds: bool = False  # it complains of a state: shown again after others, until it is settled
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
    """The recent messages, newest last."""

    clock: Callable[[], float] = time.monotonic
    logged: bool = True  # False while the caller raises what goes wrong, so that it is not shown twice
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
        """Show and log `text`, after what weighs more was read; the same again only refreshes the one shown."""
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
        """Post something good to know, of a file that was written at `path`."""
        self.post(text, Level.NOTE, path=path)

    def warn(self, text: str, topic: object = None) -> None:
        """Post something the user should look at; about a topic it holds until that is settled, for a minute at most."""
        self.post(text, Level.WARNING, topic)

    def error(self, problem: BaseException | str, topic: object = None, holds: bool = True) -> None:
        """Post an error; an exception is shown as its own sentence.

        About a topic it `holds` until that is settled, unless it was an attempt that failed, such as the reading of a file.
        """
        text = str(problem) or type(problem).__name__
        remedy = str(getattr(problem, "remedy", ""))
        self.post(text, Level.ERROR, topic, remedy=remedy, holds=holds and topic is not None)

    def show_in_folder(self, path: Path) -> None:
        """Open the system's file manager where a file is."""
        try:
            show_in_folder(path)
            self.note(f"{path.name} is in {path.parent}.")
        except OSError as error:
            self.warn(f"No file manager opens ({error.strerror}); the file is {path}.")

    def settle(self, topic: object) -> None:
        """Settle what was said about a topic: it went well since. A note goes at once."""
        for at, message in reversed(list(enumerate(self.recent))):
            if message.topic == topic and not message.settled:
                if message.level is Level.NOTE:
                    del self.recent[at]
                else:
                    self.recent[at] = replace(message, settled=True)

    @property
    def current(self) -> Message | None:
        """What the status line shows now: the newest message, then again what still holds."""
        now = self.clock()
        begun = [message for message in self.recent if message.begins_s <= now]
        if begun and now <= begun[-1].ends_s:
            return begun[-1]
        return next((message for message in reversed(begun) if message.holds and not message.settled), None)
