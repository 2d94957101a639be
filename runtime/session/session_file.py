"""A session in its file: every step of its history, the frames of its takes, and what is recorded while it is recorded.

What is submitted here returns at once; the database's own thread packs and writes it.
"""

from __future__ import annotations

import json
import re
import threading
import uuid
import weakref
from collections import OrderedDict
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.arrays import Float32Array
from runtime.errors import FileError
from runtime.safe_read import parse_json, printable
from runtime.session.blobs import REMEDY, BlobReader
from runtime.session.character_files import (
    check_character_files,
    read_character_files,
    write_character_files,
)
from runtime.session.database import Database
from runtime.session.document import (
    DocumentReader,
    DocumentWriter,
    header_text,
    pack_sticks,
    read_view,
    unpack_sticks,
)
from runtime.session.frames import BYTES, CLIP_BYTES, packed_frames, pieces, unpacked_frames
from runtime.session.history import History, Step
from runtime.session.motion import Motion, MotionHeader
from runtime.session.session import CharacterChoice, Session, Take
from runtime.session.sqlite_file import Budget, file_errors
from runtime.session.writer import Writer
from runtime.skeleton import J
from runtime.takes.clip import Clip, are_poses
from runtime.takes.input_recording import COLUMNS, InputFrames, InputRecording
from runtime.takes.metadata import PromptEvent, gait_seconds

LOADED_CLIPS = 4  # whose frames stay in memory when nothing shows them
RECORDED_PIECE = 300  # frames that are packed as one while a recording runs
ROW = 3 + 4 * J + 4 + 1  # numbers of a recorded frame: hips, local rotations, contacts, gait
INPUT, TAIL = ".input", ".tail"  # of a motion's key: what drove it, and its newest frames
DROPPED_STEPS = 50  # of the history, after which what only they referred to is removed
# in texts of the file: every reference, those of the texts of takes, and keys of characters and motions
_REFERENCE = re.compile(r'"(?:<f[48]|\|[iu]1) [0-9x]* ([0-9a-f]{32})"')
_TAKE = re.compile(r'"\|u1 [0-9]+ ([0-9a-f]{32})"')
_CHARACTER, _MOTION = re.compile(r'"key": "([^"\\]+)"'), re.compile(r'"motion": "([0-9a-f]{32})"')


