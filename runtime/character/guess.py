"""Guesses which joints of a user's character correspond to SPORT joints: from the joint map, names, hierarchy and rest pose."""

import itertools
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from runtime.arrays import AnyArray
from runtime.character.joint_map import joint_map_path
from runtime.character.joints import NEEDED, REQUIRED, match_centre, match_names
from runtime.character.structure import guess_by_structure, leg_count
from runtime.character.tree import JointTree
from runtime.errors import FileError
from runtime.skeleton import MIRROR_JOINTS, SPORT_SKELETON

NO_JOINTS: Mapping[str, int] = {}
BY_TREE = "hierarchy and rest pose"
STILL_RAD = 0.01  # a joint that rotates less in a whole motion does not move
SIDES = ("Left", "Right")
# the mirrored joint of each joint
OTHER_SIDE = {name: SPORT_SKELETON.names[MIRROR_JOINTS[k]] for k, name in enumerate(SPORT_SKELETON.names)}
LIMBS = {  # joints from the trunk outwards, and the minimum ratio of its two bones' lengths
    "leg": (("UpLeg", "Leg", "Foot"), 0.35),
    "arm": (("Arm", "ForeArm", "Hand"), 0.3),
}
MAX_UNEVEN_FRACTION = 0.3  # allowed difference of left and right
MIN_FORWARD_FRACTION = 0.2  # of the hips' width: feet pointing forward by less do not tell left from right
# thresholds of a quadruped, relative to the length of its legs
MIN_LEANING_COSINE = -0.6  # between legs and trunk; an upright trunk points the other way
MIN_ALIKE_COSINE = 0.5  # between front and hind legs
FRONT_LEG_FRACTION = 0.5  # reach of the front legs below the hips
# height of limb ends on the ground, and their distance from the feet
GROUND_FRACTION, OTHER_FEET_FRACTION = 0.75, 0.6


class JointsUnknown(FileError):
    """Raised if required joints of a character could not be found; the user can choose them by hand."""


class NotUpright(FileError):
    """Raised if a character stands on four legs."""


@dataclass(frozen=True)
class JointGuess:
    """The joints of a file and the SPORT joints they correspond to.

    `found` maps SPORT joints to indices; `origin` is the naming convention, or `BY_TREE`; `chosen` are set by the joint
    map; `missing` are required joints that were not found; `doubts` gives the reason for each guess that geometry rejected.
    """

    names: tuple[str, ...]
    parents: tuple[int, ...]
    positions: AnyArray  # (K, 3) rest pose, scene space
    found: dict[str, int]
    origin: str
    chosen: frozenset[str]
    missing: tuple[str, ...]
    doubts: dict[str, str]


def require(path: Path, guess: JointGuess) -> None:
    """Raise `JointsUnknown` if a required joint is missing; the message says where it can be named."""
    if guess.missing:
        raise JointsUnknown(
            f"{path}: no joints found for {', '.join(guess.missing)} (neither by known names nor by tree and rest"
            f" pose{''.join(f'; {reason}' for reason in guess.doubts.values())}).",
            "Choose them in the window Joints, which opens when the file is dropped on the viewer; or write"
            f" {joint_map_path(path).name} next to it, or give such a file as --joint-map:"
            ' {"LeftArm": "name in the file", ...}.',
        )


def _not_upright(path: Path) -> FileError:
    return NotUpright(
        f"{path}: it stands on four legs; characters need two legs and two arms.",
        "Choose a human or humanoid character.",
    )


def guess_skeleton(
    path: Path,
    names: tuple[str, ...],
    tree: JointTree,
    points: AnyArray,
    joint_map: Mapping[str, str],
    turning: AnyArray | None = None,
    humanoid: Mapping[str, int] = NO_JOINTS,
) -> JointGuess:
    """Guess which joints of a skeleton correspond to SPORT joints, from names, hierarchy and rest pose.

    `points` `(N, 3)` are the body or mesh in the rest pose. Guesses that the geometry contradicts are dropped; entries
    of `joint_map` always win. `turning` `(K,)` is how far each joint rotates in a motion (radians): limb joints must
    rotate. `humanoid` are the joints that a VRM names.

    Raises FileError if the map names an unknown joint, and `NotUpright` for a quadruped.
    """
    found, origin = _guessed_joints(tree, points, names, humanoid)
    if turning is not None:
        found = _bending(found, tree, turning)
    if _missing(found) and not joint_map and leg_count(tree) > 2:
        raise _not_upright(path)
    refused = refusals(found, tree)
    chosen = _chosen(path, names, joint_map)
    used = {joint: k for joint, k in ({**found, **dict.fromkeys(refused, -1)} | chosen).items() if k >= 0}
    if on_four_legs(dict(found) | used, tree):
        raise _not_upright(path)
    reasons = {
        joint: f"{names[found[joint]]!r} is not believed to be {joint}: {why}"
        for joint, why in refused.items()
        if joint not in used
    }
    return JointGuess(
        names, tree.parents, tree.positions, used, origin, frozenset(joint_map), _missing(used), reasons
    )


