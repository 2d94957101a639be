"""A session as text: JSON that refers to contents by their hashes, and the same from a file that is not trusted.

Records are objects of their fields, whose annotations say how they are read: every name, kind and length is checked.
Grounds, motions, styles and what made a take have forms of their own.
"""

from __future__ import annotations

import json
import math
import types
import typing
from collections.abc import Callable
from dataclasses import dataclass, field, fields, is_dataclass, replace
from enum import Enum
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.character.character import NAMED_UNITS
from runtime.checked import read_number, read_text, read_whole
from runtime.edits.request import checked_targets, written_targets
from runtime.errors import FileError, SportError
from runtime.motion.control_scripts import MAX_POINTS
from runtime.motion.snapshot import Snapshot
from runtime.motion.style import StyleMix
from runtime.prompts.parts import PartDescriptions
from runtime.safe_read import is_text, parse_json, printable, reason
from runtime.session.blobs import REMEDY, BlobReader, BlobWriter, Once
from runtime.session.character_files import safe_name
from runtime.session.frames import packed_table, unpacked_table
from runtime.session.motion import Motion, MotionHeader
from runtime.session.prompt_blend import Answer, PromptBlend
from runtime.session.session import LIVE, MAX_RATING, CharacterChoice, Ground, Session, Take
from runtime.skeleton import PART_NAMES
from runtime.takes.camera_keys import MAX_KEYS
from runtime.takes.clip import MAX_DISTANCE_M, MAX_FPS, MAX_SIZE, MIN_SIZE
from runtime.takes.footplants import MAX_FRAME, FootplantEdit
from runtime.takes.input_recording import (
    COLUMNS,
    Change,
    GroundChange,
    InputFrames,
    InputRecording,
    Keyframe,
    Restart,
    StyleChange,
    are_asked,
)
from runtime.takes.metadata import PromptEvent
from runtime.takes.own_skeleton import OwnSkeleton
from runtime.takes.pins import MAX_PINS
from runtime.takes.pose_edits import PoseEdits
from runtime.terrain.files import MAX_HEIGHT_M
from runtime.terrain.height_map import Terrain
from runtime.terrain.mesh import MAX_SIDE

MAX_TAKES, MAX_VARIANTS, MAX_NEAREST = 10_000, 9, 20
MAX_FRAMES = 2_000_000  # of a take: nine hours
MAX_TEXT_CHARACTERS = 4096  # characters of a name
MAX_ITEMS = 400_000  # values of one text
# in memory, about: of a take without its frames, of a state, and of a change of what made a take
TAKE_BYTES, STATE_BYTES, CHANGE_BYTES = 20_000, 65_536, 4096
ITEM_BYTES = 100  # of a value of a text
CODE_SHAPE = (6, 64)
SOURCES = ("library", "gpt", "explicit")
Json = Any
# what JSON of another shape raises where it is unpacked
STRUCTURE_ERRORS = (
    KeyError, TypeError, ValueError, IndexError, AttributeError, OverflowError, RecursionError, MemoryError,
)  # fmt: skip
_NOT_KEPT = {(PromptBlend, "shares"), (Answer, "milliseconds"), (Answer, "final"), (Answer, "question")}
_LATER = {  # fields that older files lack
    (PoseEdits, "layer"), (Take, "rating"), (Take, "note"), (Take, "numbered_from"), (CharacterChoice, "unit"),
    (MotionHeader, "loop"),
}  # fmt: skip
_LONG_TEXTS = (PromptEvent, Answer)  # records whose texts are prompts


@cache
def _schema(kind: Any) -> tuple[tuple[str, Any], ...]:
    """Fields of a record with their types."""
    hints = typing.get_type_hints(kind)
    return tuple((f.name, hints[f.name]) for f in fields(kind) if (kind, f.name) not in _NOT_KEPT)


def pack_sticks(rows: NDArray[np.float64]) -> bytes:
    """Sticks and settings of frames `(T, COLUMNS)`."""
    return packed_table(rows.astype("<f8", copy=False)) if len(rows) else b""


def unpack_sticks(content: bytes, count: int) -> NDArray[np.float64]:
    """What `pack_sticks` packed; ValueError for what no hand can push."""
    if len(content) != 8 * COLUMNS * count:
        raise ValueError("sticks of another length")
    if not count:
        return np.zeros((0, COLUMNS))
    rows = unpacked_table(content, count, np.dtype("<f8"))
    if not are_asked(rows):
        raise ValueError("a stick that no hand can push")
    return rows


