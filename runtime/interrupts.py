"""Ends this process at Ctrl+C, SIGTERM or SIGHUP: removes unfinished files and child processes, and prints one sentence.

The handler raises nothing. An exception at an arbitrary line would be lost in a library's callback, leave a module
half imported, or wait for a worker; and library threads abort a process whose interpreter is shut down under them.
It is imported first and itself imports almost nothing: before that, Ctrl+C prints a traceback.
"""

from __future__ import annotations

import contextlib
import os
import signal
import sys
import threading
import time

TYPE_CHECKING = False  # importing `typing` would delay the handling of Ctrl+C
if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence
    from pathlib import Path
    from subprocess import CompletedProcess
    from typing import NoReturn

SIGNALS = tuple(
    getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)
)  # Windows has no SIGHUP
CLEAN_UP_S = 1.2  # after which the process ends regardless


class _Unfinished:
    """Cleanup actions for when this process is ended, each under a key: a file, a folder or a session."""

    def __init__(self) -> None:
        self.actions: dict[object, Callable[[], object]] = {}
        self.ending = False
        self.remark = "unfinished files were removed"  # of the message

    def undo(self) -> None:
        """Call all registered actions, the last one first; a failing action is reported and does not stop the others."""
        for action in reversed([*self.actions.values()]):
            try:
                action()
            except Exception as error:
                _write(f"not undone: {type(error).__name__}: {error}")


_UNFINISHED = _Unfinished()


def undo_when_ended(key: object, action: Callable[[], object]) -> None:
    """Call `action` if a signal or a failure ends this process before `forget(key)`."""
    while _UNFINISHED.ending and threading.current_thread() is not threading.main_thread():
        time.sleep(1.0)  # the process is about to end: start nothing new
    _UNFINISHED.actions[key] = action


def forget(key: object) -> None:
    """Cancel the `undo_when_ended` registered under `key`."""
    _UNFINISHED.actions.pop(key, None)


def remark_when_ended(remark: str) -> None:
    """Set the remark that is printed when a signal ends this command, after "stopped by Ctrl+C;"."""
    _UNFINISHED.remark = remark


@contextlib.contextmanager
def removed_when_ended(*paths: Path) -> Iterator[None]:
    """Remove the files if this process is ended within the block."""
    for path in paths:
        remove_when_ended(path)
    try:
        yield
    finally:
        for path in paths:
            forget(path)


def remove_when_ended(path: Path) -> None:
    """Remove `path`, a file or an empty folder, if this process is ended before `forget(path)`."""

    def remove() -> None:
        with contextlib.suppress(OSError):  # it no longer exists, or is no longer empty
            (path.rmdir if path.is_dir() else path.unlink)()

    undo_when_ended(path, remove)


def exit_code(number: int) -> int:
    """Return the exit code of a process ended by a signal: 130 for SIGINT, 143 for SIGTERM."""
    return 128 + number


def take_signals(name: str) -> None:
    """Install handlers so that the signals of `SIGNALS` end this process with `exit_code`; main thread only.

    Ignored signals stay ignored, as `nohup` needs. `name` is the command's name in the message on stderr.
    """
    owner = os.getpid()

    def end(number: int, _frame: object) -> None:
        if os.getpid() != owner:  # a forked child, which prints and removes nothing
            os._exit(exit_code(number))
        end_now(number, name)

    for number in SIGNALS:
        if signal.getsignal(number) != signal.SIG_IGN:
            signal.signal(number, end)


def end_now(number: int, name: str) -> None:
    """Undo unfinished work, print a message, and end the process without shutting down the interpreter.

    Returns at once if this is already under way, so that a second signal does not interrupt it.
    """
    if _UNFINISHED.ending:
        return
    _UNFINISHED.ending = True
    threading.Thread(target=_end_late, args=(exit_code(number),), daemon=True).start()
    end_children()
    remove_shared = getattr(sys.modules.get("multiprocessing.util"), "_exit_function", None)
    if remove_shared is not None:  # semaphores; the interpreter would call it at exit
        remove_shared()
    _UNFINISHED.undo()
    with contextlib.suppress(OSError, ValueError, RuntimeError, AttributeError):  # it may be in use right now
        sys.stdout.flush()
    say(number, name, _UNFINISHED.remark)
    os._exit(exit_code(number))


def say(number: int, name: str, remark: str = "") -> None:
    """Print the message about a signal to stderr, on a line of its own."""
    begin = "\n" if os.isatty(2) else ""  # after the terminal's ^C or a line of progress
    what = "Ctrl+C" if number == signal.SIGINT else signal.Signals(number).name
    _write(f"{begin}{name}: stopped by {what}{remark and '; '}{remark}.")


def _write(line: str) -> None:
    """Write a line to stderr without Python's buffer, which may be in use right now."""
    with contextlib.suppress(OSError):
        os.write(2, f"{line}\n".encode())


def _end_late(code: int) -> None:
    time.sleep(CLEAN_UP_S)
    os._exit(code)


def end_children() -> None:
    """Kill the child processes started by `multiprocessing`."""
    # a module still being imported has none yet
    active_children = getattr(sys.modules.get("multiprocessing"), "active_children", tuple)
    for process in active_children():
        process.kill()


@contextlib.contextmanager
def signals_kept_from_children() -> Iterator[None]:
    """Block signals in `multiprocessing` processes started by this thread within the block; this process ends them.

    A terminal sends Ctrl+C to all of them, and they would print tracebacks while importing.
    """
    if not hasattr(signal, "pthread_sigmask"):  # Windows
        yield
        return
    from multiprocessing import resource_tracker

    resource_tracker.ensure_running()  # otherwise it would unblock the signals
    before = signal.pthread_sigmask(signal.SIG_BLOCK, SIGNALS)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def run_child(
    command: Sequence[str], timeout: float | None = None, env: Mapping[str, str] | None = None
) -> CompletedProcess[str]:
    """Run a program to its end and return its exit code and output.

    It and its children are killed after `timeout` seconds, or with this process. Raises subprocess.TimeoutExpired, OSError.
    """
    from subprocess import PIPE, CompletedProcess, Popen

    with Popen(
        command, stdout=PIPE, stderr=PIPE, text=True, errors="replace", env=env, start_new_session=True
    ) as child:

        def kill() -> None:
            if child.poll() is None and hasattr(os, "killpg"):
                os.killpg(child.pid, signal.SIGKILL)
            child.kill()

        undo_when_ended(child, kill)
        try:
            out, err = child.communicate(timeout=timeout)
        finally:
            kill()
            forget(child)
    return CompletedProcess(command, child.returncode, out, err)


def run_process(name: str, command: Callable[[], int | None]) -> NoReturn:
    """Run a command as the whole process and exit with its code; see `take_signals` and `run_command`."""
    take_signals(name)
    from runtime.errors import run_command

    leave(run_command(name, command))


def leave(code: int) -> NoReturn:
    """End the process with an exit code; after a failure, undo unfinished work first.

    The interpreter is not shut down: that takes seconds, and aborts if a library still runs threads.
    """
    if code:
        _UNFINISHED.undo()
    if "logging" in sys.modules:
        sys.modules["logging"].shutdown()
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(OSError, ValueError, AttributeError):  # a pipe without a reader
            stream.flush()
    os._exit(code)
