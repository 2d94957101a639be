"""Each fault as a function: it happens to a recording process, and what is left of the take is counted."""

from __future__ import annotations

import contextlib
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

from runtime.formats.bvh_clip import load_clip_bvh
from runtime.takes.journal import find_journals

RECORDER = Path(__file__).with_name("recorder.py")
START_S = 120.0
FPS = 60.0


@dataclass
class Outcome:
    """What came out of one fault."""

    lost_s: float  # of the recording, by the frames that the process had reported
    code: int
    where: str  # what holds the take now
    takes: int = 1
    said: str = ""  # on stderr
    problems: list[str] = field(default_factory=list)  # nothing may be in it


class Recorder:
    """A recording process; `frames` is what it reported last."""

    def __init__(self, folder: Path, *options: str, env: dict[str, str] | None = None) -> None:
        self.config, self.export = folder / "config", folder / "clips"
        command = [sys.executable, str(RECORDER), str(self.config), str(self.export), *options]
        self.process = subprocess.Popen(
            command,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            env={**os.environ, **(env or {})},
        )
        self.frames, self.said, self.stuck = 0, "", False
        self._readers = [threading.Thread(target=read, daemon=True) for read in (self._count, self._listen)]
        for reader in self._readers:
            reader.start()

    def _count(self) -> None:
        assert self.process.stdout is not None
        for line in self.process.stdout:
            self.frames = int(line)

    def _listen(self) -> None:
        assert self.process.stderr is not None
        self.said = self.process.stderr.read()

    def until(self, seconds: float) -> None:
        """Wait until that much is recorded."""
        end = time.monotonic() + START_S + 10 * seconds
        while self.frames < seconds * FPS:
            assert self.process.poll() is None, f"it ended: {self.said[-1000:]}"
            assert time.monotonic() < end, "it records too slowly"
            time.sleep(0.02)

    def wait(self) -> int:
        """Its exit code; that of SIGKILL where it does not end by itself, which `stuck` says."""
        try:
            code = self.process.wait(START_S)
        except subprocess.TimeoutExpired:
            self.stuck = True
            self.process.kill()
            code = self.process.wait(START_S)
        for reader in self._readers:
            reader.join(10)
        return code


def signalled(number: int) -> Callable[[Path, float], Outcome]:
    """The process is killed by a signal that it cannot or does not handle."""

    def fault(folder: Path, seconds: float) -> Outcome:
        recorder = Recorder(folder)
        recorder.until(seconds)
        recorder.process.send_signal(number)
        return _from_journal(recorder)

    return fault


def _from_journal(recorder: Recorder, finished: int = 0) -> Outcome:
    code = recorder.wait()
    found, complaints = find_journals(recorder.config / "journals")
    outcome = Outcome(recorder.frames / FPS, code, "journal", len(found), recorder.said, complaints)
    outcome.problems += [f"it did not end within {START_S:.0f} s"] * recorder.stuck
    if len(found) == 1 + finished:
        outcome.lost_s -= max(len(journal.read()) for journal in found) / FPS
    else:
        outcome.problems.append(f"{len(found)} journals of {1 + finished}")
    if outcome.lost_s > 1.0:
        outcome.problems.append(f"{outcome.lost_s:.2f} s lost")
    for journal in found:
        journal.release()
    return outcome


def config_removed(folder: Path, seconds: float) -> Outcome:
    """The folder of settings and journals is removed while a take runs and another has ended; then the process is killed."""
    recorder = Recorder(folder, "--takes", "1")
    recorder.until(seconds)
    shutil.rmtree(recorder.config)
    recorder.until(seconds + 1.0)
    recorder.process.send_signal(signal.SIGKILL)
    return _from_journal(recorder, finished=1)


def display_gone(folder: Path, seconds: float) -> Outcome:
    """The display server is killed under the window."""
    with display() as (server, name):
        recorder = Recorder(folder, "--window", env={"DISPLAY": name, "WAYLAND_DISPLAY": ""})
        recorder.until(seconds)
        server.kill()
        return _from_journal(recorder)


def window_killed(folder: Path, seconds: float) -> Outcome:
    """The window's connection is cut by another program, as xkill does."""
    with display() as (_, name):
        recorder = Recorder(folder, "--window", env={"DISPLAY": name, "WAYLAND_DISPLAY": ""})
        recorder.until(seconds)
        subprocess.run([sys.executable, "-c", _XKILL, name], check=True)
        return _from_journal(recorder)


_XKILL = """
import ctypes, sys
x = ctypes.CDLL("libX11.so.6")
x.XOpenDisplay.restype = ctypes.c_void_p
display = ctypes.c_void_p(x.XOpenDisplay(sys.argv[1].encode()))
x.XDefaultRootWindow.restype = ctypes.c_ulong
root, parent, children, count = ctypes.c_ulong(), ctypes.c_ulong(), ctypes.POINTER(ctypes.c_ulong)(), ctypes.c_uint()
x.XQueryTree(display, ctypes.c_ulong(x.XDefaultRootWindow(display)), ctypes.byref(root), ctypes.byref(parent),
             ctypes.byref(children), ctypes.byref(count))
assert count.value
x.XKillClient(display, ctypes.c_ulong(children[count.value - 1]))
x.XSync(display, 0)
"""


