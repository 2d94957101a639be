"""The shipped mannequin, skinning, and users' skeletons."""

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest

from runtime import rotations
from runtime.assets import asset_path, character_file
from runtime.character.character import Character, load_character
from runtime.character.joint_map import read_joint_map
from runtime.character.joints import match_names
from runtime.character.skinned_mesh import skin_vertices
from runtime.character.writer import write_character
from runtime.errors import FileError
from runtime.pose import Pose
from runtime.skeleton import REST_HIPS_HEIGHT, SPORT_SKELETON
from tests.helpers import shipped
from tests.helpers.gltf_characters import make_pose, user_character

JOINTS = SPORT_SKELETON.names


@pytest.fixture(scope="module")
def mannequin() -> Character:
    return shipped.mannequin()


def test_mannequin_is_a_bounded_closed_body(mannequin: Character) -> None:
    assert asset_path("character/mannequin.glb").stat().st_size < 2_000_000
    assert 8_000 < len(mannequin.positions) < 25_000
    assert mannequin.joint_names == JOINTS
    assert mannequin.joint_parents == SPORT_SKELETON.parents
    assert abs(mannequin.positions[:, 1].min()) < 2e-3, "the soles stand on y = 0"
    assert 1.6 < mannequin.positions[:, 1].max() < 1.8
    corners = np.unique(np.round(mannequin.positions, 6), axis=0, return_inverse=True)[1].ravel()
    triangles = corners[mannequin.triangles]
    start, end = triangles[:, [0, 1, 2]].ravel(), triangles[:, [1, 2, 0]].ravel()
    edges, twins = (np.sort(a * len(mannequin.positions) + b) for a, b in ((start, end), (end, start)))
    assert np.all(np.diff(edges) > 0), "an edge is used twice in one direction"
    assert np.array_equal(edges, twins), "the surface has a hole"


def test_mannequin_is_mirror_symmetric_with_distinct_sides(mannequin: Character) -> None:
    def keys(points: np.ndarray) -> set[tuple[int, ...]]:
        return set(map(tuple, np.round(points * 1e5).astype(int).tolist()))

    assert keys(mannequin.positions) == keys(mannequin.positions * np.float32([-1, 1, 1]))
    left = mannequin.colors[mannequin.positions[:, 0] > 0.2]
    right = mannequin.colors[mannequin.positions[:, 0] < -0.2]
    assert np.any(left[:, 2] > left[:, 0] + 0.2), "teal on the left"
    assert np.any(right[:, 0] > right[:, 2] + 0.2), "orange on the right"


def test_weights_sum_to_one_and_do_not_bleed(mannequin: Character) -> None:
    assert np.allclose(mannequin.joint_weights.sum(axis=1), 1, atol=1e-5)
    assert mannequin.joint_weights.min() >= 0
    full = np.zeros((len(mannequin.positions), 31))
    np.add.at(full, (np.arange(len(full))[:, None], mannequin.joint_indices), mannequin.joint_weights)
    x, y = mannequin.positions[:, 0], mannequin.positions[:, 1]
    of = {name: full[:, i] for i, name in enumerate(JOINTS)}
    assert np.all(of["RightUpLeg"][x > 0.02] < 0.05), "the right leg moves the left half"
    assert np.all(of["RightLeg"][x > 0] == 0)
    assert np.all(of["LeftArm"][(y < 1.1) | (x < 0.05)] < 0.02), "the arm moves the flank or the middle"
    assert np.all(of["Head"][y > 1.54] > 0.99)
    assert np.all(of["LeftHandIndex1"][x > 0.79] > 0.98)
    assert np.all(of["LThumb"][x > 0.79] < 0.02), "the thumb moves the fingers"
    assert of["LThumb"].max() > 0.95
    assert of["LeftToeBase"].max() > 0.95
    assert np.all(full.sum(axis=0)[[JOINTS.index(n) for n in ("Hips", "Spine", "Spine1", "LeftLeg")]] > 50)


def test_the_walker_is_small_and_on_our_skeleton() -> None:
    walker = load_character(character_file("walker"))
    assert character_file("walker").stat().st_size < 700_000
    assert walker.alignment.native
    assert walker.joint_names == JOINTS
    assert abs(walker.positions[:, 1].min()) < 3e-3, "the soles stand on y = 0"
    assert np.allclose(walker.joint_weights.sum(axis=1), 1, atol=1e-5)


