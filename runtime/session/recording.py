"""A motion being recorded: its frames are written to the session's file six times a second."""

from __future__ import annotations

import uuid
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from runtime.arrays import Float32Array
from runtime.session.database import Database
from runtime.session.document import header_text, pack_sticks
from runtime.session.frames import packed_frames
from runtime.session.motion import Motion, MotionHeader
from runtime.session.stored_rows import Writer
from runtime.session.tables import TAIL
from runtime.skeleton import J
from runtime.takes.clip import Clip
from runtime.takes.input_recording import InputRecording
from runtime.takes.metadata import PromptEvent

PIECE_FRAMES = 300  # packed as one piece while recording
FRAME_NUMBERS = 3 + 4 * J + 4 + 1  # numbers of a recorded frame: hips, local rotations, contacts, gait


class RecordingFile(Protocol):
    """The session's file, as a recording needs it."""

    database: Database

    def put_recorded(self, writer: Writer, key: str, header: str, inputs: InputRecording | None) -> None:
        """Store the header and the input of a motion."""

    def hold(self, key: str, motion: Motion | Recording) -> None:
        """Keep the stored data of a motion for as long as the object lives."""

    def lose(self, key: str) -> None:
        """Record that no step will refer to a motion."""


@dataclass
class Recording:
    """A motion being recorded; if the process is killed, only frames not yet added are lost."""

    file: RecordingFile
    header: MotionHeader
    key: str = field(default_factory=lambda: uuid.uuid4().hex)
    _rows: list[Float32Array] = field(default_factory=list)  # frames not yet packed as one piece
    _sticks: list[NDArray[np.float64]] = field(default_factory=list)
    _packed: int = 0  # frames

    def add(
        self,
        rows: Float32Array,
        sticks: NDArray[np.float64] | None,
        prompts: tuple[PromptEvent, ...] = (),
        inputs: InputRecording | None = None,
    ) -> None:
        """Append frames `(T, 132)` in the format of `ClipRecorder`, with stick positions and settings `(T, 8)`.

        `prompts` and `inputs` cover all frames so far; pass them when they have changed.
        """
        about = replace(
            self.header, frames=self.header.frames + len(rows), prompts=prompts or self.header.prompts
        )
        self.header = about
        part, first = len(self._rows), self._packed
        self._rows.append(rows)
        self._sticks += [] if sticks is None else [sticks]
        whole = sum(map(len, self._rows)) >= PIECE_FRAMES
        tables, table_sticks = list(self._rows), list(self._sticks)
        if whole:
            self._packed += sum(map(len, tables))
            self._rows, self._sticks = [], []

        def work(writer: Writer) -> None:
            if whole:
                table = np.concatenate(tables)
                known = np.concatenate(table_sticks) if len(table_sticks) == len(tables) else None
                writer.put_frames(self.key, first, len(table), _packed_rows(table, known))
                writer.drop_frames(self.key + TAIL)
            else:
                writer.put_frames(self.key + TAIL, part, len(rows), _packed_rows(rows, sticks))
            self.file.put_recorded(writer, self.key, header_text(about, recording=True), inputs)

        self.file.database.submit(work)

    def finish(self, clip: Clip, inputs: InputRecording | None) -> Motion:
        """Return the recorded motion; its frames are already in the file unless the clip has fewer."""
        if len(clip) != self.header.frames:
            self.give_up()
            return Motion.of(clip, inputs)
        motion = Motion(self.key, MotionHeader.of(clip, inputs), clip, inputs)
        self.file.hold(self.key, motion)
        text = header_text(motion.header)
        self.file.database.submit(partial(self.file.put_recorded, key=self.key, header=text, inputs=inputs))
        return motion

    def give_up(self) -> None:
        """Abandon the recording; it becomes one of the file's lost motions."""
        self.file.lose(self.key)


def _packed_rows(rows: Float32Array, sticks: NDArray[np.float64] | None) -> bytes:
    turns = rows[:, 3:-5].reshape(len(rows), J, 4)
    content = packed_frames(rows[:, :3], turns, rows[:, -5:-1], rows[:, -1])
    return content + (b"" if sticks is None else pack_sticks(sticks))
