"""Reads glTF containers and accessors with limits on everything; damage raises a FileError."""

import base64
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np

from runtime.arrays import AnyArray
from runtime.character.native import HEADS, fbx_as_glb
from runtime.character.unpack import COMPONENTS, MESHOPT, WIDTHS, unpack
from runtime.errors import FileError
from runtime.safe_read import parse_json, read_bounded, reason

SUFFIXES = (".glb", ".gltf", ".vrm", ".fbx")  # of characters; a VRM is a GLB; an FBX is converted to one
MOTIONS = (".bvh", *SUFFIXES, ".vrma")
MAX_FILE_BYTES = 256 * 1024 * 1024
MAX_VALUE = 1e9  # of any coordinate or matrix element
MAX_ENTRIES = 20_000  # per list of the document
MAX_PRIMITIVES = 4096
MAX_SPARSE = 2_000_000  # elements of an accessor without bytes
REMEDY = "Export it again as glTF binary (.glb), or choose another file."
_LISTS = (
    "accessors", "animations", "buffers", "bufferViews", "images", "materials", "meshes", "nodes", "skins", "textures",
)  # fmt: skip
# exceptions of numpy and attribute access for JSON of the wrong shape or values out of range
STRUCTURE_ERRORS = (
    KeyError, TypeError, ValueError, IndexError, AttributeError, AssertionError, OverflowError, RecursionError,
    struct.error, np.linalg.LinAlgError,
)  # fmt: skip


class Entry(dict[str, Any]):
    """A JSON object of the document; missing fields read as None.

    It parses a document of thousands of nodes in milliseconds, where one class per glTF type takes seconds.
    """

    def __getattr__(self, field: str) -> Any:
        return self.get(field)


@dataclass(frozen=True)
class GltfFile:
    """A parsed glTF document with its buffers."""

    path: Path
    gltf: Entry
    buffers: tuple[memoryview, ...]

    def error(self, problem: str, remedy: str = REMEDY) -> FileError:
        """Return an error that names the file."""
        return FileError(f"{self.path}: {problem}", remedy)

    def view_bytes(self, index: Any, what: str) -> memoryview:
        """Return the bytes of a buffer view; `what` names it in error messages."""
        views = self.gltf.bufferViews or []
        if not isinstance(index, int) or not 0 <= index < len(views):
            raise self.error(f"the buffer view of {what} is missing.")
        view = views[index]
        start, length = view.byteOffset or 0, view.byteLength
        whole = all(isinstance(number, int) for number in (view.buffer, start, length))
        if not whole or view.buffer not in range(len(self.buffers)):
            raise self.error(f"the buffer of {what} is missing.")
        data = self.buffers[view.buffer]
        if not 0 <= start <= start + length <= len(data):
            raise self.error(f"{what} reaches beyond its buffer.")
        return data[start : start + length]

    def count(self, index: Any) -> int:
        """Return the declared element count of an accessor; 0 if it is missing or damaged."""
        accessor = self._accessor(index)
        count = 0 if accessor is None else accessor.count
        return count if isinstance(count, int) and count > 0 else 0

    def values(self, index: Any, what: str) -> AnyArray:
        """Read the values `(count, width)` of an accessor; normalised integers become float32; `what` names it in error messages."""
        accessor = self._accessor(index)
        if accessor is None:
            raise self.error(f"the accessor for {what} is missing.")
        if accessor.componentType not in COMPONENTS or accessor.type not in WIDTHS:
            raise self.error(f"{what} has an unknown component or element type.")
        values = (_accessor_values if accessor.sparse is None else _sparse_values)(self, accessor, what)
        if values.dtype.kind == "f" and not np.all(np.abs(values) < MAX_VALUE):
            raise self.error(f"{what} holds values that are not finite or above {MAX_VALUE:.0e}.")
        if accessor.normalized and values.dtype.kind in "iu":
            return np.maximum(values.astype(np.float32) / np.iinfo(values.dtype).max, -1.0)
        return values

    def _accessor(self, index: Any) -> Entry | None:
        accessors = self.gltf.accessors or []
        return accessors[index] if isinstance(index, int) and 0 <= index < len(accessors) else None


