"""A file held by this process alone: the system releases the lock however the process ends."""

import os
import sys
from pathlib import Path

_FAR = 0x7FFF0000  # Windows locks bytes, which then cannot be read: this offset is beyond any of our files


def open_locked(path: Path, create: bool = False, wait: bool = False) -> int | None:
    """Open `path` for reading and writing with an exclusive lock; return its descriptor, or None if another process holds the lock.

    `create` makes a missing file, `wait` waits for the other process. Raises OSError if it cannot be opened. Closing
    the descriptor releases the lock.
    """
    flags = (
        os.O_RDWR | getattr(os, "O_BINARY", 0) | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0)
    )
    handle = os.open(path, flags | (os.O_CREAT if create else 0), 0o600)
    try:
        # another process may have removed the file between the opening and the lock
        if _lock(handle, wait) and os.path.samestat(os.fstat(handle), os.stat(path)):
            return handle
    except FileNotFoundError:
        pass
    except BaseException:
        os.close(handle)
        raise
    os.close(handle)
    return None


def _lock(handle: int, wait: bool) -> bool:
    try:
        if sys.platform == "win32":
            import msvcrt

            os.lseek(handle, _FAR, os.SEEK_SET)
            msvcrt.locking(handle, msvcrt.LK_LOCK if wait else msvcrt.LK_NBLCK, 1)
            os.lseek(handle, 0, os.SEEK_SET)
        else:
            import fcntl

            fcntl.flock(handle, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
    except OSError:
        return False
    return True
