"""What may be changed in a session's file."""

from __future__ import annotations

import sqlite3
import zlib
from collections.abc import Callable, Collection, Iterable, Iterator
from typing import Any

from runtime.session.tables import MAX_TEXT_BYTES, PAGE_BYTES, Row, checksum, put_rows, sealed

ZLIB_LEVEL = 1  # of zlib


class Writer:
    """What a work may change, one for each transaction. Only within `Database.submit`; nothing of it lasts unless all does."""

    def __init__(self, connection: sqlite3.Connection, counted: set[tuple[Any, ...]]) -> None:
        self._connection, self._run = connection, connection.execute
        self._many = connection.executemany
        self._counted = counted
        # called once all of it lasts; not where it is rolled back
        self.committed: list[Callable[[], None]] = []

    def put_blob(self, key: str, content: bytes) -> None:
        """Keep bytes under the hash of their content; once is enough."""
        self._counted.add(("blobs", key))
        if self._run("SELECT 1 FROM blobs WHERE key = ?", (key,)).fetchone() is None:
            self._put("blobs", (key, len(content), zlib.compress(content, ZLIB_LEVEL)))

    def put_motion(self, key: str, header: str) -> None:
        """Keep the header of a motion, or replace it; its place in the order stays."""
        self._counted.add(("motions", key))
        self._run(
            "INSERT INTO motions (key, header, checksum) VALUES (?, ?, ?)"
            " ON CONFLICT (key) DO UPDATE SET header = excluded.header, checksum = excluded.checksum",
            (key, header, checksum("motions", (0, key, header))),
        )

    def put_frames(self, key: str, number: int, count: int, content: bytes) -> None:
        """Keep piece `number` of a motion, of `count` frames, or replace it."""
        self._counted.add(("frames", key, number))
        self._put("frames", (key, number, count, len(content), zlib.compress(content, ZLIB_LEVEL)))

    def drop_frames(self, key: str) -> None:
        self._run("DELETE FROM frames WHERE motion = ?", (key,))

    def put_step(self, number: int, label: str, document: str) -> None:
        """Keep a step of the session's history, or replace it."""
        self._counted.add(("steps", number))
        self._put("steps", (number, label, document))

    def drop_step(self, number: int) -> None:
        self._run("DELETE FROM steps WHERE number = ?", (number,))

    def drop_steps(self, first: int | None = None, before: int | None = None) -> None:
        """Remove the steps from `first` on, and those before `before`."""
        self._run("DELETE FROM steps WHERE number >= ? OR number < ?", (first, before))

    def set_meta(self, name: str, value: str | bytes) -> None:
        self._counted.add(("meta", name))
        self._put("meta", (name, value))

    def documents(self) -> Iterator[str]:
        """The texts of all steps as this transaction has them, one after the other."""
        for (number,) in self._run("SELECT number FROM steps").fetchall():
            yield self._run("SELECT document FROM steps WHERE number = ?", (number,)).fetchone()[0]

    def motion(self, key: str) -> str:
        """The header of a motion as this transaction has it; "" where there is none."""
        found = self._run("SELECT header FROM motions WHERE key = ?", (key,)).fetchone()
        return "" if found is None else found[0]

    def blob(self, key: str) -> bytes:
        """Bytes by their key as this transaction has them, as many as a text may have; b"" where there are none."""
        found = self._run("SELECT content FROM blobs WHERE key = ?", (key,)).fetchone()
        return b"" if found is None else zlib.decompressobj().decompress(found[0], MAX_TEXT_BYTES)

    # --- what no step names

    def lose(self, keys: Iterable[str], since_s: int, text: str = "") -> None:
        """Note that no step names motions or blobs any more since a time; one that is noted already keeps its own."""
        put_rows(self._connection, "lost", (sealed("lost", (key, since_s, text)) for key in keys), "IGNORE")

    def find(self, keys: Iterable[str]) -> None:
        """Note that a step names motions or blobs again."""
        self._many("DELETE FROM lost WHERE key = ?", ((key,) for key in keys))

    def lost(self) -> list[tuple[str, int, str]]:
        """Key, time in seconds since 1970 and text of what is lost, the oldest first."""
        return self._run("SELECT key, since, text FROM lost ORDER BY since, rowid").fetchall()

    def kept(self) -> tuple[list[str], list[str]]:
        """Keys of all motions, those that have frames only too, and of all blobs."""
        motions = self._run("SELECT key FROM motions UNION SELECT motion FROM frames").fetchall()
        return [key for (key,) in motions], [key for (key,) in self._run("SELECT key FROM blobs")]

    def remove(self, keys: Collection[str]) -> None:
        """Remove motions with their frames, blobs, and what is noted of them as lost."""
        for table, column in (("motions", "key"), ("frames", "motion"), ("blobs", "key"), ("lost", "key")):
            self._many(f"DELETE FROM {table} WHERE {column} = ?", ((key,) for key in keys))

    def stored_bytes(self) -> int:
        """Bytes of the file that hold something."""
        pages, free = (self._run(f"PRAGMA {name}").fetchone()[0] for name in ("page_count", "freelist_count"))
        return int(PAGE_BYTES * (pages - free))

    def _put(self, table: str, row: Row) -> None:
        put_rows(self._connection, table, [sealed(table, row)], "REPLACE")
