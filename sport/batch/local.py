"""Rows on the cores of this machine: processes with one thread each."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from pathlib import Path
from typing import Any

from sport.batch.manifest import entry
from sport.batch.plan import Task
from sport.batch.work import THREADS, Maker, put


def cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@dataclass
class _Worker:
    process: Any
    pipe: Connection
    task: Task | None = None


def run_local(tasks: Sequence[Task], target: Path, scratch: Path, workers: int) -> Iterator[dict[str, Any]]:
    """The line of each task as it is finished, its files in place. A process that dies costs the row it had."""
    waiting = list(reversed(tasks))
    os.environ.update(THREADS)  # for the processes that begin here
    context = multiprocessing.get_context("spawn")
    team: list[_Worker] = []
    try:
        while waiting or any(worker.task for worker in team):
            while waiting and len(team) < workers:
                team.append(_start(context, target, scratch))
            for worker in team:
                if worker.task is None and waiting:
                    worker.task = waiting.pop()
                    with contextlib.suppress(OSError):  # it has died; seen below
                        worker.pipe.send(worker.task)
            ready = wait([worker.pipe for worker in team if worker.task])
            for worker in [w for w in team if w.pipe in ready]:
                line = _line(worker)
                if line is None:
                    line = _died(worker)
                    team.remove(worker)
                worker.task = None
                yield line
    finally:
        for worker in team:
            worker.pipe.close()
            worker.process.terminate()
        for worker in team:
            worker.process.join()


def _start(context: Any, target: Path, scratch: Path) -> _Worker:
    ours, theirs = context.Pipe()
    process = context.Process(target=_serve, args=(theirs, target, scratch), daemon=True)
    process.start()
    theirs.close()
    return _Worker(process, ours)


def _line(worker: _Worker) -> dict[str, Any] | None:
    try:
        line: dict[str, Any] = worker.pipe.recv()
    except (EOFError, OSError):
        return None
    return line


def _died(worker: _Worker) -> dict[str, Any]:
    worker.process.join()
    code, task = worker.process.exitcode, worker.task
    assert task is not None
    reason = f"signal {-code}" if code < 0 else f"exit code {code}"
    return entry(task.number, task.values, task.key, f"the process that made it ended ({reason})")


def _serve(pipe: Connection, target: Path, scratch: Path) -> None:
    """A worker: tasks come, lines go, until the other end is gone, however it went."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl+C is for the process that leads
    maker = Maker()
    while True:
        try:
            task: Task = pipe.recv()
            folder = scratch / f"{task.number}"
            line = maker.make(task, folder)
            if not line["error"]:
                line = _placed(folder, line, target, task)
            pipe.send(line)
        except (EOFError, OSError):
            return


def _placed(folder: Path, line: dict[str, Any], target: Path, task: Task) -> dict[str, Any]:
    try:
        put(folder, line, target)
    except OSError as error:
        return entry(task.number, task.values, task.key, f"{error.filename}: {error.strerror or error}")
    return line
