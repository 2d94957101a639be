"""Autosaved sessions: one file for each running viewer, held by a lock, found by the next start when it is let go of."""

from __future__ import annotations

import contextlib
import os
import re
import time
import uuid
from dataclasses import dataclass, field
from pathlib import Path

from runtime.errors import SportError
from runtime.file_lock import open_locked
from runtime.projects.archive import ArchiveReader
from runtime.projects.project import SUFFIX

INTERVAL_S = 6.0  # after a change; with the writing it stays below ten seconds
LOCK = ".lock"
KEPT_SESSIONS = 1  # that ended as planned
_NAME = re.compile(r"(\d{8}-\d{6})-(\d{4})-")


@dataclass(frozen=True)
class LeftBehind:
    """An autosaved session of a run that is over."""

    path: Path
    origin: str  # file of the project; "" for one that was never saved
    takes: int
    ended: bool  # as planned; else it was cut off
    saved_s: float  # seconds since 1970

    def describe(self) -> str:
        """Name, takes and time in a few words."""
        takes = f"{self.takes} take{'s' * (self.takes != 1)}"
        try:
            when = time.strftime("%d %b %H:%M:%S", time.localtime(self.saved_s))
        except (OverflowError, ValueError, OSError):  # of a clock that was far off
            when = "at an unknown time"
        return f"{Path(self.origin).stem or 'untitled'}, {takes}, {when}"


@dataclass
class AutosaveFile:
    """Where this session is autosaved."""

    folder: Path
    path: Path = field(init=False)
    written: bool = False
    _handle: int | None = None

    def __post_init__(self) -> None:
        self._name()

    def _name(self) -> None:
        """Names sort by the order of the sessions, also where the clock was set back between them."""
        stamp, serial = time.strftime("%Y%m%d-%H%M%S"), 0
        with contextlib.suppress(OSError):
            for path in self.folder.iterdir():
                found = _NAME.match(path.name)
                if found is not None and (found[1], int(found[2])) >= (stamp, serial):
                    stamp, serial = found[1], int(found[2]) + 1
        self.path = self.folder / f"{stamp}-{serial:04d}-{uuid.uuid4().hex[:8]}{SUFFIX}"

    def hold(self) -> None:
        """Take the lock, before the first writing; OSError."""
        if self._handle is None:
            self.folder.mkdir(parents=True, exist_ok=True)
            self._handle = open_locked(_lock_of(self.path), create=True)

    def leave(self, keep: bool) -> None:
        """Let go of the file, which the next start may find, or remove it; another one begins."""
        if not keep:
            remove(self.path)
        elif self._handle is not None:
            with contextlib.suppress(OSError):
                _lock_of(self.path).unlink()
        if self._handle is not None:
            os.close(self._handle)
        self._handle, self.written = None, False
        self._name()


def find_sessions(folder: Path) -> list[LeftBehind]:
    """Sessions that no living process holds, newest first. What cannot be read stays where it is, unseen."""
    found = []
    try:
        paths = [path for path in folder.iterdir() if path.suffix == SUFFIX]
    except OSError:
        return []
    for path in sorted(paths, reverse=True):
        if _held(path):
            continue
        with contextlib.suppress(SportError, OSError, KeyError, TypeError, AttributeError):
            found.append(_summary(path))
    return found


def held_sessions(folder: Path) -> set[Path]:
    """Sessions of living processes, and of one that was killed as long as the system has not ended all of its threads."""
    try:
        return {path for path in folder.iterdir() if path.suffix == SUFFIX and _held(path)}
    except OSError:
        return set()


def drop_old_sessions(folder: Path) -> None:
    """Of the sessions that ended as planned only the newest is kept."""
    for old in [left for left in find_sessions(folder) if left.ended][KEPT_SESSIONS:]:
        remove(old.path)


def remove(path: Path) -> None:
    """Remove a session and its lock; one that cannot be removed is offered again."""
    for file in (path, _lock_of(path)):
        with contextlib.suppress(OSError):
            file.unlink(missing_ok=True)


def _summary(path: Path) -> LeftBehind:
    document = ArchiveReader.open(path).document
    view = document["view"]
    return LeftBehind(
        path,
        str(view.get("origin", "")),
        len(document["takes"]),
        view.get("ended") is True,
        path.stat().st_mtime,
    )


def _held(path: Path) -> bool:
    lock = _lock_of(path)
    if not lock.exists():
        return False
    try:
        handle = open_locked(lock)
    except OSError:
        return False
    if handle is None:
        return True
    os.close(handle)
    return False


def _lock_of(path: Path) -> Path:
    return path.with_name(path.name + LOCK)