@dataclass
class SessionFile:
    """The file of the session that is open."""

    database: Database
    cache: Path  # folder for the files of characters
    _documents: DocumentWriter = field(init=False)
    _written: dict[int, Session] = field(default_factory=dict)  # steps of the file, by their numbers
    _known: set[str] = field(default_factory=set)  # blobs, motions and characters that the file has
    _fresh: set[str] = field(default_factory=set)  # those that the transaction under way adds
    _putting: Writer | None = None  # the transaction under way
    # motions and recordings that anything in this process holds, by their keys
    _held: weakref.WeakValueDictionary[str, Motion | Recording] = field(
        default_factory=weakref.WeakValueDictionary
    )
    _dropped: int = 0  # steps of the history since the last removal of what is not used
    _clips: OrderedDict[str, Clip] = field(default_factory=OrderedDict)
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def __post_init__(self) -> None:
        self._documents = DocumentWriter(self._put)

    @staticmethod
    def create(path: Path, cache: Path) -> SessionFile:
        return SessionFile(Database.create(path), cache)

    @staticmethod
    def open(path: Path, cache: Path) -> tuple[SessionFile, History]:
        """An existing file and its history, as untrusted; FileError, FileInUse."""
        database = Database.open(path)
        try:
            file, history = _opened(database, cache)
            file._remove_unused()
            return file, history
        except BaseException:
            database.close()
            raise

    @staticmethod
    def copy(path: Path, target: Path) -> None:
        """Copy a file that another window may have open; FileError, FileInUse."""
        database = Database.read(path)
        try:
            database.save_copy(target)
        finally:
            database.close()

    @property
    def path(self) -> Path:
        return self.database.path

    @property
    def problem(self) -> str:
        """Why what was done is not on disk; "" when it is."""
        return self.database.problem

    @property
    def view(self) -> dict[str, Any]:
        """How the session was looked at when it was closed: flat values."""
        return read_view(self.database.meta("view"))

    # --- writing

    def write(self, history: History) -> None:
        """Bring the file to a history; takes no time on the thread that calls."""
        steps = [s for s in history.steps if self._written.get(s.number) is not s.session]
        first, last, present = history.steps[0].number, history.steps[-1].number, history.present
        kept = {s.number: s.session for s in history.steps}
        self._dropped += len(self._written.keys() - kept.keys())
        self._written = kept

        def work(writer: Writer) -> None:
            self._begin(writer)
            for step in steps:
                self._put_motions(writer, step.session)
                writer.put_step(step.number, printable(step.label), self._documents.session(step.session))
            writer.drop_steps(first=last + 1)
            writer.drop_steps(before=first)
            takes = present.session.takes
            seconds = sum((b - a) / t.made.header.fps for t in takes for a, b in (t.range,))
            for name, value in (("at", present.number), ("takes", len(takes)), ("seconds", f"{seconds:.3f}")):
                writer.set_meta(name, str(value))
            writer.set_meta("ended", "")

        self.database.submit(work)
        if self._dropped >= DROPPED_STEPS:
            self._remove_unused()

    def _remove_unused(self) -> None:
        """Have the writer remove motions and blobs that no step refers to and nothing in this process holds."""
        self._dropped = 0

        def work(writer: Writer) -> None:
            self._begin(writer)
            held = [known.key for known in self._held.valuerefs() if known() is not None]
            motions, blobs = _used(writer, held)
            writer.keep_only(motions, blobs)
            self._known &= motions | blobs
            self._fresh &= motions | blobs
            self._documents = DocumentWriter(self._put)  # what it remembers to have packed may be gone

        self.database.submit(work)

    def _begin(self, writer: Writer) -> None:
        """Begin to count what a transaction adds; of one that was rolled back nothing counts."""
        if self._putting is writer:
            return
        if self._fresh:
            self._documents = DocumentWriter(self._put)
        self._putting, self._fresh = writer, set()

        def committed() -> None:
            self._known |= self._fresh
            self._fresh = set()

        writer.committed.append(committed)

    def _is_new(self, key: str) -> bool:
        """Whether the file lacks a blob, motion or character; from now on it has it."""
        new = key not in self._known and key not in self._fresh
        self._fresh.add(key)
        return new

    def write_view(self, view: Mapping[str, Any], ended: bool = False, picture: bytes = b"") -> None:
        """Remember how the session is looked at; `ended` as planned, with a `picture` (PNG) to know it by."""
        text = json.dumps(dict(view), ensure_ascii=True)

        def work(writer: Writer) -> None:
            writer.set_meta("view", text)
            writer.set_meta("ended", "1" if ended else "")
            if picture:
                writer.set_meta("picture", picture)

        self.database.submit(work)

    def _put(self, key: str, content: bytes) -> None:
        if self._putting is not None and self._is_new(key):
            self._putting.put_blob(key, content)

    def _put_motions(self, writer: Writer, session: Session) -> None:
        for take in session.takes:
            motion = take.made
            if self._is_new(motion.key):
                self._put_motion(writer, motion)
                self._held[motion.key] = motion
            if not motion.is_stored:
                writer.committed.append(partial(motion.stored, self))
        for choice in _characters(session):
            if self._is_new(f"character {choice.key}"):
                self._put_character(writer, choice)

    def _put_motion(self, writer: Writer, motion: Motion) -> None:
        clip, inputs = motion.clip, motion.inputs
        check_motion(clip, self.path)
        rows = None if inputs is None else inputs.frames.rows[-inputs.start :]
        for part in pieces(len(clip)):
            content = _piece(clip, part) + (b"" if rows is None else pack_sticks(rows[part]))
            writer.put_frames(motion.key, part.start, part.stop - part.start, content)
        if inputs is not None:
            writer.put_motion(motion.key + INPUT, self._input(inputs))
        writer.put_motion(motion.key, header_text(motion.header))

    def _input(self, inputs: InputRecording) -> str:
        """What drove a take, but for the sticks of its own frames."""
        lead = inputs.frames.rows[: -inputs.start] if inputs.start else inputs.frames.rows[:0]
        sticks = self._documents.blobs.data(pack_sticks(lead))
        value = self._documents.inputs(inputs) | {"lead": sticks, "lead_frames": len(lead)}
        return json.dumps(value, ensure_ascii=True)

    def _put_character(self, writer: Writer, choice: CharacterChoice) -> None:
        blobs = self._documents.blobs
        files = read_character_files(self.cache / choice.key)
        names = {name: blobs.data(content) for name, content in files.items()}
        writer.put_blob(f"character {choice.key}", json.dumps(names).encode("ascii"))

    # --- recording

    def put_recorded(self, writer: Writer, key: str, header: str, inputs: InputRecording | None) -> None:
        """Put the header of a motion whose frames are in the file, and what drove it but for the sticks of these."""
        self._begin(writer)
        self._is_new(key)
        if inputs is not None:
            writer.put_motion(key + INPUT, self._input(inputs))
        writer.put_motion(key, header)

    def begin_recording(self, header: MotionHeader) -> Recording:
        """Keep what is recorded from now on."""
        recording = Recording(self, uuid.uuid4().hex, header)
        self.hold(recording.key, recording)
        return recording

    def hold(self, key: str, motion: Motion | Recording) -> None:
        """Keep what is stored of a motion for as long as this lives."""
        self._held[key] = motion

    # --- reading

    def load_clip(self, key: str, header: MotionHeader) -> Clip:
        """The frames of a motion; on any thread, FileError."""
        with self._lock:
            if key not in self._clips:
                self._clips[key] = self._read_clip(key, header)
                while len(self._clips) > LOADED_CLIPS:
                    self._clips.popitem(last=False)
            self._clips.move_to_end(key)
            return self._clips[key]

    def _read_clip(self, key: str, header: MotionHeader) -> Clip:
        count, found = header.frames, self._frame_count(key)
        if found != count:
            raise FileError(f"{self.path}: {header.name} has {found} frames of {count}.", REMEDY)
        with file_errors(self.path):
            self._budget().spend(CLIP_BYTES * count)
            hips, rotations = np.empty((count, 3), np.float32), np.empty((count, J, 4), np.float32)
            contacts, gaits = np.empty((count, 4), np.float32), np.empty(count, np.int8)
            at = 0
            for size, content in self._pieces(key):
                part = slice(at, at + size)
                frames = unpacked_frames(content[: BYTES * size], size)
                hips[part], rotations[part], contacts[part], gaits[part] = frames
                at += size
        clip = header.clip(hips, rotations, contacts, gaits)
        check_motion(clip, self.path)
        return clip

    def load_inputs(self, key: str) -> InputRecording | None:
        """The input of a motion; on any thread, FileError."""
        reader = self._reader()

        def read() -> InputRecording:
            value = parse_json(self.database.motion(key + INPUT), 400_000)
            rows = [unpack_sticks(reader.blobs.data(value["lead"]), value["lead_frames"])]
            for size, content in self._pieces(key):
                rows.append(unpack_sticks(content[BYTES * size :], size))
            table = np.concatenate(rows)
            reader.blobs.budget.spend(8 * table.size)
            return reader.inputs(value, InputFrames(table))

        return reader.checked(read)

    def _frame_count(self, key: str) -> int:
        """Frames that the pieces of a motion say they have."""
        return self.database.frame_count(key) + self.database.frame_count(key + TAIL)

    def _pieces(self, key: str) -> Iterator[tuple[int, bytes]]:
        for count, content in (*self.database.frames(key), *self.database.frames(key + TAIL)):
            if len(content) not in (BYTES * count, (BYTES + 8 * COLUMNS) * count):
                raise FileError(f"{self.path}: damaged frames.", REMEDY)
            yield count, content

    def _budget(self) -> Budget:
        return Budget.for_file(self.database.budget.of)

    def _reader(self) -> DocumentReader:
        blobs = BlobReader(self.path, self.database.blob, self._budget())
        return DocumentReader(blobs, lambda key: self._motion(key, {}))

    def _motion(self, key: str, known: dict[str, Motion]) -> Motion:
        if key not in known:
            header, _ = self._reader().header(self.database.motion(key))
            known[key] = Motion(key, header, source=self)
        return known[key]

    def character_path(self, choice: CharacterChoice) -> Path | None:
        """The glTF of a character, written to the cache where it is not there; None for the mannequin. FileError."""
        if not choice.key:
            return None
        if (self.cache / choice.key).is_file():
            return self.cache / choice.key
        reader = self._reader()

        def read() -> Path:
            names = parse_json(self.database.blob(f"character {choice.key}"))
            files = {name: reader.blobs.data(reference) for name, reference in names.items()}
            check_character_files(files)
            return write_character_files(files, self.cache)

        return reader.checked(read)

    # --- the file

    def save_as(self, path: Path) -> None:
        """Go on in another file; what is there already is replaced. FileError, FileInUse."""
        self.database.save_as(path)

    def save_copy(self, path: Path) -> None:
        self.database.save_copy(path)

    def flush(self, seconds: float | None = None) -> bool:
        """Wait until all is on disk; whether it is."""
        return self.database.flush(seconds)

    def close(self, seconds: float | None = None) -> bool:
        """Write what is left and let go of the file, within so many seconds; whether all is in it."""
        return self.database.close(seconds)


