"""A film in a process of its own at low priority: the window goes on at its pace while it is drawn and written."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import threading
import time
from collections.abc import Callable
from functools import partial
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from runtime.atomic import sweep_of
from runtime.errors import SportError
from runtime.formats.prepare import ExportOptions, PreparedTake
from runtime.terrain.height_map import Terrain
from viewer.filming.film import FilmOptions, Progress, film_of_take

NICENESS = 10  # of the process: whatever the window needs comes first
POLL_S = 0.1
KILL_S = 0.2  # that a cancelled film may take to clean up by itself


def film_in_process(
    take: PreparedTake,
    terrain: Terrain,
    path: Path,
    export: ExportOptions,
    film: FilmOptions,
    progress: Progress,
    cancel: threading.Event,
) -> str:
    """As `film_of_take`, in another process; waits for it. SportError also when that process was ended from outside."""
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe()
    make = partial(film_of_take, take, terrain, path, export, film)
    process = context.Process(target=_work, args=(theirs, make), name="sport-film", daemon=True)
    process.start()
    theirs.close()
    try:
        return _follow(ours, progress, cancel, process.kill)
    except (EOFError, ConnectionError) as error:
        if cancel.is_set():
            return ""
        raise SportError(
            f"{path}: the film was ended from outside.", "Free some memory, or choose a smaller size."
        ) from error
    finally:
        ours.close()
        process.join()
        if cancel.is_set() and process.pid is not None:
            sweep_of(process.pid, path.parent)


def _follow(pipe: Connection, progress: Progress, cancel: threading.Event, kill: Callable[[], None]) -> str:
    """Hand progress on until the film is done; its sentence. EOFError or ConnectionError when the process is gone."""
    cancelled = 0.0
    while True:
        if cancel.is_set() and not cancelled:
            cancelled = time.monotonic()
            pipe.send("cancel")
        elif cancelled and time.monotonic() - cancelled > KILL_S:
            kill()  # it has no say in how long the program takes to end
        if not pipe.poll(POLL_S):
            continue
        kind, value = pipe.recv()
        if kind == "progress":
            progress(*value)
        elif kind == "failed":
            raise value
        else:
            return str(value)


def _work(pipe: Connection, make: Callable[[Progress, threading.Event], str]) -> None:
    """The other process; when the window's is gone, the film is given up."""
    if hasattr(os, "nice"):
        os.nice(NICENESS)
    cancel = threading.Event()

    def report(kind: str, value: Any) -> None:
        try:
            pipe.send((kind, value))
        except OSError:
            cancel.set()

    def progress(done: int, total: int) -> None:
        if pipe.poll():
            cancel.set()
        report("progress", (done, total))

    with contextlib.suppress(KeyboardInterrupt):  # Ctrl+C reaches both; the window's process decides
        try:
            report("done", make(progress, cancel))
        except Exception as error:  # raised again where the film was wanted
            report("failed", error)
