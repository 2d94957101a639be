"""A glTF document with one binary buffer, to which arrays are added."""

from __future__ import annotations

import io
import json
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from runtime.arrays import AnyArray
from runtime.atomic import write_atomic
from runtime.character.read import STRUCTURE_ERRORS, Entry, GltfFile
from runtime.character.textures import EXTENSIONS, image_bytes, open_image, texture_source
from runtime.character.unpack import COMPONENTS, WIDTHS
from runtime.safe_read import reason

if TYPE_CHECKING:
    from pygltflib import GLTF2


GENERATOR = "SPORT viewer"  # stored as the file's generator
ARRAY_BUFFER, ELEMENT_BUFFER = 34962, 34963
_COMPONENT_TYPES = {kind: number for number, kind in COMPONENTS.items()}
_ELEMENT_TYPES = {width: name for name, width in WIDTHS.items()}
NAMES_ACCESSORS = {"EXT_mesh_gpu_instancing"}
WEIGHT_SUM_TOLERANCE = 1e-3  # from one: rounding to 8 bits causes as much
_IMAGE_TYPES = {b"\x89PNG": "image/png", b"\xff\xd8\xff": "image/jpeg"}


class GlbBuffer:
    """A glTF document with one binary buffer; `add` appends arrays, `save` writes a GLB."""

    def __init__(self, gltf: GLTF2) -> None:
        self.gltf = gltf
        self._blob = bytearray()

    @staticmethod
    def of_file(file: GltfFile) -> GlbBuffer:
        """Return a file's document, without animations, with all buffers and images packed into one buffer.

        Raises FileError if something is missing or damaged.
        """
        import pygltflib as g

        try:
            gltf = g.GLTF2.gltf_from_json(json.dumps(file.gltf, allow_nan=False))
        except STRUCTURE_ERRORS as error:
            raise file.error(f"damaged glTF document ({reason(error)}).") from error
        gltf.animations = []
        made = GlbBuffer(gltf)
        for index, view in enumerate(gltf.bufferViews):
            held = file.view_bytes(index, f"buffer view {index}")
            view.byteOffset, view.buffer = made._append(held), 0
        made._embed_images(file)
        made._normalise_weights(file)
        return made

    def _embed_images(self, file: GltfFile) -> None:
        """Embed all images in the buffer as PNG or JPEG: many programs lack the extensions for other formats."""
        gltf = self.gltf
        for number, image in enumerate(gltf.images):
            if image.uri is None and image.mimeType in _IMAGE_TYPES.values():
                continue
            data = image_bytes(file, image, f"image {number}")
            kind = next((t for head, t in _IMAGE_TYPES.items() if data.startswith(head)), None)
            if kind is None:
                data, kind = _as_png(data, file, f"image {number}"), "image/png"
            image.mimeType, image.uri, image.bufferView = kind, None, self.add_view(data)
        self._drop_image_extensions(file)

    def _drop_image_extensions(self, file: GltfFile) -> None:
        gltf = self.gltf
        for texture, read in zip(gltf.textures, file.gltf.textures or [], strict=True):
            texture.source = texture_source(read)
            for name in EXTENSIONS:
                (texture.extensions or {}).pop(name, None)
        for names in (gltf.extensionsUsed, gltf.extensionsRequired):
            if names:
                names[:] = [name for name in names if name not in EXTENSIONS]

    def _normalise_weights(self, file: GltfFile) -> None:
        """Replace skin weights that do not add up to one, which are invalid but written by many exporters."""
        done: dict[tuple[int, ...], list[int]] = {}
        for primitive in _primitives(self.gltf):
            fields = vars(primitive.attributes)
            names = [name for name in ("WEIGHTS_0", "WEIGHTS_1") if fields.get(name) is not None]
            old = tuple(fields[name] for name in names)
            if old and old not in done:
                done[old] = self._normalised(file, old)
            fields.update(zip(names, done.get(old, old), strict=True))

    def _normalised(self, file: GltfFile, indices: tuple[int, ...]) -> list[int]:
        """Return accessors of normalised weights: those at `indices` if they already are."""
        sets = [file.values(index, "skin weights").astype(np.float64) for index in indices]
        if any(values.shape != sets[0].shape for values in sets):
            return list(indices)
        total = sum(values.sum(axis=1, keepdims=True) for values in sets)
        if np.all(np.abs(total - 1.0) < WEIGHT_SUM_TOLERANCE) or np.any(total <= 0.0):
            return list(indices)
        return [self.add(values / total, ARRAY_BUFFER) for values in sets]

    def _append(self, data: bytes | memoryview) -> int:
        self._blob.extend(b"\0" * (-len(self._blob) % 4))
        start = len(self._blob)
        self._blob.extend(data)
        return start

    def append(self, field: str, entry: Any) -> int:
        """Append an entry to a list of the document and return its index."""
        entries = getattr(self.gltf, field)
        entries.append(entry)
        return len(entries) - 1

    def add_view(self, data: bytes, target: int | None = None) -> int:
        """Add a buffer view that holds `data` and return its index."""
        import pygltflib as g

        start = self._append(data)
        view = g.BufferView(buffer=0, byteOffset=start, byteLength=len(data), target=target)
        return self.append("bufferViews", view)

    def add(
        self, values: AnyArray, target: int | None = None, *, bounds: bool = False, normalized: bool = False
    ) -> int:
        """Add an accessor that holds `values` `(count, width)` and return its index; floats are written as float32."""
        import pygltflib as g

        values = np.ascontiguousarray(values, np.float32 if values.dtype.kind == "f" else values.dtype)
        accessor = g.Accessor(
            bufferView=self.add_view(values.tobytes(), target),
            componentType=_COMPONENT_TYPES[values.dtype.type],
            count=len(values),
            type=_ELEMENT_TYPES[values.shape[1]],
            normalized=normalized,
        )
        if bounds:
            accessor.min, accessor.max = values.min(axis=0).tolist(), values.max(axis=0).tolist()
        return self.append("accessors", accessor)

    def _drop_unused(self) -> None:
        """Remove accessors and buffer views that are not used, such as those of old animations, and their bytes.

        Nothing is removed if unknown extensions may refer to accessors.
        """
        gltf = self.gltf
        if set(gltf.extensionsUsed or []) & NAMES_ACCESSORS:
            return
        gltf.accessors = _renumbered(gltf.accessors, list(_accessor_references(gltf)))
        gltf.bufferViews = _renumbered(gltf.bufferViews, list(_view_references(gltf)))
        old, self._blob = self._blob, bytearray()
        for view in gltf.bufferViews:
            first = view.byteOffset or 0
            view.byteOffset = self._append(bytes(old[first : first + view.byteLength]))

    def as_file(self, path: Path) -> GltfFile:
        """Return the document as if it had been read from `path`, for writers of other formats."""
        return GltfFile(path, json.loads(self.gltf.to_json(), object_hook=Entry), (memoryview(self._blob),))

    def save(self, path: Path) -> None:
        """Write the GLB completely or not at all; FileError if it cannot be written."""
        write_atomic(path, self.to_bytes())

    def to_bytes(self) -> bytes:
        """Return the document as bytes of a GLB file."""
        import pygltflib as g

        self._drop_unused()
        for accessor in self.gltf.accessors:
            if accessor.bufferView is None:  # zeros, except for sparse values
                accessor.byteOffset = None
        self._blob.extend(b"\0" * (-len(self._blob) % 4))
        self.gltf.buffers = [g.Buffer(byteLength=len(self._blob))]
        self.gltf.set_binary_blob(bytes(self._blob))
        return b"".join(self.gltf.save_to_bytes())