@dataclass
class Recording:
    """A motion while it is recorded. A process that is killed loses what was not added yet."""

    file: SessionFile
    key: str
    header: MotionHeader
    _rows: list[Float32Array] = field(default_factory=list)  # of frames that are not packed as one piece yet
    _sticks: list[NDArray[np.float64]] = field(default_factory=list)
    _packed: int = 0  # frames

    def add(
        self,
        rows: Float32Array,
        sticks: NDArray[np.float64] | None,
        prompts: tuple[PromptEvent, ...] = (),
        inputs: InputRecording | None = None,
    ) -> None:
        """More frames `(T, 132)` as a `ClipRecorder` keeps them, with their sticks and settings `(T, 8)`.

        `prompts` and `inputs` are those of all frames so far where they are others than before.
        """
        about = replace(
            self.header, frames=self.header.frames + len(rows), prompts=prompts or self.header.prompts
        )
        self.header = about
        part, first = len(self._rows), self._packed
        self._rows.append(rows)
        self._sticks += [] if sticks is None else [sticks]
        whole = sum(map(len, self._rows)) >= RECORDED_PIECE
        tables, table_sticks = list(self._rows), list(self._sticks)
        if whole:
            self._packed += sum(map(len, tables))
            self._rows, self._sticks = [], []

        def work(writer: Writer) -> None:
            if whole:
                table = np.concatenate(tables)
                known = np.concatenate(table_sticks) if len(table_sticks) == len(tables) else None
                writer.put_frames(self.key, first, len(table), _row_piece(table, known))
                writer.drop_frames(self.key + TAIL)
            else:
                writer.put_frames(self.key + TAIL, part, len(rows), _row_piece(rows, sticks))
            self.file.put_recorded(writer, self.key, header_text(about, recording=True), inputs)

        self.file.database.submit(work)

    def finish(self, clip: Clip, inputs: InputRecording | None) -> Motion:
        """The motion that was recorded. Its frames are in the file already, unless they are more than the clip's."""
        whole = len(clip) == self.header.frames
        motion = (
            Motion(self.key, MotionHeader.of(clip, inputs), clip, inputs)
            if whole
            else Motion.of(clip, inputs)
        )
        if whole:
            self.file.hold(self.key, motion)
        text = header_text(motion.header)
        self.file.database.submit(partial(self.file.put_recorded, key=self.key, header=text, inputs=inputs))
        return motion


