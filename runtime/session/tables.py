"""The tables of a session's file, their rows with a checksum each, and the checks of a foreign file."""

import contextlib
import sqlite3
import struct
import zlib
from collections.abc import Iterable, Iterator, Sequence
from functools import cache

APPLICATION_ID = 0x53504F52  # "SPOR"
SCHEMA_VERSION = 2
PLAIN_VERSION = 1  # without checksums and lost items
PAGE_BYTES = 4096
INPUT, TAIL = ".input", ".tail"  # suffixes of a motion's key, for its input and its newest frames
MAX_TEXT_BYTES = 16 << 20  # of one text
MAX_CONTENT_BYTES = 3 << 29  # of one unpacked content
MAX_ROWS = 100_000  # per table: a full file, 28 hours, has half
MAX_OPERATIONS = 400_000_000  # of SQLite's virtual machine while a file is checked: a full file needs a tenth
TABLES = {
    "meta": "name TEXT PRIMARY KEY, value",
    "steps": "number INTEGER PRIMARY KEY, label TEXT, document TEXT",
    "blobs": "key TEXT PRIMARY KEY, size INTEGER, content BLOB",  # size: unpacked
    "motions": "number INTEGER PRIMARY KEY, key TEXT UNIQUE, header TEXT",
    "frames": "motion TEXT, number INTEGER, count INTEGER, size INTEGER, content BLOB",
    # lost items, with the time in seconds since 1970: a motion, a blob, or the text of a step
    "lost": "key TEXT PRIMARY KEY, since INTEGER, text TEXT",
}
_TABLE_SUMS = {table: zlib.crc32(f"{SCHEMA_VERSION} {table}".encode()) for table in TABLES}
_SIZED = struct.Struct("<cq").pack  # of a value: its type, and its number or length
_KEYS = {"frames": "PRIMARY KEY (motion, number)"}
_TEXT = f"typeof({{0}}) = 'text' AND length(CAST({{0}} AS BLOB)) <= {MAX_TEXT_BYTES}"
_NUMBER = "typeof({0}) = 'integer' AND {0} BETWEEN {1} AND {2}"
_CONTENT = f"{_NUMBER.format('size', 0, MAX_CONTENT_BYTES)} AND typeof(content) = 'blob'"
_SOUND = {  # conditions on each row
    "meta": f"{_TEXT.format('name')} AND (typeof(value) = 'blob' OR {_TEXT.format('value')})",
    "steps": f"{_TEXT.format('label')} AND {_TEXT.format('document')}",
    "blobs": f"{_TEXT.format('key')} AND {_CONTENT}",
    "motions": f"{_TEXT.format('key')} AND {_TEXT.format('header')}",
    "frames": f"{_TEXT.format('motion')} AND {_NUMBER.format('number', 0, 2_000_000)} "
    f"AND {_NUMBER.format('count', 1, 1_000_000)} AND {_CONTENT}",
    "lost": f"{_TEXT.format('key')} AND {_NUMBER.format('since', 0, 1 << 40)} AND {_TEXT.format('text')}",
}
Value = str | int | bytes
Row = Sequence[Value]


class DamageError(ValueError):
    """Raised if rows or pages of a session differ from what was written."""


class VersionError(ValueError):
    """Raised if the file was written by a later version of the program."""


def checksum(table: str, row: Row) -> int:
    """Return the CRC-32 of a row without its checksum, and without the number of a motion, which only gives its position.

    It covers the table, then type, length and content of each value.
    """
    known = _TABLE_SUMS[table]
    for value in row[1:] if table == "motions" else row:
        if isinstance(value, int):
            known = zlib.crc32(_SIZED(b"i", value), known)
        else:
            content = value.encode("utf-8", "surrogatepass") if isinstance(value, str) else value
            known = zlib.crc32(content, zlib.crc32(_SIZED(b"c", len(content)), known))
    return known


def sealed(table: str, row: Row) -> tuple[Value, ...]:
    """Return a row with its checksum appended, as it is stored."""
    return (*row, checksum(table, row))


