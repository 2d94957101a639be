"""Slow work (loading, encoding, writing) on worker threads; results are delivered on the main thread."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import Any

from runtime.errors import SportError
from viewer.messages import Messages

_LOG = logging.getLogger("sport.viewer")
PATIENCE_S = 0.7  # a file that is read faster needs no word


class ReadingCancelled(SportError):
    """The user has stopped the reading of a file."""


@dataclass
class _Job:
    slot: str
    number: int
    future: Future[Any]
    done: Callable[[Any], None]
    failed: Callable[[Exception], None] | None
    reading: str = ""  # what is read: it can be cancelled, and the end of the program does not wait for it
    begun: float = field(default_factory=time.monotonic)


@dataclass
class Jobs:
    """Named slots, the latest job of a slot wins: an older one's result is dropped.

    With `blocking` every job is done before `submit` returns, so that an offscreen run is deterministic.
    """

    messages: Messages
    blocking: bool = False
    workers: int = 2
    first_error: SportError | None = None
    _pool: ThreadPoolExecutor | None = None
    _jobs: list[_Job] = field(default_factory=list)
    _latest: dict[str, int] = field(default_factory=dict)

    def submit(
        self,
        slot: str,
        work: Callable[[], Any],
        done: Callable[[Any], None],
        failed: Callable[[Exception], None] | None = None,
        reading: str = "",
    ) -> None:
        """Run `work` on a thread, then `done(result)` here; a failure is posted and given to `failed`.

        With `reading`, the name of a file, the job has a thread of its own, and `cancel` ends it.
        """
        number = self._latest.get(slot, 0) + 1
        self._latest[slot] = number
        future = _on_its_own_thread(work) if reading else self._threads().submit(work)
        self._jobs.append(_Job(slot, number, future, done, failed, reading))
        if self.blocking:
            self._jobs[-1].future.exception()  # waits; `deliver` looks at it
            self.deliver()

    def _threads(self) -> ThreadPoolExecutor:
        if self._pool is None:
            self._pool = ThreadPoolExecutor(self.workers, thread_name_prefix="sport")
        return self._pool

    def reading(self) -> str:
        """The file that has been read for longest, once that takes a while; "" for none."""
        late = time.monotonic() - PATIENCE_S
        return next((job.reading for job in self._jobs if job.reading and job.begun < late), "")

    def cancel(self) -> None:
        """Drop what is being read: its result comes no more."""
        dropped = [job for job in self._jobs if job.reading]
        self._jobs = [job for job in self._jobs if not job.reading]
        for job in dropped:
            self.messages.note(f"Stopped reading {job.reading}.")
            if job.failed is not None and job.number == self._latest[job.slot]:
                job.failed(ReadingCancelled(f"{job.reading}: cancelled."))

    def busy(self, slot: str) -> bool:
        """Whether a job of the slot is running or waiting."""
        return any(job.slot == slot for job in self._jobs)

    def deliver(self) -> None:
        """Hand over what has finished; call once a frame."""
        finished = [job for job in self._jobs if job.future.done()]
        self._jobs = [job for job in self._jobs if job not in finished]
        for job in finished:
            if job.number == self._latest[job.slot]:
                self._hand_over(job)

    def _hand_over(self, job: _Job) -> None:
        try:
            result = job.future.result()
            self.messages.settle(job.slot)
            job.done(result)
        except Exception as error:  # whatever a loader meets becomes a message; the window lives on
            if isinstance(error, SportError):
                known = error
            else:
                _LOG.exception("job %s failed", job.slot)
                known = SportError(
                    f"{job.slot}: {type(error).__name__}: {error}.", "Please report this defect."
                )
            self.messages.error(known, job.slot)
            self.first_error = self.first_error or known
            if job.failed is not None:
                job.failed(error)

    def finish(self, prefix: str) -> bool:
        """Wait for the jobs whose slots begin with `prefix` and hand over what they made; whether none failed."""
        errors = [job.future.exception() for job in self._jobs if job.slot.startswith(prefix)]
        self.deliver()
        return not any(errors)

    def close(self) -> None:
        """Finish what was begun, but for files that are read: a clip that is being written, or waits for it, must not be lost."""
        if self._pool is not None:
            self._pool.shutdown(wait=True)
            self._pool = None


def _on_its_own_thread(work: Callable[[], Any]) -> Future[Any]:
    """A thread that dies with the program: a pipe that nobody writes, or a file without end, must not hold it up."""
    future: Future[Any] = Future()

    def run() -> None:
        try:
            future.set_result(work())
        except BaseException as error:  # whatever it is, it is raised where the result is asked for
            future.set_exception(error)

    threading.Thread(target=run, daemon=True, name="sport reading").start()
    return future
