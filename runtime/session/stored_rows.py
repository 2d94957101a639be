"""Rows of a session file: read as untrusted, with every length checked before memory is allocated, and changed."""

import sqlite3
import threading
import zlib
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from runtime.errors import FileError
from runtime.session.sqlite_file import MAX_BUDGET_BYTES, REMEDY, Budget, file_errors
from runtime.session.tables import MAX_TEXT_BYTES, PAGE_BYTES, TAIL, Row, checksum, put_rows, sealed

MIN_PIECE_FRAMES, MAX_SMALL_PIECES = 100, 400  # of a motion on average; limit of small pieces, the newest
MAX_TAKE_TEXT_BYTES, MAX_TAKE_TEXTS = 1 << 18, 10_000  # size of a text, and how many are searched
ZLIB_LEVEL = 1  # of zlib


@dataclass
class StoredRows:
    """Reads the tables of a session; FileError for rows that are missing, damaged or exceed the budget."""

    path: Path  # with links resolved
    budget: Budget
    _reader: sqlite3.Connection | None = None
    # rows already charged to the budget, or written by this process
    _counted: set[tuple[Any, ...]] = field(default_factory=set)
    _reading: threading.RLock = field(default_factory=threading.RLock)

    def steps(self, count: int = -1) -> list[tuple[int, str]]:
        """Return (number, label) of the last `count` steps, or of all for -1."""
        size, order = "16 + length(CAST(label AS BLOB))", f"ORDER BY number DESC LIMIT {count}"
        return self._rows("steps", "number, label", (int, str), size, order=order)[::-1]

    def step(self, number: int) -> str:
        """Return the document of a step; FileError if there is none."""
        size = "length(CAST(document AS BLOB))"
        rows = self._rows("steps", "document", (str,), size, "number = ?", number)
        return self._one(rows, f"step {number}")[0]

    def blob(self, key: str) -> bytes:
        """Return a blob by key; FileError if there is none."""
        return self._content("blobs", "key = ?", key)

    def motion(self, key: str) -> str:
        """Return the header of a motion; FileError if there is none."""
        size = "length(CAST(header AS BLOB))"
        return self._one(self._rows("motions", "header", (str,), size, "key = ?", key), f"motion {key}")[0]

    def motions(self) -> list[str]:
        """Return the keys of all motions, oldest first."""
        rows = self._rows("motions", "key", (str,), "length(CAST(key AS BLOB))", order="ORDER BY number")
        return [key for (key,) in rows]

    def frame_counts(self) -> Counter[str]:
        """Return the stated frame count of each motion, oldest first."""
        size, order = "length(CAST(motion AS BLOB))", "GROUP BY motion ORDER BY min(rowid)"
        counts = Counter[str]()
        for key, count in self._rows("frames", "motion, sum(count)", (str, int), size, order=order):
            counts[key.removesuffix(TAIL)] += count
        return counts

    def text_blobs(self) -> list[tuple[str, int]]:
        """Return (key, length) of blobs that may be texts of takes, newest first."""
        size, where = "length(CAST(key AS BLOB))", f"size BETWEEN 2 AND {MAX_TAKE_TEXT_BYTES}"
        order = f"ORDER BY rowid DESC LIMIT {MAX_TAKE_TEXTS}"
        return self._rows("blobs", "key, size", (str, int), size, where, order=order)

    def lost(self) -> list[tuple[str, int, str]]:
        """Return (key, seconds since 1970, text) of lost items, oldest first."""
        size = "length(CAST(key AS BLOB)) + length(CAST(text AS BLOB))"
        return self._rows("lost", "key, since, text", (str, int, str), size, order="ORDER BY since, rowid")

    def frames(self, key: str) -> Iterator[tuple[int, bytes]]:
        """Yield the pieces of a motion in order: frame count, and content as given to `put_frames`."""
        order = "ORDER BY number"
        rows = self._rows("frames", "number, count", (int, int), "16", "motion = ?", key, order=order)
        if len(rows) > sum(count for _, count in rows) // MIN_PIECE_FRAMES + MAX_SMALL_PIECES:
            raise FileError(f"{self.path}: frames in {len(rows)} pieces.", REMEDY)
        for number, count in rows:
            yield count, self._content("frames", "motion = ? AND number = ?", key, number)

    def frame_count(self, key: str) -> int:
        """Return the stated frame count of a motion."""
        return sum(count for (count,) in self._rows("frames", "count", (int,), "8", "motion = ?", key))

    def meta(self, name: str, default: str = "") -> str:
        rows = self._rows("meta", "value", (str,), "length(CAST(value AS BLOB))", "name = ?", name)
        return rows[0][0] if rows else default

    def meta_bytes(self, name: str) -> bytes:
        """Return the metadata bytes under a name, or b""."""
        rows = self._rows("meta", "value", (bytes,), "length(value)", "name = ?", name)
        return rows[0][0] if rows else b""

    def _content(self, table: str, where: str, *values: Any) -> bytes:
        rows = self._rows(
            table, "size, content", (int, bytes), "max(size, 0) + length(content)", where, *values
        )
        size, content = self._one(rows, f"{table} {values[0]}")
        with file_errors(self.path):
            if not 0 <= size <= MAX_BUDGET_BYTES:
                raise ValueError(f"{size} bytes")
            unfold = zlib.decompressobj()
            made = unfold.decompress(content, size + 1)
            if len(made) != size or not unfold.eof or unfold.unused_data:
                raise ValueError(f"expected {size} bytes")
        return made

    def _one(self, rows: Sequence[Any], what: str) -> Any:
        if len(rows) != 1:
            raise FileError(f"{self.path}: {what[:80]} is missing.", REMEDY)
        return rows[0]

    def _rows(
        self,
        table: str,
        columns: str,
        kinds: tuple[type, ...],
        size: str,
        where: str = "1",
        *values: Any,
        order: str = "",
    ) -> Any:
        """Return rows of values of these types; their size is charged to the budget before they are read, once per query."""
        question = (table, *values)
        with self._reading, file_errors(self.path):
            if self._reader is None:
                raise ValueError("it is closed")
            if question not in self._counted:
                sized = (
                    f"SELECT coalesce(sum({size}), 0), coalesce(max({size}), 0) FROM {table} WHERE {where}"
                )
                total, most = self._reader.execute(sized, values).fetchone()
                if most > MAX_TEXT_BYTES and bytes not in kinds:
                    raise ValueError("a text is too long")
                self.budget.spend(total)
                self._counted.add(question)
            query = f"SELECT {columns} FROM {table} WHERE {where} {order}"
            rows = self._reader.execute(query, values).fetchall()
            if any(type(value) is not kind for row in rows for value, kind in zip(row, kinds, strict=True)):
                raise ValueError("a value is of another type")
        return rows


