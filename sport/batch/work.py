"""Rows made into files: one row, wherever it runs, and all of them by an executor."""

from __future__ import annotations

import argparse
import contextlib
import hashlib
import io
import os
import re
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

from runtime.atomic import write_atomic
from runtime.errors import SportError
from sport.batch.manifest import entry
from sport.batch.plan import Task

AHEAD = 2  # rows that wait for each core
Files = dict[str, bytes]
_PROGRESS = re.compile(r": (a film of|\d+ of \d+ frames|this folder is new)")


def make_rows(
    tasks: Sequence[Task], target: Path, executor: Callable[[], Executor], workers: int
) -> Iterator[dict[str, Any]]:
    """The line of each task as it is finished, its files in place.

    A process that dies takes its executor with it: the rows under way are made once more, each by an executor of its
    own, so that one that ends its process again costs itself alone.
    """
    waiting = list(reversed(tasks))
    while waiting:
        again: list[Task] = []
        with _closed(executor()) as pool:
            under_way: dict[Future[tuple[dict[str, Any], Files]], Task] = {}
            while under_way or (waiting and not again):
                while waiting and not again and len(under_way) < AHEAD * workers:
                    task = waiting.pop()
                    try:
                        under_way[pool.submit(make_row, task)] = task
                    except BrokenProcessPool:
                        again.append(task)
                for future in wait(under_way, return_when=FIRST_COMPLETED).done:
                    task = under_way.pop(future)
                    if isinstance(future.exception(), BrokenProcessPool):
                        again.append(task)
                    else:
                        yield _placed(task, future, target)
        for task in again:
            with _closed(executor()) as pool:
                yield _placed(task, pool.submit(make_row, task), target)


@contextlib.contextmanager
def _closed(executor: Executor) -> Iterator[Executor]:
    """An executor that drops what has not begun when the block ends."""
    try:
        yield executor
    finally:
        executor.shutdown(cancel_futures=True)


def _placed(task: Task, future: Future[tuple[dict[str, Any], Files]], target: Path) -> dict[str, Any]:
    """The line of a task; its files written, each whole, the one that was asked for last."""
    try:
        line, files = future.result()
        for name in sorted(files, key=lambda name: name == line["file"]):
            (target / name).parent.mkdir(parents=True, exist_ok=True)
            write_atomic(target / name, files[name])
    except BrokenProcessPool:
        return entry(task.number, task.values, task.key, "the process that made it ended")
    except SportError as error:
        return entry(task.number, task.values, task.key, str(error))
    except Exception as error:  # of the executor, or of the disk
        return entry(task.number, task.values, task.key, f"{type(error).__name__}: {str(error)[:200]}")
    return line


def make_row(task: Task) -> tuple[dict[str, Any], Files]:
    """On a worker: a task's line of the manifest, whatever happens, and its files."""
    with tempfile.TemporaryDirectory(prefix="sport-batch-") as name:
        return _maker().make(task, Path(name) / "row")


@dataclass
class Maker:
    """Makes rows one after the other and keeps the model and the text encoder of the last one."""

    _model: tuple[Any, Any] = (None, None)
    _prompter: tuple[Any, Any] = (None, None)

    def make(self, task: Task, folder: Path) -> tuple[dict[str, Any], Files]:
        """Make the files of a task in the empty `folder`; its line and the files."""
        begin = time.perf_counter()
        said = io.StringIO()
        try:
            folder.mkdir(parents=True)
            with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(said):
                self._run(task, folder)
        except SportError as error:
            problem = str(error).replace(f"{folder}{os.sep}", "")
            return entry(task.number, task.values, task.key, problem), {}
        except Exception as error:  # one row must not end the others
            return entry(task.number, task.values, task.key, f"{type(error).__name__}: {error}"), {}
        files = {
            path.relative_to(folder).as_posix(): path.read_bytes()
            for path in sorted(folder.rglob("*"))
            if path.is_file()
        }
        hashes = {name: hashlib.sha256(data).hexdigest() for name, data in files.items()}
        main = _main_file(task.options, hashes)
        notes = [
            line.removeprefix("sport: ")
            for line in said.getvalue().splitlines()
            if not _PROGRESS.search(line)
        ]
        line = entry(
            task.number, task.values, task.key, file=main, sha256=hashes[main], files=hashes, notes=notes,
            seconds=round(time.perf_counter() - begin, 3),
        )  # fmt: skip
        return line, files

    def _run(self, task: Task, folder: Path) -> None:
        """As `sport generate` does; imported here, since a process that only leads needs none of it."""
        from sport.clips import write_clips

        options = argparse.Namespace(**vars(task.options))
        options.out = folder / options.out
        if options.ground_out is not None:
            options.ground_out = folder / options.ground_out
        write_clips(options, self._tools)

    def _tools(self, options: argparse.Namespace) -> Any:
        """The model and the prompter for these arguments, those of the row before where they are the same."""
        from runtime.motion.model import load_model
        from runtime.prompts.prompter import Prompter

        key = options.model
        if self._model[1] is None or self._model[0] != key:
            self._model, self._prompter = (key, load_model(options.model)), (None, None)
        model, key = self._model[1], (options.expander, options.text_encoder)
        if self._prompter[1] is None or self._prompter[0] != key:
            self._prompter = key, Prompter(model, options.expander, text_encoder=options.text_encoder)
        return model, self._prompter[1]


@lru_cache(maxsize=1)
def _maker() -> Maker:
    """One for each process, so that models are read once."""
    return Maker()


def _main_file(options: argparse.Namespace, files: dict[str, str]) -> str:
    """The file that was asked for; the first of several."""
    name = options.out.as_posix()
    return name if name in files else min((f for f in files if not f.endswith(".json")), default=min(files))