def _character_keys(session: Session) -> list[str]:
    return [f"character {choice.key}" for choice in _characters(session)]


def _characters(session: Session) -> list[CharacterChoice]:
    choices = (session.character, None if session.reference is None else session.reference.character)
    return [choice for choice in choices if choice is not None and choice.key]


def _used(writer: Writer, held: Iterable[str]) -> tuple[set[str], set[str]]:
    """Keys of the motions and blobs that steps, or motions that are `held`, refer to."""
    takes, characters, blobs, motions = set[str](), set[str](), set[str](), set(held)
    for document in writer.documents():
        takes.update(_TAKE.findall(document))
        blobs.update(_REFERENCE.findall(document))
        characters.update(f"character {key}" for key in _CHARACTER.findall(document))
    texts = [writer.blob(key).decode("utf-8", "replace") for key in takes | characters]
    for text in texts:
        motions.update(_MOTION.findall(text))
    texts += [writer.motion(key + INPUT) for key in motions]
    for text in texts:
        blobs.update(_REFERENCE.findall(text))
    return {key + part for key in motions for part in ("", INPUT, TAIL)}, blobs | characters


def _opened(database: Database, cache: Path) -> tuple[SessionFile, History]:
    """The session of a database, with what was being recorded when it was cut off as takes of a step of their own."""
    file = SessionFile(database, cache)
    blobs = BlobReader(database.path, database.blob, database.budget)
    known: dict[str, Motion] = {}
    reader = DocumentReader(blobs, lambda key: file._motion(key, known))
    steps = [Step(number, label, reader.session(database.step(number))) for number, label in database.steps()]
    places = {str(step.number): i for i, step in enumerate(steps)}
    history = History(steps, places.get(database.meta("at"), len(steps) - 1)) if steps else History()
    motions = {key for key in database.motions() if not key.endswith(INPUT)}
    file._written = {step.number: step.session for step in steps}
    file._known = motions.union(*map(_character_keys, file._written.values()))
    file._held.update(known)
    for key in sorted(motions - set(known)):
        header, cut_off = reader.header(database.motion(key))
        if cut_off:
            _recover(file, history, key, header)
    return file, history


