"""Cost of work, counted rather than timed; and limits for malicious files of unbounded cost."""

import sys
import time
import tracemalloc
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

BOMB_S = 60.0  # CPU time; valid files take less than a fiftieth of it
BOMB_BYTES = 500 << 20


def python_calls(work: Callable[[], Any]) -> int:
    """Count the Python function calls of some work on this thread."""
    count = 0

    def seen(_frame: FrameType, event: str, _argument: Any) -> None:
        nonlocal count
        count += event == "call"

    before = sys.getprofile()
    sys.setprofile(seen)
    try:
        work()
    finally:
        sys.setprofile(before)
    return count


@contextmanager
def allocated() -> Iterator[list[int]]:
    """Yield a list that gets the peak memory of Python and numpy, bytes."""
    peak: list[int] = []
    tracemalloc.start()
    try:
        yield peak
    finally:
        peak.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()


@contextmanager
def bounded() -> Iterator[None]:
    """Fail if a malicious file exceeds the limits."""
    begun = time.process_time()
    with allocated() as peak:
        yield
    assert time.process_time() - begun < BOMB_S
    assert peak[0] < BOMB_BYTES
