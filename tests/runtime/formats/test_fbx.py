"""FBX: read back by ufbx, and by Blender where there is one."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from runtime import rotations
from runtime.assets import asset_path
from runtime.character.character import Character, load_character
from runtime.errors import FileError
from runtime.formats import glb_skeleton
from runtime.formats.bvh_clip import load_clip_bvh, save_bvh
from runtime.formats.glb import MANNEQUIN
from runtime.formats.prepare import ExportOptions, prepare
from runtime.formats.reference import open_take
from runtime.formats.table import save_motion
from runtime.takes.clip import Clip
from runtime.takes.metadata import PromptEvent
from runtime.terrain.height_map import Terrain
from tests.helpers.blender_addon import needs_blender, run_in_blender
from tests.helpers.fbx_playback import play_fbx
from tests.helpers.foreign_rigs import RIGS, sparse_rig
from tests.helpers.glb_playback import play, skinned
from tests.helpers.gltf_characters import join_glb, split_glb
from tests.helpers.walker import walk

pytest.importorskip("ufbx", reason="needs the extra [characters]")
CLIP = Clip("walk", 60.0, *walk(61))
FLAT = Terrain.flat()
READER = """
import json, sys
import bpy
source, frames, fps, target = sys.argv[-4], int(sys.argv[-3]), float(sys.argv[-2]), sys.argv[-1]
bpy.ops.wm.read_factory_settings(use_empty=True)
scene = bpy.context.scene
if source.endswith("fbx"):
    bpy.ops.import_scene.fbx(filepath=source)
else:
    scene.render.fps = round(fps)
    bpy.ops.import_scene.gltf(filepath=source)
rig = next(thing for thing in bpy.data.objects if thing.type == "ARMATURE")
takes = {}
for action in bpy.data.actions:
    rig.animation_data.action = action
    if hasattr(action, "slots"):
        rig.animation_data.action_slot = action.slots[0]
    first, last = action.frame_range
    bones = []
    for k in range(0, frames, 6):
        at = first + k / fps * scene.render.fps  # the importer's own keys: it leaves the base out
        scene.frame_set(int(at), subframe=at - int(at))
        bones.append({b.name: [list(row) for row in rig.matrix_world @ b.matrix] for b in rig.pose.bones})
    takes[action.name.split("|")[-1]] = {"bones": bones, "last": (last - first) / scene.render.fps}
meshes = [thing for thing in bpy.data.objects if thing.type == "MESH" and thing.modifiers]
json.dump({"takes": takes, "images": [image.size[0] for image in bpy.data.images], "meshes": len(meshes),
           "shapes": [key.name for mesh in meshes if mesh.data.shape_keys for key in mesh.data.shape_keys.key_blocks],
           "note": rig.get("sport"), "materials": [m.name for m in bpy.data.materials]}, open(target, "w"))
"""
UPRIGHT = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])  # Blender has Z up


def in_blender(path: Path, frames: int, fps: float) -> dict:
    return json.loads(run_in_blender(READER, path.parent, path, frames, repr(fps)))


def shown(character: Character, clip: Clip) -> np.ndarray:
    """World matrices `(T, joints, 4, 4)` of a character's joints as the window shows them."""
    return character.joint_matrices(*character.adapted(*clip.world(), clip.contacts)).astype(float)


def three_takes(folder: Path) -> dict[str, Path]:
    """Takes of several names, lengths and rates."""
    clips = {"walk": CLIP, "grün größer": replace(CLIP.trim(0, 40), name="grün größer")}
    clips["at 25"] = replace(CLIP.resampled(25.0), name="at 25")
    return {name: save_bvh(clip, folder / f"{name}.bvh", clip.fps) for name, clip in clips.items()}


@pytest.mark.parametrize(
    ("name", "engine"),
    [
        *((name, "blender") for name in ("mannequin", *RIGS)),
        ("mannequin", "unreal"),
        ("centimetres", "unreal"),
    ],
)
def test_ufbx_shows_the_joints_and_the_skin_of_the_glb(name: str, engine: str, tmp_path: Path) -> None:
    source = None if name == "mannequin" else RIGS[name](tmp_path / "rig.glb")
    options = ExportOptions(fps=30.0, character=source, engine=engine)
    for suffix in ("glb", "fbx"):
        save_motion(CLIP, tmp_path / f"take.{suffix}", options, FLAT)
    glb, found = play(tmp_path / "take.glb"), play_fbx(tmp_path / "take.fbx", 30.0)
    assert found["fps"] == 30.0
    worlds = found["worlds"]["walk"]
    worlds[..., :3, 3] *= found["unit"]
    for joint, world in glb.joints().items():
        assert joint in found["limbs"]
        assert np.abs(worlds[:, found["nodes"].index(joint)] - world).max() < 1e-5, joint
    points = skinned(glb, -1)
    vertices = found["worlds"]["vertices walk"][: len(points)] * found["unit"]
    assert np.abs(vertices - points).max() < 1e-5
    assert len(found["images"]) == {"mannequin": 0, "vrm": 2}.get(name, 1)
    assert all(found["images"].values())
    if name == "mannequin":  # six colours of vertices are materials, which every program shows
        assert len(found["materials"]) == 6


