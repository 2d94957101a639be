"""FBX through Blender: read back by Blender where there is one, a clear sentence where there is none."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from runtime.assets import asset_path
from runtime.character.character import load_character
from runtime.errors import FileError, UsageError
from runtime.formats import fbx, glb_skeleton
from runtime.formats.bvh_clip import load_clip_bvh, save_bvh
from runtime.formats.glb import MANNEQUIN
from runtime.formats.prepare import ExportOptions, prepare
from runtime.formats.table import ExportCancelled, save_motion
from runtime.takes.clip import Clip
from runtime.terrain.height_map import Terrain
from tests.helpers.foreign_rigs import RIGS
from tests.helpers.walker import walk

CLIP = Clip("walk", 60.0, *walk(61))
READER = """
import json, sys
import bpy
source, target, fps = sys.argv[-3], sys.argv[-2], float(sys.argv[-1])
bpy.ops.wm.read_factory_settings(use_empty=True)
scene = bpy.context.scene
scene.render.fps = round(fps)
if source.endswith("fbx"):
    bpy.ops.import_scene.fbx(filepath=source)
else:
    bpy.ops.import_scene.gltf(filepath=source)
rig = next(thing for thing in bpy.data.objects if thing.type == "ARMATURE")
first, last = (round(v) for v in max((a.frame_range for a in bpy.data.actions), key=lambda r: r[1]))
found = {}
for frame in range(first, last + 1, 10):
    scene.frame_set(frame)
    found[frame - first] = {b.name: [list(row) for row in rig.matrix_world @ b.matrix] for b in rig.pose.bones}
images = [image.size[0] for image in bpy.data.images]
meshes = sum(thing.type == "MESH" and bool(thing.modifiers) for thing in bpy.data.objects)
json.dump({"frames": last - first + 1, "bones": found, "images": images, "meshes": meshes,
           "materials": [m.name for m in bpy.data.materials]}, open(target, "w"))
"""
TAKES_READER = """
import json, sys
import bpy
source, target, fps, frames = sys.argv[-4], sys.argv[-3], float(sys.argv[-2]), int(sys.argv[-1])
bpy.ops.wm.read_factory_settings(use_empty=True)
bpy.ops.import_scene.fbx(filepath=source)
scene = bpy.context.scene
rig = next(thing for thing in bpy.data.objects if thing.type == "ARMATURE")
found = {}
for action in bpy.data.actions:
    rig.animation_data.action = action
    if hasattr(action, "slots"):
        rig.animation_data.action_slot = action.slots[0]
    poses, first = [], action.frame_range[0]
    for k in range(0, frames, 7):
        at = first + k / fps * scene.render.fps  # the importer's own keys: it leaves the base out
        scene.frame_set(int(at), subframe=at - int(at))
        poses.append({b.name: list((rig.matrix_world @ b.matrix).translation) for b in rig.pose.bones})
    last = (action.frame_range[1] - first) / scene.render.fps
    found[action.name.split("|")[1]] = {"poses": poses, "last": last}
