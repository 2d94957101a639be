"""A take on disk while it is recorded: what is left of it when the process is killed, and how that is read.

A journal is one line of JSON, then records: `F` and one frame of 132 little-endian float32 as `ClipRecorder` keeps it,
or `P`, a length of four bytes and a prompt as JSON. Whoever writes it holds its lock until the take is safe elsewhere.
"""

from __future__ import annotations

import json
import os
import stat
import struct
import threading
import time
import uuid
from collections import deque
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from runtime.errors import FileError, SportError
from runtime.file_lock import open_locked
from runtime.open_files import leaves_room
from runtime.safe_read import is_text, parse_json, printable
from runtime.skeleton import J
from runtime.takes.clip import MAX_DISTANCE_M, MAX_FPS, MAX_NORM_ERROR, MAX_SIZE, MIN_SIZE, Clip
from runtime.takes.metadata import Origin, PromptEvent, event_from, origin_from
from runtime.takes.recorder import ClipRecorder

SUFFIX = ".take"
ROW = 3 + 4 * J + 4 + 1  # floats of a frame: hips, local rotations, contacts, gait
MAX_HEADER = 64 * 1024  # bytes
MAX_EVENT = 1 << 20  # bytes
MAX_BYTES = 1 << 30  # of a journal: nine hours; what is recorded after that is in memory only
WRITE_SECONDS = 0.25  # between two writes: what a killed process loses
PATIENCE_SECONDS = 0.05  # that the end of a journal that nobody wants may keep its caller waiting
SYNC_SECONDS = 1.0  # between two fsyncs: what a machine without power loses
_FORMAT, _VERSION = "sport-journal", 1
_FRAME, _PROMPT = b"F", b"P"


@dataclass(frozen=True)
class Header:
    """What is known of a take when it begins."""

    name: str
    fps: float
    terrain: str  # name or file of the ground
    origin: Origin
    begun: float = 0.0  # seconds since 1970
    size: float = 1.0  # of the body that the take is made for, see `Clip.size`


class TakeJournal:
    """The journal of one take. The frame's path only appends to a queue; a thread writes."""

    def __init__(self, folder: Path, header: Header) -> None:
        self.path = folder / f"{time.strftime('%Y%m%d-%H%M%S')}-{uuid.uuid4().hex[:8]}{SUFFIX}"
        self.problem = ""  # why the take is not on disk
        self.cpu_seconds = 0.0  # that the thread has used
        self._header = header
        self._queue: deque[NDArray[np.float32] | PromptEvent] = deque()
        self._handle: int | None = None
        self._ending = threading.Event()
        self._unwanted = False
        self._thread = threading.Thread(target=self._run, name="sport-journal", daemon=True)
        self._thread.start()

    def add_row(self, row: NDArray[Any]) -> None:
        """Write a frame soon; see `ClipRecorder.add_row`."""
        self._queue.append(row)

    def mark_prompt(self, event: PromptEvent) -> None:
        """Write a prompt soon; its time is that of the next frame."""
        self._queue.append(event)

    def finish(self) -> None:
        """The take has ended: write what is queued, and keep the file and its lock. Does not wait."""
        self._ending.set()

    def watch(self) -> None:
        """Once the take has ended, write its file again where somebody has removed it; `problem` says why that failed."""
        if self._handle is None or self._thread.is_alive() or self.problem:
            return
        try:
            self._handle = still_there(self._handle, self.path)
        except (OSError, SportError) as error:
            self.problem = _reason(self.path, error)

    def release(self) -> None:
        """Let go of the file: another start of the program may offer it."""
        self.finish()
        self._thread.join()
        handle, self._handle = self._handle, None
        if handle is not None:
            os.close(handle)

    def delete(self) -> None:
        """The take is safe elsewhere, or not wanted. A file that cannot be removed is offered again."""
        self._unwanted = True
        self._queue.clear()
        self.finish()
        self._thread.join(PATIENCE_SECONDS)
        if self._thread.is_alive():  # a disk that syncs: the window does not wait for it
            threading.Thread(target=self._remove, name="sport-journal-end", daemon=True).start()
        else:
            self._remove()

    def _remove(self) -> None:
        self.release()
        _unlink(self.path)

    def _run(self) -> None:
        """The thread: open, then write and sync until the end."""
        try:
            handle = self._open()
            synced, size = time.monotonic(), 0
            ended = False
            while not ended:
                ended = self._ending.wait(WRITE_SECONDS)
                if self._unwanted:
                    break
                data = self._drained()
                handle = self._handle = still_there(handle, self.path)
                _write(handle, data)
                size += len(data)
                if ended or time.monotonic() - synced >= SYNC_SECONDS:
                    os.fsync(handle)
                    synced = time.monotonic()
                self.cpu_seconds = time.thread_time()
                if size > MAX_BYTES:
                    raise FileError(
                        f"{self.path}: {MAX_BYTES >> 20} MB are full.", "Stop the take and export it."
                    )
        except (OSError, SportError) as error:
            self.problem = _reason(self.path, error)
        while not self._ending.wait(WRITE_SECONDS):
            self._queue.clear()  # nobody writes it; the recorder has it all

    def _open(self) -> int:
        self.path.parent.mkdir(parents=True, exist_ok=True)
        handle = open_locked(self.path, create=True)
        if handle is None:
            raise FileError(
                f"{self.path}: it cannot be locked.", "Choose another folder by SPORT_CONFIG_DIR."
            )
        if not leaves_room(handle):
            os.close(handle)
            _unlink(self.path)
            raise FileError(f"{self.path}: {handle} files are open.", "Save the project, or export takes.")
        self._handle = handle
        head = {"format": _FORMAT, "version": _VERSION, **asdict(self._header)}
        head["terrain"] = printable(self._header.terrain)
        _write(handle, json.dumps(head).encode("ascii") + b"\n")
        os.fsync(handle)
        return handle

    def _drained(self) -> bytes:
        parts = []
        for _ in range(len(self._queue)):
            item = self._queue.popleft()
            if isinstance(item, PromptEvent):
                event = json.dumps(asdict(item)).encode("ascii")
                parts += [_PROMPT, struct.pack("<I", len(event)), event]
            else:
                parts += [_FRAME, item.astype("<f4", copy=False).tobytes()]
        return b"".join(parts)


