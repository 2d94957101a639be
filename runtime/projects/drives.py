"""What a take was driven by, as JSON and arrays: sticks, styles, grounds, restarts and keyframes."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from runtime.controls import Controls, Gait
from runtime.errors import FileError
from runtime.motion.snapshot import Snapshot
from runtime.motion.style_mix import StyleMix
from runtime.projects.archive import REMEDY, ArchiveReader, ArchiveWriter
from runtime.safe_read import is_text, parse_json
from runtime.takes.drive import Change, Drive, DrivenFrame, GroundChange, Keyframe, Restart, StyleChange
from runtime.takes.metadata import PromptEvent, event_from
from runtime.terrain.height_map import Terrain

CODE = (6, 64)
MAX_HEIGHT_M = 10_000.0
MAX_SIDE = 8192  # samples of a ground
MAX_DISTANCE_M = 100_000.0
Json = Any
Note = Callable[[Any], Json]  # packs what a program keeps with a style, or unpacks it


@dataclass
class DriveWriter:
    """Packs drives; what several share is stored once."""

    archive: ArchiveWriter
    note: Note  # JSON of a style's note
    snapshots: dict[int, tuple[Snapshot, bytes]] = field(
        default_factory=dict
    )  # by identity, kept by the caller
    grounds: list[Json] = field(default_factory=list)
    _ground_ids: dict[int, tuple[Terrain, int]] = field(default_factory=dict)
    _frame_ids: dict[int, tuple[Any, Json]] = field(default_factory=dict)

    def ground(self, terrain: Terrain) -> int:
        """The number of a ground in `grounds`."""
        known = self._ground_ids.get(id(terrain))
        if known is None:
            x, z = terrain.origin
            heights = self.archive.array(terrain.heights)
            self.grounds.append(
                {"name": terrain.name, "cell_m": float(terrain.cell_m), "x": float(x), "z": float(z),
                 "note": terrain.note, "heights": heights}
            )  # fmt: skip
            self._ground_ids[id(terrain)] = known = (terrain, len(self.grounds) - 1)
        return known[1]

    def drive(self, drive: Drive) -> Json:
        """JSON of a drive."""
        return {
            "frames": self._frames(drive.frames),
            "changes": [self._change(change) for change in drive.changes],
            "keyframes": [[key.frame, self._snapshot(key.snapshot)] for key in drive.keyframes],
        }

    def _frames(self, frames: tuple[DrivenFrame, ...]) -> Json:
        known = self._frame_ids.get(id(frames))
        if known is None:
            nowhere = (math.nan, math.nan)
            rows = [
                (
                    *f.controls.move,
                    *(f.controls.facing or nowhere),
                    int(f.controls.gait),
                    f.temperature,
                    f.strength,
                )
                for f in frames
            ]
            number = self.archive.array(np.array(rows, np.float64).reshape(-1, 7), "<f8")
            self._frame_ids[id(frames)] = known = (frames, number)
        return known[1]

    def _snapshot(self, snapshot: Snapshot) -> int:
        known = self.snapshots.get(id(snapshot))
        if known is None:
            self.snapshots[id(snapshot)] = known = (snapshot, snapshot.to_bytes())
        return self.archive.data(known[1])

    def _change(self, change: Change) -> Json:
        if isinstance(change, Restart):
            return {"restart": [change.frame, change.x, change.z, change.yaw]}
        if isinstance(change, GroundChange):
            return {"ground": self.ground(change.terrain), "frame": change.frame, "name": change.name}
        event = change.event
        return {
            "frame": change.frame,
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

    def drive(self, value: Json) -> Drive:
        """A drive of JSON."""
        frames = self._frames(value["frames"])
        keyframes = tuple(self._keyframe(key) for key in value["keyframes"])
        changes = tuple(self._change(change) for change in value["changes"])
        starts = [key.frame for key in keyframes]
        if not starts or starts != sorted(starts) or starts[0] > 0 or len(frames) + starts[0] < 1:
            raise FileError(f"{self.archive.path}: keyframes that do not fit the take.", REMEDY)
        if starts[-1] >= len(frames) + starts[0]:
            raise FileError(f"{self.archive.path}: a keyframe after the take's end.", REMEDY)
        return Drive(frames, changes, keyframes)

    def _frames(self, number: Json) -> tuple[DrivenFrame, ...]:
        rows = self.archive.array(number, "<f8", (None, 7))
        rest = np.delete(rows, (2, 3), axis=1)
        if not np.isfinite(rest).all() or not (np.abs(rest[:, 3:]) <= 10.0).all():
            raise FileError(f"{self.archive.path}: a stick that is not finite.", REMEDY)
        return tuple(
            DrivenFrame(
                Controls((x, z), None if math.isnan(fx) else (fx, fz), Gait(int(gait))), temperature, strength
            )
            for x, z, fx, fz, gait, temperature, strength in rows.tolist()
        )

    def _keyframe(self, value: Json) -> Keyframe:
        frame, number = value
        data = self.archive.data(number)
        return Keyframe(_whole(frame), Snapshot.from_bytes(data, f"{self.archive.path}: keyframe {frame}"))

    def _change(self, value: Json) -> Change:
        if "restart" in value:
            frame, x, z, yaw = value["restart"]
            return Restart(_whole(frame), *(_number(v, MAX_DISTANCE_M) for v in (x, z, yaw)))
        if "ground" in value:
            return GroundChange(_whole(value["frame"]), _text(value["name"]), self.ground(value["ground"]))
        seconds = _number(value["seconds"], 1e6)
        words = {"prompt": _text(value["prompt"]), "typed": _text(value["typed"])}
        checked = event_from({**words, "transition_seconds": value["transition"]})
        event = PromptEvent(
            0.0, checked.prompt, checked.transition_seconds, read_words_text(value["words"]), checked.typed
        )
        note = None if value["note"] is None else self.note(value["note"])
        return StyleChange(_whole(value["frame"]), self.code(value["style"]), seconds, event, note)

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
    if max(heights.shape) > MAX_SIDE or not (np.abs(heights) <= MAX_HEIGHT_M).all() or cell < 1e-4:
        raise FileError(
            f"{archive.path}: a ground of {heights.shape[0]} x {heights.shape[1]} samples.", REMEDY
        )
    origin = (_number(value["x"], MAX_DISTANCE_M), _number(value["z"], MAX_DISTANCE_M))
    return Terrain(_text(value["name"]), heights, cell, origin, _text(value["note"]))


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
