"""A batch from its list to its manifest: what is there is kept, what is missing is made, what fails is listed."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from runtime.errors import FileError, UsageError
from runtime.file_lock import open_locked
from runtime.safe_read import printable
from sport.batch.executors import RayExecutor, cores, processes
from sport.batch.manifest import Manifest, entry
from sport.batch.plan import NOT_COLUMNS, RowParser, Task, plan
from sport.batch.progress import BatchProgress
from sport.batch.rows import read_rows
from sport.batch.work import make_rows

LOCK = ".sport-batch.lock"
MAX_WORKERS = 1024


def run_batch(options: argparse.Namespace, parser: RowParser) -> int:
    """Make the clips of `options.batch` in the folder `options.out`; 0, or 1 when rows failed. SportError."""
    folder: Path = options.out
    if options.workers is not None and not 1 <= options.workers <= MAX_WORKERS:
        raise UsageError(f" {options.workers}: expected 1 to {MAX_WORKERS}.", "Try 2.", "workers")
    rows = read_rows(options.batch)
    base = {name: value for name, value in vars(options).items() if name not in (*NOT_COLUMNS, "command")}
    tasks, refused = plan(rows, parser, argparse.Namespace(**base))
    with _held(folder):
        manifest = Manifest(folder)
        missing = [task for task in tasks if not manifest.done(task)]
        progress = BatchProgress(len(rows), len(tasks) - len(missing))
        if progress.kept:
            print(f"sport: {progress.kept} of {len(rows)} clips are there already", file=sys.stderr)
        try:
            for row in refused:
                _note(entry(row.number, row.values, error=row.error), manifest, progress)
            for line in _lines(missing, folder, options):
                _note(line, manifest, progress)
            manifest.finish(row.number for row in rows)
        except KeyboardInterrupt:
            print("\nsport: stopped; the same command goes on from here", file=sys.stderr)
            raise
        finally:
            manifest.close()
        _report(manifest, [row.number for row in rows], progress)
    return int(progress.failed > 0)


def _lines(tasks: list[Task], folder: Path, options: argparse.Namespace) -> Iterator[dict[str, Any]]:
    if not tasks:
        return iter(())
    workers = options.workers or cores()
    if options.ray is not None:
        cluster = RayExecutor(options.ray, workers)
        return make_rows(tasks, folder, lambda: cluster, cluster.workers)
    return make_rows(tasks, folder, lambda: processes(min(workers, len(tasks))), workers)


def _note(line: dict[str, Any], manifest: Manifest, progress: BatchProgress) -> None:
    manifest.add(line)
    progress.add(failed=bool(line["error"]))


def _report(manifest: Manifest, numbers: list[int], progress: BatchProgress) -> None:
    for number in numbers:
        line = manifest.lines[number]
        if line["error"]:
            print(f"sport: row {number}: {printable(line['error'])}", file=sys.stderr)
    made = len(numbers) - progress.failed
    failed = f", {progress.failed} failed" if progress.failed else ""
    new = f", {progress.made} of them new, {progress.per_minute:.1f} a minute" if progress.made else ""
    print(printable(f"{manifest.path}: {made} of {len(numbers)} clips{new}{failed}"))


@contextmanager
def _held(folder: Path) -> Iterator[None]:
    """No other batch writes into the folder. FileError."""
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
