"""The input that made a take, as JSON and arrays: sticks, prompts, grounds, restarts and keyframes."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.checked import read_number, read_text, read_whole
from runtime.errors import FileError
from runtime.motion.snapshot import Snapshot
from runtime.motion.style import StyleMix
from runtime.prompts.parts import PartDescriptions
from runtime.safe_read import parse_json, printable
from runtime.session.blobs import REMEDY, BlobReader, BlobWriter, Once
from runtime.session.frames import packed_table, unpacked_table
from runtime.session.prompt_blend import Answer, PromptBlend
from runtime.skeleton import PART_NAMES
from runtime.takes.clip import MAX_DISTANCE_M, MAX_SIZE, MIN_SIZE
from runtime.takes.footplants import MAX_FRAME
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
from runtime.takes.metadata import PromptEvent, event_from
from runtime.terrain.files import MAX_HEIGHT_M
from runtime.terrain.height_map import Terrain
from runtime.terrain.mesh import MAX_SIDE

CODE = (6, 64)
# in memory, about
FRAME_BYTES, STATE_BYTES, CHANGE_BYTES = 8 * COLUMNS, 65_536, 4096
Json = Any
MAX_NEAREST = 20
SOURCES = ("library", "gpt", "explicit")


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


@dataclass
class InputWriter:
    """Packs inputs, prompts and grounds; what several have in common is stored once."""

    blobs: BlobWriter
    once: Once

    def ground(self, terrain: Terrain) -> Json:
        """JSON of a ground."""
        x, z = terrain.origin
        heights = self.once.get("heights", terrain.heights, lambda: self.blobs.array(terrain.heights))
        return {"name": terrain.name, "cell_m": float(terrain.cell_m), "x": float(x), "z": float(z),
                "note": terrain.note, "unit_m": terrain.unit_m, "heights": heights}  # fmt: skip

    def inputs(self, inputs: InputRecording) -> Json:
        """JSON of what drove a take, but for its sticks: see `pack_sticks`."""
        return {
            "changes": [[c.frame, self._change(c)] for c in inputs.changes],
            "keyframes": [[key.frame, self._snapshot(key.snapshot)] for key in inputs.keyframes],
        }

    def _snapshot(self, snapshot: Snapshot) -> str:
        return self.once.get("state", snapshot, lambda: self.blobs.data(snapshot.to_bytes()))

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
            "note": self.prompt(change.note) if isinstance(change.note, PromptBlend) else None,
        }

    def code(self, z: Any) -> Json:
        """JSON of a style code or a mix of codes."""
        if isinstance(z, StyleMix):
            return [self.blobs.array(np.stack(z.codes)), [float(share) for share in z.weights]]
        return self.blobs.array(z)

    def prompt(self, blend: PromptBlend) -> Json:
        """JSON of an answered prompt or a blend of two."""
        answers = [None if answer is None else self._answer(answer) for answer in blend.answers]
        return {"answers": answers, "weights": list(blend.weights), "locked": sorted(blend.locked)}

    def _answer(self, answer: Answer) -> Json:
        return {
            "prompt": answer.prompt,
            "said": answer.said.to_mapping(),
            "words": answer.words.to_mapping(),
            "z": self.blobs.array(answer.z),
            "source": answer.source,
            "nearest": [[text, float(share)] for text, share in answer.nearest],
            "note": answer.note,
        }


@dataclass
class InputReader:
    """Unpacks what an `InputWriter` packed; FileError or a structural error (KeyError, TypeError, ValueError) for what is none."""

    blobs: BlobReader

    def inputs(self, value: Json, frames: InputFrames) -> InputRecording:
        """What drove a take, of JSON and its sticks."""
        keyframes = tuple(self._keyframe(key) for key in value["keyframes"])
        changes = tuple(self._change(change) for change in value["changes"])
        starts = [key.frame for key in keyframes]
        if not starts or starts != sorted(starts) or starts[0] > 0 or len(frames) + starts[0] < 1:
            raise FileError(f"{self.blobs.path}: keyframes that do not fit the take.", REMEDY)
        if starts[-1] >= len(frames) + starts[0]:
            raise FileError(f"{self.blobs.path}: a keyframe after the take's end.", REMEDY)
        return InputRecording(frames, changes, keyframes)

    def _keyframe(self, value: Json) -> Keyframe:
        frame, number = value

        def made() -> Snapshot:
            self.blobs.budget.spend(STATE_BYTES)
            return Snapshot.from_bytes(self.blobs.data(number), f"{self.blobs.path}: keyframe {frame}")

        return Keyframe(read_whole(frame, -MAX_FRAME), self.blobs.once("state", number, made))

    def _change(self, value: Json) -> Change:
        frame, change = value
        return replace(self._read_change(change), frame=read_whole(frame, -MAX_FRAME))

    def _read_change(self, value: Json) -> Change:
        """A change of JSON, as if at frame 0."""
        self.blobs.budget.spend(CHANGE_BYTES)
        if "restart" in value:
            x, z, yaw = (read_number(v, MAX_DISTANCE_M) for v in value["restart"])
            return Restart(0, x, z, yaw)
        if "ground" in value:
            return GroundChange(0, read_text(value["name"]), self.ground(value["ground"]))
        seconds = read_number(value["seconds"], 1e6)
        words = {"prompt": read_text(value["prompt"]), "typed": read_text(value["typed"])}
        checked = event_from({**words, "transition_seconds": value["transition"]})
        event = PromptEvent(
            0.0, checked.prompt, checked.transition_seconds, read_words_text(value["words"]), checked.typed
        )
        note = None if value["note"] is None else self.prompt(value["note"])
        return StyleChange(0, self.code(value["style"]), seconds, event, note)

    def code(self, value: Json) -> Any:
        """A style code, or a mix of codes."""
        if not isinstance(value, list):
            return self._finite(self.blobs.array(value, "<f4", CODE))
        number, shares = value
        codes = self._finite(self.blobs.array(number, "<f4", (len(shares), *CODE)))
        mixed = tuple(read_number(share, 1.0) for share in shares)
        if not mixed or min(mixed) < 0.0 or abs(sum(mixed) - 1.0) > 1e-3:
            raise ValueError("shares of styles that are no mix")
        return StyleMix(mixed, tuple(codes))

    def prompt(self, value: Json) -> PromptBlend:
        """An answered prompt, or a blend of two."""
        a, b = (None if entry is None else self._answer(entry) for entry in value["answers"])
        weights = tuple(read_number(weight, 1.0) for weight in value["weights"])
        if len(weights) != len(PART_NAMES) or min(weights) < 0.0:
            raise ValueError("weights of a blend that are none")
        return PromptBlend((a, b), weights, frozenset(p for p in value["locked"] if p in PART_NAMES))

    def _answer(self, value: Json) -> Answer:
        z = self._finite(self.blobs.array(value["z"], "<f4", CODE))
        nearest = tuple((read_text(text), float(share)) for text, share in value["nearest"][:MAX_NEAREST])
        if value["source"] not in SOURCES:
            raise ValueError("an answer of no known source")
        said, words = (PartDescriptions.from_mapping(value[name]) for name in ("said", "words"))
        return Answer(
            read_text(value["prompt"]), said, words, z, value["source"], nearest, read_text(value["note"])
        )

    def ground(self, value: Json) -> Terrain:
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
        return self.blobs.once(
            "ground",
            json.dumps(value, sort_keys=True),
            lambda: Terrain(name, heights, cell, origin, note, unit),
        )

    def _finite(self, values: Any) -> Any:
        if not (np.abs(values) <= 1e6).all():
            raise FileError(f"{self.blobs.path}: a style that is not finite.", REMEDY)
        return values


def _is_ground(heights: Any) -> bool:
    fits = min(heights.shape) >= 2 and max(heights.shape) <= MAX_SIDE
    return fits and max(-float(heights.min()), float(heights.max())) <= MAX_HEIGHT_M  # nor with NaN


def read_words_text(value: Json) -> str:
    """The JSON text of a prompt's words, or ""."""
    text = read_text(value)
    if text and not isinstance(parse_json(text), dict):
        raise ValueError("words that are none")
    return text
