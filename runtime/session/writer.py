"""What may be changed in a session's file."""

from __future__ import annotations

import sqlite3
import zlib
from collections.abc import Callable, Collection, Iterator
from typing import Any

from runtime.session.sqlite_file import MAX_TEXT_BYTES

LEVEL = 1  # of zlib


class Writer:
    """What a work may change, one for each transaction. Only within `Database.submit`; nothing of it lasts unless all does."""

    def __init__(self, connection: sqlite3.Connection, counted: set[tuple[Any, ...]]) -> None:
        self._run = connection.execute
        self._many = connection.executemany
        self._counted = counted
        # called once all of it lasts; not where it is rolled back
        self.committed: list[Callable[[], None]] = []

    def put_blob(self, key: str, content: bytes) -> None:
        """Keep bytes under the hash of their content; once is enough."""
        self._counted.add(("blobs", key))
        if self._run("SELECT 1 FROM blobs WHERE key = ?", (key,)).fetchone() is None:
            self._run(
                "INSERT INTO blobs VALUES (?, ?, ?)", (key, len(content), zlib.compress(content, LEVEL))
            )

    def put_motion(self, key: str, header: str) -> None:
        """Keep the header of a motion, or replace it; its place in the order stays."""
        self._counted.add(("motions", key))
        self._run(
            "INSERT INTO motions (key, header) VALUES (?, ?) ON CONFLICT (key) DO UPDATE SET header = excluded.header",
            (key, header),
        )

    def put_frames(self, key: str, number: int, count: int, content: bytes) -> None:
        """Keep piece `number` of a motion, of `count` frames, or replace it."""
        self._counted.add(("frames", key, number))
        values = key, number, count, len(content), zlib.compress(content, LEVEL)
        self._run("INSERT OR REPLACE INTO frames VALUES (?, ?, ?, ?, ?)", values)

    def drop_frames(self, key: str) -> None:
        self._run("DELETE FROM frames WHERE motion = ?", (key,))

    def put_step(self, number: int, label: str, document: str) -> None:
        """Keep a step of the session's history, or replace it."""
        self._counted.add(("steps", number))
        self._run("INSERT OR REPLACE INTO steps VALUES (?, ?, ?)", (number, label, document))

    def drop_steps(self, first: int | None = None, before: int | None = None) -> None:
        """Remove the steps from `first` on, and those before `before`."""
        self._run("DELETE FROM steps WHERE number >= ? OR number < ?", (first, before))

    def set_meta(self, name: str, value: str | bytes) -> None:
        self._counted.add(("meta", name))
        self._run("INSERT OR REPLACE INTO meta VALUES (?, ?)", (name, value))

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

    def keep_only(self, motions: Collection[str], blobs: Collection[str]) -> None:
        """Remove all other motions with their frames, and all other blobs."""
        for table, column, kept in (
            ("motions", "key", motions),
            ("frames", "motion", motions),
            ("blobs", "key", blobs),
        ):
            found = self._run(f"SELECT DISTINCT {column} FROM {table}").fetchall()
            self._many(
                f"DELETE FROM {table} WHERE {column} = ?", [row for row in found if row[0] not in kept]
            )
