"""VRM animation: what a player of VRM avatars makes of it is the take, and one of another program comes in."""

import shutil
from pathlib import Path

import numpy as np
import pytest
from pygltflib import GLTF2

from runtime import rotations
from runtime.formats.options import ExportOptions
from runtime.formats.reference import open_take
from runtime.formats.table import save_motion
from runtime.skeleton import SPORT_SKELETON
from runtime.takes.clip import Clip
from runtime.terrain.height_map import Terrain
from tests.helpers.glb_playback import play
from tests.helpers.walker import walk

OURS = {"hips": "Hips", "spine": "LowerBack", "chest": "Spine", "upperChest": "Spine1", "neck": "Neck", "head": "Head",
        **{f"{s}{bone}": f"{s.capitalize()}{joint}" for s in ("left", "right") for bone, joint in (
            ("UpperLeg", "UpLeg"), ("LowerLeg", "Leg"), ("Foot", "Foot"), ("Toes", "ToeBase"), ("Shoulder", "Shoulder"),
            ("UpperArm", "Arm"), ("LowerArm", "ForeArm"), ("Hand", "Hand"))}}  # fmt: skip


@pytest.fixture(scope="module")
def clip() -> Clip:
    """A walk in which every joint turns a little, those that no VRM has too."""
    hips, local, contacts = walk(90)
    waves = np.sin(np.arange(90)[:, None, None] / 9 + np.arange(93).reshape(31, 3))
    turn = rotations.from_rotation_vector(0.03 * waves)
    return Clip("a walk", 60.0, hips, rotations.multiply(local, turn).astype(np.float32), contacts)


@pytest.fixture
def written(clip: Clip, tmp_path: Path) -> Path:
    save_motion(clip, tmp_path / "take.vrma", ExportOptions(fps=30.0), Terrain.flat())
    return tmp_path / "take.vrma"


def test_a_player_turns_every_bone_as_the_take_does(clip: Clip, written: Path) -> None:
    """The specification: the rest pose is a T-pose on the ground, only the hips are moved, and nothing is scaled."""
    played = play(Path(shutil.copy(written, written.with_suffix(".glb"))))  # it is one
    world = clip.resampled(30.0).world()[1]
    gltf = played.gltf
    extension = gltf.extensions["VRMC_vrm_animation"]
    assert (extension["specVersion"], gltf.extensionsUsed) == ("1.0", ["VRMC_vrm_animation"])
    bones = {bone: entry["node"] for bone, entry in extension["humanoid"]["humanBones"].items()}
    assert bones.keys() == OURS.keys()
    paths = {(channel.target.node, channel.target.path) for channel in gltf.animations[0].channels}
    assert [node for node, path in paths if path != "rotation"] == [bones["hips"]]
    assert all(node.rotation in (None, [0, 0, 0, 1]) and node.scale is None for node in gltf.nodes)
    assert gltf.nodes[bones["hips"]].translation[1] == pytest.approx(1.0, abs=0.05)
    rest = {bone: np.array(gltf.nodes[bones[bone]].translation) for bone in ("leftLowerArm", "leftLowerLeg")}
    assert rest["leftLowerArm"][0] > 0.2
    assert rest["leftLowerLeg"][1] < -0.3
    for bone, node in bones.items():
        turns = rotations.from_matrix(played.worlds[:, node, :3, :3])
        wanted = world[:, SPORT_SKELETON.index(OURS[bone])]
        assert rotations.angle_between(turns, wanted).max() < 1e-3, bone
        parents = [k for k, entry in enumerate(gltf.nodes) if node in (entry.children or [])]
        assert bone == "hips" or parents


def test_it_is_a_take_again(clip: Clip, written: Path) -> None:
    """Joints between two bones turn with the lower one: a hip or head is a little off its place."""
    opened = open_take(written)
    assert opened.reference is None
    assert np.abs(opened.clip.world()[0] - clip.resampled(30.0).world()[0]).max() < 0.02
    np.testing.assert_allclose(opened.clip.contacts, clip.resampled(30.0).contacts, atol=1e-4)


def test_one_of_another_program_is_known_by_its_bones(clip: Clip, written: Path) -> None:
    gltf = GLTF2().load_binary(str(written))
    gltf.animations[0].extras, gltf.scenes[0].extras = {}, {}
    for number, node in enumerate(gltf.nodes):
        node.name = f"โหนด {number}"
    gltf.save_binary(str(written))
    opened = open_take(written)
    assert opened.reference is not None
    ours, theirs = (c.world()[0] for c in (clip.resampled(30.0), opened.clip))
    for above, below in (("LeftArm", "LeftForeArm"), ("RightUpLeg", "RightLeg"), ("LeftLeg", "LeftFoot")):
        a, b = SPORT_SKELETON.index(above), SPORT_SKELETON.index(below)
        assert np.abs((theirs[:, b] - theirs[:, a]) - (ours[:, b] - ours[:, a])).max() < 1e-3
