"""A take as VRM animation (`VRMC_vrm_animation` 1.0): rotations of humanoid bones, playable on any VRM avatar.

Our rest pose is a T-pose, as required. A player rotates the humanoid bones and moves the hips, and ignores other joints:
rotations of joints between two bones are added to the lower bone.
"""

from pathlib import Path

import numpy as np

from runtime.character.glb_buffer import GlbBuffer
from runtime.formats.engines import ENGINES
from runtime.formats.glb import add_animation
from runtime.formats.prepare import Check, PreparedTake
from runtime.formats.sidecar import take_extras
from runtime.rotations import continuous
from runtime.skeleton import REST_HIPS_HEIGHT, SPORT_SKELETON

EXTENSION = "VRMC_vrm_animation"
_NAMES = ENGINES["unity"].bones  # the specification's names, except for the case of their first letter
BONES = {SPORT_SKELETON.index(name): bone for name, bone in _NAMES.items() if name != "Root"}
BETWEEN = sorted({SPORT_SKELETON.parents[joint] for joint in BONES} - {-1, *BONES})


def save_vrma(take: PreparedTake, path: Path, options: object, terrain: object, check: Check) -> None:
    """Write a prepared take as a VRM animation. Raises FileError."""
    import pygltflib as g

    buffer, size = GlbBuffer(g.GLTF2(asset=g.Asset(version="2.0", generator="SPORT viewer"))), take.clip.size
    gltf, parents = buffer.gltf, SPORT_SKELETON.parents
    for joint, (name, offset) in enumerate(zip(SPORT_SKELETON.names, SPORT_SKELETON.offsets, strict=True)):
        place = offset if joint else np.array([0.0, REST_HIPS_HEIGHT, 0.0])
        children = [k for k, parent in enumerate(parents) if parent == joint]
        node = g.Node(name=_NAMES.get(name, name), translation=(place * size).tolist(), children=children)
        buffer.append("nodes", node)
    gltf.scenes, gltf.scene = [g.Scene(name="take", nodes=[0], extras={"sport": take_extras(take)})], 0
    world = take.clip.world()[1].copy()
    for joint in BETWEEN:
        world[:, joint] = world[:, parents[joint]]
    turns = continuous(SPORT_SKELETON.local_rotations(world))
    channels = [(0, "translation", take.clip.hips_positions * np.float32(size))]
    channels += [
        (joint, "rotation", turns[:, joint]) for joint in range(len(parents)) if joint not in BETWEEN
    ]
    check()
    add_animation(buffer, take, take.clip.name, channels)
    bones = {bone[0].lower() + bone[1:]: {"node": joint} for joint, bone in BONES.items()}
    gltf.extensionsUsed = [EXTENSION]
    gltf.extensions = {EXTENSION: {"specVersion": "1.0", "humanoid": {"humanBones": bones}}}
    check()
    buffer.save(path)
