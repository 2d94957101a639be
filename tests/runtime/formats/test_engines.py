"""Files for engines: unit and scale 1, names of takes and bones, and the motion in them, read by other programs."""

from pathlib import Path

import numpy as np
import pytest
from pygltflib import GLTF2

from runtime.errors import UsageError
from runtime.formats.bvh_clip import save_bvh
from runtime.formats.engines import ENGINES
from runtime.formats.prepare import ExportOptions
from runtime.formats.table import save_motion
from runtime.skeleton import SPORT_SKELETON
from runtime.takes.clip import Clip
from runtime.terrain.height_map import Terrain
from tests.helpers.fbx_playback import play_fbx
from tests.helpers.foreign_rigs import RIGS
from tests.helpers.glb_playback import play, skinned
from tests.helpers.walker import walk

CLIP, FLAT = Clip("proud walk", 30.0, *walk(31)), Terrain.flat()


@pytest.mark.parametrize(("engine", "unit"), [("unreal", 0.01), ("unity", 1.0)])
def test_an_fbx_is_what_its_engine_expects(engine: str, unit: float, tmp_path: Path) -> None:
    path = tmp_path / "take.fbx"
    save_motion(CLIP, path, ExportOptions(fps=30.0, engine=engine, humanoid_names=True), FLAT)
    found = play_fbx(path, 30.0)
    assert found["unit"] == pytest.approx(unit)
    worlds, bones, wanted = found["worlds"]["proud walk"], ENGINES[engine].bones, CLIP.world()[0]
    assert np.abs(np.linalg.norm(worlds[..., :3, :3], axis=-2) - 1.0).max() < 1e-5
    assert found["parents"][bones["Hips"]] == bones["Root"]
    for name, bone in bones.items():
        if name != "Root":
            away = worlds[:, found["nodes"].index(bone), :3, 3] * unit - wanted[:, SPORT_SKELETON.index(name)]
            assert np.linalg.norm(away, axis=-1).max() < 1e-4, name


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
    chosen = {"engine": "unreal", "humanoid_names": True, "animation_only": True}
    options = ExportOptions(fps=30.0, with_takes=(other, other), **chosen)
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