class Writer:
    """Changes the tables within one transaction of `Database.submit`, which takes effect as a whole or not at all."""

    def __init__(self, connection: sqlite3.Connection, counted: set[tuple[Any, ...]]) -> None:
        self._connection, self._run = connection, connection.execute
        self._many = connection.executemany
        self._counted = counted
        # called after the commit; not after a rollback
        self.committed: list[Callable[[], None]] = []

    def put_blob(self, key: str, content: bytes) -> None:
        """Store bytes under their hash, unless they exist already."""
        self._counted.add(("blobs", key))
        if self._run("SELECT 1 FROM blobs WHERE key = ?", (key,)).fetchone() is None:
            self._put("blobs", (key, len(content), zlib.compress(content, ZLIB_LEVEL)))

    def put_motion(self, key: str, header: str) -> None:
        """Store or replace the header of a motion; its position in the order stays."""
        self._counted.add(("motions", key))
        self._run(
            "INSERT INTO motions (key, header, checksum) VALUES (?, ?, ?)"
            " ON CONFLICT (key) DO UPDATE SET header = excluded.header, checksum = excluded.checksum",
            (key, header, checksum("motions", (0, key, header))),
        )

    def put_frames(self, key: str, number: int, count: int, content: bytes) -> None:
        """Store or replace piece `number` of a motion, with `count` frames."""
        self._counted.add(("frames", key, number))
        self._put("frames", (key, number, count, len(content), zlib.compress(content, ZLIB_LEVEL)))

    def drop_frames(self, key: str) -> None:
        self._run("DELETE FROM frames WHERE motion = ?", (key,))

    def put_step(self, number: int, label: str, document: str) -> None:
        """Store or replace a step of the history."""
        self._counted.add(("steps", number))
        self._put("steps", (number, label, document))

    def drop_step(self, number: int) -> None:
        self._run("DELETE FROM steps WHERE number = ?", (number,))

    def drop_steps(self, first: int | None = None, before: int | None = None) -> None:
        """Delete the steps from `first` on, and those before `before`."""
        self._run("DELETE FROM steps WHERE number >= ? OR number < ?", (first, before))

    def set_meta(self, name: str, value: str | bytes) -> None:
        self._counted.add(("meta", name))
        self._put("meta", (name, value))

    def documents(self) -> Iterator[str]:
        """Yield the documents of all steps, including changes of this transaction."""
        for (number,) in self._run("SELECT number FROM steps").fetchall():
            yield self._run("SELECT document FROM steps WHERE number = ?", (number,)).fetchone()[0]

    def motion(self, key: str) -> str:
        """Return the header of a motion, including changes of this transaction; "" if there is none."""
        found = self._run("SELECT header FROM motions WHERE key = ?", (key,)).fetchone()
        return "" if found is None else found[0]

    def blob(self, key: str) -> bytes:
        """Return a blob by key, including changes of this transaction, up to the size limit of texts; b"" if there is none."""
        found = self._run("SELECT content FROM blobs WHERE key = ?", (key,)).fetchone()
        return b"" if found is None else zlib.decompressobj().decompress(found[0], MAX_TEXT_BYTES)

    # --- lost items

    def lose(self, keys: Iterable[str], since_s: int, text: str = "") -> None:
        """Mark motions or blobs as lost since a time; items already marked keep theirs."""
        put_rows(self._connection, "lost", (sealed("lost", (key, since_s, text)) for key in keys), "IGNORE")

    def find(self, keys: Iterable[str]) -> None:
        """Remove the lost mark of motions or blobs."""
        self._many("DELETE FROM lost WHERE key = ?", ((key,) for key in keys))

    def lost(self) -> list[tuple[str, int, str]]:
        """Return (key, seconds since 1970, text) of lost items, oldest first."""
        return self._run("SELECT key, since, text FROM lost ORDER BY since, rowid").fetchall()

    def kept(self) -> tuple[list[str], list[str]]:
        """Return the keys of all motions, including those with frames only, and of all blobs."""
        motions = self._run("SELECT key FROM motions UNION SELECT motion FROM frames").fetchall()
        return [key for (key,) in motions], [key for (key,) in self._run("SELECT key FROM blobs")]

    def remove(self, keys: Collection[str]) -> None:
        """Delete motions with their frames, blobs, and their lost marks."""
        for table, column in (("motions", "key"), ("frames", "motion"), ("blobs", "key"), ("lost", "key")):
            self._many(f"DELETE FROM {table} WHERE {column} = ?", ((key,) for key in keys))

    def stored_bytes(self) -> int:
        """Return how many bytes of the file are in use."""
        pages, free = (self._run(f"PRAGMA {name}").fetchone()[0] for name in ("page_count", "freelist_count"))
        return int(PAGE_BYTES * (pages - free))

    def _put(self, table: str, row: Row) -> None:
        put_rows(self._connection, table, [sealed(table, row)], "REPLACE")
