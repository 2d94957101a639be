"""A take as GLB: the character's own mesh, skin and materials, and joints where our kinematics puts them."""

import os
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image
from pygltflib import GLTF2

from runtime import rotations
from runtime.assets import asset_path
from runtime.character.character import load_character
from runtime.character.glb_buffer import GlbBuffer
from runtime.character.read import open_gltf
from runtime.character.skinned_mesh import skin_vertices
from runtime.formats.glb import MANNEQUIN, save_glb
from runtime.formats.prepare import ExportOptions, prepare
from runtime.skeleton import SPORT_SKELETON
from runtime.takes.clip import Clip
from runtime.takes.metadata import PromptEvent
from runtime.terrain.library import load_terrain
from tests.helpers.foreign_rigs import RIGS, mixamo_rig
from tests.helpers.glb_playback import play, read_accessor
from tests.helpers.walker import walk

CHARACTERS = ("mannequin", *RIGS)
HILLS = load_terrain("hills")


@pytest.fixture(scope="module")
def clip() -> Clip:
    """A walk that turns, over hills, with arms that move."""
    hips, local, contacts = walk(90, drift=(0.3, 0.0), terrain=HILLS)
    axis = np.tile([0.2, 0.9, 0.3], (90, 31, 1)) / np.linalg.norm([0.2, 0.9, 0.3])
    turn = rotations.from_axis_angle(axis, 0.4 * np.sin(np.arange(90)[:, None] / 20 + np.arange(31)))
    local = rotations.multiply(local, turn).astype(np.float32)
    gaits = np.repeat([1, 2], 45).astype(np.int8)
    prompts = (PromptEvent(0.0, "a proud queen"), PromptEvent(0.8, "drunk", 0.5))
    return Clip("walk", 60.0, hips, local, contacts, prompts=prompts, terrain="hills", gaits=gaits)


