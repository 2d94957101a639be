"""How far a batch is: a bar on a terminal, a line every tenth in a log."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TextIO

WIDTH = 24  # signs of the bar


@dataclass
class BatchProgress:
    """Counts rows; `kept` are those that were there already."""

    total: int
    kept: int = 0
    stream: TextIO = field(default_factory=lambda: sys.stderr)
    clock: Callable[[], float] = time.monotonic
    made: int = 0
    failed: int = 0
    _begun_s: float = field(init=False)

    def __post_init__(self) -> None:
        self._begun_s = self.clock()

    @property
    def per_minute(self) -> float:
        """Rows a minute since the start."""
        return 60.0 * (self.made + self.failed) / max(self.clock() - self._begun_s, 1e-6)

    def add(self, failed: bool) -> None:
        """One row is done."""
        before = self._tenth()
        self.failed, self.made = self.failed + failed, self.made + (not failed)
        if self.stream.isatty():
            end = "\n" if self._done() == self.total else ""
            print(f"\r{self.text()}\x1b[K", end=end, file=self.stream, flush=True)
        elif self._tenth() != before:
            print(f"sport: {self.text()}", file=self.stream, flush=True)

    def text(self) -> str:
        """Bar, counts, rows a minute, and the time that is left."""
        done, speed = self._done(), self.per_minute
        full = WIDTH * done // self.total
        left_s = (self.total - done) / max(speed, 1e-6) * 60.0
        left = f"{left_s / 60.0:.0f} min" if left_s >= 90.0 else f"{left_s:.0f} s"
        failed = f", {self.failed} failed" if self.failed else ""
        return f"[{'#' * full}{'.' * (WIDTH - full)}] {done} of {self.total} clips{failed}, {speed:.1f} a minute, {left} left"

    def _done(self) -> int:
        return self.kept + self.made + self.failed

    def _tenth(self) -> int:
        return 10 * self._done() // self.total
