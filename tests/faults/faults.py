"""Each fault as a function: it happens to a process that records or edits, and what is left is counted."""

import contextlib
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from unittest.mock import patch

from runtime.errors import SportError
from runtime.session.session import Take
from runtime.session.session_file import SessionFile

RECORDER = Path(__file__).with_name("recorder.py")
START_S = 120.0
FPS = 60.0
MOST_LOST_S = 0.25 + 0.2  # what is written down together, and the time until it is on disk on a busy machine


@dataclass
class Outcome:
    """What came out of one fault."""

    lost_s: float  # of the recording, by the frames that the process had reported
    code: int
    where: str  # the folder that holds the session now
    said: str = ""  # on stderr
    problems: list[str] = field(default_factory=list)  # nothing may be in it


class Recorder:
    """A process that records; `frames` is what it reported last, of edits their number."""

    def __init__(self, folder: Path, *options: str, env: dict[str, str] | None = None) -> None:
        self.config, self.temporary = folder / "config", folder / "temporary"
        self.temporary.mkdir(parents=True, exist_ok=True)
        command = [sys.executable, str(RECORDER), str(self.config), *options]
        environment = {**os.environ, "TMPDIR": str(self.temporary), **(env or {})}
        pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
        self.process = subprocess.Popen(command, env=environment, **pipes)  # type: ignore[call-overload]
        self.frames, self.said, self.stuck = 0, "", False
        self._readers = [threading.Thread(target=read, daemon=True) for read in (self._count, self._listen)]
        for reader in self._readers:
            reader.start()

    def _count(self) -> None:
        assert self.process.stdout is not None
        for line in self.process.stdout:
            self.frames = int(line)

    def _listen(self) -> None:
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


def signalled(number: int, *options: str) -> Callable[[Path, float], Outcome]:
    """The process is killed by a signal that it cannot or does not handle."""

    def fault(folder: Path, seconds: float) -> Outcome:
        recorder = Recorder(folder, *options)
        recorder.until(seconds)
        recorder.process.send_signal(number)
        return _killed(recorder, takes=1, edits="--edits" in options)

    return fault


def takes_in(folder: Path, problems: list[str]) -> list[list[Take]]:
    """The takes of each session in a folder, whose frames are all there; what is wrong goes to `problems`."""
    found = []
    for path in sorted(folder.glob("*.sport")):
        try:
            file, history = SessionFile.open(path, folder / "characters")
            takes = list(history.present.session.takes)
            for take in takes:
                header = take.made.header
                if len(take.made.clip) != take.frames or (header.resimulable and take.made.inputs is None):
                    problems.append(f"{path.name}: {take.title} is not whole")
                if not take.made.header.resimulable:
                    problems.append(f"{path.name}: {take.title} cannot be resimulated")
            file.close()
        except SportError as error:
            problems.append(str(error))
            continue
        found.append(takes)
    return found


def _killed(recorder: Recorder, takes: int, edits: bool = False) -> Outcome:
    """What the session of a killed process has of what it had reported."""
    code = recorder.wait()
    outcome = Outcome(recorder.frames / FPS, code, "sessions", recorder.said)
    outcome.problems += [f"it did not end within {START_S:.0f} s"] * recorder.stuck
    found = takes_in(recorder.config / "sessions", outcome.problems)
    if [len(session) for session in found] == [takes]:
        last = found[0][-1]
        outcome.lost_s -= (int(last.name.split()[-1]) if edits else last.frames) / FPS
    else:
        outcome.problems.append(f"{[len(session) for session in found]} takes of {takes}")
    if outcome.lost_s > MOST_LOST_S:
        outcome.problems.append(f"{outcome.lost_s:.2f} s lost")
    return outcome


def folder_removed(folder: Path, seconds: float) -> Outcome:
    """The folder of settings and sessions is removed while a take runs and another has ended; then the process is killed."""
    recorder = Recorder(folder, "--takes", "1")
    recorder.until(seconds)
    shutil.rmtree(recorder.config)
    recorder.until(seconds + 2.0)
    recorder.process.send_signal(signal.SIGKILL)
    return _killed(recorder, takes=2)


def display_gone(folder: Path, seconds: float) -> Outcome:
    """The display server is killed under the window."""
    with display() as (server, name):
        recorder = Recorder(folder, "--window", env={"DISPLAY": name, "WAYLAND_DISPLAY": ""})
        recorder.until(seconds)
        server.kill()
        return _killed(recorder, takes=1)


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


