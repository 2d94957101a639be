"""glTF container and accessor reading with bounds on everything; turns what pygltflib raises into FileError."""

from __future__ import annotations

import struct
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import unquote

import numpy as np
from numpy.typing import NDArray
from sport.runtime.errors import FileError

if TYPE_CHECKING:
    from pygltflib import GLTF2, Accessor

Array = NDArray[Any]

MAX_FILE_BYTES = 256 * 1024 * 1024
MAX_VALUE = 1e9  # of any coordinate or matrix element
REMEDY = (
    "Export the character again as glTF binary (.glb) with mesh, skin and skeleton, or choose another file."
)
_COMPONENTS: dict[int, type] = {
    5120: np.int8,
    5121: np.uint8,
    5122: np.int16,
    5123: np.uint16,
    5125: np.uint32,
    5126: np.float32,
}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}
_COMPRESSION = {"KHR_draco_mesh_compression", "EXT_meshopt_compression"}
# what dataclass decoding and numpy raise on JSON of the wrong shape or values out of range
STRUCTURE_ERRORS = (
    KeyError,
    TypeError,
    ValueError,
    IndexError,
    AttributeError,
    AssertionError,
    OverflowError,
    RecursionError,
    struct.error,
    np.linalg.LinAlgError,
)


@dataclass(frozen=True)
class GltfFile:
    """A parsed glTF and its buffers."""

    path: Path
    gltf: GLTF2
    buffers: tuple[bytes, ...]

    @property
    def name(self) -> str:
        """What error messages call the file."""
        return str(self.path)


def open_gltf(path: Path) -> GltfFile:
    """Read a .glb or .gltf with its buffers; FileError when it is missing, too large, damaged or compressed."""
    from pygltflib import GLTF2, Buffer

    data = _read_bounded(path)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            if data[:4] == b"glTF":
                _check_header(data, path)
                gltf = GLTF2.load_from_bytes(data)
            elif data.lstrip()[:1] == b"{":
                gltf = GLTF2.gltf_from_json(data.decode("utf-8"))
            else:
                raise FileError(f"{path}: neither a binary nor a JSON glTF file.", REMEDY)
    except (*STRUCTURE_ERRORS, OSError, Warning) as error:
        raise FileError(f"{path}: damaged glTF container ({_short(error)}).", REMEDY) from error
    if gltf is None:
        raise FileError(f"{path}: the glTF container holds no JSON chunk.", REMEDY)
    used = _COMPRESSION & set(gltf.extensionsRequired or [])
    if used:
        raise FileError(
            f"{path}: compressed with {', '.join(sorted(used))}.", "Export it without mesh compression."
        )
    if any(not isinstance(item, Buffer) for item in gltf.buffers or []):
        raise FileError(f"{path}: its list of buffers is damaged.", REMEDY)
    return GltfFile(path, gltf, _load_buffers(path, gltf))


def _short(error: BaseException) -> str:
    return f"{type(error).__name__}: {error}"[:160]


def _read_bounded(path: Path) -> bytes:
    try:
        size = path.stat().st_size
        if size > MAX_FILE_BYTES:
            raise FileError(
                f"{path}: {size >> 20} MB; a character may have at most {MAX_FILE_BYTES >> 20} MB.",
                "Reduce the mesh or its textures.",
            )
        return path.read_bytes()
    except OSError as error:
        raise FileError(f"{path}: {error.strerror or error}.", "Check the path.") from error


def _check_header(data: bytes, path: Path) -> None:
    version, length = struct.unpack("<II", data[4:12])
    if version != 2:
        raise FileError(f"{path}: glTF version {version}; expected 2.", REMEDY)
    if length > len(data):
        raise FileError(
            f"{path}: cut off, {len(data)} of {length} bytes are there.", "Copy or export the file again."
        )


