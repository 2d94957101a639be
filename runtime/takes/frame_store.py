"""Frames of takes on disk: a take that nobody looks at holds no memory, and is read by page as before.

The file has no name, so that nothing of it is left when the program ends in whatever way. It grows by extents; what an
extent held goes back to the disk with the last clip in it.
"""

from __future__ import annotations

import contextlib
import mmap
import tempfile
import threading
from collections.abc import Sequence
from pathlib import Path
from typing import BinaryIO
from weakref import WeakSet

import numpy as np

from runtime.arrays import Array
from runtime.errors import FileError
from runtime.takes.clip import Clip

EXTENT = 32 << 20  # bytes; a take that is larger has one of its own
ALIGNED = 64
REMEDY = "Make room on the disk, or export takes and remove them from the list."


class FrameStore:
    """Keeps the arrays of clips in files of `folder`."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._file: BinaryIO | None = None
        self._map: mmap.mmap | None = None
        self._used = self._size = 0
        self._maps: WeakSet[mmap.mmap] = WeakSet()
        self._lock = threading.Lock()

    @staticmethod
    def holds(clip: Clip) -> bool:
        """Whether the frames of a clip are in a file."""
        base: object = clip.local_rotations
        while isinstance(base, np.ndarray):
            base = base.base
        return isinstance(base.obj if isinstance(base, memoryview) else base, mmap.mmap)

    def move(self, clips: Sequence[Clip]) -> None:
        """Put the frames of clips into the file: the clips are the same ones afterwards, with equal arrays.

        FileError where there is no room; the frames that were not written stay in memory.
        """
        with self._lock:
            try:
                self._folder.mkdir(parents=True, exist_ok=True)
                for clip in clips:
                    arrays = (clip.hips_positions, clip.local_rotations, clip.contacts)
                    clip.move(*self._written(arrays))
                if self._map is not None:
                    _let_go(self._map)  # what was just compared
            except (OSError, ValueError) as error:  # a mapping that cannot be made is a ValueError
                reason = getattr(error, "strerror", None) or error
                raise FileError(f"{self._folder}: {reason}; takes stay in memory.", REMEDY) from error

    def let_go(self) -> None:
        """Give the memory back that was read into; it is read again when a clip is looked at."""
        for held in list(self._maps):
            _let_go(held)

    def _written(self, arrays: Sequence[Array]) -> list[Array]:
        whole = sum(-(-array.nbytes // ALIGNED) * ALIGNED for array in arrays)
        file, mapped = self._room(whole)
        views = []
        for array in arrays:
            file.seek(self._used)
            file.write(np.ascontiguousarray(array).data)
            file.flush()
            view = np.frombuffer(mapped, array.dtype, array.size, self._used).reshape(array.shape)
            if not np.array_equal(view, array):
                raise OSError("what was written is not what is read")
            views.append(view)
            self._used += -(-array.nbytes // ALIGNED) * ALIGNED
        return views

    def _room(self, size: int) -> tuple[BinaryIO, mmap.mmap]:
        """The extent that has room for so many bytes: the last one, or a new one."""
        if self._file is not None and self._map is not None and self._used + size <= self._size:
            return self._file, self._map
        self.close()
        self._size = max(size, EXTENT)
        self._file = file = tempfile.TemporaryFile(dir=self._folder)  # noqa: SIM115
        file.truncate(self._size)
        self._map = mapped = mmap.mmap(file.fileno(), self._size, access=mmap.ACCESS_READ)
        self._maps.add(mapped)
        return file, mapped

    def close(self) -> None:
        """Write to the extent no more; it lives as long as a clip in it."""
        if self._file is not None:
            self._file.close()
        self._file = self._map = None
        self._used = self._size = 0


def _let_go(held: mmap.mmap) -> None:
    if hasattr(mmap.mmap, "madvise"):
        with contextlib.suppress(ValueError, OSError):  # only advice
            held.madvise(mmap.MADV_DONTNEED)
