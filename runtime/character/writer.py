"""Skinned GLB files from a `Character`, written atomically."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from runtime import rotations
from runtime.arrays import AnyArray
from runtime.character.character import Character
from runtime.errors import FileError

if TYPE_CHECKING:
    from pygltflib import GLTF2


_ARRAY_BUFFER, _ELEMENT_BUFFER = 34962, 34963
_COMPONENT_TYPES = {"uint8": 5121, "uint16": 5123, "uint32": 5125, "float32": 5126}
_ELEMENT_TYPES = {1: "SCALAR", 3: "VEC3", 4: "VEC4", 16: "MAT4"}


def write_character(path: str | Path, character: Character, name: str = "character") -> None:
    """Write the character in its bind pose as a skinned GLB; FileError when the file cannot be written."""
    gltf, blob = _document(character, name)
    _save(gltf, blob, Path(path))


def _document(character: Character, name: str) -> tuple[GLTF2, bytearray]:
    import pygltflib as g

    blob = bytearray()
    gltf = g.GLTF2(asset=g.Asset(version="2.0", generator="SPORT viewer"))
    rgba = np.concatenate([character.colors, np.ones((len(character.colors), 1))], axis=1)
    put = _accessor
    attributes = g.Attributes(
        POSITION=put(gltf, blob, character.positions, _ARRAY_BUFFER, bounds=True),
        NORMAL=put(gltf, blob, character.normals, _ARRAY_BUFFER),
        COLOR_0=put(gltf, blob, np.round(rgba * 65535).astype(np.uint16), _ARRAY_BUFFER, normalized=True),
        JOINTS_0=put(gltf, blob, character.joint_indices.astype(np.uint16), _ARRAY_BUFFER),
        WEIGHTS_0=put(gltf, blob, character.joint_weights, _ARRAY_BUFFER),
    )
    small = len(character.positions) < 65535
    index_type = np.uint16 if small else np.uint32
    indices = put(gltf, blob, character.triangles.reshape(-1, 1).astype(index_type), _ELEMENT_BUFFER)
    material = g.Material(
        name=name, pbrMetallicRoughness=g.PbrMetallicRoughness(metallicFactor=0.0, roughnessFactor=0.6)
    )
    gltf.materials = [material]
    gltf.meshes = [
        g.Mesh(name=name, primitives=[g.Primitive(attributes=attributes, indices=indices, material=0)])
    ]
    inverse = np.asarray(character.inverse_bind, np.float32).transpose(0, 2, 1).reshape(-1, 16)
    inverse = inverse.copy()
    inverse[:, [3, 7, 11]], inverse[:, 15] = 0.0, 1.0  # the format wants the last row exact
    gltf.skins = [
        g.Skin(inverseBindMatrices=put(gltf, blob, inverse), joints=list(range(len(character.joint_names))))
    ]
    _add_nodes(gltf, character, name)
    return gltf, blob


def _add_nodes(gltf: GLTF2, character: Character, name: str) -> None:
    import pygltflib as g

    count = len(character.joint_names)
    translations, quaternions, scales = local_transforms(character, character.rest_world)
    children: list[list[int]] = [[] for _ in range(count)]
    for k, parent in enumerate(character.joint_parents):
        if parent >= 0:
            children[parent].append(k)
    gltf.nodes = [
        g.Node(
            name=character.joint_names[k],
            children=children[k],
            translation=translations[k].tolist(),
            rotation=quaternions[k][[1, 2, 3, 0]].tolist(),
            scale=None if np.allclose(scales[k], 1.0, atol=1e-5) else scales[k].tolist(),
        )
        for k in range(count)
    ]
    roots = [k for k, parent in enumerate(character.joint_parents) if parent < 0]
    gltf.nodes.append(g.Node(name=name, mesh=0, skin=0))
    gltf.scenes = [g.Scene(name=name, nodes=[*roots, count])]
    gltf.scene = 0


def local_transforms(character: Character, world: AnyArray) -> tuple[AnyArray, AnyArray, AnyArray]:
    """Translations `(..., K, 3)`, quaternions `(..., K, 4)`, scales `(..., K, 3)` relative to the parent joint."""
    world = np.asarray(world, np.float64)
    parents = np.array(character.joint_parents)
    local = world.copy()
    inner = np.flatnonzero(parents >= 0)
    local[..., inner, :, :] = np.linalg.inv(world[..., parents[inner], :, :]) @ world[..., inner, :, :]
    scales = np.linalg.norm(local[..., :3, :3], axis=-2)
    turn = rotations.from_matrix(local[..., :3, :3] / np.maximum(scales[..., None, :], 1e-12))
    return local[..., :3, 3], turn, scales


def _accessor(
    gltf: GLTF2,
    blob: bytearray,
    values: AnyArray,
    target: int | None = None,
    *,
    normalized: bool = False,
    bounds: bool = False,
) -> int:
    """Append `values` `(count, width)` to the buffer and return the index of its new accessor."""
    import pygltflib as g

    values = np.ascontiguousarray(values)
    if values.dtype == np.float64:
        values = values.astype(np.float32)
    blob.extend(b"\0" * (-len(blob) % 4))
    view = g.BufferView(buffer=0, byteOffset=len(blob), byteLength=values.nbytes, target=target)
    blob.extend(values.tobytes())
    gltf.bufferViews.append(view)
    accessor = g.Accessor(
        bufferView=len(gltf.bufferViews) - 1,
        componentType=_COMPONENT_TYPES[values.dtype.name],
        count=len(values),
        type=_ELEMENT_TYPES[values.shape[1]],
        normalized=normalized,
    )
    if bounds:
        accessor.min = values.min(axis=0).tolist()
        accessor.max = values.max(axis=0).tolist()
    gltf.accessors.append(accessor)
    return len(gltf.accessors) - 1


def _save(gltf: GLTF2, blob: bytearray, path: Path) -> None:
    import pygltflib as g

    blob.extend(b"\0" * (-len(blob) % 4))
    gltf.buffers = [g.Buffer(byteLength=len(blob))]
    gltf.set_binary_blob(bytes(blob))
    data = b"".join(gltf.save_to_bytes())
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, temporary = tempfile.mkstemp(dir=path.parent, suffix=".glb.part")
        try:
            with os.fdopen(handle, "wb") as out:
                out.write(data)
            os.replace(temporary, path)
        except OSError:
            Path(temporary).unlink(missing_ok=True)
            raise
    except OSError as error:
        raise FileError(
            f"{path}: cannot be written ({error.strerror or error}).", "Choose another folder."
        ) from error
