"""FBX through Blender: read back by Blender where there is one, a clear sentence where there is none."""

from __future__ import annotations

import json
import subprocess
import time
from pathlib import Path

import numpy as np
import pytest

from runtime.assets import asset_path
from runtime.character.character import load_character
from runtime.errors import FileError, UsageError
from runtime.formats import fbx
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
needs_blender = pytest.mark.skipif(fbx.find_blender() is None, reason="neither bpy nor a command blender")


def read_back(path: Path, folder: Path, fps: float) -> dict:
    """What Blender sees of a file."""
    command = fbx.find_blender()
    assert command is not None
    script, target = folder / "read.py", folder / "read.json"
    script.write_text(READER)
    separator = ["--"] if len(command) > 1 else []
    subprocess.run([*command, str(script), *separator, str(path), str(target), str(fps)], check=True,
                   capture_output=True, timeout=300)  # fmt: skip
    return json.loads(target.read_text())


@needs_blender
@pytest.mark.parametrize("suffix", [".fbx", ".glb"])
@pytest.mark.parametrize("name", ["mannequin", *RIGS])
def test_blender_reads_the_same_joints(name: str, suffix: str, tmp_path: Path) -> None:
    source = asset_path(MANNEQUIN) if name == "mannequin" else RIGS[name](tmp_path / "rig.glb")
    options = ExportOptions(fps=30.0, character=source, fit_to_motion=True)
    path = tmp_path / f"take{suffix}"
    save_motion(CLIP, path, options, Terrain.flat())
    found = read_back(path, tmp_path, 30.0)
    take, character = prepare(CLIP, options, Terrain.flat()), load_character(source)
    assert found["frames"] == len(take.clip)
    assert found["materials"]
    assert found["meshes"] == (2 if name == "vrm" else 1)
    assert found["images"] == [8] * (0 if name == "mannequin" else found["meshes"])
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