json.dump(found, open(target, "w"))
"""
needs_blender = pytest.mark.skipif(fbx.find_blender() is None, reason="neither bpy nor a command blender")


def run_reader(reader: str, path: Path, folder: Path, *facts: str) -> dict:
    """What a script in Blender writes of a file."""
    command = fbx.find_blender()
    assert command is not None
    script, target = folder / "read.py", folder / "read.json"
    script.write_text(reader)
    separator = ["--"] if len(command) > 1 else []
    subprocess.run([*command, str(script), *separator, str(path), str(target), *facts], check=True,
                   capture_output=True, timeout=300)  # fmt: skip
    return json.loads(target.read_text())


def stacks_of(path: Path) -> dict[str, float]:
    """Name and end of each take of an FBX as ufbx reads it, in a process of its own: it crashes where it frees a scene."""
    script = (
        "import json, os, sys, ufbx; scene = ufbx.load_file(sys.argv[1]); "
        "print(json.dumps({s.name: s.time_end for s in scene.anim_stacks}), flush=True); os._exit(0)"
    )
    done = subprocess.run([sys.executable, "-c", script, str(path)], check=True, capture_output=True)
    return json.loads(done.stdout)


@needs_blender
@pytest.mark.parametrize("suffix", [".fbx", ".glb"])
@pytest.mark.parametrize("name", ["mannequin", *RIGS])
def test_blender_reads_the_same_joints(name: str, suffix: str, tmp_path: Path) -> None:
    source = asset_path(MANNEQUIN) if name == "mannequin" else RIGS[name](tmp_path / "rig.glb")
    options = ExportOptions(fps=30.0, character=source, fit_to_motion=True)
    path = tmp_path / f"take{suffix}"
    save_motion(CLIP, path, options, Terrain.flat())
    found = run_reader(READER, path, tmp_path, "30.0")
    take, character = prepare(CLIP, options, Terrain.flat()), load_character(source)
    assert found["frames"] == len(take.clip)
    assert found["materials"]
    assert found["meshes"] == (2 if name == "vrm" else 1)
    textured = 0 if name == "mannequin" else found["meshes"]
    assert len(found["images"]) <= textured, "the FBX importer of some versions makes one of two equal images"
    assert set(found["images"]) == ({8} if textured else set())
    matrices = character.joint_matrices(*character.adapted(*take.clip.world(), take.clip.contacts)).astype(
        float
    )
    names = list(character.joint_names)
    upright = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])  # Blender has Z up
    ours, theirs = [], []
    for frame, bones in found["bones"].items():
        theirs.append(upright @ np.array([bones[n] for n in names]))
        ours.append(matrices[int(frame)])
    ours, theirs = np.stack(ours), np.stack(theirs)
    assert np.linalg.norm(ours[..., :3, 3] - theirs[..., :3, 3], axis=-1).max() < 1e-3
    turns = []
    for side in (ours, theirs):
        unit = side[..., :3, :3] / np.linalg.norm(side[..., :3, :3], axis=-2, keepdims=True)
        turns.append(unit @ np.linalg.inv(unit[0]))
    angle = np.linalg.norm(turns[0] - turns[1], axis=(-2, -1)) / np.sqrt(2.0)
    assert np.rad2deg(angle).max() < 0.1


@needs_blender
def test_hips_exactly_above_a_root_of_their_own_keep_where_they_go(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Blender connects bones that meet, and drops where the lower one goes."""
    options, source = ExportOptions(fps=30.0, ground_root=True, plain=True), tmp_path / "rooted.glb"
    with monkeypatch.context() as patch:
        patch.setattr(glb_skeleton, "OFF_THE_HIPS_M", 0.0)
        save_motion(CLIP, source, options, Terrain.flat())
    options = ExportOptions(fps=30.0, character=source, fit_to_motion=True, ground_root=True)
    save_motion(CLIP, tmp_path / "take.fbx", options, Terrain.flat())
    found = run_reader(READER, tmp_path / "take.fbx", tmp_path, "30.0")["bones"]
    take, character = prepare(CLIP, options, Terrain.flat()).clip, load_character(source)
    places = character.joint_matrices(*character.adapted(*take.world(), take.contacts))[..., :3, 3]
    for frame, bones in found.items():
        read = np.array(bones["Hips"])[:3, 3][[0, 2, 1]] * (1, 1, -1)
        assert np.linalg.norm(read - places[int(frame), character.joint_names.index("Hips")]) < 1e-3, frame


