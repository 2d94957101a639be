"""USD: read back by OpenUSD's own skinning, validated by its validators, and a clear sentence where it is not there."""

import importlib.util
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from runtime.errors import FileError, UsageError
from runtime.formats.bvh_clip import save_bvh
from runtime.formats.prepare import ExportOptions
from runtime.formats.reference import open_take
from runtime.formats.table import check_export, save_motion
from runtime.skeleton import SPORT_SKELETON
from runtime.takes.clip import Clip
from runtime.takes.metadata import PromptEvent
from runtime.terrain.height_map import Terrain
from tests.helpers.blender_addon import needs_blender, run_in_blender
from tests.helpers.foreign_rigs import RIGS
from tests.helpers.glb_playback import play, skinned
from tests.helpers.gltf_characters import character_glb, join_glb, split_glb
from tests.helpers.walker import walk

CLIP = Clip("a walk", 60.0, *walk(21), prompts=(PromptEvent(0.0, "proud"),))
needs_usd = pytest.mark.skipif(importlib.util.find_spec("pxr") is None, reason="needs the extra [usd]")
MILLIMETRE_M = 1e-3


def test_without_the_library_the_sentence_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(UsageError, match=r"pip install usd-core"):
        check_export(Path("take.usdz"), ExportOptions())


@needs_usd
@pytest.mark.parametrize(
    ("name", "suffix"),
    [("mannequin", ".usd"), ("mixamo", ".usd"), ("vrm", ".usdz"), ("centimetres", ".usdz")],
)
def test_openusd_shows_the_same_skin_as_the_glb(name: str, suffix: str, tmp_path: Path) -> None:
    from pxr import Usd, UsdGeom, UsdSkel

    source = None if name == "mannequin" else RIGS[name](tmp_path / "rig.glb")
    options = ExportOptions(fps=30.0, character=source)
    save_motion(CLIP, tmp_path / f"take{suffix}", options, Terrain.flat())
    save_motion(CLIP, tmp_path / "take.glb", replace(options, engine="blender"), Terrain.flat())
    played, stage = play(tmp_path / "take.glb"), Usd.Stage.Open(str(tmp_path / f"take{suffix}"))
    assert stage.GetTimeCodesPerSecond() == 30.0
    assert stage.GetEndTimeCode() == len(played.times) - 1
    assert UsdGeom.GetStageMetersPerUnit(stage) == 1.0
    cache, root = UsdSkel.Cache(), UsdSkel.Root(stage.GetDefaultPrim())
    cache.Populate(root, Usd.PrimDefaultPredicate)
    (binding, *_) = cache.ComputeSkelBindings(root, Usd.PrimDefaultPredicate)
    query, (target, *_) = cache.GetSkelQuery(binding.GetSkeleton()), binding.GetSkinningTargets()
    joints = [str(joint).rpartition("/")[2] for joint in query.GetJointOrder()]
    for frame in (0, 5, len(played.times) - 1):
        found = query.ComputeJointWorldTransforms(UsdGeom.XformCache(frame))
        for joint, world in played.joints().items():
            place = found[joints.index(joint.replace(":", "_").replace(" ", "_"))].ExtractTranslation()
            assert np.abs(np.array(place) - world[frame, :3, 3]).max() < 0.1 * MILLIMETRE_M, joint
        points = UsdGeom.Mesh(target.GetPrim()).GetPointsAttr().Get()
        target.ComputeSkinnedPoints(query.ComputeSkinningTransforms(frame), points, frame)
        assert np.abs(np.array(points) - skinned(played, frame)).max() < 0.1 * MILLIMETRE_M


