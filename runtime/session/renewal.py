"""Renews a session's file when it is opened: all its rows, or the intact rows of a damaged file, go into a new file."""

import contextlib
import sqlite3
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import groupby, islice
from pathlib import Path

from runtime.errors import FileError
from runtime.session import tables, unwritten
from runtime.session.recovery import fill_gaps
from runtime.session.salvage import salvaged
from runtime.session.sqlite_file import connect, file_errors, in_memory, keep_aside, new_file, side_files

MAX_SALVAGED_ROWS = 2 * tables.MAX_ROWS  # from a damaged file


@dataclass
class Renewal:
    """Result of renewing a session file: what was damaged, and its rows in memory if the disk is full."""

    path: Path
    repaired: str = ""  # what was damaged, for the user
    memory: sqlite3.Connection | None = None
    # changes of an earlier run, while the session is in memory only
    waiting: list[unwritten.Change] = field(default_factory=list)

    def put(self) -> None:
        """Replace the file by a new one with its rows; for a damaged file, with all rows that are intact."""
        path, log = self.path, side_files(self.path)[0]
        mode = "ro" if log.exists() and log.stat().st_size else "immutable"
        try:
            with (
                file_errors(path),
                contextlib.closing(checked(connect(path, mode))) as connection,
                new_file(path, self._keep_aside) as target,
            ):
                tables.copy_rows(connection, target)
                unwritten.make(unwritten.read(path), target)
                self._mend(target)
                connection.close()  # before the file is replaced
        except FileError as error:
            if is_damage(error):
                self._salvage(error)
            elif is_of_the_disk(error.__cause__):
                with file_errors(path), contextlib.closing(checked(connect(path, mode))) as connection:
                    self.waiting = unwritten.read(path)
                    self.memory = memory_of(connection, self.waiting)
            else:
                raise

    def _salvage(self, damage: FileError) -> None:
        """Replace a damaged file by a new one with its intact rows, keeping the old one aside; raises `damage` if none are intact."""
        with new_file(self.path, self._keep_aside) as target:
            rows = islice(salvaged(self.path), MAX_SALVAGED_ROWS)
            for table, found in groupby(rows, lambda pair: pair[0]):
                tables.put_rows(target, table, (row for _, row in found), known="IGNORE")
            if not target.execute("SELECT 1 FROM meta UNION SELECT 1 FROM frames LIMIT 1").fetchone():
                raise damage
            unwritten.make(unwritten.read(self.path), target)
            self.repaired = "It was damaged; what was intact is here."
            self._mend(target)

    def _mend(self, target: sqlite3.Connection) -> None:
        """Complete motions with missing pieces."""
        changed, held = fill_gaps(target)
        if changed:
            gaps = f": {held} missing frames repeat the pose before them" if held else ""
            damaged = self.repaired or "It was damaged."
            self.repaired = f"{damaged} {changed} of its motions have changed{gaps}."

    def _keep_aside(self) -> None:
        """Keep a damaged file before it is replaced."""
        if self.repaired:
            self.repaired += f" The damaged file is {keep_aside(self.path).name}."


def is_damage(error: FileError) -> bool:
    """Return whether an error comes from damaged content of what may be a session file."""
    cause = error.__cause__
    wrong = (sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_NOTADB, sqlite3.SQLITE_CONSTRAINT, sqlite3.SQLITE_ERROR)
    plain = sqlite3.SQLITE_ERROR if isinstance(cause, sqlite3.Error) else -1  # invalid text
    code = getattr(cause, "sqlite_errorcode", plain)
    return isinstance(cause, tables.DamageError | tables.VersionError) or code & 0xFF in wrong


def is_of_the_disk(error: BaseException | None) -> bool:
    """Return whether an error of the disk may go away when the operation is tried again."""
    kinds = (OSError, FileError, sqlite3.OperationalError)
    return isinstance(error, kinds) or type(error) is sqlite3.DatabaseError


def checked(connection: sqlite3.Connection, thorough: bool = True) -> sqlite3.Connection:
    """Return the connection if its file is valid; otherwise close it and raise ValueError or sqlite3.Error."""
    try:
        tables.version_of(connection)
        if thorough:
            tables.check_content(connection)
    except BaseException:
        connection.close()
        raise
    return connection


def memory_of(connection: sqlite3.Connection, changes: Sequence[unwritten.Change]) -> sqlite3.Connection:
    """Return a copy of a file's rows in memory, with changes applied that are not in the file."""
    memory = in_memory()
    tables.copy_rows(connection, memory)
    unwritten.make(changes, memory)
    return checked(memory)