def _as_png(data: bytes, file: GltfFile, what: str) -> bytes:
    """Convert an image of another format to PNG; FileError if it is damaged or too large."""
    from PIL import Image

    out = io.BytesIO()
    try:
        with open_image(data, file, what) as image:
            image.save(out, "PNG")
    except (Image.DecompressionBombError, *STRUCTURE_ERRORS, OSError, SyntaxError, EOFError) as error:
        raise file.error(f"{what} is damaged ({reason(error)}).") from error
    return out.getvalue()


Reference = tuple[dict[str, Any], str]  # an object's fields, and the one that refers to an entry of a list


def _primitives(gltf: GLTF2) -> Iterator[Any]:
    return (primitive for mesh in gltf.meshes or [] for primitive in mesh.primitives)


def _accessor_references(gltf: GLTF2) -> Iterator[Reference]:
    yield from ((vars(skin), "inverseBindMatrices") for skin in gltf.skins)
    for primitive in _primitives(gltf):
        yield vars(primitive), "indices"
        attributes = [vars(primitive.attributes), *(primitive.targets or [])]
        yield from ((named, name) for named in attributes for name in named)
    yield from (
        (vars(s), end) for a in gltf.animations or [] for s in a.samplers for end in ("input", "output")
    )


def _view_references(gltf: GLTF2) -> Iterator[Reference]:
    sparse = [accessor.sparse for accessor in gltf.accessors if accessor.sparse is not None]
    parts = [part for each in sparse for part in (each.indices, each.values)]
    return ((vars(user), "bufferView") for user in (*gltf.accessors, *parts, *(gltf.images or [])))


def _renumbered(entries: list[Any], references: list[Reference]) -> list[Any]:
    """Return the entries that are referred to, and renumber the references."""
    references = [(fields, name) for fields, name in references if isinstance(fields.get(name), int)]
    used = sorted({fields[name] for fields, name in references})
    place = {index: k for k, index in enumerate(used)}
    for fields, name in references:
        fields[name] = place[fields[name]]
    return [entries[index] for index in used]