@contextlib.contextmanager
def display() -> Iterator[tuple[subprocess.Popen[bytes], str]]:
    """A display server of its own and its name."""
    read, write = os.pipe()
    command = ["Xvfb", "-displayfd", str(write), "-screen", "0", "640x480x24", "-nolisten", "tcp"]
    with subprocess.Popen(command, pass_fds=[write], stderr=subprocess.DEVNULL) as server:
        os.close(write)
        try:
            with open(read, encoding="ascii") as answer:
                yield server, f":{answer.readline().strip()}"
        finally:
            server.kill()


def interrupted_twice(folder: Path, seconds: float) -> Outcome:
    """Ctrl+C, and again and again while the take is being written."""
    recorder = Recorder(folder, "--slow", "1.0")
    recorder.until(seconds)
    for _ in range(4):
        recorder.process.send_signal(signal.SIGINT)
        time.sleep(0.2)
    return _exported(recorder, [recorder.export], expected=0)


def disk_full(folder: Path, seconds: float) -> Outcome:
    """The disk of the export folder has no room (a real one of 16 KB where root may mount it)."""
    export = folder / "clips"
    export.mkdir(parents=True)
    mount = ["mount", "-t", "tmpfs", "-o", "size=16k", "tmpfs", str(export)]
    mounted = bool(shutil.which("mount")) and subprocess.run(mount, capture_output=True).returncode == 0
    try:
        recorder = Recorder(folder, *(() if mounted else ("--full",)))
        recorder.until(seconds)
        recorder.process.send_signal(signal.SIGTERM)
        return _exported(recorder, [recorder.config / "takes"], expected=1)
    finally:
        if mounted:
            subprocess.run(["umount", str(export)], check=True)


def export_is_a_file(folder: Path, seconds: float) -> Outcome:
    """What should be the export folder is a file; so it is where nothing can be made in a read-only home."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "clips").write_text("", encoding="utf-8")
    recorder = Recorder(folder)
    recorder.until(seconds)
    recorder.process.send_signal(signal.SIGTERM)
    return _exported(recorder, [recorder.config / "takes"], expected=1)


def no_home(folder: Path, seconds: float) -> Outcome:
    """Neither the export folder nor the folder of settings and journals can be made."""
    folder.mkdir(parents=True, exist_ok=True)
    for name in ("clips", "config"):
        (folder / name).write_text("", encoding="utf-8")
    temporary = folder / "temporary"
    temporary.mkdir()
    recorder = Recorder(folder, env={"TMPDIR": str(temporary)})
    recorder.until(seconds)
    recorder.process.send_signal(signal.SIGTERM)
    return _exported(recorder, [temporary / "sport-clips"], expected=1)


def two_at_once(folder: Path, seconds: float) -> Outcome:
    """Two runs with three takes each end at the same moment and export into one folder."""
    recorders = [Recorder(folder, "--takes", "2") for _ in range(2)]
    for recorder in recorders:
        recorder.until(seconds)
    for recorder in recorders:
        recorder.process.send_signal(signal.SIGTERM)
    recorders[1].wait()
    return _exported(recorders[0], [recorders[0].export], expected=0, takes=6, others=recorders[1:])


def _exported(
    recorder: Recorder,
    folders: list[Path],
    expected: int,
    takes: int = 1,
    others: list[Recorder] | None = None,
) -> Outcome:
    """What the files in `folders` hold of what was recorded."""
    code = recorder.wait()
    clips = [load_clip_bvh(path) for folder in folders for path in sorted(folder.glob("*.bvh"))]
    frames = sum(r.frames for r in (recorder, *(others or [])))
    finished = 10 * len(others or []) * 2  # frames of the takes before the running ones
    held = sum(len(clip) for clip in clips) - finished
    outcome = Outcome(max(frames - held, 0) / FPS, code, folders[0].name, len(clips), recorder.said)
    if len(clips) != takes:
        outcome.problems.append(f"{len(clips)} takes of {takes}")
    if outcome.lost_s > 0.0:
        outcome.problems.append(f"{outcome.lost_s:.2f} s lost")
    outcome.problems += [f"it did not end within {START_S:.0f} s"] * any(
        r.stuck for r in (recorder, *(others or []))
    )
    codes = [code, *(r.process.returncode for r in others or [])]
    if any(c != expected for c in codes):
        outcome.problems.append(f"exit codes {codes}, expected {expected}: {recorder.said[-300:]}")
    if expected and str(folders[0]) not in recorder.said:
        outcome.problems.append(f"it does not say where: {recorder.said[-300:]}")
    if find_journals(recorder.config / "journals")[0]:
        outcome.problems.append("a journal is left")
    return outcome


def all_faults() -> dict[str, Callable[[Path, float], Outcome]]:
    """The faults that can be made on this machine, by name."""
    names = [name for name in ("SIGKILL", "SIGSEGV", "SIGABRT", "SIGQUIT") if hasattr(signal, name)]
    faults = {f"killed by {name}": signalled(getattr(signal, name)) for name in names}
    if shutil.which("Xvfb"):
        faults |= {"display gone": display_gone, "window killed": window_killed}
    return {
        **faults,
        "folder of journals removed, then SIGKILL": config_removed,
        "Ctrl+C four times": interrupted_twice,
        "disk full": disk_full,
        "export folder is a file": export_is_a_file,
        "nothing can be written but temporary files": no_home,
        "two runs end at once": two_at_once,
    }