# --- writing


@dataclass
class DocumentWriter:
    """Packs sessions; what did not change since the last one is not packed again. Contents that a text refers to are put first."""

    put: Callable[[str, bytes], None]
    _once: Once = field(default_factory=Once)
    blobs: BlobWriter = field(init=False)
    _forms: list[tuple[type, Callable[[Any], Json]]] = field(init=False)  # of what is no record

    def __post_init__(self) -> None:
        self.blobs = BlobWriter(self.put)
        self._forms = [
            (Enum, lambda value: value.value),
            (str, _text),
            (tuple, self._list),
            (frozenset, sorted),
            (np.ndarray, self.blobs.array),
            (Motion, lambda motion: motion.key),
            (
                Ground,
                lambda ground: [_text(ground.spec)[:MAX_TEXT_CHARACTERS], self._terrain(ground.terrain)],
            ),
            (OwnSkeleton, lambda own: self._once.get("own skeleton", own, lambda: self._own(own))),
            (PartDescriptions, PartDescriptions.to_mapping),
        ]

    def session(self, session: Session) -> str:
        return json.dumps(self._record(session), ensure_ascii=True)

    def inputs(self, inputs: InputRecording) -> Json:
        """JSON of what made a take, but for its sticks: see `pack_sticks`."""
        return {
            "changes": [[change.frame, self._change(change)] for change in inputs.changes],
            "keyframes": [[key.frame, self._snapshot(key.snapshot)] for key in inputs.keyframes],
        }

    def _record(self, value: Any) -> Json:
        kind: Any = type(value)
        packed = {name: self._value(getattr(value, name)) for name, _ in _schema(kind)}
        if kind in _LONG_TEXTS:
            return packed
        return {name: v[:MAX_TEXT_CHARACTERS] if isinstance(v, str) else v for name, v in packed.items()}

    def _value(self, value: Any) -> Json:
        for kind, pack in self._forms:
            if isinstance(value, kind):
                return pack(value)
        return self._record(value) if is_dataclass(value) else value

    def _list(self, values: Any) -> Json:
        return [self._text_of(value) if isinstance(value, Take) else self._value(value) for value in values]

    def _text_of(self, take: Take) -> str:
        return self._once.get("take", take, lambda: self.blobs.text(json.dumps(self._record(take))))

    def _terrain(self, terrain: Terrain) -> Json:
        x, z = terrain.origin
        heights = self._once.get("heights", terrain.heights, lambda: self.blobs.array(terrain.heights))
        return {"name": terrain.name, "cell_m": float(terrain.cell_m), "x": float(x), "z": float(z),
                "note": terrain.note, "unit_m": terrain.unit_m, "heights": heights}  # fmt: skip

    def _own(self, own: OwnSkeleton) -> Json:
        middle, steps = own.packed()
        return [list(own.parents), self.blobs.array(middle), self.blobs.data(steps)]

    def _snapshot(self, snapshot: Snapshot) -> str:
        return self._once.get("state", snapshot, lambda: self.blobs.data(snapshot.to_bytes()))

    def _change(self, change: Change) -> Json:
        if isinstance(change, Restart):
            return {"restart": [change.x, change.z, change.yaw]}
        if isinstance(change, GroundChange):
            return {"name": printable(change.name), "ground": self._terrain(change.terrain)}
        z, note = change.z, change.note
        style = (
            [self.blobs.array(np.stack(z.codes)), list(map(float, z.weights)), written_targets(z.edits)]
            if isinstance(z, StyleMix)
            else self.blobs.array(z)
        )
        kept = self._record(note) if isinstance(note, PromptBlend) else None
        return {
            "seconds": change.seconds, "style": style, "event": self._record(change.event), "note": kept
        }  # fmt: skip


def _text(text: str) -> str:
    """Text as it can be read again."""
    return printable(text).replace("\0", "\ufffd")


def header_text(header: MotionHeader, recording: bool = False) -> str:
    """A motion's header as JSON; `recording`: it is not finished."""
    value = DocumentWriter(lambda key, content: None)._record(header)
    return json.dumps(value | {"recording": recording}, ensure_ascii=True)


# --- reading