def open_gltf(path: Path, motion: bool = False) -> GltfFile:
    """Read a .glb, .gltf or .fbx with its buffers, decompressed; `motion` includes the animations of an FBX.

    Raises FileError if it is missing, too large or damaged.
    """
    data = _read(path)
    if data.startswith(HEADS):
        data = fbx_as_glb(path, motion)
    if data[:4] == b"glTF":
        text, blob = _chunks(data, path)
    elif data.lstrip()[:1] == b"{" or data[:3] == b"\xef\xbb\xbf":
        text, blob = data, memoryview(b"")
    else:
        raise FileError(f"{path}: neither a binary nor a JSON glTF file, nor an FBX.", REMEDY)
    try:
        gltf = parse_json(text, kind=Entry)
    except ValueError as error:
        raise FileError(f"{path}: damaged glTF container ({reason(error)}).", REMEDY) from error
    if not isinstance(gltf, Entry):
        raise FileError(f"{path}: the glTF container holds no document.", REMEDY)
    _check_document(gltf, path)
    buffers, total = list[memoryview](), 0
    for i, buffer in enumerate(gltf.buffers or []):
        buffers.append(_buffer(path, buffer, i, blob))
        total += len(buffers[-1])
        if total > MAX_FILE_BYTES:
            raise FileError(f"{path}: its buffers are larger than {MAX_FILE_BYTES >> 20} MB.", REMEDY)
    return GltfFile(path, gltf, tuple(unpack(path, gltf, buffers)))


def _read(path: Path) -> bytes:
    return read_bounded(path, MAX_FILE_BYTES, "Reduce the mesh or its textures.")


def _chunks(data: bytes, path: Path) -> tuple[bytes, memoryview]:
    """Return the JSON text and the binary chunk of a .glb."""
    if len(data) < 20:
        raise FileError(f"{path}: damaged glTF container (too short).", REMEDY)
    version, length, size, kind = struct.unpack("<III4s", data[4:20])
    if version != 2:
        raise FileError(f"{path}: glTF version {version}; expected 2.", REMEDY)
    if length > len(data):
        problem = f"{path}: cut off, {len(data)} of {length} bytes are there."
        raise FileError(problem, "Copy or export the file again.")
    if kind != b"JSON" or 20 + size > length:
        raise FileError(f"{path}: damaged glTF container (no JSON chunk).", REMEDY)
    at = 20 + size
    blob = memoryview(b"")
    while at + 8 <= length:
        size, kind = struct.unpack("<I4s", data[at : at + 8])
        at += 8
        if kind == b"BIN\0":
            blob = memoryview(data)[at : min(at + size, length)]
            break
        at += size
    return data[20 : 20 + struct.unpack("<I", data[12:16])[0]], blob


def _check_document(gltf: Entry, path: Path) -> None:
    """Raise FileError unless the document consists of lists of objects of a reasonable number."""
    for field in ("extensionsUsed", "extensionsRequired"):
        if not isinstance(gltf.get(field) or [], list):
            raise FileError(f"{path}: its list of {field} is damaged.", REMEDY)
    for field in _LISTS:
        entries = gltf.get(field) or []
        if not isinstance(entries, list) or not all(isinstance(entry, Entry) for entry in entries):
            raise FileError(f"{path}: its list of {field} is damaged.", REMEDY)
        if len(entries) > MAX_ENTRIES:
            raise FileError(f"{path}: {len(entries)} {field}; expected at most {MAX_ENTRIES}.", REMEDY)


