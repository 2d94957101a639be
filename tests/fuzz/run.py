"""Runs a target on damaged inputs and judges each: read, refused by a SportError, or a failure."""

from __future__ import annotations

import contextlib
import logging
import os
import random
import signal
import tempfile
import time
import traceback
import warnings
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from types import FrameType

from runtime.errors import SportError

from . import files, lists, models, sessions, window, words
from .target import Target

_ROOMS = (files, words, models, sessions, lists, window)
TARGETS = {target.name: target for room in _ROOMS for target in room.TARGETS}
MAX_MB = 500.0
HUNG_SECONDS = 30  # by the clock; and no less than 15 for each second that a target may take
MAX_INPUT_BYTES = 4_000_000  # damage repeats damage; large files are tests of their own


class HungError(BaseException):
    """An input that was not read in time; no reader may take it for damage."""


@dataclass
class Tally:
    """What came of the inputs of one target; a failure is an input's number and what went wrong."""

    inputs: int = 0
    read: int = 0
    refused: int = 0
    slowest_s: float = 0.0
    most_mb: float = 0.0
    failures: list[tuple[int, str]] = field(default_factory=list)

    def add(self, other: Tally) -> None:
        """Take up what came of other inputs of the same target."""
        self.inputs += other.inputs
        self.read += other.read
        self.refused += other.refused
        self.slowest_s = max(self.slowest_s, other.slowest_s)
        self.most_mb = max(self.most_mb, other.most_mb)
        self.failures += other.failures


def damaged(target: Target, seeds: list[bytes], number: int) -> bytes:
    """Input `number` of a target: the same in every run."""
    rng = random.Random(f"{target.name} {number}")
    return target.damage(rng, rng.choice(seeds))[:MAX_INPUT_BYTES]


def run(
    target: Target, folder: Path, first: int, count: int, before: Path | None = None, measured: bool = True
) -> Tally:
    """Read inputs `first` to `first + count`; the number of each is in the file `before` while it is being read.

    What takes more time or memory than it may is a failure where that is `measured`.
    """
    home = folder / "home"
    home.mkdir(parents=True, exist_ok=True)
    with quiet_environment(home), warnings.catch_warnings(), _no_log():
        warnings.simplefilter("ignore")
        return _run(target, folder, first, count, before, measured)


def run_apart(name: str, first: int, count: int, before: Path) -> Tally:
    """The same for a process of its own."""
    with tempfile.TemporaryDirectory(prefix="sport-fuzz-") as folder:
        return run(TARGETS[name], Path(folder), first, count, before)


@contextlib.contextmanager
def _no_log() -> Iterator[None]:
    """Readers log what they repair; a million of these lines say nothing, and tests that come after need the log."""
    before = logging.root.manager.disable
    logging.disable(logging.CRITICAL)
    try:
        yield
    finally:
        logging.disable(before)


def _run(target: Target, folder: Path, first: int, count: int, before: Path | None, measured: bool) -> Tally:
    seeds = target.seeds(folder)
    tally = Tally()
    with contextlib.suppress(SportError):
        target.read(folder, seeds[0])  # what is imported and loaded once belongs to no input
    for number in range(first, first + count):
        if before is not None:
            before.write_text(str(number), encoding="utf-8")
        data = damaged(target, seeds, number)
        held = _reset_peak()
        started = time.thread_time()
        problem = ""
        try:
            with _alarm(max(HUNG_SECONDS, round(15 * target.seconds))):
                target.read(folder, data)
            tally.read += 1
        except SportError as error:
            tally.refused += 1
            problem = _sentence(error)
        except (Exception, HungError) as error:
            where = traceback.extract_tb(error.__traceback__)[-1]
            at = f"{Path(where.filename).name}:{where.lineno}"
            problem = f"{type(error).__name__} at {at}: {str(error)[:200]}"
        taken, grown = time.thread_time() - started, _peak() - held
        if measured and taken > target.seconds:
            problem = problem or f"{taken:.1f} s"
        if measured and grown > MAX_MB:
            problem = problem or f"{grown:.0f} MB"
        tally.inputs += 1
        tally.slowest_s, tally.most_mb = max(tally.slowest_s, taken), max(tally.most_mb, grown)
        if problem:
            tally.failures.append((number, problem))
    return tally


def _sentence(error: SportError) -> str:
    """What is wrong with the message of an error, "" when it can be shown: one line, not a page."""
    said = str(error)
    if not said.strip() or len(said) > 3000 or "\n" in said:
        return f"a message that is no sentence: {said[:200]!r}"
    try:
        said.encode()
    except UnicodeEncodeError:
        return f"a message that cannot be written: {said[:200]!a}"
    return ""


@contextlib.contextmanager
def _alarm(seconds: int) -> Iterator[None]:
    """HungError in what takes longer than so many seconds."""

    def ring(_signal: int, _frame: FrameType | None) -> None:
        raise HungError(f"not read within {seconds} s")

    if not hasattr(signal, "SIGALRM"):
        yield
        return
    old = signal.signal(signal.SIGALRM, ring)
    signal.alarm(seconds)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, old)


@contextlib.contextmanager
def quiet_environment(home: Path) -> Iterator[None]:
    """No key, no settings and no caches of whoever runs this."""
    changed = {
        "HOME": str(home), "SPORT_CONFIG_DIR": str(home), "SPORT_CACHE_DIR": str(home),
        **dict.fromkeys(("OPENAI_API_KEY", "OPENAI_BASE_URL", "HTTP_PROXY", "http_proxy", "ALL_PROXY", "all_proxy")),
    }  # fmt: skip
    old = {name: os.environ.get(name) for name in changed}
    _set(changed)
    try:
        yield
    finally:
        _set(old)


def _set(values: dict[str, str | None]) -> None:
    for name, value in values.items():
        if value is None:
            os.environ.pop(name, None)
        else:
            os.environ[name] = value


def _reset_peak() -> float:
    """MB held now, from which the peak is counted again; 0 where the system does not tell."""
    try:
        Path("/proc/self/clear_refs").write_text("5", encoding="utf-8")
    except OSError:
        return 0.0
    return _status("VmRSS")


def _peak() -> float:
    return _status("VmHWM")


def _status(name: str) -> float:
    try:
        text = Path("/proc/self/status").read_text(encoding="utf-8")
    except OSError:
        return 0.0
    return int(text.split(f"{name}:")[1].split()[0]) / 1024
