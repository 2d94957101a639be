"""A take as GLB: the character's own mesh, materials, textures and skin, animated on its own skeleton."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from runtime import rotations
from runtime.arrays import Array
from runtime.assets import asset_path
from runtime.character.bodies import open_character
from runtime.character.character import Character, load_character
from runtime.character.glb_buffer import GENERATOR, GlbBuffer
from runtime.character.mesh import read_meshes
from runtime.formats.glb_skeleton import (
    Rig,
    joint_worlds,
    local_rest,
    nearest_rotation,
    open_rig,
    rename_bones,
    set_local,
    written,
)
from runtime.formats.ground import MARGIN_M, add_ground, ground_of, names_ground
from runtime.formats.options import ExportOptions
from runtime.formats.prepare import Check, PreparedTake, go_on, prepare
from runtime.formats.reference import open_take
from runtime.formats.sidecar import take_extras
from runtime.takes.clip import Clip
from runtime.terrain.height_map import Terrain

if TYPE_CHECKING:
    from pygltflib import GLTF2

MANNEQUIN = "character/mannequin.glb"
CHUNK_FRAMES = 1800  # frames processed at once, so that an hour does not fill the memory
STILL_M = 1e-6  # a joint that moves less relative to its parent has no translation track


def save_glb(
    take: PreparedTake, path: Path, options: ExportOptions, terrain: Terrain | None, check: Check = go_on
) -> None:
    """Write a prepared take as GLB with the character of `options`, including the `terrain` if requested.

    Raises FileError if the character cannot be used or the file cannot be written.
    """
    buffer, _ = glb_document([take, *further_takes(options, terrain)], options, terrain, check)
    check()
    buffer.save(path)


def glb_document(
    takes: list[PreparedTake],
    options: ExportOptions,
    terrain: Terrain | None,
    check: Check = go_on,
    ground_vertices: int | None = None,
    ground_margin_m: float = MARGIN_M,
) -> tuple[GlbBuffer, int]:
    """Return the document of `save_glb` for some takes, and the index of its hips node. Raises FileError."""
    source = options.character or asset_path(MANNEQUIN)
    character = load_character(source, options.joint_map, options.character_unit)
    file, _ = open_character(source)
    buffer = GlbBuffer.of_file(file)
    buffer.gltf.asset.generator = GENERATOR
    size, plain = body_size(takes[0].clip, options, character), options.plain or options.engine is not None
    rig = open_rig(buffer, file, character, read_meshes(file), options.rooted, plain, size)
    names: list[str] = []
    for number, take in enumerate(takes, 1):  # names must be unique
        name = take.clip.name
        _animate(rig, buffer, take, f"{name}-{number}" if name in names else name, check)
        names.append(name)
    if options.humanoid_names:
        rename_bones(rig, options.bones)
    if options.animation_only:
        _drop_meshes(buffer.gltf)
    if options.with_ground and terrain is not None:
        add_ground(buffer, terrain, takes[0], size, most=ground_vertices, margin_m=ground_margin_m)
    buffer.gltf.scenes[0].extras = {"sport": take_extras(takes[0])}
    return buffer, rig.sport_nodes["Hips"]


def _drop_meshes(gltf: GLTF2) -> None:
    """Remove everything but the nodes and their animations."""
    for node in gltf.nodes:
        node.mesh = node.skin = None
    for field in ("meshes", "materials", "textures", "images", "samplers", "skins"):
        setattr(gltf, field, [])


def further_takes(options: ExportOptions, terrain: Terrain | None) -> list[PreparedTake]:
    """Read the additional takes of an export, each on the ground that it names, or else on `terrain`. Raises FileError."""
    clips = [(open_take(path).clip, path) for path in options.with_takes]
    return [
        prepare(clip, options, ground_of(clip, path) if names_ground(clip) else terrain)
        for clip, path in clips
    ]


def body_size(clip: Clip, options: ExportOptions, character: Character) -> float:
    """Return the scale of a clip for a character: the character's own size, or the size for which the clip was made."""
    return clip.size if options.character is None or options.fit_to_motion else character.size


def _animate(rig: Rig, buffer: GlbBuffer, take: PreparedTake, name: str, check: Check) -> None:
    """Add the take as an animation to the document."""
    nodes = buffer.gltf.nodes
    animated = [*rig.joints, *([rig.root_node] if rig.root_node not in (-1, *rig.joints) else [])]
    scales = {node: set_local(nodes[node], local_rest(rig, node))[1] for node in animated}
    channels = []
    for node, (translations, quaternions) in _tracks(rig, take, scales, check).items():
        channels.append((node, "rotation", quaternions))
        above = written(rig, rig.rest[rig.parents[node]]) if rig.parents[node] >= 0 else np.eye(4)
        unit = float(np.abs(np.linalg.det(above[:3, :3]))) ** (1 / 3)  # metres per unit of the track
        if np.abs(translations - np.array(nodes[node].translation)).max() * unit > STILL_M:
            channels.append((node, "translation", translations))
    add_animation(buffer, take, name, channels)


def add_animation(
    buffer: GlbBuffer, take: PreparedTake, name: str, channels: list[tuple[int, str, Array]]
) -> None:
    """Add a take as an animation with one key per frame; channels are (node, "translation" or "rotation", values `(T, 3 or 4)`)."""
    import pygltflib as g

    seconds = np.arange(len(take.clip)) / take.clip.fps
    times = buffer.add(seconds.astype(np.float32)[:, None], bounds=True)
    animation = g.Animation(name=name, extras={"sport": take_extras(take)})
    for number, (node, path, values) in enumerate(channels):
        values = values[:, [1, 2, 3, 0]] if path == "rotation" else values
        sampler = g.AnimationSampler(input=times, output=buffer.add(values), interpolation="LINEAR")
        animation.samplers.append(sampler)
        target = g.AnimationChannelTarget(node=node, path=path)
        animation.channels.append(g.AnimationChannel(sampler=number, target=target))
    buffer.gltf.animations.append(animation)


def _tracks(
    rig: Rig, take: PreparedTake, scales: dict[int, Array], check: Check
) -> dict[int, tuple[Array, Array]]:
    """Return translations `(T, 3)` and quaternions `(T, 4)` of every animated node relative to its parent, float32."""
    parts: dict[int, list[tuple[Array, Array]]] = {node: [] for node in scales}
    for start in range(0, len(take.clip), CHUNK_FRAMES):
        check()
        frames = slice(start, min(start + CHUNK_FRAMES, len(take.clip)))
        worlds = joint_worlds(rig, take, frames)
        for node in scales:
            parent = rig.parents[node]
            local = worlds[node] if parent < 0 else np.linalg.inv(_world(rig, parent, worlds)) @ worlds[node]
            turn = nearest_rotation(local[:, :3, :3] / scales[node])
            parts[node].append((local[:, :3, 3].astype(np.float32), turn))
    tracks = {
        node: [np.concatenate(part) for part in zip(*each, strict=True)] for node, each in parts.items()
    }
    return {node: (t, rotations.continuous(q).astype(np.float32)) for node, (t, q) in tracks.items()}


def _world(rig: Rig, node: int, worlds: dict[int, Array]) -> Array:
    """Return world matrices `(n, 4, 4)` or `(4, 4)` of a node; nodes between joints follow the joint above."""
    if node in worlds:
        return worlds[node]
    parent = rig.parents[node]
    return local_rest(rig, node) if parent < 0 else _world(rig, parent, worlds) @ local_rest(rig, node)