def _write(handle: int, data: bytes) -> None:
    """All of it: a full disk takes a part, and an error comes with the next call."""
    rest = memoryview(data)
    while rest:
        rest = rest[os.write(handle, rest) :]


def _reason(path: Path, error: OSError | SportError) -> str:
    return f"{path}: {getattr(error, 'strerror', None) or error}"


def still_there(handle: int, path: Path) -> int:
    """The descriptor of the file under this name: one that somebody has removed, with its folder or without, is written again.

    OSError or FileError when that fails; `handle` stays open then.
    """
    try:
        if os.path.samestat(os.fstat(handle), os.stat(path)):
            return handle
    except FileNotFoundError:
        pass
    path.parent.mkdir(parents=True, exist_ok=True)
    again = open_locked(path, create=True)
    if again is None:
        raise FileError(f"{path}: it cannot be locked.", "Export the take.")
    try:
        os.lseek(handle, 0, os.SEEK_SET)
        while piece := os.read(handle, 1 << 20):  # what has no name any more can still be read
            _write(again, piece)
    except BaseException:
        os.close(again)
        raise
    os.close(handle)
    return again


def _unlink(path: Path) -> None:
    try:
        path.unlink(missing_ok=True)
    except OSError:
        return  # a read-only folder: the journal is offered again at the next start


@dataclass
class FoundJournal:
    """A journal that nobody writes any more, locked by this process until it is let go of."""

    path: Path
    header: Header
    seconds: float  # about, by the size of the file
    _handle: int
    problem: str = ""  # why the take is not on disk any more

    @property
    def leaves_room(self) -> bool:
        """Whether this process may hold more files; see `open_files`."""
        return leaves_room(self._handle)

    def read(self) -> Clip:
        """The take up to the first thing that is none. FileError when there is no frame."""
        os.lseek(self._handle, 0, os.SEEK_SET)
        with open(self._handle, "rb", closefd=False) as file:
            return read_journal(file, self.path)

    def watch(self) -> None:
        """Write the file again where somebody has removed it; `problem` says why that failed."""
        if self._handle < 0 or self.problem:
            return
        try:
            self._handle = still_there(self._handle, self.path)
        except (OSError, SportError) as error:
            self.problem = _reason(self.path, error)

    def release(self) -> None:
        """Let go of the file."""
        handle, self._handle = self._handle, -1
        if handle >= 0:
            os.close(handle)

    def delete(self) -> None:
        """The take is safe elsewhere, or not wanted."""
        self.release()
        _unlink(self.path)


def find_journals(folder: Path) -> tuple[list[FoundJournal], list[str]]:
    """The journals in `folder` that no living process holds, oldest first, and complaints about those that are none.

    Journals without a whole frame are removed. Of more than this process may hold open the first are found.
    """
    found, complaints = [], []
    try:
        paths = sorted(path for path in folder.iterdir() if path.suffix == SUFFIX)
    except FileNotFoundError:
        return [], []
    except OSError as error:
        return [], [f"{folder}: {error.strerror or error}; takes that were cut off cannot be looked for."]
    for path in paths:
        try:
            journal = _claim(path)
        except (OSError, SportError) as error:
            complaints.append(str(error))
            continue
        if journal is not None:
            found.append(journal)
            if not journal.leaves_room:
                break
    return found, complaints