@dataclass
class DocumentReader:
    """Unpacks what a `DocumentWriter` packed. `motion` finds one by its key; FileError for what is no session."""

    blobs: BlobReader
    motion: Callable[[str], Motion]
    _forms: dict[Any, Callable[[Json], Any]] = field(init=False)  # of what is no record
    left_out: set[str] = field(default_factory=set)  # references of takes that cannot be read

    def __post_init__(self) -> None:
        self._forms = {
            Motion: lambda value: self.motion(read_text(value, MAX_TEXT_CHARACTERS)),
            Ground: self._ground,
            OwnSkeleton: self._own,
            PartDescriptions: PartDescriptions.from_mapping,
            NDArray[np.float32]: self._code,
        }

    def session(self, text: str) -> Session:
        return self.checked(lambda: self._record(Session, self._parsed(text)))

    def _parsed(self, text: str) -> Json:
        """The value of a text, whose making is counted before."""
        self.blobs.budget.spend(ITEM_BYTES * sum(map(text.count, "[{,")))
        return parse_json(text, MAX_ITEMS)

    def header(self, text: str) -> tuple[MotionHeader, bool]:
        """A motion's header, and whether its recording was cut off."""

        def read() -> tuple[MotionHeader, bool]:
            value = self._parsed(text)
            return self._record(MotionHeader, value), value.pop("recording") is True

        return self.checked(read)

    def checked(self, read: Callable[[], Any]) -> Any:
        """What `read` gives; FileError where it fails by what it reads."""
        path = self.blobs.path
        try:
            return read()
        except FileError:
            raise
        except SportError as error:
            raise FileError(f"{path}: damaged ({error.problem.rstrip('.')}).", REMEDY) from error
        except STRUCTURE_ERRORS as error:
            raise FileError(f"{path}: damaged ({reason(error)}).", REMEDY) from error

    def inputs(self, value: Json, frames: InputFrames) -> InputRecording:
        """What made a take, of JSON and its sticks; FileError or one of `STRUCTURE_ERRORS` for what is none."""
        keyframes = tuple(self._keyframe(*key) for key in value["keyframes"])
        changes = tuple(self._change(*change) for change in value["changes"])
        starts = [key.frame for key in keyframes]
        if not starts or starts != sorted(starts) or starts[0] > 0 or len(frames) + starts[0] < 1:
            raise FileError(f"{self.blobs.path}: keyframes that do not fit the take.", REMEDY)
        if starts[-1] >= len(frames) + starts[0]:
            raise FileError(f"{self.blobs.path}: a keyframe after the take's end.", REMEDY)
        return InputRecording(frames, changes, keyframes)

    def _record(self, kind: Any, value: Json) -> Any:
        longest = math.inf if kind in _LONG_TEXTS else MAX_TEXT_CHARACTERS
        schema = _schema(kind)
        if value.keys() != {name for name, _ in schema}:
            schema = tuple(entry for entry in schema if entry[0] in value or (kind, entry[0]) not in _LATER)
            if kind is not MotionHeader and set(value) != {name for name, _ in schema}:
                raise ValueError(f"not the fields of a {kind.__name__}")
        made = kind(**{name: self._value(hint, value[name], longest) for name, hint in schema})
        return _CHECKS.get(kind, lambda _: None)(made) or made

    def _value(self, hint: Any, value: Json, longest: float) -> Any:
        if hint in _PLAIN:
            return _plain(hint, value, longest)
        if hint in self._forms:
            return self._forms[hint](value)
        origin, inside = _parts(hint)
        if origin in (typing.Union, types.UnionType):
            known = next(each for each in inside if each is not type(None))
            return None if value is None else self._value(known, value, longest)
        if origin in (tuple, frozenset):
            return origin(self._values(inside, value, longest))
        return self._record(hint, value) if is_dataclass(hint) else _plain(hint, value, longest)

    def _values(self, inside: Any, value: Json, longest: float) -> list[Any]:
        if not isinstance(value, list) or len(value) > MAX_TAKES:
            raise ValueError("expected a list of some values")
        if inside[0] is Take:
            return [take for reference in value if (take := self._sound_take(reference)) is not None]
        hints = inside if len(inside) > 1 and inside[-1] is not Ellipsis else inside[:1] * len(value)
        return [self._value(h, v, longest) for h, v in zip(hints, value, strict=True)]

    def is_whole(self, text: str) -> bool:
        """Whether every take of a session that was read is there."""
        return not any(reference in text for reference in self.left_out)

    def _sound_take(self, reference: Json) -> Take | None:
        """A take; None for one that cannot be read, which its session is without."""
        if str(reference) in self.left_out:
            return None
        try:
            return self.take(reference)
        except FileError:
            self.left_out.add(str(reference))
            return None

    def take(self, reference: Json) -> Take:
        """The take of a reference; FileError."""

        def made() -> Take:
            self.blobs.budget.spend(TAKE_BYTES)
            return self._record(Take, self._parsed(self.blobs.text(reference)))

        return self.checked(lambda: self.blobs.once("take", reference, made))

    def _ground(self, value: Json) -> Ground:
        spec, terrain = value
        made = self._terrain(terrain)
        name = read_text(spec, MAX_TEXT_CHARACTERS)
        return self.blobs.once("ground of", (id(made), name), lambda: Ground.of(name, made))

    def _terrain(self, value: Json) -> Terrain:
        """A ground; FileError for one on which no one can stand."""
        heights = self.blobs.array(value["heights"], "<f4", (None, None))
        cell, path = read_number(value["cell_m"], 1000.0), self.blobs.path
        if not _is_ground(heights) or cell < 1e-4:
            raise FileError(f"{path}: a ground of {heights.shape[0]} x {heights.shape[1]} samples.", REMEDY)
        origin = (read_number(value["x"], MAX_DISTANCE_M), read_number(value["z"], MAX_DISTANCE_M))
        unit = read_number(value["unit_m"], MAX_SIZE)
        if unit < MIN_SIZE:
            raise FileError(f"{path}: a ground for a body of {unit:g} times our size.", REMEDY)
        name, note = read_text(value["name"]), read_text(value["note"])
        key = json.dumps(value, sort_keys=True)
        return self.blobs.once(
            "ground", key, lambda: Terrain(name, heights, cell, origin, note, unit)
        )  # fmt: skip

    def _own(self, value: Json) -> OwnSkeleton:
        parents, middle, steps = value
        if not all(type(parent) is int for parent in parents):
            raise ValueError("parents")

        def made() -> OwnSkeleton:
            self.blobs.budget.spend(10 * self.blobs.size(steps))  # whole numbers and places while it unfolds
            points = self.blobs.array(middle, "<f4", (None, 3))
            return OwnSkeleton.unpacked(tuple(parents), points, self.blobs.data(steps))

        return self.blobs.once("own skeleton", (steps, tuple(parents)), made)

    def _keyframe(self, frame: Json, reference: Json) -> Keyframe:
        def made() -> Snapshot:
            self.blobs.budget.spend(STATE_BYTES)
            return Snapshot.from_bytes(self.blobs.data(reference), f"{self.blobs.path}: keyframe {frame}")

        return Keyframe(read_whole(frame, -MAX_FRAME), self.blobs.once("state", reference, made))

    def _change(self, frame: Json, value: Json) -> Change:
        self.blobs.budget.spend(CHANGE_BYTES)
        at = read_whole(frame, -MAX_FRAME)
        if "restart" in value:
            x, z, yaw = (read_number(v, MAX_DISTANCE_M) for v in value["restart"])
            return Restart(at, x, z, yaw)
        if "ground" in value:
            return GroundChange(at, read_text(value["name"]), self._terrain(value["ground"]))
        event = replace(self._record(PromptEvent, value["event"]), seconds=0.0)
        note = None if value["note"] is None else self._record(PromptBlend, value["note"])
        return StyleChange(at, self._style(value["style"]), read_number(value["seconds"], 1e6), event, note)

    def _style(self, value: Json) -> Any:
        if not isinstance(value, list):
            return self._code(value)
        number, parts, edits = value
        codes = self._finite(self.blobs.array(number, "<f4", (len(parts), *CODE_SHAPE)))
        mixed = tuple(read_number(part, 1.0) for part in parts)
        if not mixed or min(mixed) < 0.0 or abs(sum(mixed) - 1.0) > 1e-3:
            raise ValueError("fractions of styles that are no mix")
        return StyleMix(mixed, tuple(codes), checked_targets(edits))

    def _code(self, value: Json) -> Any:
        return self._finite(self.blobs.array(value, "<f4", CODE_SHAPE))

    def _finite(self, values: Any) -> Any:
        if not (np.abs(values) <= 1e6).all():
            raise FileError(f"{self.blobs.path}: a style that is not finite.", REMEDY)
        return values


