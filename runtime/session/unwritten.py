"""Changes that were not in a session's file when the program ended: the next process that opens it applies them.

They are calls of `Writer` in order, as JSON. Applying them twice has no further effect, so a file that already contains
some of them ends up in the same state.
"""

from __future__ import annotations

import base64
import contextlib
import json
import os
import sqlite3
import threading
import time
import uuid
import zlib
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

from runtime.errors import FileError
from runtime.safe_read import parse_json, read_bounded
from runtime.session.sqlite_file import BUDGET_PER_FILE_BYTE, MAX_FILE_BYTES, is_own, unwritten_files
from runtime.session.stored_rows import Writer

Change = tuple[str, list[Any], dict[str, Any]]  # a method of `Writer` and its arguments
CHANGES = (
    "put_blob", "put_motion", "put_frames", "drop_frames", "put_step", "drop_step", "drop_steps", "set_meta",
    "lose", "find",
)  # fmt: skip
# results of the other methods of `Writer`; old lost items are removed when the session is opened
NOTHING_READ: dict[str, Any] = {
    "documents": (), "motion": "", "blob": b"", "lost": [], "kept": ([], []), "remove": None, "stored_bytes": 0,
}  # fmt: skip
MIN_UNFOLDED_BYTES = 64 << 20  # unpacked size allowed for a small file, see `BUDGET_PER_FILE_BYTE`
MAX_ITEMS = 1 << 25  # including commas within texts
MAX_CHANGES = 200_000
REMEDY = "Move it away to open the session without its last changes."


class ChangeLog:
    """Records the calls of `Writer` methods instead of making changes."""

    def __init__(self) -> None:
        self.changes: list[Change] = []
        self.committed: list[Callable[[], None]] = []

    def __getattr__(self, name: str) -> Callable[..., Any]:
        if name in NOTHING_READ:
            return lambda *_: NOTHING_READ[name]
        if name not in CHANGES:
            raise AttributeError(name)
        return lambda *values, **named: self.changes.append((name, list(values), named))


def keep(path: Path, changes: Sequence[Change], seconds: float) -> Path | None:
    """Store changes for the next process that opens `path`; return the file that holds them, or None.

    They go next to the session, or into the user's state folder if that disk is full or hangs. They are not synced,
    since only this process ends.
    """
    text = json.dumps(changes, default=_as_json)
    content, until = zlib.compress(text.encode("ascii"), 1), time.monotonic() + seconds
    for file, patience in zip(unwritten_files(path), (0.5, 1.0), strict=True):
        kept = threading.Event()
        threading.Thread(target=_write, args=(file, content, kept), daemon=True).start()
        with contextlib.suppress(OSError):
            in_time = kept.wait(patience * max(until - time.monotonic(), 0.0))
            if in_time and file.stat().st_size == len(content):
                return file
    return None


def _as_json(value: bytes | Iterable[str]) -> dict[str, str] | list[str]:
    if isinstance(value, bytes):
        return {"bytes": base64.b64encode(value).decode("ascii")}
    return sorted(value)


def _write(file: Path, content: bytes, done: threading.Event) -> None:
    """Write a file of this user's own; no link is followed, and only own files are replaced."""
    temporary = file.with_name(f"{file.name}.{uuid.uuid4().hex}")
    try:
        file.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        if file.name.startswith(".") or is_own(file.parent):
            with open(os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "wb") as opened:
                opened.write(content)
            temporary.replace(file)
    except OSError:
        with contextlib.suppress(OSError):  # `keep` notices that it is missing
            temporary.unlink(missing_ok=True)
    done.set()


def read(path: Path) -> list[Change]:
    """Return the stored changes of a session's file, ignoring those of other users; FileError if they are damaged."""
    files = [file for file in unwritten_files(path) if is_own(file)]
    changes: list[Change] = []
    for file in sorted(files, key=lambda file: file.stat().st_mtime):
        try:
            unfold, content = zlib.decompressobj(), read_bounded(file, MAX_FILE_BYTES, REMEDY)
            text = unfold.decompress(content, MIN_UNFOLDED_BYTES + BUDGET_PER_FILE_BYTE * len(content))
            if not unfold.eof or text.count(b"], {") > 2 * MAX_CHANGES:
                raise ValueError("truncated, or too large when unpacked")
            changes += [_change(value) for value in parse_json(text, MAX_ITEMS)]
            if len(changes) > MAX_CHANGES:
                raise ValueError("more changes than are ever waiting")
        except (ValueError, TypeError, KeyError, zlib.error) as error:
            raise FileError(f"{file}: damaged.", REMEDY) from error
    return changes


def _change(value: Any) -> Change:
    name, values, named = value
    if name not in CHANGES:
        raise ValueError(name)
    return name, [base64.b64decode(v["bytes"]) if isinstance(v, dict) else v for v in values], dict(named)


def make(changes: Iterable[Change], connection: sqlite3.Connection) -> None:
    """Apply stored changes to a file. Raises ValueError, sqlite3.Error."""
    writer = Writer(connection, set())
    try:
        for name, values, named in changes:
            getattr(writer, name)(*values, **named)
    except TypeError as error:
        raise ValueError("its last changes are damaged") from error
