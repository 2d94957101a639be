"""A session in its file: every step of its history, the frames of its takes, and recordings in progress.

Calls return at once; the database's own thread packs and writes the data.
"""

from __future__ import annotations

import json
import logging
import time
import weakref
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from operator import methodcaller
from pathlib import Path
from typing import Any

from runtime.errors import FileError
from runtime.safe_read import printable
from runtime.session.blobs import REMEDY, BlobReader
from runtime.session.character_files import read_character_files
from runtime.session.database import Database
from runtime.session.document import DocumentWriter, header_text, pack_sticks
from runtime.session.document_reader import MAX_TAKES, DocumentReader, read_view
from runtime.session.edits import with_new_take
from runtime.session.frames import packed_frames, pieces
from runtime.session.history import MAX_STEPS, History, Step
from runtime.session.lost import MAX_RECOVERED_TAKES, LostTake, settle
from runtime.session.motion import Motion, MotionHeader
from runtime.session.recording import Recording
from runtime.session.session import CharacterChoice, Session, Take, has_edits
from runtime.session.stored_motions import StoredMotions, check_motion
from runtime.session.stored_rows import Writer
from runtime.session.tables import INPUT, TAIL
from runtime.takes.clip import Clip
from runtime.takes.input_recording import InputRecording

_LOG = logging.getLogger("sport.session")
DROPPED_STEPS = 50  # of the history, after which motions that only they referred to are marked as lost