def _bending(found: Mapping[str, int], tree: JointTree, turning: AnyArray) -> dict[str, int]:
    """Return the guess with limbs that start at the rotating joint: a buttock or shoulder joint above it is skipped."""
    moved = dict(found)
    for side in ("Left", "Right"):
        for upper, lower in (("UpLeg", "Leg"), ("Arm", "ForeArm")):
            top, below = moved.get(side + upper, -1), moved.get(side + lower, -1)
            if top < 0 or below < 0 or top not in tree.ancestors(below) or turning[top] > STILL_RAD:
                continue
            between = tree.chain(top, below)[1:-1]
            moved[side + upper] = next((k for k in between if turning[k] > STILL_RAD), top)
    return moved


def _guessed_joints(
    tree: JointTree, points: AnyArray, names: tuple[str, ...], humanoid: Mapping[str, int]
) -> tuple[dict[str, int], str]:
    by_name, convention = match_names(names)
    by_name = {**by_name, **humanoid}
    named = _by_names(by_name, convention, "VRM" if humanoid else convention)
    for found, origin in named:
        if not refusals(found, tree):
            return found, origin
    by_tree = guess_by_structure(tree, points)
    believed = not _missing({} if named and refusals(by_tree, tree) else by_tree)
    by_name |= match_centre(names, by_name)
    if believed or (_missing(by_name) and len(by_tree) > len(by_name)):
        return by_tree, BY_TREE
    return by_name, convention


def _by_names(by_name: dict[str, int], convention: str, origin: str) -> list[tuple[dict[str, int], str]]:
    """Return the joints by name, and with left and right swapped for a mirrored body; empty if names are missing."""
    if not all(name in by_name for name in REQUIRED):
        return []
    exchanged = {OTHER_SIDE[joint]: k for joint, k in by_name.items()}
    return [(by_name, origin), (exchanged, f"{convention}, left and right swapped")]


def _missing(found: Mapping[str, int]) -> tuple[str, ...]:
    """Return the missing joints without which a body cannot be driven."""
    return tuple(name for name in NEEDED if name not in found)


def _chosen(path: Path, names: tuple[str, ...], joint_map: Mapping[str, str]) -> dict[str, int]:
    chosen = {}
    for joint, name in joint_map.items():
        if joint not in SPORT_SKELETON.names or (name and name not in names):
            problem = f"{path}: the joint map names {joint!r} -> {name!r}, which is not in the skeleton."
            raise FileError(problem, f"Joints of the file: {', '.join(names[:80])}.")
        chosen[joint] = names.index(name) if name else -1
    return chosen


def refusals(found: Mapping[str, int], tree: JointTree) -> dict[str, str]:
    """Return the reason for each SPORT joint whose guess is rejected; empty if all are plausible.

    Bones of a limb must have comparable lengths and match left to right, joints must follow the hierarchy, and the left
    leg must be on the left of the direction in which the feet point.
    """
    wrong: dict[str, str] = {}
    for limb, (bones, _) in LIMBS.items():
        spans = {}
        for side in SIDES:
            refused, length = _limb(found, tree, side, limb)
            wrong |= refused
            if length is not None:
                spans[side] = length
        shorter = min(spans, key=lambda side: spans[side], default="")
        if len(spans) == 2 and spans[shorter] < (1.0 - MAX_UNEVEN_FRACTION) * max(spans.values()):
            wrong[shorter + bones[0]] = f"this {limb} is much shorter than the other one"
    swapped = [side + bone for bone in _swapped(found, tree) for side in SIDES]
    return wrong | dict.fromkeys(swapped, "it is on the wrong side for the direction of the feet")


def _limb(
    found: Mapping[str, int], tree: JointTree, side: str, limb: str
) -> tuple[dict[str, str], float | None]:
    """Return the problems of one limb by joint, and its length if all its joints are known."""
    bones, least = LIMBS[limb]
    joints = [found.get(side + bone, -1) for bone in bones]
    if min(joints[:2]) >= 0 and joints[1] in tree.ancestors(joints[0]):
        return {side + bones[1]: f"it lies above the {limb}'s first joint"}, None
    if min(joints) < 0:
        return {}, None
    lengths = [tree.distance(joints[k], joints[k + 1]) for k in (0, 1)]
    if min(lengths) >= least * max(lengths):
        return {}, sum(lengths)
    share = min(lengths) / max(*lengths, 1e-9)
    short = side + bones[lengths.index(min(lengths))]
    why = f"its bone has {100 * share:.0f} % of the length of the other one of this {limb}"
    return {short: why}, sum(lengths)


