"""Run inside Blender, or by a Python that has `bpy`: a GLB of a take becomes an FBX. Arguments: GLB, FBX, frames a second,
unit of the FBX (cm or m), name of the take.

blender --background --factory-startup --python blender_fbx.py -- take.glb take.fbx 60 m walk
"""

from __future__ import annotations

import math
import os
import sys
from typing import Any


def convert(source: str, target: str, fps: float, unit: str, name: str) -> None:
    """Import `source` at the take's rate and export it with a key in every frame and its textures inside.

    `unit` is that of the file ("cm" or "m"), in which nothing is scaled; takes are named as in the source.
    """
    import bpy

    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.name = name
    scene.unit_settings.scale_length = 0.01 if unit == "cm" else 1.0
    # versions of the importer differ in what `fps_base` does to their keys: it is 1 until they are there
    scene.render.fps = max(1, math.ceil(fps - 1e-6))
    # bones keep the axes of the character's own joints, and no shape is drawn for them
    bpy.ops.import_scene.gltf(filepath=source, bone_heuristic="BLENDER", disable_bone_shape=True)
    scene.render.fps_base = scene.render.fps / fps
    for action in bpy.data.actions:
        _on_frames(action, fps / scene.render.fps)
    _note_markers(bpy.data.objects, scene)
    last = max((action.frame_range[1] for action in bpy.data.actions), default=0.0)
    scene.frame_start, scene.frame_end = 0, round(last)
    several = _strips_of_takes(bpy.data.objects)
    _same_bytes()
    written = target + ".part"
    bpy.ops.export_scene.fbx(
        filepath=written,
        object_types={"ARMATURE", "MESH", "EMPTY"},
        apply_scale_options="FBX_SCALE_NONE" if unit == "cm" else "FBX_SCALE_ALL",
        add_leaf_bones=False,
        use_custom_props=True,
        bake_anim=True,
        bake_anim_use_all_bones=True,
        bake_anim_use_nla_strips=several,
        bake_anim_use_all_actions=False,
        bake_anim_step=1.0,
        bake_anim_simplify_factor=0.0,
        path_mode="COPY",
        embed_textures=True,
    )
    os.replace(written, target)  # a file of this name is whole, whatever Blender does at its end


def _on_frames(action: Any, scale: float) -> None:
    """Multiply the times of all keys, which then lie on whole frames."""
    if hasattr(action, "fcurves"):
        curves = action.fcurves
    else:
        bags = [bag for layer in action.layers for strip in layer.strips for bag in strip.channelbags]
        curves = [curve for bag in bags for curve in bag.fcurves]
    for curve in curves:
        values = [0.0] * (2 * len(curve.keyframe_points))
        curve.keyframe_points.foreach_get("co", values)
        values[::2] = [round(time * scale) for time in values[::2]]
        curve.keyframe_points.foreach_set("co", values)
        curve.update()


def _strips_of_takes(objects: Any) -> bool:
    """Several takes as strips that are exported one by one, named as their tracks; whether there are several.

    The importer leaves tracks muted, which the exporter passes over, and its strips as long as the keys were.
    """
    several = False
    for thing in objects:
        tracks = [] if thing.animation_data is None else list(thing.animation_data.nla_tracks)
        several = several or len(tracks) > 1
        for track in tracks:
            track.mute = False
            for strip in list(track.strips):
                action, slot = strip.action, getattr(strip, "action_slot", None)
                track.strips.remove(strip)
                made = track.strips.new(track.name, 0, action)
                made.name = track.name
                if slot is not None:
                    made.action_slot = slot
    return several


def _same_bytes() -> None:
    """The exporter writes the time of day, unless it is given another one."""
    import datetime
    from types import SimpleNamespace

    from io_scene_fbx import export_fbx_bin

    export_fbx_bin.datetime = SimpleNamespace(
        datetime=SimpleNamespace(now=lambda: datetime.datetime(1970, 1, 1))
    )


def _note_markers(objects: Any, scene: Any) -> None:
    """What the GLB tells of the take goes to its armature: FBX has no properties of a scene."""
    import json

    if "sport" not in scene:
        return
    text = json.dumps(scene["sport"].to_dict(), ensure_ascii=False)
    for thing in objects:
        if thing.type == "ARMATURE":
            thing["sport"] = text


if __name__ == "__main__":
    arguments = sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else sys.argv[1:]
    convert(arguments[0], arguments[1], float(arguments[2]), arguments[3], arguments[4])
