"""Reads a session, a motion's header or its input from the untrusted text that `document` writes."""

import json
import math
import types
import typing
from collections.abc import Callable
from dataclasses import dataclass, field, is_dataclass, replace
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.character.character import NAMED_UNITS
from runtime.checked import read_number, read_text, read_whole
from runtime.edits.request import checked_targets
from runtime.errors import FileError, SportError
from runtime.motion.control_scripts import MAX_POINTS
from runtime.motion.snapshot import Snapshot
from runtime.motion.style import StyleMix
from runtime.prompts.parts import PartDescriptions
from runtime.safe_read import is_text, parse_json, reason
from runtime.session.blobs import REMEDY, BlobReader
from runtime.session.character_files import safe_name
from runtime.session.document import (
    LONG_TEXTS,
    MAX_FRAMES,
    MAX_ITEMS,
    MAX_TEXT_CHARACTERS,
    Json,
    record_fields,
)
from runtime.session.motion import Motion, MotionHeader
from runtime.session.prompt_blend import Answer, PromptBlend
from runtime.session.session import LIVE, MAX_RATING, CharacterChoice, Ground, Session, Take
from runtime.skeleton import PART_NAMES
from runtime.takes.camera_keys import MAX_KEYS
from runtime.takes.clip import MAX_DISTANCE_M, MAX_FPS, MAX_SIZE, MIN_SIZE
from runtime.takes.footplants import MAX_FRAME, FootplantEdit
from runtime.takes.input_recording import (
    Change,
    GroundChange,
    InputFrames,
    InputRecording,
    Keyframe,
    Restart,
    StyleChange,
)
from runtime.takes.metadata import PromptEvent
from runtime.takes.own_skeleton import OwnSkeleton
from runtime.takes.pose_edits import PoseEdits
from runtime.terrain.files import MAX_HEIGHT_M
from runtime.terrain.height_map import Terrain
from runtime.terrain.mesh import MAX_SIDE

MAX_TAKES = 10_000
MAX_VARIANTS, MAX_NEAREST = 9, 20
SOURCES = ("library", "gpt", "explicit")
# approximate memory of a take without its frames, of a controller state, and of a change in a take's input
TAKE_BYTES, STATE_BYTES, CHANGE_BYTES = 20_000, 65_536, 4096
ITEM_BYTES = 100  # per value of a text
CODE_SHAPE = (6, 64)
# exceptions raised while unpacking JSON of another shape
STRUCTURE_ERRORS = (
    KeyError, TypeError, ValueError, IndexError, AttributeError, OverflowError, RecursionError, MemoryError,
)  # fmt: skip
_LATER = {  # fields that older files lack
    (PoseEdits, "layer"), (Take, "rating"), (Take, "note"), (Take, "numbered_from"), (CharacterChoice, "unit"),
    (MotionHeader, "loop"),
}  # fmt: skip


Form = Callable[["DocumentReader", Json], Any]