@cache
def _parts(hint: Any) -> tuple[Any, tuple[Any, ...]]:
    return typing.get_origin(hint), typing.get_args(hint)


_PLAIN = (float, int, bool, str)


def _plain(hint: Any, value: Json, longest: float) -> Any:
    if hint is bool:
        return value is True
    if hint is int:
        return read_whole(value)
    if hint is float:
        return read_number(value)
    return read_text(value, longest) if hint is str else hint(value)


def _is_ground(heights: Any) -> bool:
    fits = min(heights.shape) >= 2 and max(heights.shape) <= MAX_SIDE
    return fits and max(-float(heights.min()), float(heights.max())) <= MAX_HEIGHT_M  # nor with NaN


# --- what annotations do not say


def _refuse(what: str, wrong: bool) -> None:
    if wrong:
        raise ValueError(what)


def _check_session(session: Session) -> Session:
    numbers = [take.number for take in session.takes]
    _refuse("takes without numbers of their own", len(set(numbers)) < len(numbers) or 0 in numbers)
    _refuse(f"{len(session.variants)} variants", len(session.variants) > MAX_VARIANTS)
    selected = session.selected if session.selected in numbers else 0
    return replace(session, counter=max(session.counter, *numbers, 0), selected=selected)


def _check_take(take: Take) -> None:
    many = len(take.cameras) > MAX_KEYS or len(take.path) > MAX_POINTS
    edits = take.poses.pins, take.poses.footplants, take.poses.layer.keys
    _refuse("a take without a motion", take.number != LIVE and take.motion is None)
    _refuse("edits without end", many or max(map(len, edits)) > MAX_PINS)
    _refuse("a rating", not 0 <= take.rating <= MAX_RATING)
    _refuse("a frame number", not 0 <= take.numbered_from <= MAX_FRAMES)
    _refuse("a trim that keeps nothing", take.trim is not None and take.trim[0] >= take.trim[1])


