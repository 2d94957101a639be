"""Memory of this program: what it holds, and that the C library gives back what was let go of."""

from __future__ import annotations

import ctypes
import mmap
import sys
from pathlib import Path

_STATUS = Path("/proc/self/statm")
_PAGE_MB = mmap.PAGESIZE / 2**20
# of glibc's `mallopt`: heaps of threads, and the size from which on a block is mapped and unmapped by itself
_ARENA_MAX, _MMAP_THRESHOLD = -8, -3
ARENAS, MAPPED_BYTES = 2, 1 << 20


def give_back_large_blocks() -> None:
    """Blocks of a megabyte and more go back to the system when they are freed; call before threads are started.

    glibc else raises that limit to 32 MB and makes a heap for every thread: a quarter of the memory of a long session was
    free blocks in between. Other C libraries are left as they are.
    """
    _call_glibc("mallopt", _ARENA_MAX, ARENAS)
    _call_glibc("mallopt", _MMAP_THRESHOLD, MAPPED_BYTES)


def give_back_freed() -> None:
    """Hand what was freed in between back to the system: some milliseconds, and with glibc only."""
    _call_glibc("malloc_trim", 0)


def _call_glibc(name: str, *values: int) -> None:
    if sys.platform.startswith("linux"):
        function = getattr(ctypes.CDLL(None), name, None)
        if function is not None:
            function(*values)


def resident_mb() -> float:
    """Memory that this process holds; 0 where the system does not tell."""
    try:
        return int(_STATUS.read_text(encoding="ascii").split()[1]) * _PAGE_MB
    except (OSError, ValueError, IndexError):
        return 0.0
