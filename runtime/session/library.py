"""Untitled sessions in the data folder: found by the next start, and removed when there are too many."""

from __future__ import annotations

import contextlib
import os
import re
import time
import uuid
from dataclasses import dataclass
from pathlib import Path

from runtime.errors import FileError
from runtime.session.database import Database
from runtime.session.sqlite_file import (
    SUFFIX,
    Budget,
    drop_lock,
    is_held,
    side_files,
    take_lock,
    unwritten_files,
)

SUMMARY_BYTES = 8 << 20  # that a summary may cost
_NAME = re.compile(r"(\d{8}-\d{6})-(\d{4})-")


@dataclass(frozen=True)
class SessionSummary:
    """What is shown of a session before it is opened."""

    path: Path
    name: str  # of the project, or "Untitled"
    ended: bool  # closed as planned; else it was cut off
    saved_s: float  # seconds since 1970
    takes: int
    seconds: float  # of all takes
    picture: bytes  # PNG; b"" for none


def new_path(folder: Path) -> Path:
    """A free path. Names sort by the order of the sessions, also where the clock was set back between them."""
    stamp, serial = time.strftime("%Y%m%d-%H%M%S"), 0
    for path in _sessions(folder):
        found = _NAME.match(path.name)
        if found is not None and (found[1], int(found[2])) >= (stamp, serial):
            stamp, serial = found[1], int(found[2]) + 1
    return folder / f"{stamp}-{serial:04d}-{uuid.uuid4().hex[:8]}{SUFFIX}"


def find(folder: Path) -> list[SessionSummary]:
    """Sessions that no living process holds, newest first. What cannot be read stays, unseen; what is empty goes."""
    found = []
    for path in _sessions(folder):
        if not is_held(path):
            with contextlib.suppress(FileError, OSError):
                summary = _summary(path)
                if summary is None:
                    remove(path)
                else:
                    found.append(summary)
    return found


def look_at(path: Path) -> SessionSummary | None:
    """What is shown of one session; None where it cannot be read, is empty, or is held by a living process."""
    with contextlib.suppress(FileError, OSError):
        return None if is_held(path) else _summary(path)
    return None


def keep_newest(folder: Path, count: int = 10) -> list[SessionSummary]:
    """What `find` finds, at most `count`: the older ones are removed."""
    found = find(folder)
    for old in found[count:]:
        remove(old.path)
    return found[:count]


def remove(path: Path) -> None:
    """Remove a session with its other files; one that is held or cannot be removed stays."""
    with contextlib.suppress(FileError, OSError):
        handle = take_lock(path)
        try:
            for file in (path, *side_files(path), *unwritten_files(path)):
                file.unlink(missing_ok=True)
        finally:
            drop_lock(handle, path)


def _sessions(folder: Path) -> list[Path]:
    try:
        return sorted((path for path in folder.iterdir() if path.suffix == SUFFIX), reverse=True)
    except OSError:
        return []


def _summary(path: Path) -> SessionSummary | None:
    """None for a session in which nothing was done."""
    saved_s = max(os.stat(file).st_mtime for file in (path, *side_files(path)[:1]) if file.exists())
    database = Database.read(path, thorough=False)
    database.budget = Budget(SUMMARY_BYTES, SUMMARY_BYTES)
    try:
        if not database.steps():
            return None
        with contextlib.suppress(ValueError):
            return SessionSummary(
                path,
                database.meta("name") or "Untitled",
                database.meta("ended") == "1",
                saved_s,
                int(database.meta("takes", "0")),
                max(0.0, min(float(database.meta("seconds", "0")), 1e9)),  # a number also where it says none
                database.meta_bytes("picture"),
            )
    finally:
        database.close()
    raise FileError(f"{path}: it does not say what it holds.")