def _check_footplant(edit: FootplantEdit) -> None:
    spans = [span for span in (edit.old, edit.new) if span is not None]
    fits = edit.foot in (0, 1) and all(first < end < MAX_FRAME for first, end in spans)
    _refuse("a footplant of no foot or frames", not fits)


def _check_blend(blend: PromptBlend) -> PromptBlend:
    fits = len(blend.weights) == len(PART_NAMES) and all(0.0 <= weight <= 1.0 for weight in blend.weights)
    _refuse("weights of a blend that are none", not fits)
    return replace(blend, locked=blend.locked & set(PART_NAMES))


def _check_answer(answer: Answer) -> Answer:
    _refuse("an answer of no known source", answer.source not in SOURCES)
    return replace(answer, nearest=answer.nearest[:MAX_NEAREST])


def _check_event(event: PromptEvent) -> None:
    known = not event.words or isinstance(parse_json(event.words), dict)
    _refuse("words that are none", not known or event.transition_seconds < 0.0)


def _check_header(header: MotionHeader) -> None:
    fits = 0.0 < header.fps <= MAX_FPS and header.frames <= MAX_FRAMES and MIN_SIZE <= header.size <= MAX_SIZE
    _refuse(f"a motion of {header.frames} frames at {header.fps:g}", not fits)
    _refuse("a place of other numbers", header.placed is not None and len(header.placed) != 4)


def _check_character(choice: CharacterChoice) -> None:
    choice.shape.check()
    _refuse("files of a character outside their folder", bool(choice.key) and not safe_name(choice.key))
    _refuse("a character of an unknown unit", choice.unit not in ("", *NAMED_UNITS))


_CHECKS: dict[Any, Callable[[Any], Any]] = {
    Session: _check_session,
    Take: _check_take,
    FootplantEdit: _check_footplant,
    PromptBlend: _check_blend,
    Answer: _check_answer,
    PromptEvent: _check_event,
    MotionHeader: _check_header,
    CharacterChoice: _check_character,
}


def read_view(text: str) -> dict[str, Any]:
    """How a session was looked at: entries that are texts, numbers or truth values; none for what is no view."""
    try:
        value = parse_json(text) if text else {}
    except ValueError:
        return {}
    known = value.items() if isinstance(value, dict) else ()
    return {
        key: entry
        for key, entry in known
        if (is_text(entry) and len(entry) <= MAX_TEXT_CHARACTERS)
        or (isinstance(entry, bool | int | float) and math.isfinite(entry))
    }
