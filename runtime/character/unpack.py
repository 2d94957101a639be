"""Meshes compressed by Draco or meshopt, unpacked as a document is opened: everything after it sees plain accessors."""

from __future__ import annotations

import importlib
from pathlib import Path
from typing import Any

import numpy as np

from runtime.arrays import AnyArray
from runtime.errors import FileError, SportError
from runtime.safe_read import reason

DRACO = "KHR_draco_mesh_compression"
MESHOPT = ("EXT_meshopt_compression", "KHR_meshopt_compression")
MAX_BYTES = 512 * 1024 * 1024  # of all that is unpacked
_REMEDY = "Export it without mesh compression."
COMPONENTS: dict[int, type] = {  # numpy types of accessors
    5120: np.int8,
    5121: np.uint8,
    5122: np.int16,
    5123: np.uint16,
    5125: np.uint32,
    5126: np.float32,
}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}


def library(name: str, package: str, path: Path, what: str) -> Any:
    """A module that unpacks `what`; FileError says what to install where it is not there."""
    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise FileError(
            f"{path}: {what}, which needs the library {package}.",
            f"Run pip install {package} (or '.[characters]'), or export the character without it.",
        ) from error


def unpack(path: Path, gltf: Any, buffers: list[memoryview]) -> list[memoryview]:
    """Buffers with what was unpacked behind them; the document names plain accessors then. FileError."""
    named = {name for name in gltf.extensionsUsed or [] if isinstance(name, str)}
    if not named & {DRACO, *MESHOPT}:
        return buffers
    try:
        budget = _Budget(path)
        for name in MESHOPT:
            buffers = _meshopt(path, gltf, buffers, name, budget)
        if DRACO in named:
            buffers = _draco(path, gltf, buffers, budget)
    except SportError:
        raise
    except Exception as error:  # two libraries, whose errors share no base class
        raise FileError(f"{path}: its compressed meshes are damaged ({reason(error)}).", _REMEDY) from error
    for field in ("extensionsUsed", "extensionsRequired"):
        if gltf.get(field):
            gltf[field] = [name for name in gltf[field] if name not in (DRACO, *MESHOPT)]
    return buffers


class _Budget:
    """How many bytes may still be unpacked."""

    def __init__(self, path: Path) -> None:
        self._path, self._left = path, MAX_BYTES

    def take(self, size: int) -> None:
        """FileError where it is more than is left, or no size."""
        self._left -= size
        if size < 0 or self._left < 0:
            raise FileError(
                f"{self._path}: its meshes unpack to over {MAX_BYTES >> 20} MB.", "Reduce the mesh."
            )


def _slice(buffers: list[memoryview], entry: Any) -> bytes:
    start, length = entry.byteOffset or 0, entry.byteLength
    data = buffers[entry.buffer or 0]
    if start < 0 or length < 0 or start + length > len(data):
        raise ValueError("a part reaches beyond its buffer")
    return bytes(data[start : start + length])


def _meshopt(
    path: Path, gltf: Any, buffers: list[memoryview], name: str, budget: _Budget
) -> list[memoryview]:
    """Every compressed buffer view decoded into a buffer of its own."""
    made = list(buffers)
    for view in gltf.bufferViews or []:
        packed = (view.extensions or {}).get(name)
        if packed is None:
            continue
        codec = library("meshoptimizer", "meshoptimizer", path, "compressed by meshopt")
        count, stride = int(packed.count), int(packed.byteStride)
        budget.take(count * stride if stride > 0 else -1)
        data = np.frombuffer(_slice(buffers, packed), np.uint8)
        values = _decoded(codec, packed.mode, packed.filter or "NONE", data, count, stride)
        made.append(memoryview(values.tobytes()))
        view["buffer"], view["byteOffset"], view["byteLength"] = len(made) - 1, 0, values.nbytes
        del view["extensions"]
    return made


def _decoded(codec: Any, mode: str, name: str, data: AnyArray, count: int, stride: int) -> AnyArray:
    """The bytes of a buffer view: `mode` and filter are those of the extension."""
    if mode in ("TRIANGLES", "INDICES"):
        decode = codec.decode_index_buffer if mode == "TRIANGLES" else codec.decode_index_sequence
        values: AnyArray = decode(count, 4, data).astype({2: np.uint16, 4: np.uint32}[stride])
        return values
    if mode != "ATTRIBUTES":
        raise ValueError(f"unknown mode {mode[:20]}")
    values = codec.decode_vertex_buffer(count, stride, data).view(np.uint8)
    filters = {
        "OCTAHEDRAL": "decode_filter_oct",
        "QUATERNION": "decode_filter_quat",
        "EXPONENTIAL": "decode_filter_exp",
    }
    return values if name == "NONE" else getattr(codec, filters[name])(values, count, stride)


def _draco(path: Path, gltf: Any, buffers: list[memoryview], budget: _Budget) -> list[memoryview]:
    """The attributes and indices of every compressed primitive as accessors with buffers of their own."""
    made = list(buffers)
    known: dict[int, Any] = {}
    for mesh in gltf.meshes or []:
        for primitive in mesh.primitives:
            packed = (primitive.extensions or {}).get(DRACO)
            if packed is None:
                continue
            if packed.bufferView not in known:
                codec = library("DracoPy", "DracoPy", path, "compressed by Draco")
                known[packed.bufferView] = codec.decode(_slice(buffers, gltf.bufferViews[packed.bufferView]))
            decoded = known[packed.bufferView]
            arrays = {primitive.indices: np.asarray(decoded.faces).reshape(-1, 1)}
            for name, number in packed.attributes.items():
                data = decoded.get_attribute_by_unique_id(int(number))["data"]
                arrays[primitive.attributes[name]] = np.asarray(data)
            for index, values in arrays.items():
                accessor = gltf.accessors[index]
                wanted = values.reshape(-1, _WIDTHS[accessor.type])
                wanted = np.ascontiguousarray(wanted, COMPONENTS[accessor.componentType])
                budget.take(wanted.nbytes)
                made.append(memoryview(wanted.tobytes()))
                gltf.bufferViews.append(
                    type(gltf)(buffer=len(made) - 1, byteOffset=0, byteLength=wanted.nbytes)
                )
                accessor["bufferView"], accessor["byteOffset"] = len(gltf.bufferViews) - 1, 0
                accessor["count"] = len(wanted)
                if accessor.min is not None:
                    accessor["min"], accessor["max"] = (
                        wanted.min(axis=0).tolist(),
                        wanted.max(axis=0).tolist(),
                    )
            del primitive["extensions"][DRACO]
    return made