def test_a_turning_walk_stays_steady_between_frames(tmp_path: Path) -> None:
    """Angles have no jumps: half a frame later a joint is between its places."""
    hips, local, contacts = walk(61)
    local[:, 0] = rotations.multiply(rotations.from_yaw(np.linspace(0.0, 2.0 * np.pi, 61)), local[:, 0])
    save_motion(Clip("walk", 60.0, hips, local, contacts), tmp_path / "take.fbx", ExportOptions(), FLAT)
    places = play_fbx(tmp_path / "take.fbx", 120.0)["worlds"]["walk"][..., :3, 3]
    between = 0.5 * (places[:-2:2] + places[2::2])
    assert np.linalg.norm(places[1:-1:2] - between, axis=-1).max() < 5e-3


@pytest.mark.parametrize("rate", [30.0, 60000 / 1001, 12.5])
def test_takes_of_any_name_and_rate_are_all_there(rate: float, tmp_path: Path) -> None:
    files = list(three_takes(tmp_path).values())
    options = ExportOptions(fps=rate, engine="unreal", with_takes=tuple(files[1:]), animation_only=True)
    save_motion(load_clip_bvh(files[0]), tmp_path / "takes.fbx", options, FLAT)
    found, character = play_fbx(tmp_path / "takes.fbx", rate), load_character(asset_path(MANNEQUIN))
    assert found["fps"] == pytest.approx(rate, abs=1e-3)
    assert list(found["ends"]) == ["walk", "grün größer", "at 25"]
    order = [found["nodes"].index(joint) for joint in character.joint_names]
    for (name, end), path in zip(found["ends"].items(), files, strict=True):
        take = prepare(load_clip_bvh(path), replace(options, with_takes=()), FLAT).clip
        assert end == pytest.approx((len(take) - 1) / rate, abs=1e-9)
        places = 0.01 * found["worlds"][name][:, order][..., :3, 3]
        assert np.abs(places - shown(character, take)[..., :3, 3]).max() < 1e-4, name


def test_every_take_of_a_file_comes_back_as_it_was(tmp_path: Path) -> None:
    """With its rate, motion, prompts and contacts; nothing of the first take is told of another."""
    other = Clip("other", 60.0, *walk(41, speed_share=0.5), prompts=(PromptEvent(0.2, "tired"),))
    options = ExportOptions(fps=60000 / 1001, with_takes=(save_bvh(other, tmp_path / "other.bvh", 60.0),))
    save_motion(CLIP, tmp_path / "takes.fbx", options, FLAT)
    for name, clip in (("walk", CLIP), ("other", other)):
        read, wanted = open_take(tmp_path / "takes.fbx", name).clip, prepare(clip, options, FLAT).clip
        assert (read.fps, len(read)) == (wanted.fps, len(wanted))
        assert [event.prompt for event in read.prompts] == [event.prompt for event in wanted.prompts]
        assert np.abs(read.contacts - wanted.contacts).max() < 1e-3
        assert np.abs(read.world()[0] - wanted.world()[0]).max() < 1e-3


def test_notes_ground_and_root_are_nodes(tmp_path: Path) -> None:
    options = ExportOptions(ground_root=True, with_ground=True, rest_frame=True)
    save_motion(CLIP, tmp_path / "take.fbx", options, FLAT)
    found = play_fbx(tmp_path / "take.fbx", 60.0)
    assert found["parents"]["Hips"] == "Root"
    assert found["parents"]["Ground"] == found["parents"]["Armature"]
    assert "Ground" in found["materials"]
    note = json.loads(found["notes"]["Armature"])
    assert (note["name"], note["rest_frame"], len(found["worlds"]["walk"])) == ("walk", True, 62)


def test_shapes_and_many_colours_of_vertices_stay(tmp_path: Path) -> None:
    """A sparse morph target, and colours that are too many for materials; our own reader finds them again."""
    document, blob = split_glb(sparse_rig(tmp_path / "rig.glb").read_bytes())
    primitive = document["meshes"][0]["primitives"][0]
    count = document["accessors"][primitive["attributes"]["POSITION"]]["count"]
    colors = np.random.default_rng(0).uniform(size=(count, 4)).astype(np.float32)
    blob += b"\0" * (-len(blob) % 4)
    document["bufferViews"].append({"buffer": 0, "byteOffset": len(blob), "byteLength": colors.nbytes})
    view = len(document["bufferViews"]) - 1
    document["accessors"].append({"bufferView": view, "componentType": 5126, "count": count, "type": "VEC4"})
    primitive["attributes"]["COLOR_0"] = len(document["accessors"]) - 1
    del primitive["material"]
    document["meshes"][0]["extras"] = {"targetNames": ["lächeln"]}
    document["buffers"] = [{"byteLength": len(blob) + colors.nbytes}]
    (tmp_path / "rig.glb").write_bytes(join_glb(document, blob + colors.tobytes()))
    save_motion(CLIP, tmp_path / "take.fbx", ExportOptions(character=tmp_path / "rig.glb"), FLAT)
    assert play_fbx(tmp_path / "take.fbx", 60.0)["shapes"] == ["lächeln"]
    own, read = (load_character(tmp_path / name) for name in ("rig.glb", "take.fbx"))
    assert sorted(own.joint_names) == sorted(read.joint_names)
    for mesh in (own, read):
        assert len(np.unique(mesh.colors.round(3), axis=0)) == len(np.unique(colors[:, :3].round(3), axis=0))
    assert np.abs(np.sort(own.colors, axis=0) - np.sort(read.colors, axis=0)).max() < 1e-3
    document["accessors"][primitive["targets"][0]["POSITION"]]["sparse"]["count"] = 10**6
    (tmp_path / "rig.glb").write_bytes(join_glb(document, blob + colors.tobytes()))
    with pytest.raises(FileError, match="a morph target"):
        save_motion(CLIP, tmp_path / "bad.fbx", ExportOptions(character=tmp_path / "rig.glb"), FLAT)
    assert not (tmp_path / "bad.fbx").exists()