@needs_blender
@pytest.mark.parametrize("rate", [30.0, 29.97, 59.94])
@pytest.mark.parametrize("engine", [None, "unreal", "unity"])
def test_takes_of_any_name_and_rate_are_all_there(engine: str | None, rate: float, tmp_path: Path) -> None:
    """Three takes in one file: each is a stack for ufbx, and stands within 1 mm in Blender."""
    pytest.importorskip("ufbx")
    clips = {"walk": CLIP, "grün größer": replace(CLIP.trim(0, 40), name="grün größer")}
    clips["at 25"] = replace(CLIP.resampled(25.0), name="at 25")
    files = [save_bvh(clip, tmp_path / f"{name}.bvh", clip.fps) for name, clip in clips.items()]
    options = ExportOptions(fps=rate, engine=engine, with_takes=tuple(files[1:]))
    for name in ("takes.fbx", "again.fbx"):
        save_motion(load_clip_bvh(files[0]), tmp_path / name, options, Terrain.flat())
    assert (tmp_path / "takes.fbx").read_bytes() == (tmp_path / "again.fbx").read_bytes()
    stacks = stacks_of(tmp_path / "takes.fbx")
    found = run_reader(TAKES_READER, tmp_path / "takes.fbx", tmp_path, repr(rate), "19")
    character = load_character(asset_path(MANNEQUIN))
    assert set(stacks) == set(found) == set(clips)
    for name, path in zip(clips, files, strict=True):
        take = prepare(load_clip_bvh(path), options, Terrain.flat()).clip
        assert stacks[name] == pytest.approx((len(take) - 1) / rate, abs=2e-3)
        assert found[name]["last"] == pytest.approx((len(take) - 1) / rate, abs=2e-3)
        places = character.joint_matrices(*character.adapted(*take.world(), take.contacts))[..., :3, 3]
        for k, pose in zip(range(0, 19, 7), found[name]["poses"], strict=True):
            read = np.array([pose[joint] for joint in character.joint_names])[:, [0, 2, 1]] * (1, 1, -1)
            assert np.linalg.norm(read - places[k], axis=-1).max() < 1e-3, (name, k)


@needs_blender
def test_a_blender_that_crashes_at_its_end_has_written_the_file(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    command = fbx.find_blender()
    assert command is not None
    broken = tmp_path / "python-broken"
    broken.write_text(f'#!/bin/sh\n"{command[0]}" "$@"\nexit 139\n')
    broken.chmod(0o755)
    monkeypatch.setenv("SPORT_BLENDER", str(broken))
    save_motion(CLIP, tmp_path / "a.fbx", ExportOptions(), Terrain.flat())
    assert (tmp_path / "a.fbx").stat().st_size > 10_000


def test_without_blender_the_sentence_says_what_to_do(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(fbx, "find_blender", lambda: None)
    with pytest.raises(
        UsageError, match=r"neither the Python module bpy nor a command blender.*\[fbx\].*\.glb"
    ):
        save_motion(CLIP, tmp_path / "a.fbx", ExportOptions(), Terrain.flat())
    assert not (tmp_path / "a.fbx").exists()


def test_a_blender_that_fails_is_named_and_leaves_nothing(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    script = tmp_path / "python-broken"
    script.write_text("#!/bin/sh\necho 'no display driver' >&2\nexit 3\n")
    script.chmod(0o755)
    monkeypatch.setenv("SPORT_BLENDER", str(script))
    with pytest.raises(FileError, match="Blender wrote no FBX \\(no display driver\\)"):
        save_motion(CLIP, tmp_path / "a.fbx", ExportOptions(), Terrain.flat())
    monkeypatch.setenv("SPORT_BLENDER", str(tmp_path / "gone"))
    with pytest.raises(FileError, match="did not run"):
        save_motion(CLIP, tmp_path / "a.fbx", ExportOptions(), Terrain.flat())
    assert not list(tmp_path.glob("*.fbx"))


def test_a_blender_that_is_not_wanted_any_more_is_ended(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    script = tmp_path / "python-slow"
    script.write_text(f"#!/bin/sh\necho $$ > {tmp_path}/begun\nexec sleep 60\n")
    script.chmod(0o755)
    monkeypatch.setenv("SPORT_BLENDER", str(script))

    def check() -> None:
        if (tmp_path / "begun").is_file():
            raise ExportCancelled("cancelled")

    begun = time.monotonic()
    with pytest.raises(ExportCancelled):
        save_motion(CLIP, tmp_path / "a.fbx", ExportOptions(), Terrain.flat(), check)
    assert time.monotonic() - begun < 30.0
    assert sorted(path.name for path in tmp_path.iterdir()) == ["begun", "python-slow"]
