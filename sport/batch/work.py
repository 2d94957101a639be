"""Makes the files of rows: of one row, and of all of them in parallel processes."""

import argparse
import contextlib
import hashlib
import io
import multiprocessing
import os
import re
import signal
import tempfile
import threading
import time
from collections.abc import Callable, Collection, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from functools import lru_cache
from pathlib import Path, PurePosixPath
from typing import Any

from runtime.atomic import temporary_folder, write_atomic
from runtime.errors import FileError, SportError
from runtime.interrupts import end_children, signals_kept_from_children
from sport.batch.rows import Task

QUEUED_PER_CORE = 2  # rows queued for each core
# one thread per process: rows run in parallel
THREADS = {name: "1" for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")}
Line = dict[str, Any]  # of the manifest
Made = tuple[Line, dict[str, bytes]]  # and the files by their names
_PROGRESS = re.compile(r": (a film of|\d+ of \d+ frames|this folder is new)")


def cores() -> int:
    """Return the number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def processes(workers: int, scratch: Path | None = None) -> ProcessPoolExecutor:
    """Return an executor of processes of this machine, each with one thread; their temporary files are in `scratch`."""
    os.environ.update(THREADS)  # inherited by the processes
    return ProcessPoolExecutor(workers, multiprocessing.get_context("spawn"), _begin, (scratch,))


def _begin(scratch: Path | None) -> None:
    """Set up a worker: it ends with the leading process, however that ends, and leaves signals to it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Windows has no signal mask
    tempfile.tempdir = str(scratch) if scratch else None
    leader = multiprocessing.parent_process()
    assert leader is not None

    def follow() -> None:
        leader.join()
        os._exit(1)

    threading.Thread(target=follow, daemon=True).start()


def entry(row: Any, error: str = "", **made: Any) -> Line:
    """Return the manifest's line of a row or task: arguments, file, files with their hashes, seconds of work, error."""
    unmade: Line = dict.fromkeys(("file", "sha256", "seconds"))
    fields = unmade | {"error": error or None, "notes": [], "files": {}}
    return {"row": row.number, "arguments": row.values, **fields, **made, "key": getattr(row, "key", "")}


def make_rows(
    tasks: Sequence[Task], target: Path, executor: Callable[[], Executor], workers: int
) -> Iterator[Line]:
    """Yield the line of each task as it is finished, its files in place.

    A process that dies breaks its executor: the unfinished rows are made once more, each in an executor of its
    own, so that a row that kills its process again only costs itself.
    """
    waiting = list(reversed(tasks))
    while waiting:
        died: list[Task] = []
        with _closed(executor()) as pool:
            under_way: dict[Future[Made], Task] = {}
            while under_way or (waiting and not died):
                if not died:
                    died += _submit(pool, waiting, under_way, QUEUED_PER_CORE * workers)
                for future in wait(under_way, return_when=FIRST_COMPLETED).done:
                    task = under_way.pop(future)
                    if isinstance(future.exception(), BrokenProcessPool):
                        died.append(task)
                    else:
                        yield _placed(task, future, target)
        for task in died:
            with _closed(executor()) as pool:
                yield _placed(task, pool.submit(make_row, task), target)


def _submit(
    pool: Executor, waiting: list[Task], under_way: dict[Future[Made], Task], most: int
) -> list[Task]:
    """Submit tasks until `most` are running; return the one that a broken pool refuses."""
    while waiting and len(under_way) < most:
        task = waiting.pop()
        try:
            with signals_kept_from_children():
                under_way[pool.submit(make_row, task)] = task
        except BrokenProcessPool:
            return [task]
    return []


@contextlib.contextmanager
def _closed(executor: Executor) -> Iterator[Executor]:
    """Yield an executor that drops pending tasks when the block ends; after an error its processes are ended, too."""
    try:
        yield executor
    except BaseException:
        end_children()
        raise
    finally:
        executor.shutdown(cancel_futures=True)


def _placed(task: Task, future: Future[Made], target: Path) -> Line:
    """Write the files of a task completely, the main one last, and return its line."""
    try:
        line, files = future.result()
        for name in sorted(files, key=lambda name: name == line["file"]):
            write_atomic(below(target, name), files[name])
    except BrokenProcessPool:
        return entry(task, "its worker process ended")
    except Exception as error:  # of the executor, or of the disk
        return entry(task, _problem(error))
    return line


def below(folder: Path, name: str) -> Path:
    """Return the path of a file in the folder of the batch; FileError if a link is on the way, which may lead anywhere."""
    path = folder
    for part in PurePosixPath(name).parts:
        path /= part
        if path.is_symlink():
            raise FileError(f"{path}: this is a link.", "Remove it, or choose another folder.")
    return path


def _problem(error: Exception) -> str:
    return str(error) if isinstance(error, SportError) else f"{type(error).__name__}: {str(error)[:200]}"


def make_row(task: Task) -> Made:
    """Return a task's line of the manifest, whatever happens, and its files; called on a worker."""
    with temporary_folder() as scratch:
        begin, folder, printed = time.perf_counter(), scratch / "row", io.StringIO()
        try:
            folder.mkdir()
            with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(printed):
                _write_clips(task, folder)
        except Exception as error:  # a row must not end the others
            return entry(task, _problem(error).replace(f"{folder}{os.sep}", "")), {}
        paths = sorted(path for path in folder.rglob("*") if path.is_file())
        files = {path.relative_to(folder).as_posix(): path.read_bytes() for path in paths}
    hashes = {name: hashlib.sha256(data).hexdigest() for name, data in files.items()}
    main = _main_file(task.options.out.as_posix(), files)
    notes = [line for line in printed.getvalue().splitlines() if not _PROGRESS.search(line)]
    line = entry(
        task, file=main, sha256=hashes[main], files=hashes, seconds=round(time.perf_counter() - begin, 3),
        notes=[note.removeprefix("sport: ") for note in notes],
    )  # fmt: skip
    return line, files


def _write_clips(task: Task, folder: Path) -> None:
    """Write the clips of a row as `sport generate` does; imported here, since the leading process does not need it."""
    from sport.clips import write_clips

    options = argparse.Namespace(**vars(task.options))
    options.out = folder / options.out
    if options.ground_out is not None:
        options.ground_out = folder / options.ground_out
    write_clips(options, lambda o: _model_and_prompter(o.model, o.expander, o.text_encoder))


@lru_cache(maxsize=1)  # rows mostly share the model and the text encoder
def _model_and_prompter(folder: Path | None, expander: str, text_encoder: Path | None) -> tuple[Any, Any]:
    from runtime.motion.model import load_model
    from runtime.prompts.prompter import Prompter

    model = load_model(folder)
    return model, Prompter(model, expander, text_encoder=text_encoder)


def _main_file(name: str, files: Collection[str]) -> str:
    """Return the file of that name, else the first of several."""
    return name if name in files else min((f for f in files if not f.endswith(".json")), default=min(files))
