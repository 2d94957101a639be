"""The complete state of a controller at one frame, to resume the motion from there, now or in another session.

States are immutable, so that a snapshot is the state itself. Its file format is that of `runtime.records`: the fields of
`CharacterState` as JSON and arrays, each checked. The same model, ground, seed and controls after `restore` give
the same frames, bit by bit.
"""

from __future__ import annotations

import io
import json
import math
import zlib
from dataclasses import dataclass, replace
from typing import Any
from zipfile import BadZipFile, ZipFile

import numpy as np

from runtime.checked import read_number
from runtime.edits.body import BodyEdits
from runtime.edits.request import checked_targets, written_targets
from runtime.errors import FileError, ModelError
from runtime.motion.controller import Controller
from runtime.motion.mirror import LIMBS
from runtime.motion.state import CharacterState
from runtime.motion.style import Style, StyleCodes, StyleMix
from runtime.motion.swing import MAX_GAIN, SWINGS
from runtime.records import REMEDY, copied, read_record, write_record
from runtime.traversal.traversal import is_possible

VERSION = 8
MAX_BYTES = 16 * 1024 * 1024  # a folded style has 2 MB
MAX_MIX_CODES, MAX_MIX_WEIGHT, MAX_CODE_VALUE = 64, 64.0, 1e4
MAX_BLEND_S, MAX_STRENGTH_RATIO, MAX_SPEED_M_PER_S = 1e6, 16.0, 100.0
# exceptions of zipfile, json and numpy for damaged bytes
DAMAGES = (
    ValueError, KeyError, TypeError, OSError, EOFError, IndexError, AttributeError, RecursionError, NotImplementedError,
    RuntimeError, OverflowError, MemoryError, BadZipFile, zlib.error,
)  # fmt: skip
FOLDED_FIELDS = ("z", "front_bias", "content_weight", "content_bias", "rest")


@dataclass(frozen=True, eq=False)
class Snapshot:
    """State of one controller without its `styles`, and the codes from which its style is folded."""

    state: CharacterState
    codes: StyleCodes

    def restore(self, controller: Controller) -> None:
        """Restore this state into `controller`, which must have the same model and keeps its terrain.

        Raises FileError if the state belongs to another model.
        """
        start = self.codes.start
        try:
            if isinstance(start, Style) and any(
                getattr(start, name).shape != getattr(controller.style, name).shape for name in FOLDED_FIELDS
            ):
                raise FileError("state of a controller: a style of another model.", REMEDY)
            controller.put(self.state, self.codes)
        except ModelError as error:
            raise FileError(f"state of a controller: {error.problem}", REMEDY) from error

    def to_bytes(self) -> bytes:
        """Return the snapshot as NPZ bytes without pickled objects; see `from_bytes`."""
        arrays: list[np.ndarray] = []
        codes = self.codes
        style = {
            "start": _written(codes.start, arrays),
            "goal": _written(codes.goal, arrays),
            "seconds": codes.seconds,
            "progress": codes.progress,
            "strength": codes.strength,
        }
        tree = {"version": VERSION, "style": style, "state": write_record(self.state, arrays)}
        buffer = io.BytesIO()
        named = {f"a{k}": array for k, array in enumerate(arrays)}
        np.savez_compressed(buffer, head=np.frombuffer(json.dumps(tree).encode(), np.uint8), **named)  # type: ignore[arg-type]
        return buffer.getvalue()

    @staticmethod
    def from_bytes(data: bytes, name: str = "snapshot") -> Snapshot:
        """Read a snapshot written by `to_bytes`; raises a FileError beginning with `name` for anything else."""
        if len(data) > MAX_BYTES:
            raise FileError(f"{name}: larger than {MAX_BYTES >> 20} MB.", REMEDY)
        try:
            named = _arrays(data)
            tree = json.loads(named.pop("head").tobytes())
            version = tree["version"]
            if version == VERSION:
                arrays = [named[f"a{k}"] for k in range(len(named))]
                codes = _codes(tree["style"], arrays)
                state = read_record(CharacterState, _with_edits(tree["state"]), arrays, name)
                if not _is_one_character(state):
                    raise ValueError("not one character")
                return Snapshot(state, codes)
        except DAMAGES as error:
            raise FileError(f"{name}: not the state of a controller.", REMEDY) from error
        raise FileError(f"{name}: of version {str(version)[:20]}, expected {VERSION}.", REMEDY)


def _with_edits(tree: Any) -> Any:
    """Return the state of a file in which edits were stored with the feet: they restart."""
    if "edits" in tree:
        return tree
    feet = [
        {name: value for name, value in each.items() if name not in ("edit", "trunk")}
        for each in tree["feet"]
    ]
    return tree | {"feet": feet, "edits": [write_record(BodyEdits(), [])]}


