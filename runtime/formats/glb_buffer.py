"""A glTF document with one binary buffer to which arrays are added."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from runtime.atomic import write_atomic
from runtime.character.read import (
    REMEDY,
    STRUCTURE_ERRORS,
    GltfFile,
    buffer_view_bytes,
    read_accessor,
    read_uri,
)
from runtime.errors import FileError
from runtime.safe_read import reason

if TYPE_CHECKING:
    from pygltflib import GLTF2

Array = NDArray[Any]

ARRAY_BUFFER, ELEMENT_BUFFER = 34962, 34963
_COMPONENT_TYPES = {"uint8": 5121, "uint16": 5123, "uint32": 5125, "float32": 5126}
_ELEMENT_TYPES = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4", 16: "MAT4"}
WEIGHT_ERROR = 1e-3  # of their sum: 8 bits round by as much
_IMAGE_TYPES = {b"\x89PNG": "image/png", b"\xff\xd8\xff": "image/jpeg"}


class GlbBuffer:
    """A document and the bytes of its only buffer; `add` appends arrays, `save` writes a GLB."""

    def __init__(self, gltf: GLTF2) -> None:
        self.gltf = gltf
        self._blob = bytearray()

    @staticmethod
    def of_file(file: GltfFile) -> GlbBuffer:
        """The document of a file with all its buffers and images inside one buffer, without its animations.

        FileError when something is missing or damaged.
        """
        gltf, dead = _document(file)
        made = GlbBuffer(gltf)
        for index, view in enumerate(gltf.bufferViews):
            data: bytes | memoryview = b"\0" * 4
            if index in dead:
                view.byteLength, view.byteStride = len(data), None
            else:
                data = buffer_view_bytes(file, index, f"buffer view {index}")
            view.byteOffset, view.buffer = made._append(data), 0
        for image in gltf.images:
            if image.uri is None:
                continue
            data = read_uri(file.path, image.uri, "image")
            image.mimeType = next(
                (t for head, t in _IMAGE_TYPES.items() if data.startswith(head)), image.mimeType
            )
            image.bufferView, image.uri = made.add_view(data), None
        made._normalise_weights(file)
        return made

    def _normalise_weights(self, file: GltfFile) -> None:
        """Skin weights that do not add up to one are replaced: a valid file has none, and many exporters write them."""
        done: dict[tuple[int, ...], list[int]] = {}
        for mesh in self.gltf.meshes or []:
            for primitive in mesh.primitives:
                names = [
                    n
                    for n in ("WEIGHTS_0", "WEIGHTS_1")
                    if getattr(primitive.attributes, n, None) is not None
                ]
                old = tuple(getattr(primitive.attributes, n) for n in names)
                if not old:
                    continue
                if old not in done:
                    done[old] = self._normalised(file, old)
                for name, index in zip(names, done[old], strict=True):
                    setattr(primitive.attributes, name, index)

    def _normalised(self, file: GltfFile, indices: tuple[int, ...]) -> list[int]:
        """Accessors of weights that add up to one: those at `indices` where they do already."""
        sets = [read_accessor(file, index, "skin weights").astype(np.float64) for index in indices]
        if any(values.shape != sets[0].shape for values in sets):
            return list(indices)
        total = sum(values.sum(axis=1, keepdims=True) for values in sets)
        if np.all(np.abs(total - 1.0) < WEIGHT_ERROR) or np.any(total <= 0.0):
            return list(indices)
        return [self.add(values / total, ARRAY_BUFFER) for values in sets]

    def _append(self, data: bytes | memoryview) -> int:
        self._blob.extend(b"\0" * (-len(self._blob) % 4))
        start = len(self._blob)
        self._blob.extend(data)
        return start

    def add_view(self, data: bytes, target: int | None = None) -> int:
        """The index of a new buffer view that holds `data`."""
        import pygltflib as g

        start = self._append(data)
        self.gltf.bufferViews.append(
            g.BufferView(buffer=0, byteOffset=start, byteLength=len(data), target=target)
        )
        return len(self.gltf.bufferViews) - 1

    def add(self, values: Array, target: int | None = None, *, bounds: bool = False) -> int:
        """The index of a new accessor that holds `values` `(count, width)`; floats are written as float32."""
        import pygltflib as g

        values = np.ascontiguousarray(values, np.float32 if values.dtype.kind == "f" else values.dtype)
        accessor = g.Accessor(
            bufferView=self.add_view(values.tobytes(), target),
            componentType=_COMPONENT_TYPES[values.dtype.name],
            count=len(values),
            type=_ELEMENT_TYPES[values.shape[1]],
        )
        if bounds:
            accessor.min, accessor.max = values.min(axis=0).tolist(), values.max(axis=0).tolist()
        self.gltf.accessors.append(accessor)
        return len(self.gltf.accessors) - 1

    def keep_only_animations(self) -> None:
        """Take out what only meshes and images used: accessors, buffer views and their bytes."""
        gltf = self.gltf
        gltf.skins = []
        samplers = [sampler for animation in gltf.animations for sampler in animation.samplers]
        used = sorted({index for sampler in samplers for index in (sampler.input, sampler.output)})
        place = {index: k for k, index in enumerate(used)}
        accessors, views, old = [gltf.accessors[index] for index in used], gltf.bufferViews, self._blob
        self._blob, gltf.bufferViews, gltf.accessors = bytearray(), [], accessors
        for accessor in accessors:
            view = views[accessor.bufferView]
            accessor.bufferView = self.add_view(
                bytes(old[view.byteOffset : view.byteOffset + view.byteLength])
            )
        for sampler in samplers:
            sampler.input, sampler.output = place[sampler.input], place[sampler.output]

    def save(self, path: Path) -> None:
        """Write the GLB whole or not at all; FileError when it cannot be written."""
        write_atomic(path, self.to_bytes())

    def to_bytes(self) -> bytes:
        """The GLB."""
        import pygltflib as g

        self._blob.extend(b"\0" * (-len(self._blob) % 4))
        self.gltf.buffers = [g.Buffer(byteLength=len(self._blob))]
        self.gltf.set_binary_blob(bytes(self._blob))
        return b"".join(self.gltf.save_to_bytes())


def _document(file: GltfFile) -> tuple[GLTF2, set[int]]:
    """A document of its own to be changed and written, without animations, and the buffer views that this empties."""
    import pygltflib as g

    try:
        gltf = g.GLTF2.gltf_from_json(json.dumps(file.gltf))
        return gltf, _drop_animations(gltf)
    except STRUCTURE_ERRORS as error:
        raise FileError(f"{file.name}: damaged glTF document ({reason(error)}).", REMEDY) from error


def _drop_animations(gltf: GLTF2) -> set[int]:
    """Take the animations out; their accessors become empty, and the buffer views that nothing else uses are returned.

    Numbers of accessors and views stay, since extensions may name them.
    """
    kept: set[int | None] = {skin.inverseBindMatrices for skin in gltf.skins or []}
    for mesh in gltf.meshes or []:
        for primitive in mesh.primitives:
            kept |= {primitive.indices, *vars(primitive.attributes).values()}
            for target in primitive.targets or []:
                kept |= set((target if isinstance(target, dict) else vars(target)).values())
    samplers = [sampler for animation in gltf.animations or [] for sampler in animation.samplers]
    empty = {index for sampler in samplers for index in (sampler.input, sampler.output)} - kept
    empty &= set(range(len(gltf.accessors or [])))
    users: dict[int, list[bool]] = {}
    for index, accessor in enumerate(gltf.accessors or []):
        if accessor.bufferView is not None:
            users.setdefault(accessor.bufferView, []).append(index in empty)
    for index in empty:
        accessor = gltf.accessors[index]
        accessor.bufferView = accessor.byteOffset = accessor.min = accessor.max = accessor.sparse = None
        accessor.count = 1
    gltf.animations = []
    images = {image.bufferView for image in gltf.images or []}
    return {view for view, by in users.items() if all(by)} - images