@needs_usd
@pytest.mark.parametrize("suffix", [".usd", ".usdz"])
def test_the_validators_find_nothing(suffix: str, tmp_path: Path) -> None:
    from pxr import Usd, UsdShade, UsdValidation

    path = tmp_path / f"take{suffix}"
    options = ExportOptions(character=RIGS["vrm"](tmp_path / "rig.glb"), with_ground=True, ground_root=True)
    save_motion(CLIP, path, options, Terrain.flat())
    validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
    assert len(validators) > 20
    stage = Usd.Stage.Open(str(path))
    errors = UsdValidation.ValidationContext(validators).Validate(stage)
    assert [(error.GetName(), error.GetMessage()) for error in errors] == []
    shaders = [(prim, UsdShade.Shader(prim).GetIdAttr().Get()) for prim in stage.Traverse()]
    textures = [prim for prim, kind in shaders if kind == "UsdUVTexture"]
    assert bool(textures) == (suffix == ".usdz")
    assert all(prim.GetAttribute("inputs:file").Get().resolvedPath for prim in textures)
    (marker,) = json.loads(stage.GetDefaultPrim().GetCustomDataByKey("sport")["markers"])
    assert marker["name"] == "proud"


@needs_usd
def test_the_motion_alone_has_a_skeleton_and_no_mesh(tmp_path: Path) -> None:
    from pxr import Usd

    save_motion(CLIP, tmp_path / "take.usd", ExportOptions(animation_only=True), Terrain.flat())
    stage = Usd.Stage.Open(str(tmp_path / "take.usd"))
    kinds = [str(prim.GetTypeName()) for prim in stage.Traverse()]
    assert sorted(kinds) == ["SkelAnimation", "SkelRoot", "Skeleton"]


@needs_usd
def test_several_takes_are_variants(tmp_path: Path) -> None:
    """Each selection has the joints of its own file; the first one is chosen, and names of any script stay."""
    from pxr import Usd, UsdSkel

    clips = {"go on": CLIP, "zurück 🎈": replace(CLIP.trim(4, 12), prompts=()), "ไป": CLIP.trim(2, 20)}
    paths = [save_bvh(clip, tmp_path / f"{name}.bvh") for name, clip in clips.items()]
    options = ExportOptions(fps=30.0, with_takes=tuple(paths[1:]))
    save_motion(open_take(paths[0]).clip, tmp_path / "all.usdz", options, Terrain.flat())
    stage = Usd.Stage.Open(str(tmp_path / "all.usdz"))
    variants = stage.GetDefaultPrim().GetVariantSets().GetVariantSet("take")
    assert variants.GetVariantSelection() == "go_on"
    assert set(variants.GetVariantNames()) == {"go_on", "zurück__", "ไป"}
    assert stage.GetEndTimeCode() == 10
    for path, name in zip(paths, ("go_on", "zurück__", "ไป"), strict=True):
        variants.SetVariantSelection(name)
        clip = open_take(path).clip.resampled(30.0)
        cache, root = UsdSkel.Cache(), UsdSkel.Root(stage.GetDefaultPrim())
        cache.Populate(root, Usd.PrimDefaultPredicate)
        (binding, *_) = cache.ComputeSkelBindings(root, Usd.PrimDefaultPredicate)
        query = cache.GetSkelQuery(binding.GetSkeleton())
        joints = [str(joint).rpartition("/")[2] for joint in query.GetJointOrder()]
        for frame in range(len(clip)):
            found = query.ComputeJointSkelTransforms(frame)
            for joint, place in zip(SPORT_SKELETON.names, clip.world()[0][frame], strict=True):
                at = found[joints.index(joint)].ExtractTranslation()
                assert np.abs(np.array(at) - place).max() < 0.1 * MILLIMETRE_M
        assert stage.GetDefaultPrim().GetCustomDataByKey("sport")["frames"] == len(clip)


READER = """
import json, sys
import bpy
bpy.ops.wm.read_factory_settings(use_empty=True)
bpy.context.scene.render.fps = 30
bpy.ops.wm.usd_import(filepath=sys.argv[-2])
rig = next(thing for thing in bpy.data.objects if thing.type == "ARMATURE")
found = []
for frame in (0, 5, 10):
    bpy.context.scene.frame_set(frame)
    found.append({b.name: list((rig.matrix_world @ b.matrix).translation) for b in rig.pose.bones})
json.dump(found, open(sys.argv[-1], "w"))
"""


