"""Reads bytes, text and JSON from untrusted files: regular files only, with size limits."""

from __future__ import annotations

import json
import math
import os
import re
import stat
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, TypeGuard

from runtime.errors import FileError, SportError

if TYPE_CHECKING:
    from numpy.lib.npyio import NpzFile

MAX_JSON_ITEMS = 1_000_000  # an empty list of two bytes takes 56 in memory
MAX_DIGITS = 400
SAMPLED = 50  # one in this many characters is checked, to find longer numbers
# allowed unpacked size of an archive, and more per byte of it
MAX_NPZ_BYTES, NPZ_RATIO = 64 * 1024 * 1024, 16


def read_bounded(
    path: str | Path,
    limit: int,
    remedy: str = "Choose another file.",
    *,
    missing: str = "Check the path.",
    error: type[SportError] = FileError,
) -> bytes:
    """Return the bytes of a regular file; raise `error` if it is missing, larger than `limit`, or not a regular file.

    Pipes, sockets and devices are refused without blocking, and a growing file is read up to the limit.
    """
    with open_regular(path, missing=missing, error=error) as file:
        try:
            size = os.fstat(file.fileno()).st_size
            most = min(limit, max(size, 1 << 20))  # avoids allocating the whole limit
            data = b"" if size > limit else file.read(most + 1)
        except OSError as problem:
            raise error(f"{path}: {problem.strerror or problem}.", missing) from problem
    if max(size, len(data)) > limit:
        raise error(f"{path}: larger than {_size(limit)}.", remedy)
    return data


@contextmanager
def open_regular(
    path: str | Path, *, missing: str = "Check the path.", error: type[SportError] = FileError
) -> Iterator[BinaryIO]:
    """Open a regular file for reading; raise `error` if it is missing, a device or a pipe."""
    try:
        status = os.stat(path)
        # without O_NONBLOCK a pipe in its place would block forever
        flags = os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)
        handle = os.open(path, flags) if stat.S_ISREG(status.st_mode) else -1
        status = status if handle < 0 else os.fstat(handle)
    except OSError as problem:
        raise error(f"{path}: {problem.strerror or problem}.", missing) from problem
    except ValueError as problem:  # a zero byte in the name
        raise error(f"{str(path)[:80]!r}: not the name of a file.", missing) from problem
    if not stat.S_ISREG(status.st_mode):
        if handle >= 0:
            os.close(handle)
        kind = "a folder" if stat.S_ISDIR(status.st_mode) else "not a regular file"
        raise error(f"{path}: this is {kind}.", missing)
    with open(handle, "rb") as file:
        yield file


def check_source(path: str | Path) -> None:
    """Raise FileError if a file cannot be found; call it before the work that reads the file."""
    try:
        os.stat(path)
    except (OSError, ValueError) as problem:
        why = getattr(problem, "strerror", None) or "not the name of a file"
        raise FileError(f"{path}: {why}.", "Check the path.") from problem


def expanded(path: str | Path) -> Path:
    """Return a path with the home folder for its "~"; unlike `Path.expanduser`, as it is for a user who does not exist."""
    return Path(os.path.expanduser(path))


def _size(limit: int) -> str:
    return f"{limit >> 20} MB" if limit >= 1 << 20 else f"{limit} bytes"


def decode_text(data: bytes) -> str:
    """Decode bytes as UTF-8 or UTF-16, with or without a byte order mark, else as Latin-1, which never fails."""
    encoding = "utf-16" if data[:2] in (b"\xff\xfe", b"\xfe\xff") else "utf-8-sig"
    try:
        return data.decode(encoding)
    except UnicodeDecodeError:
        return data.decode("latin-1")


def parse_json(
    data: str | bytes,
    max_items: int = MAX_JSON_ITEMS,
    kind: type[dict[str, Any]] = dict,
    spend: Callable[[int], None] = lambda _: None,
) -> Any:
    """Return the value of a JSON text in UTF-8, its objects as `kind`.

    ValueError for anything that is not JSON, is too deep or has more than `max_items` items. `spend` gets their number
    before they are created.
    """
    text = data.decode("utf-8-sig") if isinstance(data, bytes) else data
    items = sum(text.count(sign) for sign in "[{,")
    if items > max_items:
        raise ValueError(f"more than {max_items} items")
    spend(items)
    many = re.search(rf"\d{{{MAX_DIGITS // SAMPLED}}}", text[::SAMPLED], re.ASCII)
    large = _integer if many else None  # Python's own is three times as fast
    try:
        return json.loads(text, parse_int=large, object_hook=None if kind is dict else kind)
    except RecursionError as error:
        raise ValueError("too deeply nested") from error


def _integer(digits: str) -> int | float:
    """Return the number of a whole text of digits; infinity for more digits than any field has, at which Python raises an error."""
    infinity = -math.inf if digits[0] == "-" else math.inf
    return int(digits) if len(digits) <= MAX_DIGITS else infinity


@contextmanager
def open_npz(
    path: str | Path, remedy: str = "Choose another file.", error: type[SportError] = FileError
) -> Iterator[NpzFile]:
    """Open an NPZ whose arrays are read when first used.

    Raises `error` if it holds objects or is too large, or if the block finds an array missing, damaged or of another type.
    """
    import zipfile
    import zlib

    import numpy as np

    damage = (
        OSError,
        ValueError,
        TypeError,
        LookupError,
        EOFError,
        RuntimeError,
        zipfile.BadZipFile,
        zlib.error,
    )
    try:
        if not Path(path).is_file():  # a pipe would block
            raise FileNotFoundError("there is no such file")
        _check_headers(path)
        with np.load(path, allow_pickle=False) as file:
            yield file
    except damage as problem:
        raise error(f"{path}: not readable as arrays ({reason(problem)}).", remedy) from problem


def _check_headers(path: str | Path) -> None:
    """Raise ValueError if the arrays of an NPZ contain objects, or more bytes than it may unpack to."""
    import zipfile

    import numpy as np

    readers = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}
    size, most = 0, MAX_NPZ_BYTES + NPZ_RATIO * os.stat(path).st_size
    with zipfile.ZipFile(path) as archive:
        for info in archive.infolist():
            with archive.open(info) as member:
                version = np.lib.format.read_magic(member)
                if version not in readers:
                    raise ValueError(f"{info.filename[:40]}: version {version} of NPY")
                shape, _, dtype = readers[version](member)
            size += math.prod(shape) * dtype.itemsize
            if dtype.hasobject or size > most:
                raise ValueError(f"{info.filename[:40]}: objects, or more than {_size(most)}")


def printable(text: object) -> str:
    """Return text that can be written as UTF-8: lone surrogates, as in undecodable file names, become U+FFFD."""
    return re.sub(r"[\ud800-\udfff]", "\ufffd", str(text))


def is_text(value: Any) -> TypeGuard[str]:
    """Return whether a JSON value is text without lone surrogates, so that it can be shown and written."""
    if not isinstance(value, str):
        return False
    try:
        value.encode("utf-8")
    except UnicodeEncodeError:
        return False
    return True


def reason(error: BaseException) -> str:
    """Return a library's error message, shortened to one line, for use in brackets."""
    said = " ".join(str(error).split())
    return (said if said and isinstance(error, OSError | ValueError) else f"{type(error).__name__}: {said}")[
        :160
    ]