@pytest.mark.parametrize("seed", range(4))
def test_skin_matrices_are_forward_kinematics(mannequin: Character, seed: int) -> None:
    pose = make_pose(seed)
    matrices = mannequin.skin_matrices(pose)
    assert matrices.shape == (31, 4, 4)
    assert matrices.dtype == np.float32
    rest = mannequin.rest_world[:, :, 3]
    assert np.allclose(np.einsum("kij,kj->ki", matrices, rest)[:, :3], pose.positions, atol=1e-5)
    assert np.allclose(matrices[:, :3, :3], rotations.to_matrix(pose.world_rotations), atol=1e-5)


def test_hanging_arms_keep_their_volume(mannequin: Character) -> None:
    local = rotations.identity((31,)).astype(np.float64)
    for side, sign in (("Left", -1.0), ("Right", 1.0)):
        angle = np.deg2rad(78 * sign)
        local[JOINTS.index(side + "Arm")] = rotations.from_axis_angle(np.array([0, 0, 1.0]), angle)
    hips = np.array([0.0, REST_HIPS_HEIGHT, 0.0])
    positions, world = SPORT_SKELETON.forward_kinematics(hips, local)
    pose = Pose(hips, local, positions, world, np.zeros(4), hips * (1, 0, 1), 0.0)
    posed = skin_vertices(mannequin, mannequin.skin_matrices(pose))
    assert _volume(posed, mannequin.triangles) > 0.97 * _volume(mannequin.positions, mannequin.triangles)


def _volume(v: np.ndarray, t: np.ndarray) -> float:
    return float(np.einsum("ij,ij->", v[t[:, 0]], np.cross(v[t[:, 1]], v[t[:, 2]])) / 6)


@pytest.fixture
def mixamo(tmp_path: Path) -> Character:
    write_character(tmp_path / "user.glb", user_character())
    return load_character(tmp_path / "user.glb")


def joint_positions(character: Character, pose: Pose) -> dict[str, np.ndarray]:
    matrices = character.joint_matrices(pose.positions, pose.world_rotations)
    places = zip(character.joint_names, matrices[:, :3, 3], strict=True)
    return {name.removeprefix("mixamorig:"): place for name, place in places}


def test_mixamo_joints_are_found(mixamo: Character) -> None:
    of = dict(zip(mixamo.joint_names, mixamo.sport_joints, strict=True))
    assert JOINTS[of["mixamorig:Spine2"]] == "Spine1"
    assert JOINTS[of["mixamorig:LeftForeArm"]] == "LeftForeArm"
    assert of["mixamorig:HeadTop_End"] == -1


def test_users_a_pose_is_aligned_with_our_t_pose(mixamo: Character) -> None:
    at = joint_positions(mixamo, make_pose(None))
    arm = rotations.normalize(at["LeftForeArm"] - at["LeftArm"])
    assert np.allclose(arm, (1, 0, 0), atol=1e-4)
    assert np.allclose(rotations.normalize(at["RightHand"] - at["RightForeArm"]), (-1, 0, 0), atol=1e-4)
    assert np.allclose(rotations.normalize(at["LeftFoot"] - at["LeftLeg"]), (0, -1, 0), atol=1e-4)
    legs = np.linalg.norm(at["LeftUpLeg"] - at["LeftLeg"]) + np.linalg.norm(at["LeftLeg"] - at["LeftFoot"])
    assert legs == pytest.approx(0.4118 + 0.4233, abs=1e-3), "scaled from centimetres by leg length"


@pytest.mark.parametrize("seed", range(3))
def test_users_limbs_follow_the_pose(mixamo: Character, seed: int) -> None:
    pose = make_pose(seed)
    at = joint_positions(mixamo, pose)
    for bone, end in (("LeftArm", "LeftForeArm"), ("RightForeArm", "RightHand"), ("LeftUpLeg", "LeftLeg"),
                      ("RightLeg", "RightFoot")):  # fmt: skip
        ours = pose.positions[JOINTS.index(end)] - pose.positions[JOINTS.index(bone)]
        theirs = at[end] - at[bone]
        assert np.allclose(rotations.normalize(theirs), rotations.normalize(ours), atol=1e-4), bone


def test_users_soles_stand_on_the_ground(mixamo: Character) -> None:
    vertices = skin_vertices(mixamo, mixamo.skin_matrices(make_pose(None)))
    assert vertices[:, 1].min() == pytest.approx(0.0, abs=5e-3)


