"""The container of a project: a ZIP of one JSON text and the arrays that it names, each of them compressed by itself.

The members are stored as they are, so that the file's size bounds what is read; what an array unfolds to stands in the
text. Everything that one file makes in memory is counted against one `Budget` before it is made, by writer and reader.
"""

from __future__ import annotations

import hashlib
import io
import json
import math
import threading
import zipfile
import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from runtime.atomic import atomic_path
from runtime.errors import FileError
from runtime.projects.spool import Place, Spool
from runtime.safe_read import parse_json, read_bounded, reason

MAX_BYTES = 1 << 29
MAX_TEXT_BYTES = 16 << 20
MAX_TEXT_ITEMS = 400_000  # values of the text: 100 bytes each and more in memory
MAX_MEMBERS = 60_000
MAX_DIRECTORY_BYTES = 4 << 20  # of the ZIP
# a small file makes no more than this, a large one a multiple of its size
SMALL_BYTES, PER_BYTE, LARGE_BYTES = 128 << 20, 16, 3 << 29
KINDS = ("<f4", "<f8", "|i1", "|u1")
DOCUMENT = "project.json"
REMEDY = "Choose another project, or an autosaved one."
SMALLER = "Remove takes, or save some of them in a project of their own."
LEVEL = 6  # of zlib
SPARE_BYTES = 32 << 20  # of what is not needed any more in a spool
_BEGINNING = (1980, 1, 1, 0, 0, 0)  # of time in a ZIP: the same content gives the same bytes
# what zipfile raises on damage, and what else a file may cost
ZIP_ERRORS = (
    zipfile.BadZipFile,
    zipfile.LargeZipFile,
    zlib.error,
    NotImplementedError,
    RuntimeError,
    EOFError,
    OSError,
    ValueError,
    OverflowError,
    KeyError,
    IndexError,
    TypeError,
    MemoryError,
)
Made = TypeVar("Made")


@dataclass
class Budget:
    """What may still be made of a file, in bytes of memory."""

    left: int
    of: int = 0

    @staticmethod
    def for_file(size: int) -> Budget:
        """The budget of a file of `size` bytes."""
        most = min(SMALL_BYTES + PER_BYTE * size, LARGE_BYTES)
        return Budget(most, most)

    def spend(self, count: int) -> None:
        """Count what is about to be made; ValueError where it is too much."""
        self.left -= count
        if self.left < 0:
            raise ValueError(f"it unfolds to more than {self.of >> 20} MB")


@dataclass
class Packed:
    """What arrays came to when they were packed last: saving again packs only what is new. Safe between threads.

    The packed bytes are in a file of `folder`: of long lists of takes they would fill the memory.
    """

    folder: Path | None = None
    lock: threading.RLock = field(default_factory=threading.RLock)
    _spool: Spool = field(init=False)
    _content: dict[bytes, Place] = field(default_factory=dict)  # by the hash of what it unfolds to
    _known: dict[tuple[str, int], tuple[Any, Any]] = field(default_factory=dict)  # by kind and identity
    _used_content: set[bytes] = field(default_factory=set)
    _used: set[tuple[str, int]] = field(default_factory=set)

    def __post_init__(self) -> None:
        self._spool = Spool(self.folder)

    @property
    def bytes_on_disk(self) -> int:
        """Size of the file."""
        return self._spool.size

    def once(self, what: str, thing: Any, make: Callable[[], Made]) -> Made:
        """What `make` gives for a thing that does not change, made once for as long as it is saved."""
        key = what, id(thing)
        self._used.add(key)
        if key not in self._known:
            self._known[key] = thing, make()  # the thing is kept alive, and its identity with it
        return self._known[key][1]

    def compress(self, digest: bytes, values: NDArray[Any]) -> None:
        """Keep an array's bytes, compressed."""
        if digest not in self._content:
            content = zlib.compress(values.data.cast("B") if values.size else b"", LEVEL)
            self._content[digest] = self._spool.add(content)

    def content(self, digest: bytes) -> bytes:
        """What `compress` kept."""
        self._used_content.add(digest)
        return self._spool.read(self._content[digest])

    def forget_unused(self) -> None:
        """Keep only what was used since the last call."""
        self._content = {key: self._content[key] for key in self._used_content}
        self._known = {key: self._known[key] for key in self._used if key in self._known}
        self._used_content, self._used = set(), set()
        if self._spool.size > 2 * sum(place.length for place in self._content.values()) + SPARE_BYTES:
            before, self._spool = self._spool, Spool(self.folder)
            self._content = {key: self._spool.add(before.read(at)) for key, at in self._content.items()}


