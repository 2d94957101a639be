"""Decompresses Draco and meshopt meshes when a document is opened: later code sees plain accessors."""

import io
from pathlib import Path
from typing import Any

import numpy as np

from runtime.arrays import AnyArray
from runtime.character.native import decode
from runtime.errors import FileError
from runtime.safe_read import reason

DRACO = "KHR_draco_mesh_compression"
MESHOPT = ("EXT_meshopt_compression", "KHR_meshopt_compression")
MAX_BYTES = 256 * 1024 * 1024  # of all unpacked data, checked before unpacking
STRIDES = {  # element size by mode and filter: the decoder would write out of bounds for others
    ("ATTRIBUTES", "NONE"): range(4, 257, 4),
    ("ATTRIBUTES", "EXPONENTIAL"): range(4, 257, 4),
    ("ATTRIBUTES", "OCTAHEDRAL"): (4, 8),
    ("ATTRIBUTES", "QUATERNION"): (8,),
    ("TRIANGLES", "NONE"): (2, 4),
    ("INDICES", "NONE"): (2, 4),
}
_REMEDY = "Export it without mesh compression."
# numpy types of accessors
COMPONENTS: dict[int, type] = {
    5120: np.int8, 5121: np.uint8, 5122: np.int16, 5123: np.uint16, 5125: np.uint32, 5126: np.float32,
}  # fmt: skip
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}  # numbers of an element


def unpack(path: Path, gltf: Any, buffers: list[memoryview]) -> list[memoryview]:
    """Decompress Draco and meshopt meshes into appended buffers and point the document's accessors at them. Raises FileError."""
    packed = {DRACO, *MESHOPT}
    if packed.isdisjoint(map(str, gltf.extensionsUsed or [])):
        return buffers
    made = list(buffers)
    try:
        for name in MESHOPT:
            _unpack_meshopt(path, gltf, made, name)
        _unpack_draco(path, gltf, made)
    except (AttributeError, IndexError, KeyError, OverflowError, TypeError, ValueError) as error:
        raise FileError(f"{path}: its compressed meshes are damaged ({reason(error)}).", _REMEDY) from error
    for field in ("extensionsUsed", "extensionsRequired"):
        if gltf.get(field):
            gltf[field] = [name for name in gltf[field] if str(name) not in packed]
    return made


def _check_size(path: Path, size: int) -> None:
    if size > MAX_BYTES:
        raise FileError(f"{path}: its meshes unpack to over {MAX_BYTES >> 20} MB.", "Reduce the mesh.")


def _part(buffers: list[memoryview], entry: Any) -> bytes:
    """Return the bytes of a buffer view, or of its compressed form; ValueError."""
    start, length, buffer = entry.byteOffset or 0, entry.byteLength, entry.buffer or 0
    if not all(type(number) is int and number >= 0 for number in (start, length, buffer)):
        raise ValueError("a part is not where bytes can be")
    if start + length > len(buffers[buffer]):
        raise ValueError("a part reaches beyond its buffer")
    return bytes(buffers[buffer][start : start + length])


def _unpack_meshopt(path: Path, gltf: Any, buffers: list[memoryview], name: str) -> None:
    """Decompress every compressed buffer view into one new buffer."""
    views = [view for view in gltf.bufferViews or [] if (view.extensions or {}).get(name) is not None]
    if not views:
        return
    facts, parts, size = [], [], 0
    for view in views:
        packed = view.extensions[name]
        _check_meshopt(view, packed)
        parts.append(_part(buffers, packed))
        facts.append({"mode": packed.mode, "filter": packed.filter or "NONE", "count": packed.count,
                      "stride": packed.byteStride, "length": len(parts[-1])})  # fmt: skip
        view["buffer"], view["byteOffset"] = len(buffers), size
        size += view.byteLength
        del view["extensions"]
        _check_size(path, size)
    data = decode("meshopt", path, {"views": facts, "size": size}, b"".join(parts), _REMEDY)
    if len(data) != size:
        raise ValueError(f"{len(data)} bytes; expected {size}")
    buffers.append(memoryview(data))


def _check_meshopt(view: Any, packed: Any) -> None:
    """Raise ValueError for what the extension forbids: the decoder trusts its arguments."""
    mode, count, stride = packed.mode, packed.count, packed.byteStride
    strides = STRIDES.get((mode, packed.filter or "NONE"), ())
    if type(stride) is not int or stride not in strides:
        problem = f"mode {str(mode)[:20]}, filter {str(packed.filter)[:20]}, byteStride {str(stride)[:20]}"
        raise ValueError(problem)
    if type(count) is not int or count < 1 or (mode == "TRIANGLES" and count % 3):
        raise ValueError(f"count {str(count)[:20]}")
    if view.byteLength != count * stride:
        raise ValueError("the size of a buffer view does not match its elements")


def _draco_primitives(gltf: Any) -> list[Any]:
    return [p for mesh in gltf.meshes or [] for p in mesh.primitives if DRACO in (p.extensions or {})]


def _unpack_draco(path: Path, gltf: Any, buffers: list[memoryview]) -> None:
    """Decompress the attributes and indices of every compressed primitive into accessors with buffers of their own."""
    primitives = _draco_primitives(gltf)
    if not primitives:
        return
    size, wanted = 0, dict[int, set[int]]()  # four bytes per number; attributes of each buffer view
    for primitive in primitives:
        packed = primitive.extensions[DRACO]
        for k in (primitive.indices, *(primitive.attributes[name] for name in packed.attributes)):
            size += 4 * WIDTHS[gltf.accessors[k].type] * gltf.accessors[k].count
        wanted.setdefault(packed.bufferView, set()).update(map(int, packed.attributes.values()))
    _check_size(path, size)
    parts = {view: _part(buffers, gltf.bufferViews[view]) for view in wanted}
    facts = [{"length": len(part), "attributes": sorted(wanted[view])} for view, part in parts.items()]
    data = decode("draco", path, {"parts": facts, "size": size}, b"".join(parts.values()), _REMEDY)
    _check_size(path, len(data) // 2)  # of 64-bit numbers at most
    with np.load(io.BytesIO(data), allow_pickle=False) as decoded:
        for primitive in primitives:
            packed = primitive.extensions.pop(DRACO)
            part = list(wanted).index(packed.bufferView)
            _set_accessor(gltf, buffers, primitive.indices, decoded[f"{part}.indices"])
            for name, number in packed.attributes.items():
                _set_accessor(gltf, buffers, primitive.attributes[name], decoded[f"{part}.{int(number)}"])


def _set_accessor(gltf: Any, buffers: list[memoryview], index: int, values: AnyArray) -> None:
    """Set the values of an accessor, in a buffer of their own."""
    accessor = gltf.accessors[index]
    values = values.reshape(-1, WIDTHS[accessor.type])
    values = np.ascontiguousarray(values, COMPONENTS[accessor.componentType])
    buffers.append(memoryview(values.tobytes()))
    gltf.bufferViews.append(type(gltf)(buffer=len(buffers) - 1, byteOffset=0, byteLength=values.nbytes))
    accessor["bufferView"], accessor["byteOffset"] = len(gltf.bufferViews) - 1, 0
    accessor["count"] = len(values)
    if accessor.min is not None:
        accessor["min"], accessor["max"] = values.min(axis=0).tolist(), values.max(axis=0).tolist()
