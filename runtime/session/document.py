"""A session as JSON text, which refers to contents by their hashes; `document_reader` reads it.

Records are objects of their fields; annotations define how they are read, with every name, kind and length checked.
Grounds, motions, styles and the input of takes have formats of their own.
"""

import json
import typing
from collections.abc import Callable
from dataclasses import dataclass, field, fields, is_dataclass
from enum import Enum
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.edits.request import written_targets
from runtime.motion.snapshot import Snapshot
from runtime.motion.style import StyleMix
from runtime.prompts.parts import PartDescriptions
from runtime.safe_read import printable
from runtime.session.blobs import BlobWriter, Once
from runtime.session.frames import packed_table, unpacked_table
from runtime.session.motion import Motion, MotionHeader
from runtime.session.prompt_blend import Answer, PromptBlend
from runtime.session.session import Ground, Session, Take
from runtime.takes.input_recording import COLUMNS, Change, GroundChange, InputRecording, Restart, are_asked
from runtime.takes.metadata import PromptEvent
from runtime.takes.own_skeleton import OwnSkeleton
from runtime.terrain.height_map import Terrain

MAX_FRAMES = 2_000_000  # per take: nine hours
MAX_TEXT_CHARACTERS = 4096  # characters of a name
MAX_ITEMS = 400_000  # values of one text
Json = Any
_NOT_KEPT = {(PromptBlend, "shares"), (Answer, "milliseconds"), (Answer, "final"), (Answer, "question")}
LONG_TEXTS = (PromptEvent, Answer)  # records whose texts are prompts


@cache
def record_fields(kind: Any) -> tuple[tuple[str, Any], ...]:
    """Return the stored fields of a record with their types."""
    hints = typing.get_type_hints(kind)
    return tuple((f.name, hints[f.name]) for f in fields(kind) if (kind, f.name) not in _NOT_KEPT)


def pack_sticks(rows: NDArray[np.float64]) -> bytes:
    """Return the bytes of stick positions and settings `(T, COLUMNS)`."""
    return packed_table(rows.astype("<f8", copy=False)) if len(rows) else b""


def unpack_sticks(content: bytes, count: int) -> NDArray[np.float64]:
    """Unpack stick positions from `pack_sticks`; ValueError for values that no stick can have."""
    if len(content) != 8 * COLUMNS * count:
        raise ValueError("sticks of another length")
    if not count:
        return np.zeros((0, COLUMNS))
    rows = unpacked_table(content, count, np.dtype("<f8"))
    if not are_asked(rows):
        raise ValueError("invalid stick positions")
    return rows


# --- writing


@dataclass
class DocumentWriter:
    """Writes sessions as text; parts unchanged since the last session are reused, and referenced contents are stored first."""

    put: Callable[[str, bytes], None]
    _once: Once = field(default_factory=Once)
    blobs: BlobWriter = field(init=False)
    _forms: list[tuple[type, Callable[[Any], Json]]] = field(init=False)  # for values other than records

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
        """Return the JSON of a take's input without its stick positions; see `pack_sticks`."""
        return {
            "changes": [[change.frame, self._change(change)] for change in inputs.changes],
            "keyframes": [[key.frame, self._snapshot(key.snapshot)] for key in inputs.keyframes],
        }

    def _record(self, value: Any) -> Json:
        kind: Any = type(value)
        packed = {name: self._value(getattr(value, name)) for name, _ in record_fields(kind)}
        if kind in LONG_TEXTS:
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
    """Return text without characters that could not be read back."""
    return printable(text).replace("\0", "\ufffd")


def header_text(header: MotionHeader, recording: bool = False) -> str:
    """Return the JSON text of a motion's header; `recording` marks an unfinished one."""
    value = DocumentWriter(lambda key, content: None)._record(header)
    return json.dumps(value | {"recording": recording}, ensure_ascii=True)