@dataclass
class ArchiveWriter:
    """Collects arrays, each content once, then writes them with the text that names them."""

    packed: Packed = field(default_factory=Packed)
    _table: list[list[Any]] = field(default_factory=list)
    _members: list[bytes] = field(default_factory=list)  # by their hashes
    _numbers: dict[bytes, int] = field(default_factory=dict)

    def array(self, values: Any, kind: str = "<f4") -> int:
        """The number under which an array of one of `KINDS` is stored."""
        return self._number(*self.packed.once(kind, values, lambda: self._kept(values, kind)))

    def data(self, content: bytes) -> int:
        """The number under which bytes are stored."""
        return self.array(content, "|u1")

    def pieces(self, what: str, thing: Any, make: Callable[[], Sequence[bytes]]) -> list[int]:
        """The numbers of the bytes that `make` gives for a thing that does not change; they are made once, and not kept here."""
        kept = self.packed.once(what, thing, lambda: [self._kept(piece, "|u1") for piece in make()])
        return [self._number(*each) for each in kept]

    def _kept(self, values: Any, kind: str) -> tuple[bytes, str, tuple[int, ...]]:
        """Hash, kind and shape of an array that was compressed."""
        plain = _as(values, kind)
        digest = _digest(plain)
        self.packed.compress(digest, plain)
        return digest, plain.dtype.str, plain.shape

    def _number(self, digest: bytes, kind: str, shape: tuple[int, ...]) -> int:
        if digest not in self._numbers:
            self._members.append(digest)
            self._table.append([kind, list(shape)])
            self._numbers[digest] = len(self._table) - 1
        return self._numbers[digest]

    def save(self, path: Path, document: dict[str, Any], check: Callable[[Path], object]) -> None:
        """Write the archive whole or not at all: it takes the place of `path` once `check` has read it; FileError."""
        text = json.dumps({**document, "arrays": self._table}, ensure_ascii=True).encode("ascii")
        with atomic_path(path) as temporary:
            with zipfile.ZipFile(temporary, "w", zipfile.ZIP_STORED) as file:
                file.writestr(zipfile.ZipInfo(DOCUMENT, _BEGINNING), text)
                for number, digest in enumerate(self._members):
                    file.writestr(
                        zipfile.ZipInfo(f"arrays/{number}", _BEGINNING), self.packed.content(digest)
                    )
            try:
                check(temporary)
            except FileError as error:
                problem = error.problem.removeprefix(f"{temporary}: ").rstrip(".")
                raise FileError(
                    f"{path}: not saved, as it could not be opened again ({problem}).", SMALLER
                ) from error


def _as(values: Any, kind: str) -> NDArray[Any]:
    if isinstance(values, bytes):
        return np.frombuffer(values, np.uint8)
    return np.ascontiguousarray(values, np.dtype(kind))


def _digest(values: NDArray[Any]) -> bytes:
    head = f"{values.dtype.str} {values.shape}".encode()
    return hashlib.blake2b(
        values.data.cast("B") if values.size else b"", digest_size=16, key=head[:64]
    ).digest()


