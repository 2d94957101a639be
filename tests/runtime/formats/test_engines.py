"""Files for engines: unit and scale 1, names of takes and bones, and the motion in them, read by other programs."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from pygltflib import GLTF2
from scipy.spatial.transform import Rotation

from runtime.errors import UsageError
from runtime.formats import fbx
from runtime.formats.bvh_clip import save_bvh
from runtime.formats.engines import ENGINES
from runtime.formats.prepare import ExportOptions
from runtime.formats.table import save_motion
from runtime.skeleton import SPORT_SKELETON
from runtime.takes.clip import Clip
from runtime.terrain.height_map import Terrain
from tests.helpers.foreign_rigs import RIGS
from tests.helpers.glb_playback import play, skinned
from tests.helpers.walker import walk

CLIP, FLAT = Clip("proud walk", 30.0, *walk(31)), Terrain.flat()
# a process of its own, that ends at once: this reader's Python binding fails while it is taken down
READER = """
import gc, json, os, sys
gc.disable()
import ufbx
scene = ufbx.load_file(sys.argv[1])
stacks, nodes = list(scene.anim_stacks), list(scene.nodes)
anim, locals_ = stacks[0].anim, {}
for frame in (0, 10, 30):
    locals_[frame] = {}
    for node in nodes:
        t = ufbx.evaluate_transform(anim, node, frame / float(sys.argv[2]))
        locals_[frame][node.name] = [[t.translation.x, t.translation.y, t.translation.z],
                                     [t.rotation.x, t.rotation.y, t.rotation.z, t.rotation.w],
                                     [t.scale.x, t.scale.y, t.scale.z]]
found = {"unit": scene.settings.unit_meters, "takes": [stack.name for stack in stacks], "locals": locals_,
         "parents": {n.name: n.parent.name if n.parent else None for n in nodes}}
print(json.dumps(found), flush=True)
os._exit(0)
"""


def world(found: dict, frame: str, name: str) -> np.ndarray:
    """The place of a node of what `READER` found, in the unit of its file."""
    point, node = np.zeros(3), name
    while node is not None:
        translation, turn, scale = found["locals"][frame][node]
        point = np.array(translation) + Rotation.from_quat(turn).apply(np.array(scale) * point)
        node = found["parents"][node]
    return point


@pytest.mark.skipif(fbx.find_blender() is None, reason="neither bpy nor a command blender")
@pytest.mark.parametrize(("engine", "unit"), [("unreal", 0.01), ("unity", 1.0)])
def test_an_fbx_is_what_its_engine_expects(engine: str, unit: float, tmp_path: Path) -> None:
    pytest.importorskip("ufbx")
    path = tmp_path / "take.fbx"
    save_motion(CLIP, path, ExportOptions(fps=30.0, engine=engine, humanoid_names=True), FLAT)
    done = subprocess.run(
        [sys.executable, "-c", READER, str(path), "30"], capture_output=True, text=True, check=True
    )
    found = json.loads(done.stdout)
    assert found["unit"] == pytest.approx(unit)
    assert found["takes"] == ["proud walk"]
    for frame, nodes in found["locals"].items():
        assert np.abs(np.array([scale for _, _, scale in nodes.values()]) - 1.0).max() < 1e-5, frame
    bones = ENGINES[engine].bones
    assert found["parents"][bones["Hips"]] == bones["Root"]
    wanted = CLIP.world()[0]
    for frame in found["locals"]:
        for name, bone in bones.items():
            if name != "Root":
                away = world(found, frame, bone) * unit - wanted[int(frame), SPORT_SKELETON.index(name)]
                assert np.linalg.norm(away) < 1e-4, (frame, name)


@pytest.mark.parametrize("name", RIGS)
def test_a_plain_rig_moves_as_the_characters_own(name: str, tmp_path: Path) -> None:
    source = RIGS[name](tmp_path / "rig.glb")
    paths = []
    for engine in (None, "blender"):
        paths.append(tmp_path / f"{engine}.glb")
        save_motion(CLIP, paths[-1], ExportOptions(fps=30.0, engine=engine, character=source), FLAT)
    own, plain = (play(path) for path in paths)
    for joint, worlds in own.joints().items():
        others = plain.joints()[joint]
        assert np.abs(worlds[:, :3, 3] - others[:, :3, 3]).max() < 1e-4
        assert np.abs(np.linalg.norm(others[:, :3, :3], axis=1) - 1.0).max() < 1e-4
    for k in (0, 20):
        assert np.abs(skinned(own, k) - skinned(plain, k)).max() < 1e-4


def test_several_takes_share_a_file_without_meshes(tmp_path: Path) -> None:
    other = save_bvh(CLIP, tmp_path / "other.bvh", 30.0)
    options = ExportOptions(
        fps=30.0, engine="unreal", humanoid_names=True, animation_only=True, with_takes=(other, other)
    )
    save_motion(CLIP, tmp_path / "takes.glb", options, FLAT)
    gltf = GLTF2.load(str(tmp_path / "takes.glb"))
    assert [animation.name for animation in gltf.animations] == ["proud walk", "other", "other-3"]
    assert not gltf.meshes
    assert not gltf.images
    assert {"root", "pelvis", "thigh_l", "hand_r"} <= {node.name for node in gltf.nodes}
    assert gltf.buffers[0].byteLength < 400_000


@pytest.mark.parametrize("engine", ["unity", "godot", "maya"])
def test_joints_of_the_neck_keep_their_names_in_a_humanoid(engine: str, tmp_path: Path) -> None:
    save_motion(CLIP, tmp_path / "take.glb", ExportOptions(engine=engine, humanoid_names=True), FLAT)
    names = [node.name for node in GLTF2.load(str(tmp_path / "take.glb")).nodes]
    assert names.count("Neck") == names.count("Neck1") == 1
    assert not any(name.startswith("Neck_") for name in names)


@pytest.mark.parametrize(
    ("suffix", "options", "message"),
    [
        (".glb", {"engine": "quake"}, "unreal, unity, godot, maya, blender"),
        (".glb", {"humanoid_names": True}, "--for unreal"),
        (".bvh", {"engine": "unity"}, r"\.glb, \.fbx have it"),
        (".mp4", {"animation_only": True}, r"\.glb, \.fbx, \.usdz, \.usd have it"),
    ],
)
def test_what_does_not_go_together_is_said(suffix: str, options: dict, message: str, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=message):
        save_motion(CLIP, tmp_path / f"x{suffix}", ExportOptions(**options), FLAT)
