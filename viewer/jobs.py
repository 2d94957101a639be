"""Slow work (loading, encoding, writing) on worker threads; results are delivered on the main thread."""

from __future__ import annotations

import logging
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import Any

from sport.runtime.errors import SportError
from sport.viewer.messages import Messages

_LOG = logging.getLogger("sport.viewer")


@dataclass
class _Job:
    slot: str
    number: int
    future: Future[Any]
    done: Callable[[Any], None]
    failed: Callable[[Exception], None] | None


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
    ) -> None:
        """Run `work` on a thread, then `done(result)` here; a failure is posted and given to `failed`."""
        number = self._latest.get(slot, 0) + 1
        self._latest[slot] = number
        if self._pool is None:
            self._pool = ThreadPoolExecutor(self.workers, thread_name_prefix="sport")
        self._jobs.append(_Job(slot, number, self._pool.submit(work), done, failed))
        if self.blocking:
            self._jobs[-1].future.exception()  # waits; `deliver` looks at it
            self.deliver()

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
        """Finish what was begun: a clip that is being written, or waits for it, must not be lost."""
        if self._pool is not None:
            self._pool.shutdown(wait=True)
            self._pool = None
