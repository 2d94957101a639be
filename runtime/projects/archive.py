"""The container of a project: a ZIP of one JSON text and the arrays that it names, none of it compressed.

What is stored as it is cannot unfold to more than the file's size: one limit on that is a limit on everything.
"""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.atomic import atomic_path
from runtime.errors import FileError
from runtime.safe_read import parse_json, read_bounded, reason

MAX_BYTES = 1 << 30
MAX_TEXT_BYTES = 64 << 20
MAX_MEMBERS = 100_000
KINDS = ("<f4", "<f8", "|i1", "|u1")
DOCUMENT = "project.json"
REMEDY = "Choose another project, or an autosaved one."
_BEGINNING = (1980, 1, 1, 0, 0, 0)  # of time in a ZIP: the same content gives the same bytes
# what zipfile raises on damage
ZIP_ERRORS = (
    zipfile.BadZipFile,
    zipfile.LargeZipFile,
    NotImplementedError,
    RuntimeError,
    EOFError,
    OSError,
    ValueError,
    OverflowError,
    KeyError,
    IndexError,
    TypeError,
)


@dataclass
class ArchiveWriter:
    """Collects arrays, each once however often it is named, then writes them with the text that names them."""

    _arrays: list[NDArray[Any]] = field(default_factory=list)
    _known: dict[int, tuple[Any, int]] = field(default_factory=dict)  # by identity; the object is kept alive

    def array(self, values: Any, kind: str = "<f4") -> int:
        """The number under which an array of one of `KINDS` is stored."""
        known = self._known.get(id(values))
        if known is None:
            self._arrays.append(np.ascontiguousarray(values, np.dtype(kind)))
            self._known[id(values)] = known = (values, len(self._arrays) - 1)
        return known[1]

    def data(self, content: bytes) -> int:
        """The number under which bytes are stored."""
        known = self._known.get(id(content))
        if known is None:
            self._arrays.append(np.frombuffer(content, np.uint8))
            self._known[id(content)] = known = (content, len(self._arrays) - 1)
        return known[1]

    def save(self, path: Path, document: dict[str, Any]) -> None:
        """Write the archive whole or not at all; FileError."""
        table = [[a.dtype.str, list(a.shape)] for a in self._arrays]
        text = json.dumps({**document, "arrays": table}, ensure_ascii=True).encode("ascii")
        with atomic_path(path) as temporary, zipfile.ZipFile(temporary, "w", zipfile.ZIP_STORED) as file:
            file.writestr(zipfile.ZipInfo(DOCUMENT, _BEGINNING), text)
            for number, values in enumerate(self._arrays):
                file.writestr(zipfile.ZipInfo(f"arrays/{number}", _BEGINNING), values.tobytes())


@dataclass
class ArchiveReader:
    """The document of an archive, and its arrays by number."""

    path: Path
    document: dict[str, Any]
    _file: zipfile.ZipFile
    _table: Sequence[Any]

    @staticmethod
    def open(path: Path) -> ArchiveReader:
        """Read a file; FileError when it is no archive of this form, or too large."""
        data = read_bounded(path, MAX_BYTES, REMEDY)
        try:
            file = zipfile.ZipFile(io.BytesIO(data))
            _check(file)
            document = parse_json(file.read(DOCUMENT))
        except ZIP_ERRORS as error:
            raise FileError(f"{path}: not a project ({reason(error)}).", REMEDY) from error
        table = document.get("arrays") if isinstance(document, dict) else None
        if not isinstance(table, list) or len(table) > MAX_MEMBERS:
            raise FileError(f"{path}: not a project (no list of arrays).", REMEDY)
        return ArchiveReader(path, document, file, table)

    def array(self, number: Any, kind: str, shape: Sequence[int | None]) -> NDArray[Any]:
        """Array `number`, a copy; FileError unless it has this kind and shape (None: any length)."""
        try:
            named, sides = self._entry(number)
            wanted = named == kind and len(sides) == len(shape)
            if not wanted or any(b not in (None, a) for a, b in zip(sides, shape, strict=True)):
                raise ValueError(f"{named} {sides}, expected {kind} {list(shape)}")
            data = self._file.read(f"arrays/{number}")
            return np.frombuffer(data, kind).reshape(sides).copy()
        except ZIP_ERRORS as error:
            raise FileError(f"{self.path}: array {str(number)[:20]} ({reason(error)}).", REMEDY) from error

    def data(self, number: Any) -> bytes:
        """Bytes stored under a number."""
        return bytes(self.array(number, "|u1", (None,)).tobytes())

    def _entry(self, number: Any) -> tuple[str, list[int]]:
        if type(number) is not int or not 0 <= number < len(self._table):
            raise ValueError("there is none")
        kind, sides = self._table[number]
        if kind not in KINDS or not all(type(side) is int and 0 <= side <= MAX_BYTES for side in sides):
            raise ValueError("of another kind")
        return kind, list(sides)


def _check(file: zipfile.ZipFile) -> None:
    """ValueError for what this program does not write: too many members, compressed or encrypted ones."""
    members = file.infolist()
    if len(members) > MAX_MEMBERS:
        raise ValueError(f"{len(members)} members")
    if any(m.compress_type != zipfile.ZIP_STORED or m.file_size != m.compress_size for m in members):
        raise ValueError("compressed members")
    if any(m.flag_bits & 1 for m in members):
        raise ValueError("encrypted members")
    if sum(m.file_size for m in members) > MAX_BYTES:
        raise ValueError("members that overlap")
    if file.getinfo(DOCUMENT).file_size > MAX_TEXT_BYTES:
        raise ValueError("its text is too long")
