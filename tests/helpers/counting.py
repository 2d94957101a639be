"""What a piece of work costs, counted rather than timed; and bounds against files that are made to cost without end."""

import sys
import time
import tracemalloc
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

BOMB_S = 60.0  # of the processor; honest work takes less than a fiftieth of it
BOMB_BYTES = 500 << 20


def python_calls(work: Callable[[], Any]) -> int:
    """How many functions of Python the work calls on this thread."""
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
    """A list that gets the most bytes that Python and numpy held at once."""
    peak: list[int] = []
    tracemalloc.start()
    try:
        yield peak
    finally:
        peak.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()


@contextmanager
def bounded() -> Iterator[None]:
    """Fail where a hostile file costs more than it may."""
    begun = time.process_time()
    with allocated() as peak:
        yield
    assert time.process_time() - begun < BOMB_S
    assert peak[0] < BOMB_BYTES
