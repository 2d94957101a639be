"""Slow work (loading, encoding, writing) on worker threads; results are delivered on the main thread.

Each job has a daemon thread, so that reading an endless pipe cannot block the end of the program. The user's files are
read and written at once, everything else a few at a time. Of jobs that do not write, only the newest in a slot counts: an
older one is dropped, and at the end of the program all of them. Writing jobs are always finished, one after the other
in their slot.
"""

import contextlib
import logging
import threading
import time
from collections.abc import Callable, Hashable, Iterator
from concurrent.futures import CancelledError, Future, wait
from dataclasses import dataclass, field
from functools import partial
from typing import Any

from runtime.errors import SportError
from viewer.messages import Messages

_LOG = logging.getLogger("sport.viewer")
PATIENCE_S = 0.7  # faster reads and writes are not mentioned
MAX_PARALLEL_JOBS = 2  # jobs that neither read nor write the user's files


class JobCancelled(SportError):
    """Raised if the user cancelled a job."""


@dataclass(frozen=True)
class Slot:
    """The subject of a job: its kind in words for the user, and which one if there are several."""

    what: str
    of: Hashable = None


@dataclass(eq=False)
class _Job:
    slot: Slot
    future: Future[Any]
    done: Callable[[Any], None]
    failed: Callable[[Exception], None] | None
    reading: str = ""  # the file being read: can be cancelled, and does not delay the end of the program
    writing: str = ""  # the file being written: delays the end of the program
    doing: str = ""  # any other text for the status line
    cancel: Callable[[], None] | None = None  # ends it early
    unwanted: Callable[[Any], object] | None = None  # gets the result if it comes no more
    begun: float = field(default_factory=time.monotonic)
    dropped: bool = False  # its result is discarded
    told: bool = False  # another job reading the same file has already reported its error

    @property
    def words(self) -> str:
        """The subject of the job, capitalised for the beginning of a sentence."""
        what = self.writing or self.doing or self.slot.what
        return self.reading or what[:1].upper() + what[1:]

    @property
    def shown(self) -> str:
        """The text that the status line shows for the job, or ""."""
        about = (("Reading", self.reading), ("Writing", self.writing))
        return next((f"{verb} {what}" for verb, what in about if what), self.doing)