def _recover(file: SessionFile, history: History, key: str, header: MotionHeader) -> None:
    """Take up a recording that was cut off, as far as its frames are there."""
    from runtime.session.edits import with_new_take

    frames = file._frame_count(key)
    if not frames:
        return
    header = replace(header, frames=frames)
    try:
        inputs = file.load_inputs(key) if header.resimulable else None
        whole = inputs is not None and len(inputs) == frames
    except FileError:
        whole = False
    clip = file.load_clip(key, header)
    header = replace(header, gait_seconds=gait_seconds(clip.gaits, clip.fps), resimulable=whole)
    motion = Motion(key, header, source=file)
    session = with_new_take(
        history.present.session, Take(motion=motion, ground=history.present.session.ground)
    )
    history.push(f"recovery of {header.name}", session)
    file.database.submit(lambda writer: writer.put_motion(key, header_text(header)))
    file.write(history)


def check_motion(clip: Clip, path: Path | str = "a take") -> None:
    """FileError unless every frame can be shown."""
    known = clip.gaits is None or bool(((clip.gaits >= -1) & (clip.gaits < 10)).all())
    if not known or not are_poses(clip.hips_positions, clip.local_rotations, clip.contacts):
        raise FileError(f"{path}: a take whose frames are no poses.", REMEDY)


def _piece(clip: Clip, part: slice) -> bytes:
    gaits = None if clip.gaits is None else clip.gaits[part]
    return packed_frames(clip.hips_positions[part], clip.local_rotations[part], clip.contacts[part], gaits)


def _row_piece(rows: Float32Array, sticks: NDArray[np.float64] | None) -> bytes:
    turns = rows[:, 3:-5].reshape(len(rows), J, 4)
    content = packed_frames(rows[:, :3], turns, rows[:, -5:-1], rows[:, -1])
    return content + (b"" if sticks is None else pack_sticks(sticks))