@needs_blender
@pytest.mark.parametrize("suffix", [".fbx", ".glb"])
@pytest.mark.parametrize("name", ["mannequin", *RIGS])
def test_blender_reads_the_same_joints(name: str, suffix: str, tmp_path: Path) -> None:
    source = asset_path(MANNEQUIN) if name == "mannequin" else RIGS[name](tmp_path / "rig.glb")
    options = ExportOptions(fps=30.0, character=source, fit_to_motion=True)
    path = tmp_path / f"take{suffix}"
    save_motion(CLIP, path, options, FLAT)
    take, character = prepare(CLIP, options, FLAT).clip, load_character(source)
    found = in_blender(path, len(take), 30.0)
    assert found["materials"]
    assert found["meshes"] == (2 if name == "vrm" else 1)
    textured = 0 if name == "mannequin" else found["meshes"]
    assert len(found["images"]) <= textured, "the importer of some versions makes one of two equal images"
    assert set(found["images"]) == ({8} if textured else set())
    (read,) = found["takes"].values()
    assert read["last"] == pytest.approx((len(take) - 1) / 30.0, abs=1e-4)
    names = list(character.joint_names)
    theirs = UPRIGHT @ np.array([[bones[n] for n in names] for bones in read["bones"]])
    ours = shown(character, take)[::6]
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
        save_motion(CLIP, source, options, FLAT)
    options = ExportOptions(fps=30.0, character=source, fit_to_motion=True, ground_root=True)
    save_motion(CLIP, tmp_path / "take.fbx", options, FLAT)
    character = load_character(source)
    places = shown(character, prepare(CLIP, options, FLAT).clip)[::6, character.joint_names.index("Hips")]
    (read,) = in_blender(tmp_path / "take.fbx", len(places) * 6 - 5, 30.0)["takes"].values()
    theirs = UPRIGHT @ np.array([bones["Hips"] for bones in read["bones"]])
    assert np.linalg.norm(theirs[:, :3, 3] - places[:, :3, 3], axis=-1).max() < 1e-3


@needs_blender
@pytest.mark.parametrize("rate", [30.0, 30000 / 1001, 60000 / 1001])
def test_blender_reads_every_take(rate: float, tmp_path: Path) -> None:
    """Three takes, the shapes and the note of one file."""
    files, source = three_takes(tmp_path), sparse_rig(tmp_path / "rig.glb")
    options = ExportOptions(fps=rate, character=source, fit_to_motion=True, with_takes=(*files.values(),)[1:])
    save_motion(load_clip_bvh(files["walk"]), tmp_path / "takes.fbx", options, FLAT)
    found, character = in_blender(tmp_path / "takes.fbx", 19, rate), load_character(source)
    assert found["shapes"] == ["Basis", "shape_0"]
    assert json.loads(found["note"])["name"] == "walk"
    assert set(found["takes"]) == set(files)
    for name, path in files.items():
        take = prepare(load_clip_bvh(path), options, FLAT).clip
        assert found["takes"][name]["last"] == pytest.approx((len(take) - 1) / rate, abs=2e-3)
        for ours, bones in zip(shown(character, take)[:19:6], found["takes"][name]["bones"], strict=True):
            theirs = UPRIGHT @ np.array([bones[joint] for joint in character.joint_names])
            assert np.linalg.norm(theirs[:, :3, 3] - ours[:, :3, 3], axis=-1).max() < 1e-3, name


def test_colours_that_look_alike_are_one_material_and_equal_options_one_file(tmp_path: Path) -> None:
    options = ExportOptions(character=asset_path("character/walker.glb"))
    for name in ("walker.fbx", "again.fbx"):
        save_motion(CLIP.trim(0, 4), tmp_path / name, options, FLAT)
    data = (tmp_path / "walker.fbx").read_bytes()
    assert data.count(b"\x00\x01Material") == 15  # of 55 colours of vertices
    assert data == (tmp_path / "again.fbx").read_bytes()
