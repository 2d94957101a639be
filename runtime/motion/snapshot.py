"""The whole state of a controller at one frame, so that motion can go on from there again, now or in another session.

A snapshot holds every number that changes from frame to frame: trajectory, phases, style and blend, foot lock, regulator,
noise. What is constant (networks, ground, skeleton, settings) is not in it. The same model, ground, seed and controls
after `restore` give the same frames, bit by bit.
"""

from __future__ import annotations

import io
import json
import math
import zlib
from dataclasses import dataclass, fields, is_dataclass
from typing import Any
from zipfile import BadZipFile, ZipFile

import numpy as np

from runtime.errors import FileError
from runtime.motion.controller import Controller
from runtime.motion.model import Style
from runtime.motion.noise import DriftingNoise
from runtime.motion.style_mix import StyleMix
from runtime.pose import Pose

VERSION = 2
MAX_BYTES = 64 * 1024 * 1024
CONSTANT = {"model", "terrain", "_folder"}  # of the controller: what `restore` leaves as it is
CHANGING: dict[type, tuple[str, ...]] = {DriftingNoise: ("_frame",)}  # where the rest follows from the seed
VALUES = {
    "Style": Style,
    "StyleMix": StyleMix,
    "Pose": Pose,
}  # immutable records of numbers, shared with the controller
RENAMED = {
    "wished_yaw": "requested_yaw",
    "asked_speed": "requested_speed",
}  # attributes that files of earlier releases name otherwise
GONE = {"blocked"}  # attributes of earlier releases that nothing holds any more
REMEDY = "Record the take again with this model."
Tree = dict[str, Any]


@dataclass(frozen=True)
class Snapshot:
    """State of one controller; `tree` holds plain numbers, arrays and nested dictionaries."""

    seed: int
    strength: float
    tree: Tree

    def restore(self, controller: Controller) -> None:
        """Put `controller` into this state; it must have the same model, and stands on its own ground.

        FileError when the state belongs to another version or another model.
        """
        controller.seed, controller.strength = self.seed, self.strength
        controller.reset()  # the noise of this seed
        _put(controller, self.tree, "controller")

    def to_bytes(self) -> bytes:
        """The snapshot as an NPZ without objects; see `from_bytes`."""
        arrays: dict[str, np.ndarray] = {}
        tree = _packed(self.tree, arrays)
        head = json.dumps(
            {"version": VERSION, "seed": self.seed, "strength": self.strength, "tree": tree}
        ).encode()
        buffer = io.BytesIO()
        np.savez_compressed(buffer, head=np.frombuffer(head, np.uint8), **arrays)  # type: ignore[arg-type]
        return buffer.getvalue()

    @staticmethod
    def from_bytes(data: bytes, name: str = "snapshot") -> Snapshot:
        """What `to_bytes` made; FileError, which begins with `name`, when `data` is anything else."""
        if len(data) > MAX_BYTES:
            raise FileError(f"{name}: larger than {MAX_BYTES >> 20} MB.", REMEDY)
        try:
            arrays = _arrays(data)
            head = json.loads(arrays.pop("head").tobytes())
            version, seed, strength = head["version"], int(head["seed"]), float(head["strength"])
            tree = _unpacked(head["tree"], arrays)
        except (
            ValueError,
            KeyError,
            TypeError,
            OSError,
            EOFError,
            IndexError,
            AttributeError,
            RecursionError,
            NotImplementedError,
            RuntimeError,
            OverflowError,
            BadZipFile,
            zlib.error,
        ) as error:
            raise FileError(f"{name}: not the state of a controller.", REMEDY) from error
        if version != VERSION or not isinstance(tree, dict):
            raise FileError(f"{name}: of version {str(version)[:20]}, expected {VERSION}.", REMEDY)
        return Snapshot(seed, strength, tree)


def _arrays(data: bytes) -> dict[str, np.ndarray]:
    """The arrays of an NPZ that unfolds to at most `MAX_BYTES`, whatever its headers say; ValueError for another."""
    arrays, left = {}, MAX_BYTES
    with ZipFile(io.BytesIO(data)) as file:
        for member in file.infolist():
            with file.open(member) as stream:
                content = stream.read(left + 1)
            left -= len(content)
            if left < 0:
                raise ValueError("it unfolds to too much")
            arrays[member.filename.removesuffix(".npy")] = _array(content)
    return arrays


def _array(content: bytes) -> np.ndarray:
    """An NPY whose values are all there."""
    stream = io.BytesIO(content)
    if np.lib.format.read_magic(stream) != (1, 0):
        raise ValueError("an array of another version")
    shape, fortran, kind = np.lib.format.read_array_header_1_0(stream)
    values = content[stream.tell() :]
    if kind.hasobject or kind.names or math.prod(shape) * kind.itemsize != len(values):
        raise ValueError("an array that is cut off")
    return np.frombuffer(values, kind).reshape(shape, order="F" if fortran else "C").copy()


