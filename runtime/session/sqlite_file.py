"""The SQLite file of a session: its tables, how it is made whole, opened, and checked as untrusted.

Of a file that is opened only the rows are used: they are copied into a new file. No SQL of a file runs, as its schema must
be the text below and nothing else.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import sqlite3
import stat
import tempfile
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import quote

from runtime.atomic import atomic_path
from runtime.errors import FileError
from runtime.file_lock import open_locked
from runtime.safe_read import reason

SUFFIX = ".sport"
APPLICATION_ID = 0x53504F52  # "SPOR"
SCHEMA_VERSION = 1
MAX_BYTES = 1 << 29  # of the file, and of its log
MAX_VALUE_BYTES = (1 << 28) + (1 << 20)  # of one row as it is stored
MAX_TEXT_BYTES = 16 << 20  # of one text
MAX_ROWS = 1_000_000  # of one table
MAX_OPERATIONS = 400_000_000  # of SQLite's machine while a file is checked: a million rows cost a tenth
# a small file makes no more than this, a large one a multiple of its size
SMALL_BYTES, PER_BYTE, LARGE_BYTES = 128 << 20, 16, 3 << 29
REMEDY = "Choose another file, or an older copy of it."
ROOM = "Make room on the disk, or save a copy elsewhere."
TABLES = {
    "meta": "name TEXT PRIMARY KEY, value",
    "steps": "number INTEGER PRIMARY KEY, label TEXT, document TEXT",
    "blobs": "key TEXT PRIMARY KEY, size INTEGER, content BLOB",  # size: of what it unfolds to
    "motions": "number INTEGER PRIMARY KEY, key TEXT UNIQUE, header TEXT",
    "frames": "motion TEXT, number INTEGER, count INTEGER, size INTEGER, content BLOB, PRIMARY KEY (motion, number)",
}
_TEXT = f"typeof({{0}}) = 'text' AND length(CAST({{0}} AS BLOB)) <= {MAX_TEXT_BYTES}"
_NUMBER = "typeof({0}) = 'integer' AND {0} BETWEEN {1} AND {2}"
_CONTENT = f"{_NUMBER.format('size', 0, LARGE_BYTES)} AND typeof(content) = 'blob'"
_SOUND = {  # what is true of each row
    "meta": f"{_TEXT.format('name')} AND (typeof(value) = 'blob' OR {_TEXT.format('value')})",
    "steps": f"{_TEXT.format('label')} AND {_TEXT.format('document')}",
    "blobs": f"{_TEXT.format('key')} AND {_CONTENT}",
    "motions": f"{_TEXT.format('key')} AND {_TEXT.format('header')}",
    "frames": f"{_TEXT.format('motion')} AND {_NUMBER.format('number', 0, 1_000_000)} "
    f"AND {_NUMBER.format('count', 1, 1_000_000)} AND {_CONTENT}",
}
_SAID = {
    sqlite3.SQLITE_FULL: f"there is no room left, or the session has reached {MAX_BYTES >> 20} MB",
    sqlite3.SQLITE_IOERR: "the disk cannot be read or written",
    sqlite3.SQLITE_CANTOPEN: "it cannot be opened",
    sqlite3.SQLITE_PERM: "it must not be written",
    sqlite3.SQLITE_READONLY: "it must not be written",
    sqlite3.SQLITE_BUSY: "another program keeps it busy",
    sqlite3.SQLITE_LOCKED: "another program keeps it busy",
    sqlite3.SQLITE_CORRUPT: "it is damaged",
    sqlite3.SQLITE_NOTADB: "it is no session",
    sqlite3.SQLITE_CONSTRAINT: "a value is not as it must be",
}


_OF_CONTENT = (sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_NOTADB, sqlite3.SQLITE_CONSTRAINT)


class FileInUse(FileError):
    """Another window or process has the session open."""


@dataclass
class Budget:
    """What may still be made of a file, in bytes of memory."""

    left: int
    of: int = 0

    @staticmethod
    def for_file(size: int) -> Budget:
        most = min(SMALL_BYTES + PER_BYTE * size, LARGE_BYTES)
        return Budget(most, most)

    def spend(self, count: int) -> None:
        """Count what is about to be made; ValueError where it is too much."""
        self.left -= count
        if self.left < 0:
            raise ValueError(f"it unfolds to more than {self.of >> 20} MB")


def said(error: Exception) -> str:
    """What went wrong with a file, in a user's words."""
    code = getattr(error, "sqlite_errorcode", None)
    if code is not None:
        return _SAID.get(code & 0xFF, reason(error))
    if isinstance(error, zlib.error):
        return _SAID[sqlite3.SQLITE_CORRUPT]
    return getattr(error, "strerror", None) or reason(error)


