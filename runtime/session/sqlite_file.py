"""The SQLite file of a session: how it is created, locked and opened.

Only the rows of an opened file are used: they are copied into a new file. No SQL of a file runs, as its schema must
be that of `tables` and nothing else.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import shutil
import sqlite3
import stat
import time
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import quote

from runtime.assets import state_directory
from runtime.atomic import atomic_path
from runtime.errors import FileError
from runtime.file_lock import open_locked
from runtime.safe_read import reason
from runtime.session.tables import MAX_CONTENT_BYTES, PAGE_BYTES, VersionError, create

SUFFIX = ".sport"
MAX_FILE_BYTES = 1 << 29  # of the file, and of its log
MAX_VALUE_BYTES = (1 << 28) + (1 << 20)  # per stored row
# memory limit for a small file, and for a large one as a multiple of its size
MIN_BUDGET_BYTES, BUDGET_PER_FILE_BYTE, MAX_BUDGET_BYTES = 128 << 20, 16, MAX_CONTENT_BYTES
MAX_NAME_BYTES = 255  # of a file, on most systems
ASIDE, KEPT_ASIDE_DAYS = ".damaged-", 30  # part of a damaged session's name, and how long it is kept
REMEDY = "Choose another file, or an older copy of it."
ROOM_REMEDY = "Make room on the disk, or save a copy elsewhere."
_SAID = {
    sqlite3.SQLITE_FULL: f"there is no room left, or the session has reached {MAX_FILE_BYTES >> 20} MB",
    sqlite3.SQLITE_IOERR: "the disk cannot be read or written",
    sqlite3.SQLITE_CANTOPEN: "it cannot be opened",
    sqlite3.SQLITE_PERM: "it is write-protected",
    sqlite3.SQLITE_READONLY: "it is write-protected",
    sqlite3.SQLITE_BUSY: "another program has locked it",
    sqlite3.SQLITE_LOCKED: "another program has locked it",
    sqlite3.SQLITE_CORRUPT: "it is damaged",
    sqlite3.SQLITE_NOTADB: "it is not a session",
    sqlite3.SQLITE_CONSTRAINT: "a value is invalid",
}


_OF_CONTENT = (sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_NOTADB, sqlite3.SQLITE_CONSTRAINT)


class FileInUse(FileError):
    """Raised if another window or process has the session open."""


@dataclass
class Budget:
    """A limit on the bytes of memory that reading a file may use."""

    left: int
    of: int = 0

    @staticmethod
    def for_file(size: int) -> Budget:
        most = min(MIN_BUDGET_BYTES + BUDGET_PER_FILE_BYTE * size, MAX_BUDGET_BYTES)
        return Budget(most, most)

    def spend(self, count: int) -> None:
        """Subtract `count` bytes from the budget; ValueError if it is exceeded."""
        if count > self.left:
            raise ValueError(f"it unpacks to more than {self.of >> 20} MB")
        self.left -= count


def _code(error: Exception) -> int:
    """Return SQLite's primary error code, 0 for other errors; a log index without room counts as a full disk, too."""
    code: int = getattr(error, "sqlite_errorcode", 0)
    return sqlite3.SQLITE_FULL if code == sqlite3.SQLITE_IOERR_SHMSIZE else code & 0xFF


def said(error: Exception) -> str:
    """Return a description of an error of a file, for the user."""
    if isinstance(error, sqlite3.Error):
        return _SAID.get(_code(error), reason(error))
    if isinstance(error, zlib.error):
        return _SAID[sqlite3.SQLITE_CORRUPT]
    return getattr(error, "strerror", None) or reason(error)


@contextlib.contextmanager
def file_errors(path: Path, remedy: str = REMEDY) -> Iterator[None]:
    """Convert errors of SQLite, the system or invalid values in the block into a FileError that names `path`."""
    try:
        yield
    except (sqlite3.Error, OSError, ValueError, OverflowError, MemoryError, zlib.error) as error:
        code = _code(error)
        remedy = REMEDY if code in _OF_CONTENT else ROOM_REMEDY if code == sqlite3.SQLITE_FULL else remedy
        if isinstance(error, VersionError):
            remedy = "Update this program."
        raise FileError(f"{path}: {said(error)}.", remedy) from error


def side_files(path: Path) -> tuple[Path, Path]:
    """Return SQLite's write-ahead log of a file, and the index of the log."""
    return path.with_name(f"{path.name}-wal"), path.with_name(f"{path.name}-shm")


