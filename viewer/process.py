"""This process: its termination signals, its memory, and the file manager that it opens."""

import contextlib
import ctypes
import mmap
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from runtime.interrupts import SIGNALS, end_now

FRAME_S = 0.9  # time for the current frame after a signal


def show_in_folder(path: Path) -> None:
    """Open the system's file manager at a file; OSError if there is none."""
    commands = {"win32": ["explorer", f"/select,{path}"], "darwin": ["open", "-R", str(path)]}
    command = commands.get(sys.platform, ["xdg-open", str(path if path.is_dir() else path.parent)])
    subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True)


class Ending:
    """Calls `end` at SIGINT, SIGTERM and SIGHUP instead of killing the process.

    The handlers raise nothing: an exception would get lost in a callback of the window, and a second signal, common
    when a terminal closes, would interrupt the writing that the first one started. A frame that hangs, and writing that
    takes longer than `limit_s`, are abandoned.
    """

    def __init__(self, end: Callable[[], None], limit_s: float) -> None:
        self.number = 0  # of the first signal
        self.saving = threading.Event()  # set when the main loop has ended
        self._over = threading.Event()
        self._end, self._limit_s = end, limit_s

    @contextlib.contextmanager
    def handled(self) -> Iterator[None]:
        """Install the handlers within the block, and restore the previous ones after it."""
        before: dict[int, Any] = {}
        if threading.current_thread() is threading.main_thread():  # only the main thread may set handlers
            for number in SIGNALS:
                if signal.getsignal(number) not in (None, signal.SIG_IGN):  # `nohup` is respected
                    before[number] = signal.signal(number, self._signalled)
        try:
            yield
        finally:
            self._over.set()
            for number, handler in before.items():
                signal.signal(number, handler)

    def _signalled(self, number: int, _frame: object) -> None:
        if not self.number:
            self.number = number
            threading.Thread(target=self._watch, daemon=True).start()
            self._end()

    def _watch(self) -> None:
        until_s = time.monotonic() + self._limit_s
        in_time = self.saving.wait(FRAME_S) and self._over.wait(until_s - time.monotonic())
        if not in_time:
            end_now(self.number, "sport")


_STATUS = Path("/proc/self/statm")
_PAGE_MB = mmap.PAGESIZE / 2**20
# of glibc's `mallopt`: number of heaps, and block size above which memory is mapped separately
_ARENA_MAX, _MMAP_THRESHOLD = -8, -3
GROWN_MB = 24.0  # growth after which freed memory is returned
ARENAS, MAPPED_BYTES = 2, 1 << 20


def give_back_large_blocks() -> None:
    """Make glibc return freed blocks of a megabyte and more to the system; call before threads are started.

    By default glibc raises that limit to 32 MB and creates a heap per thread: a quarter of the memory in a long
    session was free blocks. Other C libraries are unaffected.
    """
    _call_glibc("mallopt", _ARENA_MAX, ARENAS)
    _call_glibc("mallopt", _MMAP_THRESHOLD, MAPPED_BYTES)


def _call_glibc(name: str, *values: int) -> None:
    if sys.platform.startswith("linux"):
        function = getattr(ctypes.CDLL(None), name, None)
        if function is not None:
            function(*values)


def resident_mb() -> float:
    """Return the resident memory of this process in MB; 0 if unknown."""
    try:
        return int(_STATUS.read_text(encoding="ascii").split()[1]) * _PAGE_MB
    except (OSError, ValueError, IndexError):
        return 0.0


@dataclass
class MemoryWatch:
    """Returns freed memory to the system when this process has grown."""

    mb: float = 0.0  # memory of this process; 0 if unknown
    _trimmed_mb: float = 0.0  # memory when freed blocks were last returned

    def look(self) -> None:
        """Measure the memory, and return freed memory if it grew much; call about once a second."""
        self.mb = resident_mb()
        if self.mb > self._trimmed_mb + GROWN_MB:
            _call_glibc("malloc_trim", 0)  # takes some milliseconds; glibc only
            self.mb = self._trimmed_mb = resident_mb()
        self._trimmed_mb = min(self._trimmed_mb, self.mb)  # shrunk memory may not grow back unnoticed