@contextlib.contextmanager
def file_errors(path: Path, remedy: str = REMEDY) -> Iterator[None]:
    """Turn what SQLite, the system or a value that is none raises into a FileError that names `path`."""
    try:
        yield
    except (sqlite3.Error, OSError, ValueError, OverflowError, MemoryError, zlib.error) as error:
        if getattr(error, "sqlite_errorcode", 0) & 0xFF in _OF_CONTENT:
            remedy = REMEDY
        raise FileError(f"{path}: {said(error)}.", remedy) from error


def side_files(path: Path) -> tuple[Path, Path]:
    """SQLite's log of what is not in the file yet, and the index of it."""
    return path.with_name(f"{path.name}-wal"), path.with_name(f"{path.name}-shm")


def unwritten_files(path: Path) -> tuple[Path, Path]:
    """Where changes lie that a session's file had not taken, see `unwritten`: next to it, and in the temporary folder."""
    key = hashlib.sha256(os.fsencode(path)).hexdigest()[:16]
    folder = Path(tempfile.gettempdir()) / "sport-sessions"
    return path.with_name(f".{path.name}.unwritten"), folder / f"{key}.unwritten"


def lock_of(path: Path) -> Path:
    """The small file whose lock says that a process has a session open."""
    return path.with_name(f".{path.name}.lock")


def take_lock(path: Path) -> int:
    """The descriptor of the locked lock file; FileInUse, FileError."""
    with file_errors(path, "Open a copy of it, or choose a folder that can be written."):
        path.parent.mkdir(parents=True, exist_ok=True)
        for _ in range(3):  # a process that only looks lets go at once
            handle = open_locked(lock_of(path), create=True)
            if handle is not None:
                return handle
    raise FileInUse(f"{path}: another window has it open.", "Close it there, or open a copy.")


def drop_lock(handle: int, path: Path) -> None:
    """Let go, and remove the file that was locked."""
    with contextlib.suppress(OSError):  # one that stays locks nothing
        lock_of(path).unlink()
    os.close(handle)


def is_held(path: Path) -> bool:
    """Whether a living process has a session open, this one included."""
    try:
        handle = open_locked(lock_of(path))
    except OSError:
        return False
    if handle is not None:
        os.close(handle)
    return handle is None


def real_path(path: Path) -> Path:
    """The path without links, as SQLite's other files lie next to it; FileError when it is no name of a file."""
    try:
        return Path(os.path.realpath(path))
    except (OSError, ValueError) as error:
        raise FileError(f"{str(path)[:80]!r}: {reason(error)}.", "Check the path.") from error