def create(connection: sqlite3.Connection, version: int = SCHEMA_VERSION) -> None:
    """Create the tables."""
    sums = version > PLAIN_VERSION
    for table, columns in TABLES.items():
        if table == "lost" and not sums:
            continue
        more = [columns, *(["checksum INTEGER"] if sums else []), *filter(None, [_KEYS.get(table)])]
        sound = _SOUND[table] + " AND typeof(checksum) = 'integer'"
        if not sums:
            sound = _SOUND[table].replace("2000000", "1000000")
        connection.execute(f"CREATE TABLE {table} ({', '.join(more)}, CHECK ({sound}))")
    connection.execute(f"PRAGMA application_id = {APPLICATION_ID}")
    connection.execute(f"PRAGMA user_version = {version}")


@cache
def _schema(version: int) -> list[tuple[str | None, ...]]:
    with contextlib.closing(sqlite3.connect(":memory:")) as connection:
        create(connection, version)
        return sorted(connection.execute("SELECT type, name, tbl_name, sql FROM sqlite_master"), key=str)


def version_of(connection: sqlite3.Connection) -> int:
    """Return the schema version of a file; ValueError or sqlite3.Error unless it has exactly the expected tables."""
    calls = iter(range(MAX_OPERATIONS // 100_000))
    connection.set_progress_handler(lambda: next(calls, None) is None, 100_000)
    program, version = (
        connection.execute(f"PRAGMA {name}").fetchone()[0] for name in ("application_id", "user_version")
    )
    if program != APPLICATION_ID:
        raise DamageError("it is not a session")
    if version not in (PLAIN_VERSION, SCHEMA_VERSION):
        raise VersionError(
            f"a later version of this program wrote it (format {version}, known {SCHEMA_VERSION})"
        )
    found = connection.execute("SELECT type, name, tbl_name, sql FROM sqlite_master LIMIT 20").fetchall()
    if sorted(found, key=str) != _schema(version):
        raise DamageError("it is not a session: its tables differ")
    return int(version)


def check_content(connection: sqlite3.Connection) -> None:
    """Raise ValueError or sqlite3.Error if there are too many rows, or a page or value is invalid.

    Pages are checked before values, so that the check of the values terminates.
    """
    for table in _tables(connection):
        query = f"SELECT count(*) FROM (SELECT 1 FROM {table} LIMIT {MAX_ROWS + 1})"
        if connection.execute(query).fetchone()[0] > MAX_ROWS:
            raise ValueError(f"more than {MAX_ROWS} rows")
    for (problem,) in connection.execute("PRAGMA quick_check(1)"):
        if problem != "ok":
            raise DamageError("it is damaged")
    for table in _tables(connection):  # SQLite ignores a CHECK when reading
        if connection.execute(f"SELECT 1 FROM {table} WHERE NOT ({_SOUND[table]}) LIMIT 1").fetchone():
            raise DamageError("a value is of another type or too large")


def _tables(connection: sqlite3.Connection) -> list[str]:
    version = connection.execute("PRAGMA user_version").fetchone()[0]
    return [table for table in TABLES if table != "lost" or version > PLAIN_VERSION]


def copy_rows(source: sqlite3.Connection, target: sqlite3.Connection) -> None:
    """Copy a consistent snapshot of all rows into another file's tables. Raises sqlite3.Error, DamageError."""
    source.execute("BEGIN")
    try:
        plain = source.execute("PRAGMA user_version").fetchone()[0] == PLAIN_VERSION
        for table in _tables(source):
            rows = source.execute(f"SELECT * FROM {table}")
            put_rows(target, table, (sealed(table, row) for row in rows) if plain else _checked(table, rows))
    finally:
        source.execute("COMMIT")


def put_rows(target: sqlite3.Connection, table: str, rows: Iterable[Row], known: str = "ABORT") -> None:
    """Insert rows with checksums; `known` is SQLite's conflict action for existing keys."""
    marks = ", ".join("?" * (TABLES[table].count(",") + 2))
    target.executemany(f"INSERT OR {known} INTO {table} VALUES ({marks})", rows)


def _checked(table: str, rows: Iterable[Row]) -> Iterator[Row]:
    for row in rows:
        if checksum(table, row[:-1]) != row[-1]:
            raise DamageError("it is damaged")
        yield row