def interrupted_often(folder: Path, seconds: float) -> Outcome:
    """Ctrl+C, and again and again while the session is being written."""
    recorder = Recorder(folder, "--slow", "0.3")
    recorder.until(seconds)
    for _ in range(4):
        recorder.process.send_signal(signal.SIGINT)
        time.sleep(0.2)
    return _ended([recorder], recorder.config / "sessions", expected=130)


def disk_full(folder: Path, seconds: float) -> Outcome:
    """The disk of the sessions gets full (a real one of 256 KB where root may mount it)."""
    place = folder / "config" / "sessions"
    place.mkdir(parents=True)
    mount = ["mount", "-t", "tmpfs", "-o", "size=256k", "tmpfs", str(place)]
    mounted = bool(shutil.which("mount")) and subprocess.run(mount, capture_output=True).returncode == 0
    try:
        recorder = Recorder(folder, "--takes", "1", *(() if mounted else ("--full",)))
        recorder.until(seconds)
        if mounted:
            with contextlib.suppress(OSError), (place / "filler").open("wb", buffering=0) as filler:
                while True:
                    filler.write(bytes(512))
        recorder.until(seconds + 1.0)
        recorder.process.send_signal(signal.SIGTERM)
        with patch.object(tempfile, "tempdir", str(recorder.temporary)):
            return _ended([recorder], place, expected=143, takes=2, elsewhere=True)
    finally:
        if mounted:
            subprocess.run(["umount", str(place)], check=True)


def state_is_a_file(folder: Path, seconds: float) -> Outcome:
    """The folder of settings and sessions cannot be made; so it is in a read-only home."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "config").write_text("", encoding="utf-8")
    recorder = Recorder(folder)
    recorder.until(seconds)
    recorder.process.send_signal(signal.SIGTERM)
    recorder.wait()
    (place,) = recorder.temporary.glob("sport-*")
    return _ended([recorder], place, expected=143, elsewhere=True)


def two_at_once(folder: Path, seconds: float) -> Outcome:
    """Two runs with three takes each end at the same moment."""
    recorders = [Recorder(folder, "--takes", "2") for _ in range(2)]
    for recorder in recorders:
        recorder.until(seconds)
    for recorder in recorders:
        recorder.process.send_signal(signal.SIGTERM)
    return _ended(recorders, recorders[0].config / "sessions", expected=143, takes=3)


def _ended(
    recorders: list[Recorder], place: Path, expected: int, takes: int = 1, elsewhere: bool = False
) -> Outcome:
    """What the sessions in `place` hold of what was recorded when the processes were told to end."""
    codes = [recorder.wait() for recorder in recorders]
    said = "".join(recorder.said for recorder in recorders)
    outcome = Outcome(0.0, codes[0], place.name, said)
    found = takes_in(place, outcome.problems)
    frames = sum(recorder.frames for recorder in recorders)
    outcome.lost_s = max(frames - sum(session[-1].frames for session in found if session), 0) / FPS
    if [len(session) for session in found] != [takes] * len(recorders):
        outcome.problems.append(f"{[len(session) for session in found]} takes of {takes}")
    if outcome.lost_s > 0.0:
        outcome.problems.append(f"{outcome.lost_s:.2f} s lost")
    outcome.problems += [f"it did not end within {START_S:.0f} s"] * any(r.stuck for r in recorders)
    if any(code != expected for code in codes):
        outcome.problems.append(f"exit codes {codes}, expected {expected}: {said[-300:]}")
    if elsewhere and str(place) not in said:
        outcome.problems.append(f"it does not say where: {said[-300:]}")
    return outcome


def all_faults() -> dict[str, Callable[[Path, float], Outcome]]:
    """The faults that can be made on this machine, by name."""
    names = [name for name in ("SIGKILL", "SIGSEGV", "SIGABRT", "SIGQUIT") if hasattr(signal, name)]
    faults = {f"killed by {name}": signalled(getattr(signal, name)) for name in names}
    faults["killed while editing"] = signalled(signal.SIGKILL, "--edits")
    if shutil.which("Xvfb"):
        faults["display gone"] = display_gone
    return {
        **faults,
        "folder of sessions removed, then SIGKILL": folder_removed,
        "Ctrl+C four times": interrupted_often,
        "disk full": disk_full,
        "nothing can be written but temporary files": state_is_a_file,
        "two runs end at once": two_at_once,
    }