def unwritten_files(path: Path) -> tuple[Path, Path]:
    """Return the two places for changes that a session's file could not take: next to it, and in the user's state folder."""
    key = hashlib.sha256(os.fsencode(path)).hexdigest()[:16]
    name = _fitting(path.name, 44)  # its temporary file has a longer name still
    return path.with_name(f".{name}.unwritten"), state_directory() / "unwritten" / f"{key}.unwritten"


def _fitting(name: str, more: int) -> str:
    """Return a file name with room for `more` bytes: one that is too long is shortened and ends with its hash."""
    data = os.fsencode(name)
    if _name_size(name) + more <= MAX_NAME_BYTES:
        return name
    begin = data[: MAX_NAME_BYTES - more - 16].decode("utf-8", "ignore")
    return begin + hashlib.sha256(data).hexdigest()[:16]


def _name_size(name: str) -> int:
    """Return the length of a file name as its limit counts it: bytes, or on Windows UTF-16 units."""
    return len(name.encode("utf-16-le", "surrogatepass")) // 2 if os.name == "nt" else len(os.fsencode(name))


def _aside(path: Path) -> str:
    """Return the name prefix of damaged sessions kept by `keep_aside`; a time and a log's ending follow."""
    return _fitting(path.name, len(ASIDE) + 19) + ASIDE


def is_own(path: Path) -> bool:
    """Return whether a file or folder exists, is not a link, belongs to this user, and is writable by this user alone."""
    try:
        status = path.lstat()
    except OSError:
        return False
    if stat.S_ISLNK(status.st_mode):
        return False
    return not hasattr(os, "geteuid") or (status.st_uid == os.geteuid() and not status.st_mode & 0o022)


def keep_aside(path: Path, log: bool = True) -> Path:
    """Keep a copy of a session, with its log or alone, under another name next to it, for `KEPT_ASIDE_DAYS`; OSError."""
    aside = path.with_name(f"{_aside(path)}{time.strftime('%Y%m%d-%H%M%S')}")
    for file, kept in ((path, aside), (side_files(path)[0], side_files(aside)[0]))[: 1 + log]:
        if file.exists():
            try:
                os.link(file, kept)
            except OSError:  # a disk without hard links, such as FAT
                shutil.copyfile(file, kept)
    return aside


def kept_aside(path: Path, days: float = 0.0) -> list[Path]:
    """Return the copies that `keep_aside` made of a session more than `days` ago."""
    stamp = time.strftime("%Y%m%d-%H%M%S", time.localtime(time.time() - 86400.0 * days))
    begin = _aside(path)
    with contextlib.suppress(OSError):
        return [file for file in path.parent.iterdir() if begin < file.name <= begin + stamp + "~"]
    return []


def lock_of(path: Path) -> Path:
    """Return the small file whose lock says that a process has a session open."""
    return path.with_name(f".{_fitting(path.name, 6)}.lock")


def take_lock(path: Path) -> int:
    """Lock a session and return the descriptor of its lock file. Raises FileInUse, FileError."""
    with file_errors(path, "Open a copy of it, or choose a folder that can be written."):
        path.parent.mkdir(parents=True, exist_ok=True)
        for _ in range(3):  # a process that only checks the lock releases it at once
            handle = open_locked(lock_of(path), create=True)
            if handle is not None:
                return handle
    raise FileInUse(f"{path}: another window has it open.", "Close it there, or open a copy.")


def drop_lock(handle: int, path: Path) -> None:
    """Release a session's lock and remove the lock file."""
    with contextlib.suppress(OSError):  # a remaining lock file locks nothing
        lock_of(path).unlink()
    os.close(handle)


def is_held(path: Path) -> bool:
    """Return whether a running process, including this one, has a session open."""
    try:
        handle = open_locked(lock_of(path))
    except OSError:
        return False
    if handle is not None:
        os.close(handle)
    return handle is None


def real_path(path: Path) -> Path:
    """Return the path with links resolved, as SQLite's other files lie next to it; FileError if it is not a session's name."""
    try:
        real = Path(os.path.realpath(path))
        room = MAX_NAME_BYTES - _name_size(f"{real.name}-journal")
    except (OSError, ValueError) as error:
        raise FileError(f"{str(path)[:80]!r}: {reason(error)}.", "Check the path.") from error
    if room < 0:
        raise FileError(f"{path.name[:60]!r}: the name is {-room} bytes too long.", "Give it a shorter one.")
    return real