def take_snapshot(controller: Controller) -> Snapshot:
    """The state of `controller` after its last step; later steps do not change it. About 0.1 ms and 40 KB."""
    return Snapshot(controller.seed, controller.strength, _taken(controller))


def _names(owner: object) -> list[str]:
    return [n for n in CHANGING.get(type(owner), tuple(vars(owner))) if n not in CONSTANT]


def _is_ours(value: object) -> bool:
    """An object of the runtime whose attributes change; settings and measures are frozen and do not."""
    frozen = is_dataclass(value) and vars(type(value))["__dataclass_params__"].frozen
    return type(value).__module__.startswith("runtime.") and hasattr(value, "__dict__") and not frozen


def _taken(owner: object) -> Tree:
    tree: Tree = {}
    for name in _names(owner):
        value = getattr(owner, name)
        if isinstance(value, Style | StyleMix | Pose):
            tree[name] = value
        elif isinstance(value, tuple) and value and all(_is_ours(item) for item in value):
            tree[name] = {str(k): _taken(item) for k, item in enumerate(value)}
        elif _is_ours(value):
            tree[name] = _taken(value)
        elif _is_plain(value):
            tree[name] = _copy(value)
    return tree


def _is_plain(value: object) -> bool:
    if isinstance(value, tuple):
        return not hasattr(value, "_fields") and all(_is_plain(item) for item in value)
    return value is None or isinstance(value, bool | int | float | str | np.generic | np.ndarray)


def _copy(value: Any) -> Any:
    return value.copy() if isinstance(value, np.ndarray) else value


def _put(owner: object, tree: Tree, path: str) -> None:
    names = set(_names(owner))
    for name, value in tree.items():
        if name not in names:
            raise FileError(f"state of {path}: has no '{name}'.", REMEDY)
        now = getattr(owner, name)
        if isinstance(value, StyleMix):
            setattr(owner, name, value)  # what it is folded to is checked beside it
        elif isinstance(now, Style | Pose):
            if type(value) is not type(now):
                raise FileError(f"state of {path}.{name}: expected a {type(now).__name__}.", REMEDY)
            for field in fields(now):
                _fitting(getattr(now, field.name), getattr(value, field.name), f"{path}.{name}.{field.name}")
            setattr(owner, name, value)
        elif isinstance(now, tuple) and now and all(_is_ours(item) for item in now):
            for k, item in enumerate(now):
                _put(item, value[str(k)], f"{path}.{name}[{k}]")
        elif _is_ours(now):
            _put(now, value, f"{path}.{name}")
        else:
            setattr(owner, name, _fitting(now, value, f"{path}.{name}"))


def _fitting(now: Any, value: Any, path: str) -> Any:
    """A copy of `value` for the place where `now` is; FileError where an array has another shape."""
    if isinstance(now, np.ndarray) and isinstance(value, np.ndarray):
        if now.shape != value.shape or not np.isfinite(value).all():
            raise FileError(f"state of {path}: shape {value.shape}, expected {now.shape}, finite.", REMEDY)
        return value.astype(now.dtype)
    if isinstance(value, dict) or (value is not None and now is not None and _kind(value) != _kind(now)):
        raise FileError(f"state of {path}: expected {_kind(now)}.", REMEDY)
    return _copy(value)


def _kind(value: Any) -> str:
    if isinstance(value, np.ndarray):
        return "an array"
    if isinstance(value, bool | int | float | np.generic):
        return "a number"
    return "a tuple" if isinstance(value, tuple) else "text" if isinstance(value, str) else "another value"


def _packed(value: Any, arrays: dict[str, np.ndarray]) -> Any:
    """JSON of a tree whose arrays go to `arrays`; tuples are marked, as JSON has none."""
    if isinstance(value, dict):
        return {"d": {k: _packed(v, arrays) for k, v in value.items()}}
    if type(value).__name__ in VALUES:
        return {
            type(value).__name__: {f.name: _packed(getattr(value, f.name), arrays) for f in fields(value)}
        }
    if isinstance(value, np.ndarray):
        name = f"a{len(arrays)}"
        arrays[name] = value
        return {"a": name}
    if isinstance(value, tuple):
        return {"t": [_packed(v, arrays) for v in value]}
    return value.item() if isinstance(value, np.generic) else value


def _unpacked(value: Any, arrays: dict[str, np.ndarray]) -> Any:
    if not isinstance(value, dict):
        return value
    if "d" in value:
        return {RENAMED.get(k, k): _unpacked(v, arrays) for k, v in value["d"].items() if k not in GONE}
    if "t" in value:
        return tuple(_unpacked(v, arrays) for v in value["t"])
    for name, record in VALUES.items():
        if name in value:
            return record(**{k: _unpacked(v, arrays) for k, v in value[name].items()})
    return arrays[value["a"]]