@dataclass
class ArchiveReader:
    """The document of an archive, and its arrays by number. An array that is named twice is one array, not to be written to."""

    path: Path
    document: dict[str, Any]
    budget: Budget
    _file: zipfile.ZipFile
    _table: Sequence[Any]
    _made: dict[Any, Any] = field(default_factory=dict)
    _counted: set[Any] = field(default_factory=set)  # what was made and forgotten

    @staticmethod
    def open(path: Path) -> ArchiveReader:
        """Read a file; FileError when it is no archive of this form, or too large."""
        data = read_bounded(path, MAX_BYTES, REMEDY)
        try:
            if data[-22:-18] != b"PK\5\6" or int.from_bytes(data[-10:-6], "little") > MAX_DIRECTORY_BYTES:
                raise ValueError("not an archive that this program wrote")
            file = zipfile.ZipFile(io.BytesIO(data))
            _check(file)
            document = parse_json(file.read(DOCUMENT), MAX_TEXT_ITEMS)
        except ZIP_ERRORS as error:
            raise FileError(f"{path}: not a project ({reason(error)}).", REMEDY) from error
        table = document.get("arrays") if isinstance(document, dict) else None
        if not isinstance(table, list) or len(table) > MAX_MEMBERS:
            raise FileError(f"{path}: not a project (no list of arrays).", REMEDY)
        return ArchiveReader(path, document, Budget.for_file(len(data)), file, table)

    def once(self, what: str, key: Any, make: Callable[[], Made]) -> Made:
        """What `make` gives for a number of the file, made once however often the file names it."""
        if (what, key) not in self._made:
            before = self.budget.left
            self._made[what, key] = make()
            if (what, key) in self._counted:
                self.budget.left = before
        return self._made[what, key]

    def forget(self, *kinds: str) -> None:
        """Let go of what was made, of all `kinds` without any: it is made again where it is named again, and counted once."""
        gone = [key for key in self._made if not kinds or key[0] in kinds]
        self._counted.update(gone)
        for key in gone:
            del self._made[key]

    def array(self, number: Any, kind: str, shape: Sequence[int | None]) -> NDArray[Any]:
        """Array `number`; FileError unless it has this kind and shape (None: any length)."""
        try:
            named, sides = self._entry(number)
            wanted = named == kind and len(sides) == len(shape)
            if not wanted or any(b not in (None, a) for a, b in zip(sides, shape, strict=True)):
                raise ValueError(f"{named} {sides}, expected {kind} {list(shape)}")
            return self.once("array", number, lambda: self._unfolded(number, kind, sides))
        except ZIP_ERRORS as error:
            raise FileError(f"{self.path}: array {str(number)[:20]} ({reason(error)}).", REMEDY) from error

    def data(self, number: Any) -> bytes:
        """Bytes stored under a number."""
        return self.array(number, "|u1", (None,)).tobytes()

    def size(self, number: Any) -> int:
        """Bytes that an array says it has; FileError where there is none."""
        try:
            kind, sides = self._entry(number)
        except ZIP_ERRORS as error:
            raise FileError(f"{self.path}: array {str(number)[:20]} ({reason(error)}).", REMEDY) from error
        return math.prod(sides) * np.dtype(kind).itemsize

    def _unfolded(self, number: int, kind: str, sides: list[int]) -> NDArray[Any]:
        size = math.prod(sides) * np.dtype(kind).itemsize
        self.budget.spend(size)
        made, at = np.empty(size, np.uint8), 0
        unfold, rest = zlib.decompressobj(), self._file.read(f"arrays/{number}")
        while not unfold.eof:
            part = unfold.decompress(rest, 1 << 20)
            rest = unfold.unconsumed_tail
            if at + len(part) > size or not (part or unfold.eof):
                raise ValueError(f"expected {size} bytes")
            made[at : at + len(part)] = np.frombuffer(part, np.uint8)
            at += len(part)
        if at != size:
            raise ValueError(f"{at} bytes, expected {size}")
        made.flags.writeable = False
        return made.view(kind).reshape(sides)

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