@dataclass
class Jobs:
    """Background jobs by slot. With `blocking`, `submit` returns after the job is done, so that an offscreen run is deterministic."""

    messages: Messages
    blocking: bool = False
    first_error: SportError | None = None
    progress: dict[Slot, str] = field(default_factory=dict)  # progress text of a job; set by any thread
    _turn: threading.Semaphore = field(default_factory=lambda: threading.Semaphore(MAX_PARALLEL_JOBS))
    _jobs: list[_Job] = field(default_factory=list)

    def submit(
        self,
        slot: Slot,
        work: Callable[[], Any],
        done: Callable[[Any], None],
        failed: Callable[[Exception], None] | None = None,
        reading: str = "",
        writing: str = "",
        doing: str = "",
        cancel: Callable[[], None] | None = None,
        unwanted: Callable[[Any], object] | None = None,
    ) -> None:
        """Run `work` on a thread, then `done(result)` on this one; a failure is shown and passed to `failed`.

        `reading` is the name of a file being read, which the user can cancel. `writing` and `doing` say what is written
        or done, in words for the user. `cancel` ends a running job early. `unwanted(result)` lets go of what a dropped
        job has opened, on any thread.
        """
        before = [job.future for job in self._of(slot, writing=True)]
        if not writing:
            self._drop(self._of(slot, writing=False))
        future: Future[Any] = Future()
        self._jobs.append(_Job(slot, future, done, failed, reading, writing, doing, cancel, unwanted))

        def run() -> None:
            wait(before if writing else ())
            with contextlib.nullcontext() if reading or writing else self._turn:
                _run(work, future)

        threading.Thread(target=run, daemon=True, name=f"sport {'reading' if reading else slot.what}").start()
        if self.blocking:
            wait([future])
            self.deliver()

    @contextlib.contextmanager
    def together(self) -> Iterator[None]:
        """Run the jobs submitted in the block in parallel even if `blocking`, and deliver them in order at the end."""
        blocking, self.blocking, before = self.blocking, False, list(self._jobs)
        try:
            yield
        finally:
            self.blocking = blocking
        if blocking:
            wait([job.future for job in self._jobs if job not in before])
            self.deliver()

    def _of(self, slot: Slot, writing: bool) -> list[_Job]:
        return [job for job in self._jobs if job.slot == slot and bool(job.writing) is writing]

    def _drop(self, jobs: list[_Job]) -> None:
        """End jobs whose results are not needed, if they can be cancelled; reads are abandoned."""
        self._jobs = [job for job in self._jobs if not (job.reading and job in jobs)]
        for job in jobs:
            job.dropped = True
            if not job.future.cancel() and job.cancel is not None:
                job.cancel()
            if job.unwanted is not None:
                job.future.add_done_callback(partial(_let_go, job.unwanted))

    def shown(self) -> tuple[str, Callable[[], None] | None]:
        """Return the status text of a job that takes a while, and a function that cancels it; "" and None without one."""
        late = time.monotonic() - PATIENCE_S
        for job in self._jobs:
            if job.begun < late and not job.dropped and job.shown:
                text = ": ".join(filter(None, (job.shown, self.progress.get(job.slot))))
                if job.reading:
                    return text, self.cancel_reading
                return text, job.cancel if job.writing else partial(self._cancel, [job])
        return "", None

    def cancel_reading(self) -> None:
        """Cancel all jobs that read files; their results are dropped."""
        self._cancel([job for job in self._jobs if job.reading and not job.dropped])

    def _cancel(self, jobs: list[_Job]) -> None:
        self._drop(jobs)
        for job in jobs:
            self.messages.note(
                f"Stopped reading {job.reading}." if job.reading else f"{job.words}: cancelled."
            )
            if job.failed is not None:
                job.failed(JobCancelled(f"{job.words}: cancelled."))

    def busy(self, slot: Slot) -> bool:
        return any(job.slot == slot and not job.dropped for job in self._jobs)

    def end_slot(self, slot: Slot) -> None:
        """Cancel the jobs of a slot, except those that write; their results are dropped."""
        self._drop(self._of(slot, writing=False))

    def deliver(self) -> None:
        """Deliver the results of finished jobs; call once per frame."""
        finished = [job for job in self._jobs if job.future.done()]
        self._jobs = [job for job in self._jobs if job not in finished]
        for job in finished:
            self.progress.pop(job.slot, None)
            if not job.dropped:
                self._hand_over(job, [other for other in (*finished, *self._jobs) if other.reading])

    def _hand_over(self, job: _Job, reading: list[_Job]) -> None:
        try:
            result = job.future.result()
            self.messages.settle(job.slot)
            job.done(result)
        except CancelledError:
            return
        except Exception as error:  # any error of a loader becomes a message; the window survives
            known = error if isinstance(error, SportError) else _for_animators(job, error)
            if not job.told:
                self.messages.error(known, job.slot, holds=not (job.reading or job.writing))
            for other in reading:
                other.told |= other.reading == job.reading
            self.first_error = self.first_error or known
            if job.failed is not None:
                job.failed(error)

    # --- the end

    def end(self) -> None:
        """Cancel all jobs for the end of the program, except writing jobs without a `cancel`."""
        self._drop([job for job in self._jobs if not job.writing])
        for job in self._jobs:
            if job.writing and job.cancel is not None:
                job.cancel()
        self._jobs = [job for job in self._jobs if job.writing or not job.future.cancelled()]

    def finish(self, kind: str = "", until: float | None = None) -> bool:
        """Wait for writing jobs of a kind, or all, deliver them, and return whether all succeeded.

        Jobs not done at the time `until` (of `time.monotonic`) are abandoned.
        """
        jobs = {job.future: job for job in self._jobs if job.writing and kind in ("", job.slot.what)}
        if wait(jobs, 0.0).not_done:
            self.messages.note(f"Waiting for {', '.join(job.writing for job in jobs.values())}.")
        done, late = wait(jobs, None if until is None else max(until - time.monotonic(), 0.0))
        self._give_up([jobs[future] for future in late])
        self.deliver()
        return not late and not any(future.exception() for future in done)

    def _give_up(self, late: list[_Job]) -> None:
        """Drop jobs that are too late for the end of the program, with a message."""
        self._drop(late)
        wait([job.future for job in late if job.cancel is not None], 0.2)  # cancelled jobs clean up
        for job in late:
            self.messages.warn(f"{job.words} was cancelled: the program is closing.")
        self._jobs = [job for job in self._jobs if job not in late]

    def close(self, until: float) -> None:
        """Finish writing jobs, until a time of `time.monotonic`; drop all others."""
        self.end()
        self.finish(until=until)


def _run(work: Callable[[], Any], future: Future[Any]) -> None:
    if future.set_running_or_notify_cancel():
        try:
            future.set_result(work())
        except BaseException as error:  # raised again where the result is requested
            future.set_exception(error)


def _let_go(unwanted: Callable[[Any], object], future: Future[Any]) -> None:
    if not future.cancelled() and future.exception() is None:
        unwanted(future.result())


def _for_animators(job: _Job, error: Exception) -> SportError:
    """Return the message for an unexpected error; its traceback is in the log."""
    _LOG.exception("job %s failed", job.words)
    if isinstance(error, MemoryError):
        return SportError(f"{job.words}: not enough memory.", "Close other programs, or use a smaller file.")
    if job.reading:
        return SportError(
            f"{job.reading} cannot be read: it is damaged, empty, or has the wrong ending.",
            "Export it again from the program that made it.",
        )
    return SportError(
        f"{job.words}: internal error ({type(error).__name__}).",
        "Please report it with the log.",
    )
