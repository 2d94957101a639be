"""Storage of an open session: each change is a transaction, written soon after by a thread of its own.

Reads see only what is on disk: call `Database.flush` first to read what was just submitted.
"""

from __future__ import annotations

import contextlib
import logging
import os
import sqlite3
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import cast

from runtime.errors import FileError
from runtime.session import unwritten
from runtime.session.renewal import Renewal, checked, is_of_the_disk, memory_of
from runtime.session.sqlite_file import (
    KEPT_ASIDE_DAYS,
    ROOM_REMEDY,
    Budget,
    check_files,
    connect,
    connect_reader,
    connect_writer,
    drop_lock,
    file_errors,
    is_own,
    keep_aside,
    kept_aside,
    lock_of,
    new_file,
    real_path,
    said,
    side_files,
    take_lock,
    unwritten_files,
)
from runtime.session.stored_rows import StoredRows, Writer
from runtime.session.tables import copy_rows

GATHER_S = 0.05  # waiting time to gather further works before writing
IDLE_S = 1.0  # idle time until the log is merged into the file, and between two attempts to write
MAX_WAITING_WORKS = 20_000  # limit of works waiting for the disk; an hour or more of a recording
_LOG = logging.getLogger("sport.session")
# time for handing over unwritten changes: at least, also past the deadline; at most
HAND_OVER_S, LONGEST_HAND_OVER_S = (0.8, 10.0)
Work = Callable[[Writer], None]