@needs_usd
@needs_blender
def test_blender_reads_the_same_joints(tmp_path: Path) -> None:
    for ending, engine in ((".usd", None), (".glb", "blender")):
        save_motion(CLIP, tmp_path / f"take{ending}", ExportOptions(fps=30.0, engine=engine), Terrain.flat())
    read = json.loads(run_in_blender(READER, tmp_path, tmp_path / "take.usd"))
    played = play(tmp_path / "take.glb").joints()
    for frame, found in zip((0, 5, 10), read, strict=True):
        for joint, world in played.items():
            x, y, z = world[frame, :3, 3]
            assert np.abs(np.array(found[joint]) - (x, -z, y)).max() < 0.1 * MILLIMETRE_M, joint


@needs_usd
def test_names_of_any_script_stay_unique_and_legible(tmp_path: Path) -> None:
    """Names in Japanese, Thai and Hindi with marks above letters, with a space, of a digit, and one that three joints have; two runs are equal byte by byte."""
    import pygltflib
    from pxr import Usd, UsdSkel

    options, made = ExportOptions(fps=30.0, character=RIGS["mixamo"](tmp_path / "rig.glb")), []
    gltf = pygltflib.GLTF2().load(str(options.character))
    chosen = {
        "LeftFoot": "左足",
        "RightFoot": "右足",
        "LeftHand": "手 左",
        "RightHand": "2右",
        "LeftArm": "แขนซ้าย",
        "RightArm": "दाँया हाथ",
        "Spine1": "Spine",
        "Spine2": "Spine",
    }
    for node in gltf.nodes:
        node.name = next((new for old, new in chosen.items() if node.name.endswith(old)), node.name)
    gltf.save(str(options.character))
    for name in ("a.usdz", "b.usdz"):
        (said,) = save_motion(CLIP, tmp_path / name, options, Terrain.flat())
        made.append((tmp_path / name).read_bytes())
    assert made[0] == made[1]
    assert "joints renamed: mixamorig:" in said
    stage = Usd.Stage.Open(str(tmp_path / "a.usdz"))
    skeleton = next(UsdSkel.Skeleton(prim) for prim in stage.Traverse() if prim.IsA(UsdSkel.Skeleton))
    names = [str(joint).rpartition("/")[2] for joint in skeleton.GetJointsAttr().Get()]
    assert len(set(names)) == len(names)
    assert {"左足", "右足", "手_左", "_2右", "แขนซ้าย", "दाँया_हाथ"} <= set(names)


@needs_usd
@pytest.mark.parametrize(
    ("damage", "message"),
    [
        ("extras", "damaged glTF document"),
        ("view", "buffer of"),
        ("bind", "Singular"),
        ("joint of no weight", ""),
    ],
)
def test_a_damaged_character_is_one_sentence(damage: str, message: str, tmp_path: Path) -> None:
    document, blob = split_glb(character_glb())
    data = bytearray(blob)

    def at(accessor: int) -> int:
        return document["bufferViews"][document["accessors"][accessor]["bufferView"]].get("byteOffset", 0)

    if damage == "extras":
        document["extras"] = float("nan")
    elif damage == "view":
        document["bufferViews"].append({"buffer": 0})
    elif damage == "bind":
        first = at(document["skins"][0]["inverseBindMatrices"])
        data[first : first + 64] = bytes(64)
    else:
        first = at(document["meshes"][0]["primitives"][0]["attributes"]["JOINTS_0"])
        data[first + 2 : first + 4] = b"\xff\x7f"
    (tmp_path / "me.glb").write_bytes(join_glb(document, bytes(data)))
    options = ExportOptions(fps=30.0, character=tmp_path / "me.glb")
    if message:
        with pytest.raises(FileError, match=message):
            save_motion(CLIP, tmp_path / "take.usd", options, Terrain.flat())
    else:
        save_motion(CLIP, tmp_path / "take.usd", options, Terrain.flat())
