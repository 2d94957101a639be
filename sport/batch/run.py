"""Runs a batch from its list to its manifest: existing files are kept, missing ones are made, failures are listed."""

from __future__ import annotations

import argparse
import itertools
import json
import os
import sys
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO

from runtime.atomic import temporary_folder, write_atomic
from runtime.errors import FileError, UsageError
from runtime.file_lock import open_locked
from runtime.interrupts import remark_when_ended
from runtime.safe_read import parse_json, printable, read_bounded
from sport.batch.rows import RowParser, Task, plan, read_rows, sha256
from sport.batch.work import Line, below, cores, entry, make_rows, processes

LOCK = ".sport-batch.lock"
MANIFEST = "manifest.jsonl"
MAX_MANIFEST_BYTES = 1024 * 1024 * 1024
MAX_WORKERS = 1024


def run_batch(options: argparse.Namespace, parser: RowParser) -> int:
    """Make the clips of `options.batch` in the folder `options.out`; return 0, or 1 when rows failed. SportError."""
    if options.workers is not None and not 1 <= options.workers <= MAX_WORKERS:
        raise UsageError(f" {options.workers}: expected 1 to {MAX_WORKERS}.", "Try 2.", "workers")
    rows = read_rows(options.batch)
    tasks, refused = plan(rows, parser, options)
    remark_when_ended("run the same command again to continue")
    with _held(options.out), temporary_folder() as scratch:
        manifest = Manifest(options.out)
        missing = [task for task in tasks if not manifest.done(task)]
        progress = BatchProgress(len(rows), len(tasks) - len(missing))
        if progress.kept:
            print(f"sport: {progress.kept} of {len(rows)} clips already exist", file=sys.stderr)
        workers = min(options.workers or cores(), max(len(missing), 1))
        made = make_rows(missing, options.out, lambda: processes(workers, scratch), workers)
        _make(itertools.chain((entry(row, row.error) for row in refused), made), manifest, progress)
        manifest.finish(row.number for row in rows)
        _report(manifest, [row.number for row in rows], progress)
    return int(progress.failed > 0)


def _make(lines: Iterator[Line], manifest: Manifest, progress: BatchProgress) -> None:
    """Append lines to the manifest as they arrive."""
    try:
        for line in lines:
            manifest.add(line)
            progress.add(failed=bool(line["error"]))
    finally:
        manifest.close()


def _report(manifest: Manifest, numbers: list[int], progress: BatchProgress) -> None:
    for number in numbers:
        line = manifest.lines[number]
        if line["error"]:
            print(f"sport: row {number}: {printable(line['error'])}", file=sys.stderr)
    failed = f", {progress.failed} failed" if progress.failed else ""
    new = f", {progress.made} of them new, {progress.per_minute:.1f} a minute" if progress.made else ""
    print(
        printable(f"{manifest.path}: {len(numbers) - progress.failed} of {len(numbers)} clips{new}{failed}")
    )


@contextmanager
def _held(folder: Path) -> Iterator[None]:
    """Keep other batches out of the folder. FileError."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        handle = open_locked(folder / LOCK, create=True)
    except OSError as error:
        raise FileError(
            f"{folder}: {error.strerror or error}.", "Choose a folder that can be written."
        ) from error
    if handle is None:
        raise FileError(f"{folder}: another batch writes into it.", "Wait for it, or choose another folder.")
    try:
        yield
    finally:
        os.close(handle)


class Manifest:
    """The known rows of `folder`; `add` appends a line that survives a crash."""

    def __init__(self, folder: Path) -> None:
        self.path = below(folder, MANIFEST)
        self.lines = read_lines(self.path)
        self._file: IO[bytes] | None = None

    def done(self, task: Task) -> bool:
        """Return whether a task was made with these arguments, and all its files are unchanged."""
        line = self.lines.get(task.number, {})
        if line.get("error") or line.get("key") != task.key or not isinstance(line.get("files"), dict):
            return False
        files = [(self.path.parent / name, sha) for name, sha in line["files"].items()]
        return bool(files) and all(path.is_file() and sha256(path) == sha for path, sha in files)

    def add(self, line: Line) -> None:
        """Append a line. FileError when it cannot be written."""
        self.lines[line["row"]] = line
        try:
            if self._file is None:
                self._file = self.path.open("ab")
                if self._file.tell() and not self.path.read_bytes().endswith(b"\n"):
                    self._file.write(b"\n")  # after a truncated line
            self._file.write(_text(line).encode("utf-8"))
            self._file.flush()
            os.fsync(self._file.fileno())
        except OSError as error:
            raise FileError(
                f"{self.path}: {error.strerror or error}.", "Free disk space and run the same command again."
            ) from error

    def finish(self, numbers: Iterable[int]) -> None:
        """Write one line for each of these rows, in their order, without older ones."""
        write_atomic(self.path, "".join(_text(self.lines[n]) for n in sorted(numbers) if n in self.lines))

    def close(self) -> None:
        """Close the file."""
        if self._file is not None:
            self._file.close()
            self._file = None


def read_lines(path: Path) -> dict[int, Line]:
    """Return the last line of each row, without damaged ones, such as the last one of a run that was killed."""
    if not path.exists():
        return {}
    found = {}
    for text in read_bounded(path, MAX_MANIFEST_BYTES).splitlines():
        try:
            line = parse_json(text)
        except ValueError:
            continue
        if isinstance(line, dict) and isinstance(line.get("row"), int):
            found[line["row"]] = line
    return found


def _text(line: Line) -> str:
    return printable(json.dumps(line, ensure_ascii=False, default=str)) + "\n"


@dataclass
class BatchProgress:
    """Progress in one line on a terminal, or a line every tenth in a log; `kept` counts clips that already existed."""

    total: int
    kept: int = 0
    made: int = 0
    failed: int = 0
    begun_s: float = field(default_factory=time.monotonic)

    @property
    def per_minute(self) -> float:
        """Return the rows made in a minute since the start."""
        return 60.0 * (self.made + self.failed) / max(time.monotonic() - self.begun_s, 1e-6)

    def add(self, failed: bool) -> None:
        """Count a finished row, and show counts, rows per minute and the remaining time."""
        self.failed, self.made = self.failed + failed, self.made + (not failed)
        done = self.kept + self.made + self.failed
        left_s = (self.total - done) / max(self.per_minute, 1e-6) * 60.0
        left = f"{left_s / 60.0:.0f} min" if left_s >= 90.0 else f"{left_s:.0f} s"
        counts = f"{done} of {self.total} clips" + (f", {self.failed} failed" if self.failed else "")
        text = f"sport: {counts}, {self.per_minute:.1f} a minute, {left} left"
        if sys.stderr.isatty():
            print(f"\r{text}\x1b[K", end="\n" * (done == self.total), file=sys.stderr, flush=True)
        elif 10 * done // self.total != 10 * (done - 1) // self.total:
            print(text, file=sys.stderr, flush=True)