@dataclass
class Database(StoredRows):
    """A session's rows in a SQLite file, written by a thread of its own; created by `create`, `open` and `read`."""

    repaired: str = ""  # what was damaged when it was opened, for the user
    _handle: int = -1  # file descriptor of the lock; -1 if read-only
    _writer: sqlite3.Connection | None = None
    _files: list[tuple[int, ...]] = field(default_factory=list)  # identities of the opened files
    _queue: deque[Work] = field(default_factory=deque)
    _submitted: int = 0
    _written: int = 0
    _failures: int = 0
    _trouble: str = ""  # temporary problem
    _lost: str = ""  # permanent problem
    _full: bool = False  # no more work is accepted
    _urgent: bool = False
    _ending: bool = False
    _stopping: bool = False  # ends the current work
    handed_over: Path | None = None  # file with the changes that the session file has not taken
    # changes of an earlier run, while the session is in memory only
    _unwritten: list[unwritten.Change] = field(default_factory=list)
    # guards the queue and its counters
    _changed: threading.Condition = field(default_factory=threading.Condition)
    _turn: threading.Lock = field(default_factory=threading.Lock)  # held by the thread that writes
    _working: threading.Lock = field(default_factory=threading.Lock)  # works run one at a time
    _thread: threading.Thread | None = None
    _checker: threading.Thread | None = None  # checks the opened file, until another one is opened
    _unchecked: threading.Event = field(default_factory=threading.Event)

    @staticmethod
    def create(path: Path) -> Database:
        """Create and lock a new file; FileError, also if the file exists."""
        path = real_path(path)
        handle = take_lock(path)
        try:
            if path.exists():
                raise FileError(f"{path}: this file exists.", "Choose another name.")
            with new_file(path):
                pass
            return Database(path, Budget.for_file(0), _handle=handle)._begin()
        except BaseException:
            drop_lock(handle, path)
            raise

    @staticmethod
    def open(path: Path) -> Database:
        """Open an existing file, check and lock it. Raises FileError, FileInUse.

        Its rows are copied to a new file that replaces it. If the disk is too full for that, they stay in memory for now.
        """
        path = real_path(path)
        check_files(path)
        handle = take_lock(path)
        try:
            size, renewal = check_files(path), Renewal(path)
            renewal.put()
            database = Database(path, Budget.for_file(size), renewal.memory, repaired=renewal.repaired)
            database._handle, database._writer = handle, renewal.memory
            database._unwritten = renewal.waiting
            for file in kept_aside(path, KEPT_ASIDE_DAYS):
                _LOG.info("removed after %d days: %s", KEPT_ASIDE_DAYS, file)
                file.unlink(missing_ok=True)
            return database._begin(checked=True)
        except BaseException:
            drop_lock(handle, path)
            raise

    @staticmethod
    def read(path: Path, thorough: bool = True) -> Database:
        """Open a file for reading only, even while another process has it open. Raises FileError.

        Without `thorough`, as for a listing, the pages are not checked.
        """
        path = real_path(path)
        database = Database(path, Budget.for_file(check_files(path)))
        with file_errors(path):
            reader = checked(connect_reader(path), thorough)
            if any(is_own(file) for file in unwritten_files(path)):
                with contextlib.closing(reader):
                    reader = memory_of(reader, unwritten.read(path))
            database._reader = reader
            reader.set_progress_handler(None, 0)
        return database

    @property
    def problem(self) -> str:
        """The reason why changes are not on disk, for the user; "" if they are or soon will be."""
        return self._lost or self._trouble

    # --- writing

    def submit(self, work: Work) -> None:
        """Queue `work` for the writing thread and return at once; thread-safe.

        All queued work is one transaction, in order. Work may run more than once: for a retry, or into a copy. Raises
        FileError if the file is read-only.
        """
        if self._thread is None or self._ending:
            raise FileError(f"{self.path}: it is open for reading only.", "Save a copy of it.")
        with self._changed:
            # later changes would depend on the missing one
            if self._full or len(self._queue) >= MAX_WAITING_WORKS:
                self._full = True
                slow = self._trouble or f"{self.path}: its disk is too slow."
                self._lost = f"{slow} Further changes are in memory only."
                return
            self._queue.append(work)
            self._submitted += 1
            self._changed.notify_all()

    def flush(self, seconds: float | None = None) -> bool:
        """Wait until everything submitted is on disk; return False if that failed or timed out."""
        with self._changed:
            target, failures = self._submitted, self._failures
            self._urgent = True
            self._changed.notify_all()
            self._changed.wait_for(
                lambda: self._failures > failures or (self._written >= target and not self._trouble), seconds
            )
            return self._written >= target and not self.problem

    def save_as(self, path: Path) -> None:
        """Switch to another file, with everything submitted. Raises FileError, FileInUse; then nothing changes.

        The old file stays as it was last written. This works even if the old file's disk fails.
        """
        path = real_path(path)
        with self._turn:
            if path == self.path:
                if not self._write():
                    raise FileError(self.problem)
                return
            handle, count, committed = self._copy(path)
            with self._reading:
                before, self.path = self.path, path
                self._handle, old = handle, self._handle
                self._unwritten = []
                self._disconnect()
                drop_lock(old, before)
                self._connect()
            self._settle(count, committed)

    def save_copy(self, path: Path) -> None:
        """Write everything submitted into another file, and keep using this one. Raises FileError, FileInUse."""
        path = real_path(path)
        with self._turn:
            handle, _, _ = self._copy(path)
            drop_lock(handle, path)

    def _copy(self, path: Path) -> tuple[int, int, list[Callable[[], None]]]:
        """Create a file with all rows and queued works: its lock, the number of works in it, and their callbacks."""
        if self._thread is not None:
            self._write()
        handle = take_lock(path)
        try:
            with self._changed:
                works = list(self._queue)
            source = self._reader if self._thread is None else self._connection()
            if source is None:
                raise FileError(f"{self.path}: it is closed.")
            with new_file(path) as target, file_errors(self.path):
                copy_rows(source, target)
                writer = Writer(target, self._counted)
                with self._working:
                    for work in works:
                        work(writer)
        except BaseException:
            drop_lock(handle, path)
            raise
        return handle, len(works), writer.committed

    def close(self, seconds: float | None = None) -> bool:
        """Flush and release the file within `seconds`; return whether everything is in it.

        Unwritten changes are stored where the next `open` finds them. A hanging disk is not waited for.
        """
        if self._thread is None:
            self._let_go()
            return True
        begun, limited = time.monotonic(), seconds is not None
        limit = threading.TIMEOUT_MAX if seconds is None else seconds
        if not self._ending and not self.flush(max(limit - HAND_OVER_S, 0.0)):
            left = limit - (time.monotonic() - begun)
            self._hand_over(min(max(left, HAND_OVER_S), LONGEST_HAND_OVER_S))
        with self._changed:
            self._ending = True
            self._changed.notify_all()
        left = max(limit - (time.monotonic() - begun), 0.0)
        self._thread.join(left if self.handed_over is None or not limited else min(left, GATHER_S))
        return self._written >= self._submitted and not self.problem

    def _hand_over(self, seconds: float) -> None:
        """Store the queued changes elsewhere, for the next process that opens the file."""
        self._stopping, log, begun = True, unwritten.ChangeLog(), time.monotonic()
        if not self._working.acquire(timeout=max(seconds, 0.0)):
            return
        try:
            with self._changed:
                works = list(self._queue)
            for work in works:
                work(cast(Writer, log))
        except Exception as error:
            self._defect(error)
        finally:
            self._stopping = False
            self._working.release()
        left = seconds - (time.monotonic() - begun)
        self.handed_over = unwritten.keep(self.path, [*self._unwritten, *log.changes], left)

    def _let_go(self) -> None:
        """Merge the log into the file and close it."""
        with self._turn:
            if self._writer is not None:
                with contextlib.suppress(sqlite3.Error):  # committed changes are on disk, if in two files
                    self._writer.execute("PRAGMA wal_checkpoint(TRUNCATE)")
            self._disconnect()
            if self._handle >= 0:
                drop_lock(self._handle, self.path)
                self._handle = -1

    def _begin(self, checked: bool = False) -> Database:
        """Start the writing thread; `checked`: check the new file meanwhile."""
        if self._reader is None:
            self._connect()
            if checked:
                check = self._check_integrity
                self._checker = threading.Thread(target=check, name="sport-session check", daemon=True)
                self._checker.start()
        self._thread = threading.Thread(target=self._run, name="sport-session", daemon=True)
        self._thread.start()
        return self

    def _connect(self) -> None:
        with self._reading, file_errors(self.path):
            self._writer = connect_writer(self.path)
            self._reader = connect(self.path, "ro")
            self._reader.execute("SELECT * FROM meta LIMIT 0")  # opens the log while it has its name
            self._files = self._present()

    def _check_integrity(self) -> None:
        """Report a problem if the disk returns other pages than were written."""
        try:
            with contextlib.closing(connect(self.path, "ro")) as connection:
                connection.set_progress_handler(self._unchecked.is_set, 20_000)
                (found,) = connection.execute("PRAGMA integrity_check(1)").fetchone()
        except sqlite3.Error as error:
            found = "ok" if self._unchecked.is_set() else said(error)
        if found != "ok":
            _LOG.error("integrity_check of %s: %s", self.path, found)
            self._lost = f"{self.path}: its disk returns other data than was written. Save a copy elsewhere."

    def _disconnect(self) -> None:
        """Close both connections at once: the last one removes the log, by its name."""
        self._unchecked.set()
        if self._checker is not None:
            self._checker.join()
        with self._reading:
            for connection in (self._reader, self._writer):
                if connection is not None:
                    connection.close()
            self._reader = self._writer = None

    def _connection(self) -> sqlite3.Connection:
        if self._writer is None and self._handle < 0:
            raise FileError(f"{self.path}: it is closed.")
        if self._writer is None:
            self._connect()
        assert self._writer is not None
        return self._writer

    def _present(self) -> list[tuple[int, ...]]:
        """Return the identities of the files that have our names now."""
        return [_identity(file) for file in (self.path, side_files(self.path)[0], lock_of(self.path))]

    def _keep_there(self) -> None:
        """Write the file again if another program has removed or replaced it or its folder: the open files can still be read."""
        connection = self._connection()
        with contextlib.suppress(FileNotFoundError):
            if self._present() == self._files:
                return

        def keep_other() -> None:  # a file that a synchronising program has put in the place of ours
            if self._files and self.path.exists() and _identity(self.path) != self._files[0]:
                _LOG.warning(
                    "%s was replaced: the other one is %s", self.path, keep_aside(self.path, log=False)
                )

        with new_file(self.path, keep_other) as target:
            copy_rows(connection, target)
            if not lock_of(self.path).exists():
                os.close(self._handle)
                self._handle = -1
                self._handle = take_lock(self.path)
        self._unwritten = []
        with self._reading:
            self._disconnect()
            self._connect()

    def _run(self) -> None:
        """Write queued works soon, and merge the log into the file when idle."""
        logged = False
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._queue or self._hurried, IDLE_S)
                if self._queue:  # a disk that refuses is tried again after a while
                    self._changed.wait_for(lambda: self._hurried, IDLE_S if self._trouble else GATHER_S)
                ending, idle, self._urgent = self._ending, not self._queue, False
            with self._turn:
                self._write()
                if idle and logged and self._writer is not None:
                    with contextlib.suppress(sqlite3.Error):  # the data stays in the log
                        self._writer.execute("PRAGMA wal_checkpoint(PASSIVE)")
                logged = not idle
            if ending:
                self._let_go()
                return

    @property
    def _hurried(self) -> bool:
        return self._urgent or self._ending

    def _write(self) -> bool:
        """Write all queued works as one transaction; False if they remain queued. A faulty work is left out."""
        with self._changed:
            works = list(self._queue)
        work: Work | None = None
        committed: list[Callable[[], None]] = []
        try:
            self._keep_there()
            if works:
                connection = self._connection()
                writer = Writer(connection, self._counted)
                connection.execute("BEGIN IMMEDIATE")
                with self._working:
                    for work in works:
                        if self._stopping:
                            raise FileError(f"{self.path}: the program ends.")
                        work(writer)
                work = None
                connection.execute("COMMIT")
                committed = writer.committed
        except Exception as error:
            if self._writer is not None and self._writer.in_transaction:
                with contextlib.suppress(sqlite3.Error):  # SQLite has rolled back by itself
                    self._writer.execute("ROLLBACK")
            if work is not None and not is_of_the_disk(error):  # a defect must not block other works
                self._defect(error)
                with self._changed:
                    self._queue.remove(work)
                    self._written += 1
                return self._write()
            problem = (
                error
                if isinstance(error, FileError)
                else FileError(f"{self.path}: {said(error)}.", ROOM_REMEDY)
            )
            with self._changed:
                self._trouble = str(problem)
                self._failures += 1
                self._changed.notify_all()
            return False
        self._settle(len(works), committed)
        return True

    def _defect(self, error: Exception) -> None:
        _LOG.exception("a change could not be written")
        self._lost = f"{self.path}: a change cannot be kept ({said(error)}). Please report this defect."

    def _settle(self, count: int, committed: Sequence[Callable[[], None]]) -> None:
        """Remove the first `count` works, which are on disk."""
        for done in committed:
            try:
                done()
            except Exception as error:  # the thread continues
                self._defect(error)
        with self._changed:
            for _ in range(count):
                self._queue.popleft()
            self._written += count
            self._trouble = ""
            self._changed.notify_all()


def _identity(file: Path) -> tuple[int, ...]:
    return tuple(os.stat(file)[1:3])  # inode and device
