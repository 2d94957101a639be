"""Reads motions and characters of a session's file as untrusted, including those that no step refers to."""

import contextlib
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from itertools import chain
from pathlib import Path

import numpy as np

from runtime.arrays import AnyArray
from runtime.errors import FileError
from runtime.safe_read import parse_json
from runtime.session.blobs import REMEDY, BlobReader
from runtime.session.character_files import check_character_files, write_character_files
from runtime.session.database import Database
from runtime.session.document import MAX_FRAMES, unpack_sticks
from runtime.session.document_reader import DocumentReader
from runtime.session.frames import CLIP_FRAME_BYTES, PACKED_FRAME_BYTES, packed_gaits, unpacked_frames
from runtime.session.lost import MAX_RECOVERED_TAKES, LostTake
from runtime.session.motion import ClipCache, Motion, MotionHeader
from runtime.session.recovery import UNKNOWN_FPS, UNKNOWN_NAME
from runtime.session.session import MIN_FRAMES, CharacterChoice, Take
from runtime.session.sqlite_file import Budget, file_errors
from runtime.session.tables import INPUT, TAIL
from runtime.skeleton import J
from runtime.takes.clip import Clip, are_poses
from runtime.takes.input_recording import COLUMNS, InputFrames, InputRecording
from runtime.takes.metadata import gait_seconds

MAX_CLIP_BYTES = 300 << 20  # memory of one take: two and a half hours


@dataclass
class StoredMotions:
    """Reads motions and characters of an open session file; thread-safe."""

    database: Database
    cache: Path  # folder for the files of characters
    _clips: ClipCache = field(default_factory=ClipCache)

    @property
    def path(self) -> Path:
        return self.database.path

    def load_clip(self, key: str, header: MotionHeader) -> Clip:
        """Return the frames of a motion; thread-safe. Raises FileError."""
        return self._clips.get(key, lambda: self._read_clip(key, header))

    def _read_clip(self, key: str, header: MotionHeader) -> Clip:
        count, found = header.frames, sum(map(self.database.frame_count, (key, key + TAIL)))
        if found != count:
            raise FileError(f"{self.path}: {header.name} has {found} frames of {count}.", REMEDY)
        if CLIP_FRAME_BYTES * count > MAX_CLIP_BYTES:
            minutes = MAX_CLIP_BYTES // CLIP_FRAME_BYTES / header.fps / 60.0
            raise FileError(
                f"{self.path}: {header.name} is longer than {minutes:.0f} minutes.", "Record it in parts."
            )
        with file_errors(self.path):
            self._budget().spend(CLIP_FRAME_BYTES * count)
            hips, rotations = np.empty((count, 3), np.float32), np.empty((count, J, 4), np.float32)
            contacts, gaits = np.empty((count, 4), np.float32), np.empty(count, np.int8)
            at = 0
            for size, content in self._pieces(key):
                part = slice(at, at + size)
                frames = unpacked_frames(content[: PACKED_FRAME_BYTES * size], size)
                hips[part], rotations[part], contacts[part], gaits[part] = frames
                at += size
        clip = header.clip(hips, rotations, contacts, gaits)
        check_motion(clip, self.path)
        return clip

    def load_inputs(self, key: str) -> InputRecording | None:
        """Return the input of a motion; thread-safe. Raises FileError."""
        reader = self._reader()

        def read() -> InputRecording:
            value = parse_json(self.database.motion(key + INPUT), 400_000)
            rows = [unpack_sticks(reader.blobs.data(value["lead"]), value["lead_frames"])]
            for size, content in self._pieces(key):
                rows.append(unpack_sticks(content[PACKED_FRAME_BYTES * size :], size))
            table = np.concatenate(rows)
            reader.blobs.budget.spend(8 * table.size)
            return reader.inputs(value, InputFrames(table))

        return reader.checked(read)

    def _pieces(self, key: str) -> Iterator[tuple[int, bytes]]:
        for count, content in chain(self.database.frames(key), self.database.frames(key + TAIL)):
            if len(content) not in (PACKED_FRAME_BYTES * count, (PACKED_FRAME_BYTES + 8 * COLUMNS) * count):
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
        """Return the glTF of a character, written to the cache if needed; None for the mannequin. Raises FileError."""
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

    # --- lost items

    @property
    def lost_takes(self) -> list[LostTake]:
        """The newest `MAX_RECOVERED_TAKES` lost for less than `LOST_DAYS`, newest first; FileError."""
        frames, found = self.database.frame_counts(), dict[str, tuple[int, Motion]]()
        places = {key: place for place, key in enumerate(frames)}
        lost = [(since_s, places[key], key) for key, since_s, _ in self.database.lost() if key in places]
        for since_s, _, key in sorted(lost, reverse=True):
            motion, _ = self._recovered(key, frames[key]) or (None, False)
            if motion is not None:
                found[key] = since_s, motion
            if len(found) == MAX_RECOVERED_TAKES:
                break
        takes = self._takes_of(set(found))
        return [
            LostTake(
                key, replace(takes.get(key, Take()), motion=motion).title, motion.header.seconds, since_s
            )
            for key, (since_s, motion) in found.items()
        ]

    def _recovered(self, key: str, frames: int) -> tuple[Motion, bool] | None:
        """Return a motion with its available frames, and whether its recording was interrupted; None if it is too short."""
        if not MIN_FRAMES <= frames <= MAX_FRAMES:
            return None
        cut_off = False
        try:
            header, cut_off = self._reader().header(self.database.motion(key))
        except FileError:
            header = MotionHeader(UNKNOWN_NAME, UNKNOWN_FPS, frames)
        if not cut_off and header.frames != frames:
            header = replace(header, frames=frames, resimulable=False)
        elif cut_off:
            gaits = np.concatenate([packed_gaits(content, count) for count, content in self._pieces(key)])
            seconds = gait_seconds(gaits, header.fps) if are_gaits(gaits) else ()
            inputs = None
            with contextlib.suppress(FileError):
                inputs = self.load_inputs(key) if header.resimulable else None
            whole = inputs is not None and len(inputs) == frames
            header = replace(header, frames=frames, gait_seconds=seconds, resimulable=whole)
        return Motion(key, header, source=self), cut_off

    def _takes_of(self, keys: set[str]) -> dict[str, Take]:
        """Return the newest readable take that refers to each of some motions."""
        found: dict[str, Take] = {}
        reader = self._reader()
        for key, size in self.database.text_blobs() if keys else ():
            if len(found) == len(keys):
                break
            with contextlib.suppress(FileError):
                take = reader.take(f"|u1 {size} {key}")
                if take.made.key in keys:
                    found.setdefault(take.made.key, take)
        return found


def are_gaits(gaits: AnyArray | None) -> bool:
    """Return whether all numbers `(T,)` are gaits or -1 (unknown)."""
    return gaits is None or bool(((gaits >= -1) & (gaits < 10)).all())


def check_motion(clip: Clip, path: Path | str = "a take") -> None:
    """Raise FileError unless every frame can be shown."""
    if not are_gaits(clip.gaits) or not are_poses(clip.hips_positions, clip.local_rotations, clip.contacts):
        raise FileError(f"{path}: a take with invalid poses.", REMEDY)