@pytest.fixture(scope="module", params=CHARACTERS)
def source(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    if request.param == "mannequin":
        return asset_path(MANNEQUIN)
    path: Path = RIGS[request.param](tmp_path_factory.mktemp("rigs") / f"{request.param}.glb")
    return path


def export(clip: Clip, path: Path, source: Path, **options: object) -> tuple:
    chosen = ExportOptions(character=source, fit_to_motion=True, **options)  # type: ignore[arg-type]
    take = prepare(clip, chosen, HILLS)
    save_glb(take, path, chosen, HILLS)
    return take, play(path)


def expected(take, source: Path) -> dict[str, np.ndarray]:
    character = load_character(source)
    matrices = character.joint_matrices(*character.adapted(*take.clip.world(), take.clip.contacts))
    return dict(zip(character.joint_names, matrices.swapaxes(0, 1), strict=True))


@pytest.mark.parametrize("fps", [60.0, 30.0])
def test_joints_are_where_our_kinematics_puts_them(
    clip: Clip, source: Path, tmp_path: Path, fps: float
) -> None:
    take, played = export(clip, tmp_path / "take.glb", source, fps=fps)
    assert len(played.times) == len(take.clip) == (90 if fps == 60 else 45)
    assert np.allclose(played.times, np.arange(len(played.times)) / fps, atol=1e-5)
    for skin in range(len(played.gltf.skins)):
        found = played.joints(skin)
        for name, wanted in expected(take, source).items():
            distance = np.linalg.norm(found[name][:, :3, 3] - wanted[:, :3, 3], axis=-1)
            assert distance.max() < 1e-4, f"{name}: {distance.max() * 1000:.3f} mm"
            assert np.abs(found[name] - wanted).max() < 1e-3, name


def test_mesh_skin_materials_and_textures_are_the_characters_own(
    clip: Clip, source: Path, tmp_path: Path
) -> None:
    _, played = export(clip, tmp_path / "take.glb", source, ground_root=True)
    scene = trimesh.load(str(tmp_path / "take.glb"))
    assert sum(len(g.vertices) for g in scene.geometry.values()) > 100
    before, after = trimesh.load(str(source)), scene
    assert sorted(before.geometry) == sorted(after.geometry)
    for name, mesh in before.geometry.items():
        other = after.geometry[name]
        assert np.array_equal(mesh.vertices, other.vertices)
        assert np.array_equal(mesh.faces, other.faces)
        picture = getattr(mesh.visual.material, "baseColorTexture", None)
        assert (picture is None) == ("mannequin" in source.name)
        if picture is not None:
            assert np.array_equal(np.asarray(picture), np.asarray(other.visual.material.baseColorTexture))
        assert mesh.visual.material.name == other.visual.material.name
    for node in played.gltf.nodes:
        if node.mesh is not None:
            assert node.skin is not None
            primitive = played.gltf.meshes[node.mesh].primitives[0]
            weights = read_accessor(played.gltf, primitive.attributes.WEIGHTS_0)
            assert np.allclose(weights.sum(1), 1.0, atol=1e-5)


def test_weights_that_do_not_add_up_to_one_do_in_the_export(clip: Clip, tmp_path: Path) -> None:
    source = mixamo_rig(tmp_path / "rig.glb")
    loose = GlbBuffer.of_file(open_gltf(source))
    for mesh in loose.gltf.meshes:
        for primitive in mesh.primitives:
            values = read_accessor(GLTF2().load(str(source)), primitive.attributes.WEIGHTS_0)
            primitive.attributes.WEIGHTS_0 = loose.add(1.04 * values.astype(np.float32))
    loose.save(tmp_path / "loose.glb")
    _, played = export(clip, tmp_path / "take.glb", tmp_path / "loose.glb")
    for mesh in played.gltf.meshes:
        weights = read_accessor(played.gltf, mesh.primitives[0].attributes.WEIGHTS_0)
        assert np.allclose(weights.sum(1), 1.0, atol=1e-5)


def test_the_skinned_mesh_moves_as_on_the_screen(clip: Clip, source: Path, tmp_path: Path) -> None:
    take, played = export(clip, tmp_path / "take.glb", source, ground_root=True, at_origin=True)
    character = load_character(source)
    ours = skin_vertices(character, character.skin_matrices(take.clip.pose(80)))
    theirs = []
    for node in played.gltf.nodes:
        if node.skin is None:
            continue
        attributes = played.gltf.meshes[node.mesh].primitives[0].attributes
        skin = played.gltf.skins[node.skin]
        inverse = read_accessor(played.gltf, skin.inverseBindMatrices).reshape(-1, 4, 4).transpose(0, 2, 1)
        matrices = played.worlds[80, skin.joints] @ inverse
        joints, weights = (read_accessor(played.gltf, i) for i in (attributes.JOINTS_0, attributes.WEIGHTS_0))
        points = read_accessor(played.gltf, attributes.POSITION)
        points = np.pad(points, ((0, 0), (0, 1)), constant_values=1.0)
        theirs.append(np.einsum("vj,vjik,vk->vi", weights, matrices[joints], points)[:, :3])
    assert np.abs(np.concatenate(theirs) - ours).max() < 1e-3


def test_the_root_joint_goes_over_the_ground_and_the_hips_hang_from_it(
    clip: Clip, source: Path, tmp_path: Path
) -> None:
    take, played = export(clip, tmp_path / "take.glb", source, ground_root=True)
    own = "root" in expected(take, source)
    name = "root" if own else "Root"
    at = played.joints()[name]
    assert np.allclose(at[:, :3, 3], take.root.positions, atol=1e-4)
    ground = HILLS.height(at[:, 0, 3], at[:, 2, 3])
    assert np.abs(at[:, 1, 3] - ground).max() < 0.05, "smoothed, but on the hill"
    facing = np.unwrap(np.arctan2(at[:, 0, 2], at[:, 2, 2]))
    up_is_z = abs(at[0, 1, 2]) > 1e-3
    if not (own or up_is_z):
        assert np.allclose(facing - facing[0], take.root.yaw - take.root.yaw[0], atol=1e-3)
    for joint, wanted in expected(take, source).items():
        if joint != "root":
            assert np.abs(played.joints()[joint][:, :3, 3] - wanted[:, :3, 3]).max() < 1e-3, joint
    node = next(n for n in played.gltf.nodes if n.name == name)
    assert any("ips" in played.gltf.nodes[c].name or played.gltf.nodes[c].name in ("pelvis", "J000")
               for c in node.children)  # fmt: skip


def test_the_rest_pose_comes_first_where_the_take_begins(clip: Clip, source: Path, tmp_path: Path) -> None:
    _, played = export(clip, tmp_path / "take.glb", source, rest_frame=True, at_origin=True)
    assert len(played.times) == 91
    plain = load_character(source)
    rest = plain.rest_world.astype(float)
    space = plain.alignment.basis[0] @ np.linalg.inv(rest[0, :3, :3])
    names = list(plain.joint_names)
    first = np.stack([played.joints()[n][0] for n in names])
    rest_points = rest[:, :3, 3] @ space.T
    assert np.allclose(first[:, :3, 3] - first[0, :3, 3], rest_points - rest_points[0], atol=1e-4)
    hips = first[list(plain.sport_joints).index(0), :3, 3]
    assert np.allclose(hips[[0, 2]], 0.0, atol=1e-4)
    if names == list(SPORT_SKELETON.names):
        assert hips[1] == pytest.approx(1.0, abs=0.05)


def test_markers_name_prompts_and_gaits(clip: Clip, source: Path, tmp_path: Path) -> None:
    _, played = export(clip, tmp_path / "take.glb", source, fps=30.0, rest_frame=True)
    for extras in (played.gltf.animations[0].extras, played.gltf.scenes[0].extras):
        marks = [(m["kind"], m["name"], m["frame"]) for m in extras["sport"]["markers"]]
        assert marks == [("gait", "walk", 0), ("prompt", "a proud queen", 1), ("gait", "jog", 24),
                         ("prompt", "drunk", 25)]  # fmt: skip


def test_the_ground_is_a_node_of_its_own_in_the_same_place(clip: Clip, tmp_path: Path) -> None:
    options = {"with_ground": True, "at_origin": True}
    take, played = export(clip, tmp_path / "take.glb", asset_path(MANNEQUIN), **options)
    node = played.gltf.nodes[played.node("Ground")]
    points = read_accessor(played.gltf, played.gltf.meshes[node.mesh].primitives[0].attributes.POSITION)
    turn = rotations.to_matrix(rotations.from_yaw(take.placement.yaw))
    back = (points - np.array(take.placement.offset)) @ turn
    assert np.allclose(HILLS.height(back[:, 0], back[:, 2]), back[:, 1], atol=1e-3)
    hips = played.joints()["Hips"][0, :3, 3]
    assert np.allclose(hips[[0, 2]], 0.0, atol=0.1)
    assert 0.7 < hips[1] < 1.1, "the ground under the first frame is height 0"


def test_an_exported_take_can_be_the_character_of_the_next(clip: Clip, source: Path, tmp_path: Path) -> None:
    """A file that has an animation already loses it, and with it its bytes."""
    export(clip, tmp_path / "first.glb", source)
    character = load_character(source)
    before = character.joint_matrices(*character.adapted(*clip.world(), clip.contacts))
    take, played = export(clip.trim(0, 4), tmp_path / "second.glb", tmp_path / "first.glb", ground_root=True)
    assert len(played.gltf.animations) == 1
    assert len(played.times) == len(take.clip) == 5
    for name, wanted in zip(load_character(source).joint_names, before[:5].swapaxes(0, 1), strict=True):
        if name != "root":
            assert np.abs(played.joints()[name][:, :3, 3] - wanted[:, :3, 3]).max() < 1e-3, name
    export(clip.trim(0, 4), tmp_path / "short.glb", source, ground_root=True)
    sizes = [(tmp_path / f"{name}.glb").stat().st_size for name in ("first", "second", "short")]
    assert sizes[1] < sizes[2] + 30_000
    assert sizes[1] < sizes[0]


def test_files_beside_a_gltf_go_into_the_glb(clip: Clip, tmp_path: Path) -> None:
    gltf = GLTF2.load(str(RIGS["vrm"](tmp_path / "rig.glb")))
    gltf.images[0].uri = "cloth.png"
    view = gltf.bufferViews[gltf.images[0].bufferView]
    blob = gltf.binary_blob()
    (tmp_path / "cloth.png").write_bytes(blob[view.byteOffset : view.byteOffset + view.byteLength])
    gltf.images[0].bufferView = gltf.images[0].mimeType = None
    (tmp_path / "rig.bin").write_bytes(blob)
    gltf.buffers[0].uri = "rig.bin"
    gltf.set_binary_blob(None)
    (tmp_path / "rig.gltf").write_text(gltf.gltf_to_json())
    take, played = export(clip.trim(0, 9), tmp_path / "take.glb", tmp_path / "rig.gltf", ground_root=True)
    assert all(image.uri is None and image.bufferView is not None for image in played.gltf.images)
    assert played.gltf.buffers[0].uri is None
    for name, wanted in expected(take, tmp_path / "rig.gltf").items():
        assert np.abs(played.joints()[name][:, :3, 3] - wanted[:, :3, 3]).max() < 1e-3, name
    before = np.asarray(Image.open(tmp_path / "cloth.png"))
    meshes = trimesh.load(str(tmp_path / "take.glb")).geometry.values()
    pictures = [np.asarray(m.visual.material.baseColorTexture.convert("RGB")) for m in meshes]
    assert any(np.array_equal(picture, before) for picture in pictures)


@pytest.mark.skipif(
    not os.environ.get("SPORT_GLTF_VALIDATOR") or not shutil.which("node"),
    reason="SPORT_GLTF_VALIDATOR names no folder of Khronos' gltf-validator",
)
def test_khronos_validator_finds_no_error(clip: Clip, source: Path, tmp_path: Path) -> None:
    path = tmp_path / "take.glb"
    export(clip, path, source, with_ground=True, ground_root=True, rest_frame=True)
    script = (
        "const v=require(process.argv[1]);v.validateBytes(new Uint8Array(require('fs').readFileSync(process.argv[2])))"
        ".then(r=>{console.log(JSON.stringify(r.issues.messages.filter(m=>m.severity==0)));process.exit(r.issues.numErrors)})"
    )
    done = subprocess.run(
        ["node", "-e", script, os.environ["SPORT_GLTF_VALIDATOR"], str(path)],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