def test_unmapped_joints_keep_their_rest_relative_to_the_parent(mixamo: Character) -> None:
    head, top = (mixamo.joint_names.index("mixamorig:" + n) for n in ("Head", "HeadTop_End"))
    before = np.linalg.inv(mixamo.rest_world[head].astype(float)) @ mixamo.rest_world[top]
    for seed in (None, 1):
        pose = make_pose(seed)
        m = mixamo.joint_matrices(pose.positions, pose.world_rotations).astype(float)
        # centimetres in the joint's own frame
        assert np.allclose(np.linalg.inv(m[head]) @ m[top], before, atol=1e-2)


def test_turned_and_z_up_characters_face_forward(tmp_path: Path) -> None:
    user = user_character()
    turn = np.eye(4)
    # Z up and facing backwards
    turn[:3, :3] = np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]]) @ np.diag([-1, 1, -1])
    world = turn @ user.rest_world
    positions = user.positions @ turn[:3, :3].T
    turned = dataclasses.replace(user, rest_world=world, inverse_bind=np.linalg.inv(world).astype(np.float32),
                                 positions=positions.astype(np.float32))  # fmt: skip
    write_character(tmp_path / "turned.glb", turned)
    write_character(tmp_path / "plain.glb", user)
    pose = make_pose(2)
    turned = load_character(tmp_path / "turned.glb")
    a = skin_vertices(turned, turned.skin_matrices(pose))
    plain = load_character(tmp_path / "plain.glb")
    assert np.allclose(a, skin_vertices(plain, plain.skin_matrices(pose)), atol=1e-3)


@pytest.mark.parametrize(
    "names",
    [
        ("pelvis", "head", "thigh_l", "thigh_r", "calf_l", "calf_r", "foot_l", "foot_r", "upperarm_l", "upperarm_r",
         "lowerarm_l", "lowerarm_r", "hand_l", "hand_r"),
        ("pelvis", "head", "left_hip", "right_hip", "left_knee", "right_knee", "left_ankle", "right_ankle",
         "left_shoulder", "right_shoulder", "left_elbow", "right_elbow", "left_wrist", "right_wrist"),
        ("hips", "head", "leftUpperLeg", "rightUpperLeg", "leftLowerLeg", "rightLowerLeg", "leftFoot", "rightFoot",
         "leftUpperArm", "rightUpperArm", "leftLowerArm", "rightLowerArm", "leftHand", "rightHand"),
        ("J_Bip_C_Hips", "J_Bip_C_Head", "J_Bip_L_UpperLeg", "J_Bip_R_UpperLeg", "J_Bip_L_LowerLeg", "J_Bip_R_LowerLeg",
         "J_Bip_L_Foot", "J_Bip_R_Foot", "J_Bip_L_UpperArm", "J_Bip_R_UpperArm", "J_Bip_L_LowerArm", "J_Bip_R_LowerArm",
         "J_Bip_L_Hand", "J_Bip_R_Hand"),
    ],
)  # fmt: skip
def test_other_naming_conventions(names: tuple[str, ...]) -> None:
    ours = ("Hips", "Head", "LeftUpLeg", "RightUpLeg", "LeftLeg", "RightLeg", "LeftFoot", "RightFoot", "LeftArm",
            "RightArm", "LeftForeArm", "RightForeArm", "LeftHand", "RightHand")  # fmt: skip
    found = match_names(names)[0]
    assert {joint: names[i] for joint, i in found.items()} == dict(zip(ours, names, strict=True))


def test_joint_map_names_what_tables_do_not_know(tmp_path: Path) -> None:
    user = user_character()
    order = [n.removeprefix("mixamorig:") for n in user.joint_names]
    odd = dataclasses.replace(user, joint_names=tuple(f"b{i}" for i in range(len(order))))
    write_character(tmp_path / "odd.glb", odd)
    mapping = {joint: f"b{i}" for joint, i in match_names(order)[0].items()}
    (tmp_path / "map.json").write_text(json.dumps(mapping))
    loaded = load_character(tmp_path / "odd.glb", read_joint_map(tmp_path / "map.json"))
    assert np.array_equal(loaded.sport_joints, load_with_names(tmp_path, user).sport_joints)
    with pytest.raises(FileError, match="nobody"):
        load_character(tmp_path / "odd.glb", {"Hips": "nobody"})
    (tmp_path / "map.json").write_text('{"LeftWing": "b1"}')
    with pytest.raises(FileError, match="LeftWing"):
        read_joint_map(tmp_path / "map.json")


def load_with_names(folder: Path, user: Character) -> Character:
    write_character(folder / "named.glb", user)
    return load_character(folder / "named.glb")
