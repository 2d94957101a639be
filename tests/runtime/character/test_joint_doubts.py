"""A guess of joints is believed only where geometry agrees: bones of a limb, sides, two legs."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from runtime import rotations
from runtime.character.character import joints_of, load_character
from runtime.character.guess import JointsUnknown, NotUpright, guess_skeleton, on_four_legs, refusals
from runtime.character.tree import JointTree
from runtime.errors import FileError
from runtime.formats.bvh import format_bvh
from runtime.formats.reference import open_take
from runtime.skeleton import SPORT_SKELETON, Skeleton
from tests.helpers.odd_rigs import HELPED, PLAIN, Points, _both, write_odd

# a short piece between hips and thigh, as the 43-joint files of CMU have it, by names that no table has
BUTTOCKS: Points = _both({
    "a": ("", (0, 0.97, 0)), "b": ("a", (0, 1.17, -0.01)), "c": ("b", (0, 1.29, -0.01)), "d": ("c", (0, 1.51, -0.03)),
    "e": ("d", (0, 1.58, -0.02)), "L c": ("c", (0.03, 1.48, -0.06)), "L s": ("L c", (0.12, 1.46, -0.05)),
    "L f": ("L s", (0.4, 1.45, -0.04)), "L h": ("L f", (0.63, 1.45, 0.03)), "L o": ("a", (0.088, 1.013, 0.012)),
    "L t": ("L o", (0.088, 0.996, -0.01)), "L k": ("L t", (0.088, 0.628, -0.003)),
    "L n": ("L k", (0.08, 0.177, -0.054)),
})  # fmt: skip


def fox(
    leg: float = 0.35, lean: float = 0.0, tail: float = 0.3, head: float = 0.25, length: float = 0.7
) -> Points:
    """Four legs under a horizontal spine: `leg` metres long, the shoulders `lean` over the hips, a tail that rises."""
    hips, chest = leg + 0.08, leg + 0.08 + lean
    return _both({
        "a": ("", (0, hips, 0)), "b": ("a", (0, (hips + chest) / 2 + 0.02, length / 2)), "c": ("b", (0, chest, length)),
        "d": ("c", (0, chest + 0.5 * head, length + 0.12)), "e": ("d", (0, chest + head, length + 0.2)),
        "u": ("a", (0, hips + 0.2 * tail, -0.12)), "v": ("u", (0, hips + 0.6 * tail, -0.3)),
        "w": ("v", (0, hips + tail, -0.5)), "L j": ("a", (0.07, leg, -0.03)), "L k": ("L j", (0.07, 0.6 * leg, 0.05)),
        "L l": ("L k", (0.07, 0.3 * leg, -0.08)), "L m": ("L l", (0.07, 0.02, -0.03)),
        "L f": ("c", (0.07, leg + lean, length - 0.05)), "L g": ("L f", (0.07, 0.5 * (leg + lean), length - 0.1)),
        "L h": ("L g", (0.07, 0.03, length - 0.05)),
    })  # fmt: skip


def tree_of(points: Points) -> tuple[JointTree, tuple[str, ...]]:
    names = tuple(points)
    parents = [names.index(parent) if parent else -1 for parent, _ in points.values()]
    return JointTree(parents, np.array([place for _, place in points.values()], float)), names


def test_a_thigh_begins_behind_the_buttock(tmp_path: Path) -> None:
    guess = joints_of(write_odd(tmp_path / "odd.glb", BUTTOCKS))
    found = [guess.names[guess.found[j]] for j in ("LeftUpLeg", "LeftLeg", "LeftFoot")]
    assert found == ["L t", "L k", "L n"]


@pytest.mark.parametrize("known", [True, False], ids=["CMU's names", "no known names"])
def test_knees_of_43_joints_bend_as_in_the_file(tmp_path: Path, known: bool) -> None:
    tree, names = tree_of(BUTTOCKS)
    above = tree.positions[list(tree.parents)]
    offsets = tree.positions - np.where(np.array(tree.parents)[:, None] >= 0, above, 0.0)
    daz = {"a": "hip", "b": "abdomen", "c": "chest", "d": "neck", "e": "head", "L o": "lButtock", "L t": "lThigh",
           "L k": "lShin", "L n": "lFoot", "L c": "lCollar", "L s": "lShldr", "L f": "lForeArm", "L h": "lHand"}  # fmt: skip
    daz |= {"R" + key[1:]: "r" + name[1:] for key, name in daz.items() if key.startswith("L ")}
    called = tuple(daz[name] if known else name.replace(" ", "") for name in names)
    skeleton = Skeleton(called, tree.parents, offsets.astype(np.float32) * 100)
    bend = np.radians(np.linspace(0.0, 80.0, 30))
    local = rotations.identity((30, len(names))).astype(np.float64)
    axis = np.array([1.0, 0.0, 0.0])
    for side in "LR":
        local[:, names.index(f"{side} t")] = rotations.from_axis_angle(axis, -0.5 * bend)
        local[:, names.index(f"{side} k")] = rotations.from_axis_angle(axis, bend)
    hips = np.tile([0.0, 97.0, 0.0], (30, 1))
    path = tmp_path / "walk.bvh"
    path.write_text(format_bvh(skeleton, {0: hips}, local, 30.0))
    clip = open_take(path).reference.clip
    theirs, _ = skeleton.forward_kinematics(hips, local)
    ours, _ = SPORT_SKELETON.forward_kinematics(clip.hips_positions, clip.local_rotations)
    for side, ending in (("L", "Left"), ("R", "Right")):  # ours is straight at rest, theirs nearly
        file = _angle(theirs, [names.index(f"{side} {k}") for k in "tkn"])
        shown = _angle(ours, [SPORT_SKELETON.index(ending + bone) for bone in ("UpLeg", "Leg", "Foot")])
        assert np.abs((shown - shown[0]) - (file - file[0])).max() < 1.0


def _angle(positions: np.ndarray, chain: list[int]) -> np.ndarray:
    a, b, c = (positions[:, k] for k in chain)
    u, v = rotations.normalize(b - a), rotations.normalize(c - b)
    return np.degrees(np.arccos(np.clip(np.sum(u * v, axis=-1), -1.0, 1.0)))


def test_a_limb_begins_at_the_joint_that_turns(tmp_path: Path) -> None:
    tree, names = tree_of(BUTTOCKS)
    called = tuple({"L o": "LeftUpLeg", "R o": "RightUpLeg"}.get(name, name) for name in names)
    turning = np.array([0.0 if name[2:] == "o" else 0.5 for name in names])
    guess = guess_skeleton(tmp_path / "x.bvh", called, tree, tree.positions, {}, turning)
    assert called[guess.found["LeftUpLeg"]] == "L t"


@settings(max_examples=40, deadline=None)
@given(
    leg=st.floats(0.12, 0.5), lean=st.floats(-0.05, 0.12), tail=st.floats(-0.1, 0.7), head=st.floats(0.0, 0.6),
    length=st.floats(0.5, 0.9),
)  # fmt: skip
def test_no_fox_is_a_human(leg: float, lean: float, tail: float, head: float, length: float) -> None:
    tree, names = tree_of(fox(leg, lean, tail, head, length))
    try:
        guess = guess_skeleton(Path("fox.glb"), names, tree, tree.positions, {})
    except NotUpright:
        return
    assert guess.missing  # seen as nothing at all: then a person is asked


@pytest.mark.parametrize("leg", [0.12, 0.2, 0.35])
@pytest.mark.parametrize("hand", [True, False], ids=["three joints", "no paw"])
def test_a_fox_with_a_humans_names_is_refused(tmp_path: Path, leg: float, hand: bool) -> None:
    human = {"a": "Hips", "b": "Spine", "c": "Spine1", "d": "Neck", "e": "Head", "L j": "LeftUpLeg", "L k": "LeftLeg",
             "L l": "LeftFoot", "L f": "LeftArm", "L g": "LeftForeArm"} | ({"L h": "LeftHand"} if hand else {})  # fmt: skip
    both = human | {"R" + key[1:]: "Right" + name[4:] for key, name in human.items() if key.startswith("L")}
    with pytest.raises((NotUpright, JointsUnknown)):
        load_character(write_odd(tmp_path / "fox.glb", fox(leg), both))


@settings(max_examples=40, deadline=None)
@given(legs=st.floats(0.6, 1.3), arms=st.floats(0.6, 1.15), hang=st.floats(0.0, 1.4), tail=st.booleans())
def test_children_dwarfs_and_giants_are_believed(legs: float, arms: float, hang: float, tail: bool) -> None:
    tree, names = tree_of(body(legs, arms, hang, tail))
    guess = guess_skeleton(Path("body.glb"), names, tree, tree.positions, {})
    assert not guess.missing
    assert guess.names[guess.found["LeftUpLeg"]] == "L up"
    assert guess.names[guess.found["LeftForeArm"]] == "L fore"


def body(legs: float, arms: float, hang: float, tail: bool) -> Points:
    """A human whose legs and arms are longer or shorter by these shares, the arms `hang` radians under a T-pose."""
    points: Points = {}
    shoulder = np.array(HELPED["L arm"][1])
    down = np.array([np.cos(hang), -np.sin(hang), 0.0])
    for name, (parent, place) in HELPED.items():
        at = np.array(place, float)
        limb = name[2:] if name[1:2] == " " else ""
        side = -1.0 if name[0] == "R" else 1.0
        if limb in ("knee", "kt", "ankle", "ball"):
            at[1] = 0.9 + (at[1] - 0.9) * legs
        elif limb and limb not in ("up", "c", "scap", "arm", "eye", "eye end"):
            reach = float(np.linalg.norm(at * (side, 1, 1) - shoulder)) * arms
            at = (shoulder + reach * down) * (side, 1, 1) + (0, 0, 0.2 * (place[2] + 0.03))
        points[name] = (parent, (float(at[0]), float(at[1] - 0.9 * (1.0 - legs)), float(at[2])))
    points["world"] = ("", (0.0, 0.0, 0.0))
    if tail:
        points |= {"tail": ("root", (0, 0.8 * legs, -0.2)), "tail end": ("tail", (0, 0.3 * legs, -0.5))}
    return points


def test_bones_that_cannot_be_a_leg_are_named(tmp_path: Path) -> None:
    names = {"a": "Hips", "c": "Spine1", "d": "Neck", "e": "Head", "L f": "LeftArm", "L g": "LeftForeArm", "L h": "LeftHand",
             "L i": "LeftUpLeg", "L k": "LeftLeg", "L l": "LeftFoot"}  # fmt: skip
    both = names | {"R" + key[1:]: "Right" + name[4:] for key, name in names.items() if key.startswith("L")}
    lame = {**PLAIN, "L k": ("L j", (0.08, 0.09, 0)), "L l": ("L k", (0.08, 0.05, 0.0))}
    lame |= {"R k": ("R j", (-0.08, 0.09, 0)), "R l": ("R k", (-0.08, 0.05, 0.0))}
    guess = joints_of(write_odd(tmp_path / "lame.glb", lame, both))
    assert guess.names[guess.found["LeftLeg"]] != "LeftLeg" or "LeftLeg" in guess.missing
    tree, order = tree_of(lame)
    reasons = refusals({name: order.index(key) for key, name in both.items()}, tree)
    assert set(reasons) == {"LeftLeg", "RightLeg"}
    assert "% of the length" in reasons["LeftLeg"]


def test_sides_that_do_not_fit_the_toes_are_not_believed() -> None:
    tree, names = tree_of(HELPED)
    told = {"Hips": "root", "Head": "h", "LeftUpLeg": "L up", "LeftLeg": "L knee", "LeftFoot": "L ankle",
            "LeftToeBase": "L ball", "LeftArm": "L arm", "LeftForeArm": "L fore", "LeftHand": "L wrist"}  # fmt: skip
    told |= {"Right" + key[4:]: "R" + name[1:] for key, name in told.items() if key.startswith("Left")}
    right = {joint: names.index(name) for joint, name in told.items()}
    assert refusals(right, tree) == {}
    assert not on_four_legs(right, tree)
    arms = [joint for joint in right if joint[4:] in ("Arm", "ForeArm") or "Hand" in joint]
    crossed = right | {joint: right[_other(joint)] for joint in arms}
    assert set(refusals(crossed, tree)) == {"LeftArm", "RightArm"}
    mirrored = {_other(joint): k for joint, k in right.items()}
    assert {"LeftUpLeg", "RightUpLeg"} <= set(refusals(mirrored, tree))


def _other(joint: str) -> str:
    for a, b in (("Left", "Right"), ("Right", "Left")):
        if joint.startswith(a):
            return b + joint[len(a) :]
    return joint


def test_the_message_names_the_joint(tmp_path: Path) -> None:
    tree, _ = tree_of(BUTTOCKS)
    called = ("Hips", "Spine", "Spine1", "Neck", "Head", "LeftShoulder", "LeftArm", "LeftForeArm", "LeftHand", "x",
              "LeftUpLeg", "LeftLeg", "LeftFoot")  # fmt: skip
    called += tuple(name.replace("Left", "Right") if "Left" in name else "y" for name in called[5:])
    moved = tree.positions.copy()
    for k, name in enumerate(called):
        if name.endswith("Leg") and "Up" not in name:
            moved[k] += (0, 0.33, 0)  # the knee just under the hip
    guess = guess_skeleton(tmp_path / "x.glb", called, JointTree(tree.parents, moved), moved, {})
    assert "LeftUpLeg" in guess.missing
    assert "'LeftUpLeg' is not believed" in guess.doubts["LeftUpLeg"]
    chosen = {side + bone: side + bone for side in ("Left", "Right") for bone in ("UpLeg", "Leg")}
    by_hand = guess_skeleton(tmp_path / "x.glb", called, JointTree(tree.parents, moved), moved, chosen)
    assert not by_hand.missing
    assert not by_hand.doubts
    with pytest.raises(FileError, match="joint map"):
        guess_skeleton(tmp_path / "x.glb", called, tree, moved, {"LeftLeg": "nobody"})