def _load_buffers(path: Path, gltf: GLTF2) -> tuple[bytes, ...]:
    buffers = []
    for i, buffer in enumerate(gltf.buffers or []):
        uri = buffer.uri
        if not uri:
            data = gltf.binary_blob() or b""
        elif uri.startswith("data:"):
            try:
                data = gltf.decode_data_uri(uri)
            except STRUCTURE_ERRORS as error:
                raise FileError(f"{path}: buffer {i} is damaged ({_short(error)}).", REMEDY) from error
        else:
            data = read_sibling(path, unquote(uri), "buffer")
        if len(data) < (buffer.byteLength or 0):
            raise FileError(
                f"{path}: buffer {i} has {len(data)} bytes; expected {buffer.byteLength}.", REMEDY
            )
        buffers.append(bytes(data))
    return tuple(buffers)


def read_sibling(path: Path, uri: str, what: str) -> bytes:
    """Bytes of a file that `path` refers to; FileError when it is missing or outside the folder of `path`."""
    target = (path.parent / uri).resolve()
    if not target.is_relative_to(path.parent.resolve()):
        raise FileError(f"{path}: {what} {uri[:80]!r} lies outside the file's folder.", REMEDY)
    if not target.is_file():
        raise FileError(
            f"{path}: its {what} file {uri[:80]!r} is missing.",
            "Put it beside the .gltf file, or export as one .glb file.",
        )
    return _read_bounded(target)


def buffer_view_bytes(file: GltfFile, index: int, what: str) -> bytes:
    """The bytes of a buffer view; `what` stands in error messages."""
    views = file.gltf.bufferViews or []
    if index is None or not 0 <= index < len(views):
        raise FileError(f"{file.name}: the buffer view of {what} is missing.", REMEDY)
    view = views[index]
    start, length = view.byteOffset or 0, view.byteLength
    if not 0 <= view.buffer < len(file.buffers):
        raise FileError(f"{file.name}: the buffer of {what} is missing.", REMEDY)
    data = file.buffers[view.buffer]
    if start < 0 or length < 0 or start + length > len(data):
        raise FileError(f"{file.name}: {what} reaches beyond its buffer.", REMEDY)
    return data[start : start + length]


def read_accessor(file: GltfFile, index: int | None, what: str) -> Array:
    """Values `(count, width)` of an accessor, normalised integers as float32; `what` stands in error messages."""
    accessors = file.gltf.accessors or []
    if index is None or not 0 <= index < len(accessors):
        raise FileError(f"{file.name}: the accessor for {what} is missing.", REMEDY)
    accessor = accessors[index]
    if accessor.componentType not in _COMPONENTS or accessor.type not in _WIDTHS:
        raise FileError(f"{file.name}: {what} has an unknown component or element type.", REMEDY)
    if accessor.sparse is not None:
        raise FileError(
            f"{file.name}: {what} is a sparse accessor.", "Export the character without sparse accessors."
        )
    values = _accessor_values(file, accessor, what)
    if accessor.componentType == 5126 and not np.all(np.abs(values) < MAX_VALUE):
        raise FileError(
            f"{file.name}: {what} holds values that are not finite or above {MAX_VALUE:.0e}.", REMEDY
        )
    if accessor.normalized and values.dtype.kind in "iu":
        return np.maximum(values.astype(np.float32) / np.iinfo(values.dtype).max, -1.0)
    return values


def _accessor_values(file: GltfFile, accessor: Accessor, what: str) -> Array:
    dtype = np.dtype(_COMPONENTS[accessor.componentType]).newbyteorder("<")
    width, count = _WIDTHS[accessor.type], accessor.count
    if not isinstance(count, int) or count < 1:
        raise FileError(f"{file.name}: {what} has {count} elements; expected at least 1.", REMEDY)
    data = buffer_view_bytes(file, accessor.bufferView, what)
    size = dtype.itemsize * width
    stride = file.gltf.bufferViews[accessor.bufferView].byteStride or size
    offset = accessor.byteOffset or 0
    end = offset + stride * (count - 1) + size
    if offset < 0 or stride < size or end > len(data):
        raise FileError(f"{file.name}: {what} reaches beyond its buffer view.", REMEDY)
    block = np.frombuffer(data, np.uint8, end - offset, offset)
    rows = np.lib.stride_tricks.as_strided(block, (count, size), (stride, 1), writeable=False)
    return np.ascontiguousarray(rows).view(dtype).reshape(count, width)