@dataclass
class DocumentReader:
    """Reads what a `DocumentWriter` wrote; `motion` finds a motion by key. Raises FileError for an invalid session."""

    blobs: BlobReader
    motion: Callable[[str], Motion]
    left_out: set[str] = field(default_factory=set)  # references of takes that cannot be read
    _takes: dict[str, Take] = field(default_factory=dict)  # the readable ones, by reference

    def session(self, text: str) -> Session:
        return self.checked(lambda: self._record(Session, self._parsed(text)))

    def _parsed(self, text: str) -> Json:
        """Parse a text, charging its memory to the budget first."""
        spend = self.blobs.budget.spend
        return parse_json(text, MAX_ITEMS, spend=lambda items: spend(ITEM_BYTES * items))

    def header(self, text: str) -> tuple[MotionHeader, bool]:
        """Return a motion's header, and whether its recording was cut off."""

        def read() -> tuple[MotionHeader, bool]:
            value = self._parsed(text)
            return self._record(MotionHeader, value), value.pop("recording") is True

        return self.checked(read)

    def checked(self, read: Callable[[], Any]) -> Any:
        """Return the result of `read`, converting errors caused by invalid data to FileError."""
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
        """Read a take's input from JSON and stick positions; FileError or one of `STRUCTURE_ERRORS` if it is invalid."""
        keyframes = tuple(self._keyframe(*key) for key in value["keyframes"])
        changes = tuple(self._change(*change) for change in value["changes"])
        starts = [key.frame for key in keyframes]
        if not starts or starts != sorted(starts) or starts[0] > 0 or len(frames) + starts[0] < 1:
            raise FileError(f"{self.blobs.path}: keyframes that do not fit the take.", REMEDY)
        if starts[-1] >= len(frames) + starts[0]:
            raise FileError(f"{self.blobs.path}: a keyframe after the take's end.", REMEDY)
        return InputRecording(frames, changes, keyframes)

    def _record(self, kind: Any, value: Json) -> Any:
        forms = {n: form for n, form in _forms(kind).items() if n in value or (kind, n) not in _LATER}
        if kind is not MotionHeader and value.keys() != forms.keys():
            raise ValueError(f"not the fields of a {kind.__name__}")
        return checked_record(kind(**{name: form(self, value[name]) for name, form in forms.items()}))

    def is_whole(self, text: str) -> bool:
        """Return whether no take of a session was left out when it was read."""
        return not any(reference in text for reference in self.left_out)

    def _sound_takes(self, references: list[Json]) -> list[Take]:
        """Return the takes that can be read; every step lists all takes again."""
        names = [str(reference) for reference in references]
        for name, reference in zip(names, references, strict=True):
            if name not in self._takes and name not in self.left_out:
                try:
                    self._takes[name] = self.take(reference)
                except FileError:
                    self.left_out.add(name)
        return [self._takes[name] for name in names if name in self._takes]

    def take(self, reference: Json) -> Take:
        """Return the take of a reference. Raises FileError."""

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
        heights = self.blobs.array(value["heights"], "<f4", (None, None))
        cell, path = read_number(value["cell_m"], 1000.0), self.blobs.path
        fits = min(heights.shape) >= 2 and max(heights.shape) <= MAX_SIDE and cell >= 1e-4
        if not fits or not np.abs(heights).max() <= MAX_HEIGHT_M:  # also rejects NaN
            raise FileError(f"{path}: a ground of {heights.shape[0]} x {heights.shape[1]} samples.", REMEDY)
        origin = (read_number(value["x"], MAX_DISTANCE_M), read_number(value["z"], MAX_DISTANCE_M))
        unit = read_number(value["unit_m"], MAX_SIZE)
        if unit < MIN_SIZE:
            raise FileError(f"{path}: a ground for a body of {unit:g} times our size.", REMEDY)
        name, note = read_text(value["name"]), read_text(value["note"])
        key = json.dumps(value, sort_keys=True)
        return self.blobs.once("ground", key, lambda: Terrain(name, heights, cell, origin, note, unit))

    def _own(self, value: Json) -> OwnSkeleton:
        parents, middle, steps = value
        if not all(type(parent) is int for parent in parents):
            raise ValueError("parents")

        def made() -> OwnSkeleton:
            self.blobs.budget.spend(10 * self.blobs.size(steps))  # integers and positions, unpacked
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
            raise ValueError("invalid style weights")
        return StyleMix(mixed, tuple(codes), checked_targets(edits))

    def _code(self, value: Json) -> Any:
        return self._finite(self.blobs.array(value, "<f4", CODE_SHAPE))

    def _finite(self, values: Any) -> Any:
        if not (np.abs(values) <= 1e6).all():
            raise FileError(f"{self.blobs.path}: a style that is not finite.", REMEDY)
        return values


_FORMS: dict[Any, Form] = {  # of values that are not records
    Motion: lambda reader, value: reader.motion(read_text(value, MAX_TEXT_CHARACTERS)),
    Ground: lambda reader, value: reader._ground(value),
    OwnSkeleton: lambda reader, value: reader._own(value),
    PartDescriptions: lambda _, value: PartDescriptions.from_mapping(value),
    NDArray[np.float32]: lambda reader, value: reader._code(value),
    bool: lambda _, value: value is True,
    int: lambda _, value: read_whole(value),
    float: lambda _, value: read_number(value),
}


@cache
def _forms(kind: Any) -> dict[str, Form]:
    """Return how the fields of a record type are read; cached, as thousands of records are read."""
    longest = math.inf if kind in LONG_TEXTS else MAX_TEXT_CHARACTERS
    return {name: _form(hint, longest) for name, hint in record_fields(kind)}


