"""Joints that no table names are found by the tree and the rest pose; four legs are refused; maps by hand are kept."""

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest

from runtime.character.character import joints_of, load_character
from runtime.character.guess import BY_TREE, JointsUnknown, NotUpright
from runtime.character.joint_map import joint_map_path, save_joint_map
from runtime.character.joints import match_names
from runtime.character.writer import write_character
from runtime.errors import FileError
from tests.helpers.gltf_characters import make_pose
from tests.helpers.odd_rigs import DOG, HELPED, LOOSE, PLAIN, Points, odd_character, write_odd


def found_in(path: Path) -> dict[str, str]:
    guess = joints_of(path)
    assert guess.origin == BY_TREE
    return {joint: guess.names[k] for joint, k in guess.found.items()}


@pytest.mark.parametrize(
    ("points", "expected"),
    [
        (PLAIN, {"Hips": "a", "Spine1": "c", "Head": "e", "Neck1": "d", "LeftArm": "L f", "LeftForeArm": "L g",
                 "LeftHand": "L h", "LeftUpLeg": "L i", "RightLeg": "R j", "RightFoot": "R k"}),
        (HELPED, {"Hips": "root", "Spine1": "s3", "Head": "h", "LeftShoulder": "L scap", "LeftArm": "L arm",
                  "RightForeArm": "R fore", "LeftHand": "L wrist", "LeftUpLeg": "L up", "LeftLeg": "L knee",
                  "RightFoot": "R ankle", "RightToeBase": "R ball"}),
        (LOOSE, {"Hips": "body", "Head": "head", "LeftFoot": "L foot", "LeftLeg": "L shank", "LeftArm": "L upper",
                 "RightForeArm": "R lower", "RightUpLeg": "R thigh"}),
    ],
)  # fmt: skip
def test_tree_and_rest_pose_tell(tmp_path: Path, points: Points, expected: dict[str, str]) -> None:
    found = found_in(write_odd(tmp_path / "odd.glb", points))
    assert {joint: found.get(joint) for joint in expected} == expected


def test_sides_go_by_where_the_feet_point(tmp_path: Path) -> None:
    turned: Points = {name: (parent, (-x, y, -z)) for name, (parent, (x, y, z)) in HELPED.items()}
    assert found_in(write_odd(tmp_path / "odd.glb", turned))["LeftArm"] == "L arm"


def test_loose_feet_go_with_the_leg(tmp_path: Path) -> None:
    character = load_character(write_odd(tmp_path / "odd.glb", LOOSE))
    names = list(character.joint_names)
    foot, shank = names.index("L foot"), names.index("L shank")
    lengths = []
    for seed in (1, 2, 3):
        at = (character.skin_matrices(make_pose(seed)) @ np.linalg.inv(character.inverse_bind))[:, :3, 3]
        lengths.append(float(np.linalg.norm(at[foot] - at[shank])))
    assert np.ptp(lengths) < 1e-4
    assert lengths[0] > 0.1


def test_a_frame_of_an_animation_is_no_rest_pose(tmp_path: Path) -> None:
    bound = odd_character(HELPED)
    posed = bound.rest_world.copy()
    names = list(bound.joint_names)
    legs = ("up", "kn", "kt", "an", "ba", "ey")
    low = [k for k, name in enumerate(names) if name.startswith("L ") and name[2:4] not in legs]
    turn = np.array([[0.0, 1, 0], [-1, 0, 0], [0, 0, 1]])  # the left arm hangs down
    pivot = posed[names.index("L scap"), :3, 3].copy()
    for k in low:
        posed[k, :3, 3] = turn @ (posed[k, :3, 3] - pivot) + pivot
        posed[k, :3, :3] = turn @ posed[k, :3, :3]
    write_character(tmp_path / "posed.glb", dataclasses.replace(bound, rest_world=posed))
    write_character(tmp_path / "bound.glb", bound)
    bodies = [load_character(tmp_path / f"{name}.glb") for name in ("posed", "bound")]
    shown = [character.skin_matrices(make_pose(4)) for character in bodies]
    assert np.allclose(*shown, atol=2e-3)


def test_four_legs_are_told(tmp_path: Path) -> None:
    with pytest.raises(NotUpright, match="four legs"):
        load_character(write_odd(tmp_path / "dog.glb", DOG))
    human = {"a": "Hips", "d": "Head", "L j": "LeftUpLeg", "L k": "LeftLeg", "L l": "LeftFoot", "L f": "LeftArm",
             "L g": "LeftForeArm", "L h": "LeftHand"}  # fmt: skip
    both = human | {"R" + key[1:]: "Right" + name[4:] for key, name in human.items() if key.startswith("L")}
    with pytest.raises(NotUpright, match="four legs"):  # named as a human's
        load_character(write_odd(tmp_path / "named.glb", DOG, both))


def test_a_saved_map_is_used_again(tmp_path: Path) -> None:
    path = write_odd(tmp_path / "avatar.glb", PLAIN)
    plain = load_character(path)
    kept = save_joint_map(path, {"LeftHand": "L g", "Head": "d", "Neck1": ""})
    assert kept == joint_map_path(path) == tmp_path / "avatar.glb.joints.json"
    assert json.loads(kept.read_text())["Head"] == "d"
    chosen = joints_of(path)
    assert chosen.names[chosen.found["Head"]] == "d"
    assert "Neck1" not in chosen.found
    assert chosen.chosen == {"LeftHand", "Head", "Neck1"}
    assert not np.array_equal(load_character(path).sport_joints, plain.sport_joints)
    assert np.array_equal(load_character(path, {}).sport_joints, plain.sport_joints)  # none, when asked so


def test_what_cannot_be_guessed_names_the_file(tmp_path: Path) -> None:
    lame = {name: entry for name, entry in PLAIN.items() if name[0] != "L"}
    path = write_odd(tmp_path / "lame.glb", lame)
    with pytest.raises(JointsUnknown, match=r"lame\.glb\.joints\.json") as caught:
        load_character(path)
    assert "LeftUpLeg" in str(caught.value)
    guess = joints_of(path)
    assert guess.missing
    assert len(guess.names) == len(lame)
    joint_map_path(path).write_text("[]")
    with pytest.raises(FileError, match="not a JSON object"):
        load_character(path)


@pytest.mark.parametrize(
    "names",
    [
        ("DEF-spine", "DEF-spine.006", "DEF-thigh.L", "DEF-hand.R", "DEF-upper_arm.L"),
        ("m_avg_Pelvis", "m_avg_Head", "m_avg_L_Hip", "m_avg_R_Wrist", "m_avg_L_Shoulder"),
        ("root", "head", "lfemur", "rhand", "lhumerus"),
        ("Hips", "Head", "LeftUpLeg", "RightHand", "LeftArm"),
    ],
)
def test_more_conventions(names: tuple[str, ...]) -> None:
    found = match_names(names)[0]
    ours = ("Hips", "Head", "LeftUpLeg", "RightHand", "LeftArm")
    assert {joint: found.get(joint) for joint in ours} == {joint: k for k, joint in enumerate(ours)}
