"""Untitled sessions in the data folder: the next start offers those with work; only what was offered before is removed.

Sessions with takes or recordings are removed last, and before them those with a path, poses or camera keys.
"""

import contextlib
import json
import os
import re
import tempfile
import time
import uuid
from dataclasses import dataclass
from pathlib import Path

from runtime.atomic import write_atomic
from runtime.errors import FileError, SportError
from runtime.interrupts import removed_when_ended
from runtime.safe_read import parse_json, read_bounded
from runtime.session.database import Database
from runtime.session.renewal import is_damage
from runtime.session.session_file import SessionFile
from runtime.session.sqlite_file import (
    ROOM_REMEDY,
    SUFFIX,
    Budget,
    drop_lock,
    file_errors,
    is_held,
    kept_aside,
    lock_of,
    side_files,
    take_lock,
    unwritten_files,
)

SUMMARY_BYTES = 8 << 20  # memory budget of a summary
OFFERED = "offered.json"  # names of the sessions that were offered last time
_NAME = re.compile(r"(\d{8}-\d{6})-(\d{4})-")


@dataclass(frozen=True)
class SessionSummary:
    """Description of a session in the list, before it is opened."""

    path: Path
    name: str  # of the project, or "Untitled"
    ended: bool  # closed normally; else the program was killed
    saved_s: float  # seconds since 1970
    takes: int  # in its list of takes
    seconds: float  # of all takes
    picture: bytes  # PNG; b"" for none
    recordings: int = 0  # all motions of the file, whether in the list, undone, removed or incomplete
    damaged: bool = False  # cannot be described before it is opened

    @property
    def has_motions(self) -> bool:
        """Whether the session contains, or may contain, takes or recordings."""
        return self.damaged or self.takes > 0 or self.recordings > 0


def new_path(folder: Path) -> Path:
    """Return a free path whose name sorts after all existing sessions, even if the clock was set back."""
    stamp, serial = time.strftime("%Y%m%d-%H%M%S"), 0
    for path in _sessions(folder):
        found = _NAME.match(path.name)
        if found is not None and (found[1], int(found[2])) >= (stamp, serial):
            stamp, serial = found[1], int(found[2]) + 1
    return folder / f"{stamp}-{serial:04d}-{uuid.uuid4().hex[:8]}{SUFFIX}"


def first_file(folder: Path, cache: Path) -> tuple[SessionFile, str]:
    """Create the file of an untitled session; also return why it is not in `folder`, or ""."""
    path = new_path(folder)
    try:
        with removed_when_ended(path, *side_files(path), lock_of(path)):
            return SessionFile.create(path, cache), ""
    except SportError as error:
        with file_errors(path, ROOM_REMEDY):
            place = Path(tempfile.mkdtemp(prefix="sport-"))
        file = SessionFile.create(new_path(place), place / "characters")
        return file, f"{error.problem} This session is in {file.path} until you save it elsewhere."


def find(folder: Path) -> list[SessionSummary]:
    """Return the sessions with work that no running process holds, newest first; empty ones are removed."""
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
    """Return the summary of a session; None if it is unreadable, empty, or held by a running process."""
    with contextlib.suppress(FileError, OSError):
        return None if is_held(path) else _summary(path)
    return None


def keep_newest(folder: Path, count: int = 10) -> list[SessionSummary]:
    """Return the result of `find`, removing the least valuable beyond `count` that an earlier call has already listed."""
    found = find(folder)
    known = _offered(folder)
    least_first = sorted(found[::-1], key=lambda summary: summary.has_motions)
    for old in least_first[: max(len(found) - count, 0)]:
        if old.path.name in known:
            remove(old.path)
            found.remove(old)
    names = [summary.path.name for summary in found]
    if set(names) != known:
        with contextlib.suppress(SportError):  # then none of these is removed next time
            write_atomic(folder / OFFERED, json.dumps(names))
    return found


def _offered(folder: Path) -> set[str]:
    """Return names of the sessions that an earlier call of `keep_newest` has listed."""
    try:
        names = parse_json(read_bounded(folder / OFFERED, SUMMARY_BYTES))
    except (SportError, ValueError):
        return set()
    return {name for name in names if isinstance(name, str)} if isinstance(names, list) else set()


def remove(path: Path) -> None:
    """Remove a session and its side files, unless it is held or cannot be removed."""
    with contextlib.suppress(FileError, OSError):
        handle = take_lock(path)
        try:
            for file in (path, *side_files(path), *unwritten_files(path), *kept_aside(path)):
                file.unlink(missing_ok=True)
        finally:
            drop_lock(handle, path)


def _sessions(folder: Path) -> list[Path]:
    try:
        return sorted((path for path in folder.iterdir() if path.suffix == SUFFIX), reverse=True)
    except OSError:
        return []


def _summary(path: Path) -> SessionSummary | None:
    """Return the summary of a session, None if it is empty. FileError or OSError if it is invalid or of a later version."""
    log = side_files(path)[0]
    saved_s = max(os.stat(file).st_mtime for file in ((path, log) if log.exists() else (path,)))
    damaged = SessionSummary(path, "Untitled", False, saved_s, 0, 0.0, b"", damaged=True)
    try:
        database = Database.read(path, thorough=False)
    except FileError as error:
        if not is_damage(error):
            raise
        return damaged
    database.budget = Budget(SUMMARY_BYTES, SUMMARY_BYTES)
    try:
        takes, edits = int(database.meta("takes", "0")), database.meta("edits", "1")
        recordings = len(database.frame_counts())
        if not (takes + recordings or (edits and database.steps())):
            return None
        seconds = max(0.0, min(float(database.meta("seconds", "0")), 1e9))  # 0 if it is not a number
        name, ended = database.meta("name") or "Untitled", database.meta("ended") == "1"
        picture = database.meta_bytes("picture")
        return SessionSummary(path, name, ended, saved_s, takes, seconds, picture, recordings)
    except (FileError, ValueError):
        return damaged
    finally:
        database.close()