def _claim(path: Path) -> FoundJournal | None:
    handle = open_locked(path)
    if handle is None:
        return None  # somebody records into it
    try:
        status = os.fstat(handle)
        if not stat.S_ISREG(status.st_mode):
            raise FileError(f"{path}: not a regular file.", "Remove it.")
        with open(handle, "rb", closefd=False) as file:
            line = file.readline(MAX_HEADER)
            frames = (status.st_size - len(line)) // (1 + 4 * ROW)
            if frames <= 0 and _starts_like_ours(line):
                os.close(handle)
                _unlink(path)
                return None
            header = _header(line, path)
    except BaseException:
        os.close(handle)
        raise
    return FoundJournal(path, header, frames / header.fps, handle)


def _starts_like_ours(line: bytes) -> bool:
    """Whether a file without frames is a journal that was cut off at its beginning."""
    return (b'{"format": "%s"' % _FORMAT.encode()).startswith(line[:26]) or not line


def _header(line: bytes, path: Path) -> Header:
    try:
        value = parse_json(line) if line.endswith(b"\n") else None
    except ValueError:
        value = None
    if not isinstance(value, dict) or value.get("format") != _FORMAT or value.get("version") != _VERSION:
        raise FileError(f"{path}: not a journal of a take (version {_VERSION}).", "Remove it.")
    fps, begun, origin = value.get("fps"), value.get("begun"), value.get("origin")
    if not isinstance(fps, int | float) or not 1.0 <= fps <= MAX_FPS:
        raise FileError(f"{path}: expected fps from 1 to {MAX_FPS:.0f}.", "Remove it.")
    name, terrain, size = value.get("name"), value.get("terrain"), value.get("size")
    return Header(
        name=name[:200] if is_text(name) else "take",
        fps=float(fps),
        terrain=terrain[:4096] if is_text(terrain) else "flat",
        origin=origin_from(origin if isinstance(origin, dict) else {}),
        begun=float(begun) if isinstance(begun, int | float) and 0 <= begun < 1e11 else 0.0,
        size=float(size) if isinstance(size, int | float) and MIN_SIZE <= size <= MAX_SIZE else 1.0,
    )


def read_journal(file: BinaryIO, path: Path) -> Clip:
    """The take in a journal, up to the first record that is cut off or damaged. FileError when there is no frame."""
    header = _header(file.readline(MAX_HEADER), path)
    recorder = ClipRecorder(1.0, header.fps)
    recorder.start()
    frames = 0
    for record in _records(file):
        if isinstance(record, PromptEvent):
            recorder.mark_prompt(record.prompt, record.transition_seconds, record.words, record.typed)
        elif _is_frame(record):
            recorder.add_row(record)
            frames += 1
        else:
            break
    if not frames:
        raise FileError(f"{path}: no frame of the take is left.", "Discard it.")
    return replace(recorder.stop(header.name, header.terrain, header.origin), size=header.size)


def _records(file: BinaryIO) -> Iterator[NDArray[np.float32] | PromptEvent]:
    while True:
        kind = file.read(1)
        if kind == _FRAME:
            data = file.read(4 * ROW)
            if len(data) < 4 * ROW:
                return
            yield np.frombuffer(data, "<f4").astype(np.float32, copy=False)
        elif kind == _PROMPT:
            event = _event(file)
            if event is None:
                return
            yield event
        else:
            return


def _event(file: BinaryIO) -> PromptEvent | None:
    size = file.read(4)
    length = struct.unpack("<I", size)[0] if len(size) == 4 else MAX_EVENT + 1
    data = file.read(length) if length <= MAX_EVENT else b""
    try:
        value = parse_json(data) if len(data) == length else None
        if not isinstance(value, dict):
            return None
        words = value.get("words")
        value["words"] = parse_json(words) if isinstance(words, str) and words else None
    except ValueError:
        return None
    return event_from(value)


def _is_frame(row: NDArray[np.float32]) -> bool:
    """Whether numbers from a file can be a pose: hips on the ground of this world, rotations of length 1."""
    if not np.abs(row).max() <= MAX_DISTANCE_M:  # nor NaN
        return False
    norms = np.linalg.norm(row[3:-5].reshape(J, 4), axis=1)
    whole = row[-1] in range(-1, 10) and bool(((row[-5:-1] >= -0.5) & (row[-5:-1] <= 1.5)).all())
    return bool(whole and np.abs(norms - 1.0).max() <= MAX_NORM_ERROR)