def _on_both_sides(found: Mapping[str, int], *bones: str) -> bool:
    return all(side + bone in found for side in SIDES for bone in bones)


def _apart(found: Mapping[str, int], tree: JointTree, bone: str) -> AnyArray:
    """Return the vector from the right joint of a bone to the left one."""
    return np.asarray(tree.positions[found["Left" + bone]] - tree.positions[found["Right" + bone]])


def _swapped(found: Mapping[str, int], tree: JointTree) -> list[str]:
    """Return limbs whose left joint is on the right: legs by the direction of the toes, arms by the legs."""
    if not _on_both_sides(found, "UpLeg", "Foot"):
        return []
    down = _middle(found, tree, "Foot") - _middle(found, tree, "UpLeg")
    across = _apart(found, tree, "UpLeg")
    wrong = []
    if _on_both_sides(found, "ToeBase"):
        ahead = _middle(found, tree, "ToeBase") - _middle(found, tree, "Foot")
        seen = float(np.cross(ahead, down) @ across)  # down, left and ahead are right-handed
        width = float(np.linalg.norm(across))
        if seen < -MIN_FORWARD_FRACTION * width * float(np.linalg.norm(down)) * width:
            wrong.append("UpLeg")
    if _on_both_sides(found, "Arm") and _apart(found, tree, "Arm") @ across < 0.0:
        wrong.append("Arm")
    return wrong


def on_four_legs(found: Mapping[str, int], tree: JointTree) -> bool:
    """Return whether the skeleton is a quadruped: its arms are legs, or two other limbs reach the ground far from the feet."""
    if not _on_both_sides(found, "UpLeg", "Foot"):
        return False
    hips = _middle(found, tree, "UpLeg")
    ends = [_end(tree, found[side + "Foot"]) for side in SIDES]
    down = tree.positions[ends].mean(axis=0) - hips
    length = max(float(np.linalg.norm(down)), 1e-9)
    along = down / length
    if _on_both_sides(found, "Arm"):
        shoulders = _middle(found, tree, "Arm")
        arms = [tree.under(found[side + "Arm"]) for side in SIDES]
        ends = [max(arm, key=lambda k: float(tree.positions[k] @ along)) for arm in arms]
        front = tree.positions[ends].mean(axis=0)
        leans = _cosine(along, shoulders - hips) > MIN_LEANING_COSINE
        goes_down = _cosine(along, front - shoulders) > MIN_ALIKE_COSINE
        if leans and goes_down and float((front - hips) @ along) / length > FRONT_LEG_FRACTION:
            return True
    return _other_feet(found, tree, hips, along, length)


def _cosine(unit: AnyArray, vector: AnyArray) -> float:
    return float(unit @ vector) / max(float(np.linalg.norm(vector)), 1e-9)


def _other_feet(
    found: Mapping[str, int], tree: JointTree, hips: AnyArray, along: AnyArray, length: float
) -> bool:
    """Whether two mirrored limb ends stand on the ground before or behind the feet."""
    own = {*tree.under(found["LeftUpLeg"]), *tree.under(found["RightUpLeg"])}
    across = _apart(found, tree, "UpLeg")
    across = across / max(float(np.linalg.norm(across)), 1e-9)
    feet = _middle(found, tree, "Foot") - hips
    low = (tree.positions - hips) @ along > GROUND_FRACTION * length
    ends = [joint for joint in tree.ends if low[joint] and joint not in own and tree.parents[joint] >= 0]
    for a, b in itertools.combinations(ends, 2):
        gap = tree.positions[a] - tree.positions[b]
        wide = float(np.linalg.norm(gap))
        away = 0.5 * (tree.positions[a] + tree.positions[b]) - hips - feet
        away = away - (away @ along) * along
        mirrored = wide > 0.1 * length and abs(gap @ across) > 0.9 * wide
        if mirrored and float(np.linalg.norm(away)) > OTHER_FEET_FRACTION * length:
            return True
    return False


def _middle(found: Mapping[str, int], tree: JointTree, bone: str) -> AnyArray:
    return np.asarray(tree.positions[[found[side + bone] for side in SIDES]].mean(axis=0))


def _end(tree: JointTree, joint: int) -> int:
    """Return the farthest limb end below a joint."""
    return max(tree.under(joint), key=lambda k: tree.distance(joint, k))
