"""Plays the takes of an FBX by ufbx, an independent reader, in a separate process: ufbx crashes when it frees memory."""

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np


def play_fbx(path: Path, rate: float) -> dict[str, Any]:
    """Return `_facts` of a file; "worlds" contains world matrices `(T, nodes, 4, 4)` of each take at `rate` per second."""
    target = path.with_suffix(".npz")
    done = subprocess.run([sys.executable, __file__, str(path), str(target), repr(rate)], capture_output=True,
                          text=True, check=True)  # fmt: skip
    with np.load(target) as found:
        return json.loads(done.stdout) | {"worlds": dict(found)}


def _facts(scene: Any) -> dict[str, Any]:
    """Return unit, rate, nodes with parents, ends of takes, posed vertices, materials, images and shapes."""
    nodes = scene.nodes
    return {
        "unit": scene.settings.unit_meters, "fps": scene.settings.frames_per_second,
        "nodes": [node.name for node in nodes],
        "parents": {node.name: node.parent.name if node.parent is not None else None for node in nodes},
        "limbs": [node.name for node in nodes if node.bone is not None],
        "ends": {stack.name: stack.time_end for stack in scene.anim_stacks},
        "notes": {node.name: prop.value_str for node in nodes for prop in node.props.props if prop.name == "sport"},
        "materials": {m.name: [m.pbr.base_color.value_vec4.x, m.pbr.base_color.value_vec4.y,
                               m.pbr.base_color.value_vec4.z] for m in scene.materials},
        "images": {texture.relative_filename: len(texture.content) for texture in scene.textures},
        "shapes": [channel.name for channel in scene.blend_channels],
    }  # fmt: skip


def _main(path: str, target: str, rate: float) -> None:
    import ufbx

    from runtime.character.fbx_to_glb import Kept  # what ufbx made is not freed

    scene = Kept(ufbx.load_file(path))
    nodes, worlds = list(scene.nodes), {}
    for stack in scene.anim_stacks:
        frames = []
        for frame in range(round(stack.time_end * rate) + 1):
            world: dict[int, Any] = {}
            for node in nodes:  # parents first
                moved = ufbx.evaluate_transform(stack.anim.value, node.value, frame / rate)
                t, q, s = moved.translation, moved.rotation, moved.scale
                local = _matrix(t, q, s)
                world[node.typed_id] = local if node.parent is None else world[node.parent.typed_id] @ local
            frames.append([world[node.typed_id] for node in nodes])
        worlds[stack.name] = np.array(frames)
        posed = Kept(
            ufbx.evaluate_scene(scene.value, stack.anim.value, stack.time_end, evaluate_skinning=True)
        )
        points = [mesh.skinned_position.values.array() for mesh in posed.meshes]
        worlds[f"vertices {stack.name}"] = np.concatenate([*points, np.zeros((0, 3))])
    np.savez(target, **worlds)
    print(json.dumps(_facts(scene)), flush=True)
    os._exit(0)


def _matrix(t: Any, q: Any, s: Any) -> np.ndarray:
    x, y, z, w = q.x, q.y, q.z, q.w
    turn = np.array([[1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
                     [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
                     [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)]])  # fmt: skip
    world = np.eye(4)
    world[:3, :3], world[:3, 3] = turn * (s.x, s.y, s.z), (t.x, t.y, t.z)
    return world


if __name__ == "__main__":
    _main(sys.argv[1], sys.argv[2], float(sys.argv[3]))