def _is_one_character(state: CharacterState) -> bool:
    """Whether a state read from a file is valid for one character."""
    if {len(state.feet), len(state.edits), len(state.traversals), len(state.jumps)} != {1} or state.styles:
        return False
    numbers = bool(state.seed[0] >= 0 and state.frame[0] >= 0)
    return numbers and state.jumps[0].is_possible and is_possible(state.traversals[0])


def take_snapshot(controller: Controller) -> Snapshot:
    """Return the state of `controller` after its last step; later steps do not change it."""
    (blend,) = controller.state.styles
    state = copied(controller.state)
    state.styles = ()
    return Snapshot(state, blend.codes)


def _written(style: StyleMix | Style, arrays: list[np.ndarray]) -> dict[str, Any]:
    if isinstance(style, Style):
        return write_record(style, arrays)
    arrays.append(np.stack(style.codes))
    return {"codes": len(arrays) - 1, "weights": list(style.weights), "edits": written_targets(style.edits)}


def _codes(tree: Any, arrays: list[np.ndarray]) -> StyleCodes:
    limits = (("seconds", MAX_BLEND_S), ("progress", 1.0), ("strength", MAX_STRENGTH_RATIO))
    numbers = [read_number(tree[name], most) for name, most in limits]
    if (numbers[1] < 1.0 and numbers[0] <= 0.0) or numbers[1] < 0.0:
        raise ValueError("a blend without duration")
    start = tree["start"]
    begun = _mix(start, arrays) if "codes" in start else _folded(start, arrays)
    return StyleCodes(begun, _mix(tree["goal"], arrays), *numbers)


def _folded(tree: Any, arrays: list[np.ndarray]) -> Style:
    """Return a folded style; whether its shapes fit the model is checked by `restore`."""
    folded = [arrays[int(tree[name])] for name in FOLDED_FIELDS]
    if any(array.dtype != np.float32 or not (np.abs(array) <= MAX_CODE_VALUE).all() for array in folded):
        raise ValueError("invalid style weights")
    z, front_bias, content_weight, content_bias, rest = folded
    walk, jog = (read_number(tree[name], MAX_SPEED_M_PER_S) for name in ("walk_speed", "jog_speed"))
    edits = checked_targets(arrays[int(_edits(tree))])
    made = Style(z, front_bias, content_weight, content_bias, walk, jog, rest, edits)
    if "swings" in tree:
        made = replace(made, swings=_gains(tree["swings"]))
    if tree.get("opposite") is None:
        return replace(made, mirrored=tree.get("mirrored") is True)
    opposite = _folded(tree["opposite"] | {"opposite": None}, arrays)
    limbs = tuple(read_number(fraction, MAX_MIX_WEIGHT) for fraction in tree["limbs"])
    if len(limbs) != LIMBS:
        raise ValueError("invalid limb weights")
    return replace(made, mirrored=tree["mirrored"] is True, opposite=opposite, limbs=limbs)


def _gains(values: Any) -> tuple[float, ...]:
    gains = tuple(read_number(value, MAX_GAIN) for value in values)
    if len(gains) != len(SWINGS):
        raise ValueError("invalid swing gains")
    return gains


def _edits(tree: Any) -> Any:
    return tree["edits"] if "edits" in tree else tree["legs"]  # the field's name in files without a trunk


def _mix(tree: Any, arrays: list[np.ndarray]) -> StyleMix:
    codes = arrays[int(tree["codes"])]
    fractions = [read_number(fraction, MAX_MIX_WEIGHT) for fraction in tree["weights"]]
    fits = codes.dtype == np.float32 and codes.ndim == 3 and len(codes) == len(fractions)
    if not fits or not 1 <= len(codes) <= MAX_MIX_CODES or not (np.abs(codes) <= MAX_CODE_VALUE).all():
        raise ValueError("invalid style codes")
    return StyleMix(tuple(fractions), tuple(codes), checked_targets(_edits(tree)))


def _arrays(data: bytes) -> dict[str, np.ndarray]:
    """Return the arrays of an NPZ that unpacks to at most `MAX_BYTES`, whatever its headers say; ValueError otherwise."""
    arrays, left = {}, MAX_BYTES
    with ZipFile(io.BytesIO(data)) as file:
        for member in file.infolist():
            with file.open(member) as stream:
                content = stream.read(left + 1)
            left -= len(content)
            if left < 0:
                raise ValueError("too large when unpacked")
            arrays[member.filename.removesuffix(".npy")] = _array(content)
    return arrays


def _array(content: bytes) -> np.ndarray:
    """Return the array of a complete NPY; ValueError if it is truncated."""
    stream = io.BytesIO(content)
    if np.lib.format.read_magic(stream) != (1, 0):
        raise ValueError("an array of another version")
    shape, fortran, kind = np.lib.format.read_array_header_1_0(stream)
    values = content[stream.tell() :]
    if kind.hasobject or kind.names or math.prod(shape) * kind.itemsize != len(values):
        raise ValueError("a truncated array")
    return np.frombuffer(values, kind).reshape(shape, order="F" if fortran else "C").copy()
