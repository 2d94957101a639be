"""Writes a `Character` as a skinned GLB."""

from pathlib import Path

import numpy as np

from runtime import rotations
from runtime.character.character import Character
from runtime.character.glb_buffer import ARRAY_BUFFER, ELEMENT_BUFFER, GlbBuffer


def write_character(path: str | Path, character: Character, name: str = "character") -> None:
    """Write the character in its bind pose as a skinned GLB; FileError if the file cannot be written."""
    import pygltflib as g

    buffer = GlbBuffer(g.GLTF2(asset=g.Asset(version="2.0", generator="SPORT viewer")))
    gltf, count = buffer.gltf, len(character.joint_names)
    rgba = np.concatenate([character.colors, np.ones((len(character.colors), 1))], axis=1)
    attributes = g.Attributes(
        POSITION=buffer.add(character.positions, ARRAY_BUFFER, bounds=True),
        NORMAL=buffer.add(character.normals, ARRAY_BUFFER),
        COLOR_0=buffer.add(np.round(rgba * 65535).astype(np.uint16), ARRAY_BUFFER, normalized=True),
        JOINTS_0=buffer.add(character.joint_indices.astype(np.uint16), ARRAY_BUFFER),
        WEIGHTS_0=buffer.add(character.joint_weights, ARRAY_BUFFER),
    )
    index_type = np.uint16 if len(character.positions) < 65535 else np.uint32
    indices = buffer.add(character.triangles.reshape(-1, 1).astype(index_type), ELEMENT_BUFFER)
    surface = g.PbrMetallicRoughness(metallicFactor=0.0, roughnessFactor=0.6)
    gltf.materials = [g.Material(name=name, pbrMetallicRoughness=surface)]
    primitive = g.Primitive(attributes=attributes, indices=indices, material=0)
    gltf.meshes = [g.Mesh(name=name, primitives=[primitive])]
    inverse = character.inverse_bind.astype(np.float32).transpose(0, 2, 1).reshape(-1, 16)
    inverse[:, [3, 7, 11]], inverse[:, 15] = 0.0, 1.0  # the format requires an exact last row
    gltf.skins = [g.Skin(inverseBindMatrices=buffer.add(inverse), joints=list(range(count)))]
    parents, local = np.array(character.joint_parents), character.rest_world.astype(np.float64)
    inner = np.flatnonzero(parents >= 0)
    local[inner] = np.linalg.inv(local[parents[inner]]) @ local[inner]
    scales = np.linalg.norm(local[:, :3, :3], axis=-2)
    quaternions = rotations.from_matrix(local[:, :3, :3] / np.maximum(scales[:, None, :], 1e-12))
    gltf.nodes = [
        g.Node(
            name=character.joint_names[k],
            children=np.flatnonzero(parents == k).tolist(),
            translation=local[k, :3, 3].tolist(),
            rotation=quaternions[k][[1, 2, 3, 0]].tolist(),
            scale=None if np.allclose(scales[k], 1.0, atol=1e-5) else scales[k].tolist(),
        )
        for k in range(count)
    ]
    gltf.nodes.append(g.Node(name=name, mesh=0, skin=0))
    roots = np.flatnonzero(parents < 0).tolist()
    gltf.scenes, gltf.scene = [g.Scene(name=name, nodes=[*roots, count])], 0
    buffer.save(Path(path))