def check_files(path: Path) -> int:
    """Return the size in bytes of the file and its log; FileError if it is missing, too large, or not a regular file.

    The files are not opened: closing a file that SQLite has open would release its locks.
    """
    total = 0
    for file in (path, *side_files(path), path.with_name(f"{path.name}-journal")):
        try:
            status = file.lstat()
        except FileNotFoundError as error:
            if file == path:
                raise FileError(f"{path}: {error.strerror}.", "Check the path.") from error
            continue
        except (OSError, ValueError) as error:
            raise FileError(f"{path}: {said(error)}.", "Check the path.") from error
        if not stat.S_ISREG(status.st_mode):
            kind = "a folder" if stat.S_ISDIR(status.st_mode) else "not a regular file"
            raise FileError(f"{file}: this is {kind}.", "Check the path.")
        if file.name.endswith("-journal"):  # SQLite would replay it; this program never writes one
            raise FileError(f"{file}: this is of another program.", "Move it away.")
        if status.st_size > MAX_FILE_BYTES:
            raise FileError(f"{file}: larger than {MAX_FILE_BYTES >> 20} MB.", REMEDY)
        total += status.st_size
    return total


def connect(path: Path, mode: str) -> sqlite3.Connection:
    """Open a connection usable from any thread, one at a time; `mode` is rw, rwc, ro, immutable or memory. Raises sqlite3.Error."""
    address = f"file:{quote(os.fsencode(path.as_posix()), safe='/:')}"
    options = "mode=ro&immutable=1" if mode == "immutable" else f"mode={mode}"
    connection = sqlite3.connect(
        f"{address}?{options}", uri=True, timeout=1.0, isolation_level=None, check_same_thread=False
    )
    connection.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, MAX_VALUE_BYTES)
    connection.setlimit(sqlite3.SQLITE_LIMIT_SQL_LENGTH, 10_000)
    connection.setlimit(sqlite3.SQLITE_LIMIT_COLUMN, 20)
    connection.setlimit(sqlite3.SQLITE_LIMIT_TRIGGER_DEPTH, 1)
    connection.execute("PRAGMA trusted_schema = OFF")
    connection.execute("PRAGMA cell_size_check = ON")
    return connection


def connect_reader(path: Path) -> sqlite3.Connection:
    """Open a read-only connection to a file that may be open elsewhere too. Raises sqlite3.Error.

    Without a log or a writer no file is created for reading, since the folder may be read-only.
    """
    log = side_files(path)[0]
    alone = not is_held(path) and not (log.exists() and log.stat().st_size)
    return connect(path, "immutable" if alone else "ro")


def connect_writer(path: Path) -> sqlite3.Connection:
    """Open a connection for writing. Raises sqlite3.Error, FileError.

    Each commit is synced, so that a power failure loses no more than killing the process does.
    """
    connection = connect(path, "rw")
    if connection.execute("PRAGMA journal_mode = WAL").fetchone()[0] != "wal":
        connection.close()
        raise FileError(f"{path}: its disk cannot hold a session.", "Choose a folder on another disk.")
    connection.execute("PRAGMA synchronous = FULL")
    connection.execute("PRAGMA secure_delete = ON")  # removed data must not leave with the file
    page = connection.execute("PRAGMA page_size").fetchone()[0]
    connection.execute(f"PRAGMA max_page_count = {MAX_FILE_BYTES // page}")
    connection.execute("SELECT * FROM meta LIMIT 0")  # creates the log
    return connection


def in_memory() -> sqlite3.Connection:
    """Return an empty session database in memory."""
    memory = connect(Path(":memory:"), "memory")
    create(memory)
    return memory


@contextlib.contextmanager
def new_file(path: Path, before: Callable[[], None] = lambda: None) -> Iterator[sqlite3.Connection]:
    """Create a new file with the tables, which replaces `path` and its log when the block ends. Raises FileError.

    `before` is called before the file is replaced.
    """
    with atomic_path(path) as temporary, file_errors(path, ROOM_REMEDY):
        with contextlib.closing(connect(temporary, "rw")) as connection:
            # the file has no name yet: an interrupted one is discarded, and `atomic_path` syncs the rest
            connection.execute(f"PRAGMA page_size = {PAGE_BYTES}")
            connection.execute("PRAGMA journal_mode = OFF")
            connection.execute("PRAGMA synchronous = OFF")
            connection.execute("BEGIN")
            create(connection)
            yield connection
            connection.execute("COMMIT")
            connection.execute("PRAGMA journal_mode = WAL")
        check_files(temporary)
        before()
        # a remaining log would be read as the new file's
        for file in (*side_files(path), *unwritten_files(path)):
            file.unlink(missing_ok=True)
