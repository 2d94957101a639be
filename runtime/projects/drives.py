"""What a take was driven by, as JSON and arrays: sticks, styles, grounds, restarts and keyframes."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from runtime.errors import FileError
from runtime.motion.snapshot import Snapshot
from runtime.motion.style_mix import StyleMix
from runtime.projects.archive import REMEDY, ArchiveReader, ArchiveWriter
from runtime.projects.motion import packed_table, unpacked_table
from runtime.safe_read import is_text, parse_json, printable
from runtime.takes.clip import MAX_DISTANCE_M, MAX_SIZE, MIN_SIZE
from runtime.takes.drive import Change, Drive, GroundChange, Keyframe, Restart, StyleChange
from runtime.takes.driven_frames import COLUMNS, DrivenFrames, are_asked
from runtime.takes.metadata import PromptEvent, event_from
from runtime.terrain.files import MAX_HEIGHT_M
from runtime.terrain.height_map import Terrain
from runtime.terrain.mesh import MAX_SIDE

CODE = (6, 64)
STICK_COLUMNS = (COLUMNS, 7)  # numbers of a frame; the first takes had no response
# in memory, about
FRAME_BYTES, STATE_BYTES, CHANGE_BYTES = 8 * COLUMNS, 65_536, 4096
Json = Any
Note = Callable[[Any], Json]  # packs what a program keeps with a style, or unpacks it


@dataclass
class DriveWriter:
    """Packs drives; what several share is stored once."""

    archive: ArchiveWriter
    note: Note  # JSON of a style's note
    grounds: list[Json] = field(default_factory=list)
    changes: list[Json] = field(default_factory=list)
    _numbers: dict[str, int] = field(default_factory=dict)  # of grounds and changes, by their JSON

    def ground(self, terrain: Terrain) -> int:
        """The number of a ground in `grounds`."""
        x, z = terrain.origin
        heights = self.archive.array(terrain.heights)
        return self._number(
            self.grounds,
            {"name": terrain.name, "cell_m": float(terrain.cell_m), "x": float(x), "z": float(z),
             "note": terrain.note, "unit_m": terrain.unit_m, "heights": heights},
        )  # fmt: skip

    def drive(self, drive: Drive) -> Json:
        """JSON of a drive."""
        (sticks,) = self.archive.pieces(
            "stick", drive.frames, lambda: [packed_table(drive.frames.rows.astype("<f8", copy=False))]
        )
        return {
            "count": len(drive.frames),
            "frames": sticks,
            "changes": [[c.frame, self._number(self.changes, self._change(c))] for c in drive.changes],
            "keyframes": [[key.frame, self._snapshot(key.snapshot)] for key in drive.keyframes],
        }

    def _number(self, table: list[Json], value: Json) -> int:
        text = json.dumps(value, sort_keys=True)
        if text not in self._numbers:
            table.append(value)
            self._numbers[text] = len(table) - 1
        return self._numbers[text]

    def _snapshot(self, snapshot: Snapshot) -> int:
        (number,) = self.archive.pieces("state", snapshot, lambda: [snapshot.to_bytes()])
        return number

    def _change(self, change: Change) -> Json:
        if isinstance(change, Restart):
            return {"restart": [change.x, change.z, change.yaw]}
        if isinstance(change, GroundChange):
            return {"name": printable(change.name), "ground": self.ground(change.terrain)}
        event = change.event
        return {
            "seconds": change.seconds,
            "style": self.code(change.z),
            "prompt": event.prompt,
            "words": event.words,
            "typed": event.typed,
            "transition": event.transition_seconds,
            "note": None if change.note is None else self.note(change.note),
        }

    def code(self, z: Any) -> Json:
        """JSON of a style code or a mix of codes."""
        if isinstance(z, StyleMix):
            return [self.archive.array(np.stack(z.codes)), [float(share) for share in z.shares]]
        return self.archive.array(z)


@dataclass
class DriveReader:
    """Unpacks drives; FileError or a structural error (KeyError, TypeError, ValueError) for what is none."""

    archive: ArchiveReader
    note: Note
    grounds: list[Terrain]
    changes: Sequence[Json]

    def drive(self, value: Json) -> Drive:
        """A drive of JSON."""
        frames = self._frames(value["frames"], value["count"])
        keyframes = tuple(self._keyframe(key) for key in value["keyframes"])
        changes = tuple(self._change(change) for change in value["changes"])
        starts = [key.frame for key in keyframes]
        if not starts or starts != sorted(starts) or starts[0] > 0 or len(frames) + starts[0] < 1:
            raise FileError(f"{self.archive.path}: keyframes that do not fit the take.", REMEDY)
        if starts[-1] >= len(frames) + starts[0]:
            raise FileError(f"{self.archive.path}: a keyframe after the take's end.", REMEDY)
        return Drive(frames, changes, keyframes)

    def _frames(self, number: Json, count: Json) -> DrivenFrames:
        def made() -> DrivenFrames:
            sizes = () if type(count) is not int else [8 * columns * count for columns in STICK_COLUMNS]
            if self.archive.size(number) not in sizes:
                raise ValueError("a stick of another length")
            self.archive.budget.spend(FRAME_BYTES * count)
            return self._sticks(unpacked_table(self.archive.data(number), count, np.dtype("<f8")))

        return self.archive.once("stick", number, made)

    def _sticks(self, table: Any) -> DrivenFrames:
        rows = np.zeros((len(table), COLUMNS))
        rows[:, : table.shape[1]] = table
        if not are_asked(rows):
            raise FileError(f"{self.archive.path}: a stick that nobody can push.", REMEDY)
        return DrivenFrames(rows)

    def _keyframe(self, value: Json) -> Keyframe:
        frame, number = value

        def made() -> Snapshot:
            self.archive.budget.spend(STATE_BYTES)
            return Snapshot.from_bytes(self.archive.data(number), f"{self.archive.path}: keyframe {frame}")

        return Keyframe(_whole(frame), self.archive.once("state", number, made))

    def _change(self, value: Json) -> Change:
        frame, number = value
        if type(number) is not int or not 0 <= number < len(self.changes):
            raise ValueError(f"change {str(number)[:20]}")
        change = self.archive.once("change", number, lambda: self._read_change(self.changes[number]))
        return replace(change, frame=_whole(frame))

    def _read_change(self, value: Json) -> Change:
        """A change of JSON, as if at frame 0."""
        self.archive.budget.spend(CHANGE_BYTES)
        if "restart" in value:
            x, z, yaw = (_number(v, MAX_DISTANCE_M) for v in value["restart"])
            return Restart(0, x, z, yaw)
        if "ground" in value:
            return GroundChange(0, _text(value["name"]), self.ground(value["ground"]))
        seconds = _number(value["seconds"], 1e6)
        words = {"prompt": _text(value["prompt"]), "typed": _text(value["typed"])}
        checked = event_from({**words, "transition_seconds": value["transition"]})
        event = PromptEvent(
            0.0, checked.prompt, checked.transition_seconds, read_words_text(value["words"]), checked.typed
        )
        note = None if value["note"] is None else self.note(value["note"])
        return StyleChange(0, self.code(value["style"]), seconds, event, note)

    def code(self, value: Json) -> Any:
        """A style code, or a mix of codes."""
        if not isinstance(value, list):
            return self._finite(self.archive.array(value, "<f4", CODE))
        number, shares = value
        codes = self._finite(self.archive.array(number, "<f4", (len(shares), *CODE)))
        mixed = tuple(_number(share, 1.0) for share in shares)
        if not mixed or min(mixed) < 0.0 or abs(sum(mixed) - 1.0) > 1e-3:
            raise ValueError("shares of styles that are no mix")
        return StyleMix(mixed, tuple(codes))

    def ground(self, number: Json) -> Terrain:
        """A ground by its number."""
        if type(number) is not int or not 0 <= number < len(self.grounds):
            raise ValueError(f"ground {str(number)[:20]}")
        return self.grounds[number]

    def _finite(self, values: Any) -> Any:
        if not (np.abs(values) <= 1e6).all():
            raise FileError(f"{self.archive.path}: a style that is not finite.", REMEDY)
        return values


def read_ground(value: Json, archive: ArchiveReader) -> Terrain:
    """A ground of JSON; FileError for one that nobody can stand on."""
    heights = archive.array(value["heights"], "<f4", (None, None))
    cell = _number(value["cell_m"], 1000.0)
    if not _is_ground(heights) or cell < 1e-4:
        raise FileError(
            f"{archive.path}: a ground of {heights.shape[0]} x {heights.shape[1]} samples.", REMEDY
        )
    origin = (_number(value["x"], MAX_DISTANCE_M), _number(value["z"], MAX_DISTANCE_M))
    unit = _number(value.get("unit_m", 1.0), MAX_SIZE)
    if unit < MIN_SIZE:
        raise FileError(f"{archive.path}: a ground for a body of {unit:g} times our size.", REMEDY)
    return Terrain(_text(value["name"]), heights, cell, origin, _text(value["note"]), unit)


def _is_ground(heights: Any) -> bool:
    fits = min(heights.shape) >= 2 and max(heights.shape) <= MAX_SIDE
    return fits and max(-float(heights.min()), float(heights.max())) <= MAX_HEIGHT_M  # nor with NaN


def read_words_text(value: Json) -> str:
    """The JSON text of a prompt's words, or ""."""
    text = _text(value)
    if text and not isinstance(parse_json(text), dict):
        raise ValueError("words that are none")
    return text


def _whole(value: Json) -> int:
    if type(value) is not int or abs(value) > 1 << 40:
        raise ValueError(f"{str(value)[:20]} is no frame")
    return value


def _number(value: Json, limit: float) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) <= limit:
        raise ValueError(f"{str(value)[:20]}: expected a number up to {limit:g}")
    return float(value)


def _text(value: Json) -> str:
    if not is_text(value) or "\0" in value:
        raise ValueError("expected text")
    return value
