"""Bytes that are needed again at the next save, on disk: in a file without a name, of which nothing is left at the end."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO


@dataclass(frozen=True)
class Place:
    """Where bytes are: in the file, or here where the disk had no room for them."""

    at: int
    length: int
    content: bytes | None = None


class Spool:
    """Grows only; a new one takes over what is still needed. One thread at a time."""

    def __init__(self, folder: Path | None = None) -> None:
        self._folder = folder
        self._file: BinaryIO | None = None
        self.size = 0  # bytes of the file

    def add(self, content: bytes) -> Place:
        """Keep bytes."""
        try:
            if self._file is None:
                if self._folder is not None:
                    self._folder.mkdir(parents=True, exist_ok=True)
                self._file = tempfile.TemporaryFile(dir=self._folder)  # noqa: SIM115
            self._file.seek(self.size)
            self._file.write(content)
            self._file.flush()
        except OSError:  # a full disk: the project may still have room on another one
            return Place(0, len(content), content)
        place = Place(self.size, len(content))
        self.size += len(content)
        return place

    def read(self, place: Place) -> bytes:
        """What was added there; OSError where the disk does not give it back."""
        if place.content is not None:
            return place.content
        if self._file is None:
            raise OSError("nothing was kept")
        self._file.seek(place.at)
        content = self._file.read(place.length)
        if len(content) != place.length:
            raise OSError("the kept bytes cannot be read")
        return content