def check_files(path: Path) -> int:
    """Bytes of the file and its log; FileError for what is missing, too large, or no regular file.

    They are not opened: to close a file that SQLite has open would take its locks away.
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
        if file.name.endswith("-journal"):  # SQLite would do what it says; this program writes none
            raise FileError(f"{file}: this is of another program.", "Move it away.")
        if status.st_size > MAX_BYTES:
            raise FileError(f"{file}: larger than {MAX_BYTES >> 20} MB.", REMEDY)
        total += status.st_size
    return total


def connect(path: Path, mode: str) -> sqlite3.Connection:
    """A connection of which every thread may make use, one at a time; `mode` is rw, rwc, ro, immutable or memory.

    sqlite3.Error where the file cannot be opened.
    """
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
    """A connection for reading only, of a file that is open elsewhere too; sqlite3.Error.

    Where there is no log, and nothing that writes one, no file is made for the reading: the folder may be read-only.
    """
    log = side_files(path)[0]
    alone = not is_held(path) and not (log.exists() and log.stat().st_size)
    return connect(path, "immutable" if alone else "ro")


def connect_writer(path: Path) -> sqlite3.Connection:
    """A connection for writing; sqlite3.Error or FileError.

    Each commit is synced: a machine that loses power loses what was not written yet, as a process that is killed.
    """
    connection = connect(path, "rw")
    if connection.execute("PRAGMA journal_mode = WAL").fetchone()[0] != "wal":
        connection.close()
        raise FileError(f"{path}: its disk cannot hold a session.", "Choose a folder on another disk.")
    connection.execute("PRAGMA synchronous = FULL")
    connection.execute("PRAGMA secure_delete = ON")  # what was removed does not leave with the file
    page = connection.execute("PRAGMA page_size").fetchone()[0]
    connection.execute(f"PRAGMA max_page_count = {MAX_BYTES // page}")
    connection.execute("SELECT * FROM meta LIMIT 0")  # the log is there from now on
    return connection


def check_schema(connection: sqlite3.Connection) -> None:
    """ValueError or sqlite3.Error unless the file has our tables and nothing else."""
    calls = iter(range(MAX_OPERATIONS // 100_000))
    connection.set_progress_handler(lambda: next(calls, None) is None, 100_000)
    numbers = [
        connection.execute(f"PRAGMA {name}").fetchone()[0] for name in ("application_id", "user_version")
    ]
    if numbers[0] != APPLICATION_ID:
        raise ValueError("it is no session")
    if numbers[1] != SCHEMA_VERSION:
        raise ValueError(f"version {numbers[1]} of the format, expected {SCHEMA_VERSION}")
    found = connection.execute("SELECT type, name, tbl_name, sql FROM sqlite_master LIMIT 20").fetchall()
    if sorted(found, key=str) != _schema():
        raise ValueError("it is no session: its tables are others")


def check_content(connection: sqlite3.Connection) -> None:
    """ValueError or sqlite3.Error unless the pages are sound, the values of their types, and the rows not too many.

    The check of the pages comes first: none is part of two things then, and what follows ends.
    """
    for (problem,) in connection.execute("PRAGMA quick_check(1)"):
        if problem != "ok":
            raise ValueError("it is damaged")
    for table, sound in _SOUND.items():  # SQLite ignores a CHECK where it only reads
        query = f"SELECT count(*), total(NOT ({sound})) FROM {table}"
        rows, wrong = connection.execute(query).fetchone()
        if rows > MAX_ROWS:
            raise ValueError(f"more than {MAX_ROWS} rows")
        if wrong:
            raise ValueError("a value is of another type or too large")


def _create(connection: sqlite3.Connection) -> None:
    for table, columns in TABLES.items():
        connection.execute(f"CREATE TABLE {table} ({columns}, CHECK ({_SOUND[table]}))")
    connection.execute(f"PRAGMA application_id = {APPLICATION_ID}")
    connection.execute(f"PRAGMA user_version = {SCHEMA_VERSION}")


def _schema() -> list[tuple[str | None, ...]]:
    with contextlib.closing(sqlite3.connect(":memory:")) as connection:
        _create(connection)
        return sorted(connection.execute("SELECT type, name, tbl_name, sql FROM sqlite_master"), key=str)


def in_memory() -> sqlite3.Connection:
    """An empty session that is no file."""
    memory = connect(Path(":memory:"), "memory")
    _create(memory)
    return memory


@contextlib.contextmanager
def new_file(path: Path) -> Iterator[sqlite3.Connection]:
    """A connection to a new file that takes the place of `path`, its log included, when the block ends; FileError.

    It has the tables, and is checked like one that is opened first.
    """
    with atomic_path(path) as temporary, file_errors(path, ROOM):
        with contextlib.closing(connect(temporary, "rw")) as connection:
            # the file has no name yet: what is cut off is thrown away, and `atomic_path` syncs the rest
            connection.execute("PRAGMA journal_mode = OFF")
            connection.execute("PRAGMA synchronous = OFF")
            connection.execute("BEGIN")
            _create(connection)
            yield connection
            connection.execute("COMMIT")
            connection.execute("PRAGMA journal_mode = WAL")
        with contextlib.closing(connect(temporary, "immutable")) as connection:
            check_schema(connection)
            check_content(connection)
        check_files(temporary)
        # what stayed would be read as the new file's
        for file in (*side_files(path), *unwritten_files(path)):
            file.unlink(missing_ok=True)


def copy_rows(source: sqlite3.Connection, target: sqlite3.Connection) -> None:
    """Put the rows of one file into the tables of another, as they are at one moment; sqlite3.Error."""
    source.execute("BEGIN")
    try:
        for table in TABLES:
            rows = source.execute(f"SELECT * FROM {table}")
            first = rows.fetchone()
            if first is not None:
                insert = f"INSERT INTO {table} VALUES ({', '.join('?' * len(first))})"
                target.execute(insert, first)
                target.executemany(insert, rows)
    finally:
        source.execute("COMMIT")