def _buffer(path: Path, buffer: Entry, number: int, blob: memoryview) -> memoryview:
    """Return the bytes of a buffer: from its URI, else the `blob` of the GLB."""
    data = memoryview(read_uri(path, buffer.uri, "buffer")) if buffer.uri else blob
    packed = not buffer.uri and any((buffer.extensions or {}).get(name) for name in MESHOPT)
    if number and packed:  # a placeholder buffer for readers that do not support compression
        return memoryview(b"")
    if not isinstance(buffer.byteLength, int) or not 0 <= buffer.byteLength <= len(data):
        wanted = str(buffer.byteLength)[:40]
        raise FileError(f"{path}: buffer {number} has {len(data)} bytes; expected {wanted}.", REMEDY)
    return data


def read_uri(path: Path, uri: Any, what: str) -> bytes:
    """Return the bytes at a URI in the file `path`: embedded base64, or a file next to it. FileError otherwise."""
    if not isinstance(uri, str):
        raise FileError(f"{path}: the address of a {what} is damaged.", REMEDY)
    if not uri.startswith("data:"):
        return _read_sibling(path, unquote(uri), what)
    try:
        return base64.b64decode(uri.partition(",")[2])
    except ValueError as error:
        raise FileError(f"{path}: an embedded {what} is damaged ({reason(error)}).", REMEDY) from error


def _read_sibling(path: Path, uri: str, what: str) -> bytes:
    """Return the bytes of a file that `path` refers to; FileError if it is missing or outside the folder of `path`."""
    try:
        target = (path.parent / uri).resolve()
        inside, there = target.is_relative_to(path.parent.resolve()), target.is_file()
    except (OSError, ValueError, RuntimeError):  # too long, a zero byte, a cycle of links
        inside, there = True, False
    if not inside:
        raise FileError(f"{path}: {what} {uri[:80]!r} lies outside the file's folder.", REMEDY)
    if not there:
        problem = f"{path}: its {what} file {uri[:80]!r} is missing."
        raise FileError(problem, "Put it next to the .gltf file, or export as one .glb file.")
    return _read(target)


def _accessor_values(file: GltfFile, accessor: Entry, what: str) -> AnyArray:
    dtype = np.dtype(COMPONENTS[accessor.componentType]).newbyteorder("<")
    width, count = WIDTHS[accessor.type], accessor.count
    if not isinstance(count, int) or count < 1:
        raise file.error(f"{what} has {str(count)[:40]} elements; expected at least 1.")
    data = file.view_bytes(accessor.bufferView, what)
    size = dtype.itemsize * width
    stride = file.gltf.bufferViews[accessor.bufferView].byteStride or size
    offset = accessor.byteOffset or 0
    if offset < 0 or stride < size or offset + stride * (count - 1) + size > len(data):
        raise file.error(f"{what} reaches beyond its buffer view.")
    values: AnyArray = np.ndarray((count, width), dtype, data, offset, (stride, dtype.itemsize))
    return np.ascontiguousarray(values)


def _sparse_values(file: GltfFile, accessor: Entry, what: str) -> AnyArray:
    """Return the values of a sparse accessor, which replaces some of its base values, or of zeros."""
    count, kind = accessor.count, COMPONENTS[accessor.componentType]
    if accessor.bufferView is not None:
        values = _accessor_values(file, accessor, what).copy()
    elif isinstance(count, int) and 0 < count <= MAX_SPARSE:
        values = np.zeros((count, WIDTHS[accessor.type]), np.dtype(kind).newbyteorder("<"))
    else:
        raise file.error(f"{what} has {str(count)[:40]} elements; expected 1 to {MAX_SPARSE}.")
    sparse = accessor.sparse
    rows, others = (
        _accessor_values(file, Entry(part | {"type": accessor.type} | form, count=sparse.count), what)
        for part, form in (
            (sparse.indices, {"type": "SCALAR"}),
            (sparse["values"], {"componentType": accessor.componentType}),
        )
    )
    if rows.dtype.kind != "u" or rows.max() >= len(values):
        raise file.error(f"{what} has sparse values beyond its {len(values)} elements.")
    values[rows[:, 0]] = others
    return values