def _form(hint: Any, longest: float) -> Form:
    if hint is str:
        return lambda _, value: read_text(value, longest)
    if hint in _FORMS:
        return _FORMS[hint]
    origin, inside = typing.get_origin(hint), typing.get_args(hint)
    if origin in (typing.Union, types.UnionType):
        known = _form(next(each for each in inside if each is not type(None)), longest)
        return lambda reader, value: None if value is None else known(reader, value)
    if origin in (tuple, frozenset):
        return _form_of_values(origin, inside, longest)
    if is_dataclass(hint):
        return lambda reader, value: reader._record(hint, value)
    return lambda _, value: hint(value)


def _form_of_values(origin: Any, inside: Any, longest: float) -> Form:
    of_one = len(inside) == 1 or inside[-1] is Ellipsis
    forms = [_form(hint, longest) for hint in inside if hint is not Ellipsis]

    def read(reader: DocumentReader, value: Json) -> Any:
        if not isinstance(value, list) or len(value) > MAX_TAKES:
            raise ValueError("expected a list of some values")
        if inside[0] is Take:
            return origin(reader._sound_takes(value))
        each = forms * len(value) if of_one else forms
        return origin([form(reader, v) for form, v in zip(each, value, strict=True)])

    return read


def read_view(text: str) -> dict[str, Any]:
    """Read the saved view of a session: entries that are text, numbers or booleans; empty if it is invalid."""
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


def checked_record(record: Any) -> Any:
    """Return a record with small defects repaired; ValueError or UsageError if it is invalid for a session."""
    for what, holds in _RULES.get(type(record), ()):
        if not holds(record):
            raise ValueError(what)
    return _MENDED.get(type(record), lambda same: same)(record)


def _numbers(session: Session) -> list[int]:
    return [take.number for take in session.takes]


def _few_edits(take: Take) -> bool:
    return len(take.cameras) <= MAX_KEYS and len(take.path) <= MAX_POINTS


def _on_a_foot(edit: FootplantEdit) -> bool:
    spans = [span for span in (edit.old, edit.new) if span is not None]
    return edit.foot in (0, 1) and all(first < end < MAX_FRAME for first, end in spans)


def _mended_session(session: Session) -> Session:
    """Return the session with its counter at least that of its last take, and a valid selection."""
    numbers = _numbers(session)
    selected = session.selected if session.selected in numbers else LIVE
    return replace(session, counter=max(session.counter, *numbers, 0), selected=selected)


_RULES: dict[Any, tuple[tuple[str, Callable[[Any], bool]], ...]] = {  # error messages and conditions
    Session: (
        ("takes without unique numbers", lambda s: len({LIVE, *_numbers(s)}) == len(s.takes) + 1),
        ("too many variants", lambda s: len(s.variants) <= MAX_VARIANTS),
    ),
    Take: (
        ("a take without a motion", lambda t: t.number == LIVE or t.motion is not None),
        ("too many edits", _few_edits),
        ("a rating", lambda t: 0 <= t.rating <= MAX_RATING),
        ("a frame number", lambda t: 0 <= t.numbered_from <= MAX_FRAMES),
        ("an empty trim", lambda t: t.trim is None or t.trim[0] < t.trim[1]),
    ),
    FootplantEdit: (("an invalid footplant", _on_a_foot),),
    PromptBlend: (
        ("invalid blend weights", lambda b: len(b.weights) == len(PART_NAMES) and all(0.0 <= w <= 1.0 for w in b.weights)),
    ),
    Answer: (("an answer of an unknown source", lambda a: a.source in SOURCES),),
    PromptEvent: (
        ("invalid words", lambda e: not e.words or isinstance(parse_json(e.words), dict)),
        ("a transition that ends before it begins", lambda e: e.transition_seconds >= 0.0),
    ),
    MotionHeader: (
        ("an invalid motion", lambda h: 0.0 < h.fps <= MAX_FPS and h.frames <= MAX_FRAMES and MIN_SIZE <= h.size <= MAX_SIZE),
        ("an invalid placement", lambda h: h.placed is None or len(h.placed) == 4),
    ),
    CharacterChoice: (
        ("an invalid body shape", lambda c: c.shape.check() is None),
        ("files of a character outside their folder", lambda c: not c.key or safe_name(c.key)),
        ("a character of an unknown unit", lambda c: c.unit in ("", *NAMED_UNITS)),
    ),
}  # fmt: skip
_MENDED: dict[Any, Callable[[Any], Any]] = {
    Session: _mended_session,
    PromptBlend: lambda blend: replace(blend, locked=blend.locked & set(PART_NAMES)),
    Answer: lambda answer: replace(answer, nearest=answer.nearest[:MAX_NEAREST]),
}