@dataclass
class SessionFile(StoredMotions):
    """The file of the open session: its history, motions and recordings."""

    repaired: str = ""  # what was wrong with the file when it was opened, for the user
    recovered: int = 0  # takes that no step referred to
    unrecovered: int = 0  # of these, those that are lost takes now
    _documents: DocumentWriter = field(init=False)
    _written: dict[int, Session] = field(default_factory=dict)  # steps in the file, by number
    _known: set[str] = field(default_factory=set)  # blobs, motions and characters in the file
    _fresh: set[str] = field(default_factory=set)  # those added by the transaction in progress
    _putting: Writer | None = None  # of the transaction in progress
    # motions and recordings in use in this process, by key
    _held: weakref.WeakValueDictionary[str, Motion | Recording] = field(
        default_factory=weakref.WeakValueDictionary
    )
    _dropped: int = 0  # steps of the history dropped since unused items were last looked for
    _has_motions: bool = False
    _lost: bool = False  # the file may contain lost items

    def __post_init__(self) -> None:
        self._documents = DocumentWriter(self._put)

    @staticmethod
    def create(path: Path, cache: Path) -> SessionFile:
        return SessionFile(Database.create(path), cache)

    @staticmethod
    def open(path: Path, cache: Path) -> tuple[SessionFile, History]:
        """Open an untrusted session file and return it with its history. Raises FileError, FileInUse.

        Invalid steps and takes are left out; motions without a step become recovered takes in a last step.
        """
        database = Database.open(path)
        try:
            file = SessionFile(database, cache, repaired=database.repaired)
            history = file._read_history()
            file._settle_lost()
            return file, history
        except BaseException:
            database.close()
            raise

    @staticmethod
    def copy(path: Path, target: Path) -> None:
        """Copy a session file, even while another window has it open. Raises FileError, FileInUse."""
        database = Database.read(path)
        try:
            database.save_copy(target)
        finally:
            database.close()

    @property
    def problem(self) -> str:
        """The reason why changes are not on disk, or ""."""
        return self.database.problem

    @property
    def view(self) -> dict[str, Any]:
        """The view of the session when it was last closed: flat values."""
        return read_view(self.database.meta("view"))

    # --- writing

    def write(self, history: History) -> None:
        """Queue the changes that bring the file up to date with a history; returns at once."""
        steps = [s for s in history.steps if self._written.get(s.number) is not s.session]
        first, last, present = history.steps[0].number, history.steps[-1].number, history.present
        history_steps, kept = list(history.steps), {s.number: s.session for s in history.steps}
        before, self._written = self._written, kept
        dropped = [session for number, session in before.items() if kept.get(number) is not session]
        self._dropped += len(before.keys() - kept.keys())
        self._has_motions = self._has_motions or any(step.session.takes for step in steps)

        def work(writer: Writer) -> None:
            self._begin(writer)
            for step in steps:
                self._put_motions(writer, step.session)
                writer.put_step(step.number, printable(step.label), self._documents.session(step.session))
            writer.drop_steps(last + 1, first)
            self._note_lost(writer, [step.session for step in steps], dropped, kept)
            takes = present.session.takes
            seconds = sum((b - a) / t.made.header.fps for t in takes for a, b in (t.range,))
            edits = "1" if any(has_edits(step.session) for step in history_steps) else ""
            for name, value in (
                ("at", present.number), ("takes", len(takes)), ("seconds", f"{seconds:.3f}"),
                ("edits", edits), ("ended", ""),
            ):  # fmt: skip
                writer.set_meta(name, str(value))

        self.database.submit(work)
        if self._dropped >= DROPPED_STEPS:
            self._settle_lost()

    @property
    def has_work(self) -> bool:
        """Whether the file contains takes, recordings (including lost ones) or other work."""
        return self._has_motions or any(map(has_edits, self._written.values()))

    def set_meta(self, name: str, text: str) -> None:
        """Store a text under a name."""
        self.database.submit(methodcaller("set_meta", name, text))

    def _note_lost(
        self, writer: Writer, new: list[Session], dropped: list[Session], kept: Mapping[int, Session]
    ) -> None:
        """Mark motions that only dropped steps referred to as lost, and unmark those that a new step refers to."""
        gone = set[str]().union(*map(_motion_keys, dropped))
        for session in kept.values() if gone else ():
            gone -= _motion_keys(session)
        writer.find(sorted(set[str]().union(*map(_motion_keys, new))) if self._lost else [])
        writer.lose(sorted(gone), int(time.time()))
        self._lost = self._lost or bool(gone)

    def lose(self, key: str) -> None:
        """Record that no step will refer to a motion."""
        self._lost = True
        self.database.submit(lambda writer: writer.lose([key, key + TAIL], int(time.time())))

    def _settle_lost(self) -> None:
        """Have the writer mark unreferenced items that this process does not hold as lost, and remove old lost items."""
        self._dropped, self._lost = 0, True

        def work(writer: Writer) -> None:
            self._begin(writer)
            removed = settle(writer, list(self._held.keys()), int(time.time()))
            if removed:
                self._known -= removed
                self._fresh -= removed
                self._documents = DocumentWriter(self._put)  # its cache of packed contents is no longer valid

        self.database.submit(work)

    def _begin(self, writer: Writer) -> None:
        """Start collecting what a transaction adds; a rolled-back one adds nothing."""
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
        """Return whether the file lacks a blob, motion or character; registers it as present."""
        new = key not in self._known and key not in self._fresh
        self._fresh.add(key)
        return new

    def write_view(self, view: Mapping[str, Any], ended: bool = False, picture: bytes = b"") -> None:
        """Store the view of the session; `ended` if closed normally, with a `picture` (PNG) for the list."""
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
                blobs = self._documents.blobs
                files = read_character_files(self.cache / choice.key)
                names = {name: blobs.data(content) for name, content in files.items()}
                writer.put_blob(f"character {choice.key}", json.dumps(names).encode("ascii"))

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
        """Return the JSON of a take's input without the sticks of its own frames."""
        lead = inputs.frames.rows[: -inputs.start] if inputs.start else inputs.frames.rows[:0]
        sticks = self._documents.blobs.data(pack_sticks(lead))
        value = self._documents.inputs(inputs) | {"lead": sticks, "lead_frames": len(lead)}
        return json.dumps(value, ensure_ascii=True)

    # --- recording

    def put_recorded(self, writer: Writer, key: str, header: str, inputs: InputRecording | None) -> None:
        """Store the header of a motion whose frames are already in the file, and its input without the stick positions."""
        self._begin(writer)
        self._is_new(key)
        if inputs is not None:
            writer.put_motion(key + INPUT, self._input(inputs))
        writer.put_motion(key, header)

    def begin_recording(self, header: MotionHeader) -> Recording:
        """Start a recording in this file."""
        recording = Recording(self, header)
        self.hold(recording.key, recording)
        self._has_motions = True
        return recording

    def hold(self, key: str, motion: Motion | Recording) -> None:
        """Keep the stored data of a motion for as long as the object lives."""
        self._held[key] = motion

    # --- opening

    def _read_history(self) -> History:
        """Return the history of the file; motions without a step become takes of an extra last step."""
        known: dict[str, Motion] = {}
        reader = DocumentReader(
            BlobReader(self.path, self.database.blob, self.database.budget),
            lambda key: self._motion(key, known),
        )
        steps, unsound = self._read_steps(reader)
        places = {str(step.number): i for i, step in enumerate(steps)}
        history = History(steps, places.get(self.database.meta("at"), len(steps) - 1)) if steps else History()
        self._written = {step.number: step.session for step in steps}
        characters = (f"character {c.key}" for s in self._written.values() for c in _characters(s))
        self._known = {*self.database.motions(), *characters}
        self._held.update(known)
        counts = self.database.frame_counts()
        self._has_motions = bool(counts)
        self._note_unsound(unsound, len(reader.left_out))
        self._recover(history, set(known), counts)
        return history

    def _read_steps(self, reader: DocumentReader) -> tuple[list[Step], dict[int, tuple[str, str]]]:
        """Return the readable steps, and the texts of the others with the reason, by number.

        A step with missing takes is ignored if another one is complete.
        """
        steps, unsound = list[Step](), dict[int, tuple[str, str]]()
        whole = set[int]()  # numbers of the steps without missing takes
        for number, label in reversed(self.database.steps(MAX_STEPS + 1)):
            text = self.database.step(number)
            try:
                steps.insert(0, Step(number, label, reader.session(text)))
                whole |= {number} if reader.is_whole(text) else set()
            except FileError as error:
                unsound[number] = text, error.problem
        most = max((len(step.session.takes) for step in steps if step.number in whole), default=-1)
        for step in [s for s in steps if s.number not in whole and len(s.session.takes) <= most]:
            steps.remove(step)
            unsound[step.number] = self.database.step(step.number), "takes of it cannot be read"
        return steps, unsound

    def _note_unsound(self, unsound: Mapping[int, tuple[str, str]], left_out: int) -> None:
        """Move unreadable steps to the lost items, and report what is missing."""
        now_s = int(time.time())

        def work(writer: Writer) -> None:
            for number, (text, _) in unsound.items():
                writer.lose([f"step {number} of {now_s}"], now_s, text)
                writer.drop_step(number)

        parts = [f"{len(unsound)} of its steps cannot be read."] if unsound else []
        parts += [f"{left_out} of its takes cannot be read as they were."] if left_out else []
        self.repaired = " ".join(filter(None, [self.repaired, *parts]))
        if unsound:
            _LOG.warning(
                "%s: %s", self.path, "; ".join(f"step {n}: {why}" for n, (_, why) in unsound.items())
            )
            self.database.submit(work)

    def _recover(self, history: History, named: set[str], counts: Mapping[str, int]) -> None:
        """Recover motions with frames that no step refers to: interrupted recordings, and takes of damaged steps."""
        known = named.union(key for key, _, _ in self.database.lost())
        keys = [key for key in counts if key not in known]
        most = min(MAX_RECOVERED_TAKES, MAX_TAKES - len(history.present.session.takes))
        first = max(len(keys) - most, 0)
        motions = list(filter(None, (self._recovered(key, counts[key]) for key in keys[first:])))
        if not motions:
            return
        takes = self._takes_of({motion.key for motion, cut_off in motions if not cut_off})
        session = history.present.session
        unknown = Take(ground=session.ground)
        for motion, _ in motions:
            session = with_new_take(session, replace(takes.get(motion.key, unknown), motion=motion))
        name = motions[0][0].header.name if len(motions) == 1 else f"{len(motions)} takes"
        history.push(f"recovery of {name}", session)

        def put_headers(writer: Writer) -> None:  # without this step they are lost: each needs a header
            for motion, _ in motions:
                writer.put_motion(motion.key, header_text(motion.header))

        self.database.submit(put_headers)
        self.recovered, self.unrecovered = len(motions), first
        self.write(history)

    def found_takes(self, lost: Sequence[LostTake]) -> list[Take]:
        """Return lost takes with their edits, for restoring them. Raises FileError."""
        counts, takes = self.database.frame_counts(), self._takes_of({take.key for take in lost})
        for take in lost:
            found = self._recovered(take.key, counts[take.key])
            if found is None:
                raise FileError(f"{self.path}: {take.name} is gone.", REMEDY)
            self.hold(take.key, found[0])
            takes[take.key] = replace(takes.get(take.key, Take()), motion=found[0])
        return [takes[take.key] for take in lost]

    # --- the file

    def save_as(self, path: Path) -> None:
        """Switch to another file, replacing it if it exists. Raises FileError, FileInUse."""
        self.database.save_as(path)

    def save_copy(self, path: Path) -> None:
        self.database.save_copy(path)

    def flush(self, seconds: float | None = None) -> bool:
        """Wait until everything is on disk; return whether it is."""
        return self.database.flush(seconds)

    def close(self, seconds: float | None = None) -> bool:
        """Write what is left and release the file within `seconds`; return whether everything is in it."""
        return self.database.close(seconds)


def _motion_keys(session: Session) -> set[str]:
    return {take.made.key for take in session.takes}


def _characters(session: Session) -> list[CharacterChoice]:
    choices = (session.character, None if session.reference is None else session.reference.character)
    return [choice for choice in choices if choice is not None and choice.key]


def _piece(clip: Clip, part: slice) -> bytes:
    gaits = None if clip.gaits is None else clip.gaits[part]
    return packed_frames(clip.hips_positions[part], clip.local_rotations[part], clip.contacts[part], gaits)
