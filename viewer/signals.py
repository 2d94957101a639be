"""Signals that end the program: they end the loop, and never the saving after it."""

from __future__ import annotations

import contextlib
import signal
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any

PATIENCE_S = 1.0  # a Ctrl+C later than this after the first one breaks off a frame that does not end


class Ending:
    """Calls `end` at SIGINT, SIGTERM and SIGHUP (a logout, a closed terminal), which then no longer kill the process.

    They raise nothing: an exception would get lost in a callback of the window, and a second signal, which is usual
    when a terminal closes or a user is impatient, would cut short the writing that the first one began. Only a frame
    that does not end is broken off, by a Ctrl+C with KeyboardInterrupt; once `saving` is set, nothing is.
    """

    def __init__(self, end: Callable[[], None]) -> None:
        self.saving = False
        self._end = end
        self._asked_s: float | None = None

    @contextlib.contextmanager
    def handled(self) -> Iterator[None]:
        """Take the signals within the block; before and after it they do what they did."""
        before: dict[int, Any] = {}
        if threading.current_thread() is threading.main_thread():  # no other one may set handlers
            names = ("SIGINT", "SIGTERM", "SIGHUP")  # Windows has no SIGHUP
            for number in filter(None, (getattr(signal, name, None) for name in names)):
                if signal.getsignal(number) not in (None, signal.SIG_IGN):  # `nohup` is obeyed
                    before[number] = signal.signal(number, self._signalled)
        try:
            yield
        finally:
            for number, handler in before.items():
                signal.signal(number, handler)

    def _signalled(self, number: int, _frame: object) -> None:
        now = time.monotonic()
        late = self._asked_s is not None and now - self._asked_s > PATIENCE_S
        self._asked_s = now if self._asked_s is None else self._asked_s
        self._end()
        if late and number == signal.SIGINT and not self.saving:
            raise KeyboardInterrupt
