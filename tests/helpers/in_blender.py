"""Script for Blender, not pytest: imports a take or follows the live link with the add-on, and writes the result as JSON.

in_blender.py ADDON take TARGET PATH...      in_blender.py ADDON live TARGET POSES [RIG]
"""

import importlib.util
import json
import sys
import time

import bpy

addon_path, what, target, *rest = sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else sys.argv[1:]
spec = importlib.util.spec_from_file_location("sport_viewer", addon_path)
addon = importlib.util.module_from_spec(spec)
spec.loader.exec_module(addon)
addon.register()


def joints(armature):
    return {b.name: list((armature.matrix_world @ b.matrix).translation) for b in armature.pose.bones}


def take(path):
    """Import by the menu's operator; returns joints in every frame and data of the scene."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    done = bpy.ops.import_anim.sport_take(filepath=path)
    scene = bpy.context.scene
    armature = next(thing for thing in bpy.data.objects if thing.type == "ARMATURE")
    frames = []
    for frame in range(scene.frame_start, scene.frame_end + 1):
        scene.frame_set(frame)
        frames.append(joints(armature))
    grounds = [t for t in bpy.data.objects if t.type == "MESH" and t.name.lower().startswith("ground")]
    return {
        "done": sorted(done),
        "frames": frames,
        "fps": scene.render.fps / scene.render.fps_base,
        "range": [scene.frame_start, scene.frame_end],
        "markers": sorted([mark.frame, mark.name] for mark in scene.timeline_markers),
        "grounds": [[list(t.matrix_world @ v.co) for v in t.data.vertices] for t in grounds],
        "skinned": sum(t.type == "MESH" and t.find_armature() is armature for t in bpy.data.objects),
        "materials": len(bpy.data.materials),
    }


def live(wanted, rig=""):
    """Follow the link for `wanted` poses; returns the final armature, and that of the recorded action."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.context.scene.render.fps = 60
    if rig:
        bpy.ops.import_scene.gltf(filepath=rig, bone_heuristic="BLENDER", disable_bone_shape=True)
    own = next((thing for thing in bpy.data.objects if thing.type == "ARMATURE"), None)
    link = addon.LiveLink(bpy.context, "127.0.0.1", 0, own)
    link.recording = True
    print(link.receiver.address[1], flush=True)
    end = time.monotonic() + 60.0
    applied, seconds = 0, []
    while link.receiver.received + link.receiver.lost < wanted and time.monotonic() < end:
        begin = time.perf_counter()
        if link.step():
            seconds.append(time.perf_counter() - begin)
            applied += 1
        time.sleep(1.0 / 60.0)
    bpy.context.view_layer.update()
    shown = joints(link.armature)
    keys = link.keep()
    scene = bpy.context.scene
    first, last = (round(v) for v in link.armature.animation_data.action.frame_range)
    scene.frame_set(last)
    result = {
        "received": link.receiver.received, "lost": link.receiver.lost, "applied": applied, "keys": keys,
        "range": [first, last], "shown": shown, "recorded": joints(link.armature), "step_s": max(seconds, default=0.0),
    }  # fmt: skip
    link.close()
    return result


result = [take(path) for path in rest] if what == "take" else live(int(rest[0]), *rest[1:])
with open(target, "w") as file:
    json.dump(result, file)
addon.unregister()
