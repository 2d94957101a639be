"""Whether guessed joints can be those of an upright body: bones as long as a limb's, left on the left, two legs."""

from __future__ import annotations

import itertools
from collections.abc import Mapping

import numpy as np

from runtime.arrays import AnyArray
from runtime.character.tree import JointTree

SIDES = ("Left", "Right")
LIMBS = {  # limb: its joints from the trunk outwards, and the least share of the longer one of its two bones
    "leg": (("UpLeg", "Leg", "Foot"), 0.35),
    "arm": (("Arm", "ForeArm", "Hand"), 0.3),
}
UNEVEN = 0.3  # by which left and right may differ
SIDE_SEEN = 0.2  # of the width of the hips: feet that point less far forward tell no side
# a body on four legs, in shares of the length of its legs
LEANING = -0.6  # cosine between legs and trunk; an upright trunk goes the other way
ALIKE = 0.5  # cosine between front and hind legs
DEEP = 0.5  # how far front legs reach down from the hips
LOW, APART = 0.75, 0.6  # ends of limbs on the ground, and how far they are from the feet


def doubts(found: Mapping[str, int], tree: JointTree) -> dict[str, str]:
    """SPORT joint -> why the joint that was guessed for it cannot be it; empty where all can be believed.

    Bones of a limb must be of comparable length, left and right alike, joints in the order of the tree, and the left
    leg on the left as the feet point.
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
        if len(spans) == 2 and spans[shorter] < (1.0 - UNEVEN) * max(spans.values()):
            wrong[shorter + bones[0]] = f"this {limb} is much shorter than the other one"
    swapped = [side + bone for bone in _swapped(found, tree) for side in SIDES]
    return wrong | dict.fromkeys(swapped, "it is on the other side, as the feet point")


def _limb(
    found: Mapping[str, int], tree: JointTree, side: str, limb: str
) -> tuple[dict[str, str], float | None]:
    """What is wrong with the bones of one limb, and its length where all its joints are known."""
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
    return {short: f"its bone has {100 * share:.0f} % of the length of the other one of this {limb}"}, sum(
        lengths
    )


def _on_both_sides(found: Mapping[str, int], *bones: str) -> bool:
    return all(side + bone in found for side in SIDES for bone in bones)


def _apart(found: Mapping[str, int], tree: JointTree, bone: str) -> AnyArray:
    """From the right joint of a bone to the left one."""
    return np.asarray(tree.positions[found["Left" + bone]] - tree.positions[found["Right" + bone]])


def _swapped(found: Mapping[str, int], tree: JointTree) -> list[str]:
    """Limbs whose left joint is on the right: of the legs by where the toes point, of the arms by the legs."""
    if not _on_both_sides(found, "UpLeg", "Foot"):
        return []
    down = _middle(found, tree, "Foot") - _middle(found, tree, "UpLeg")
    across = _apart(found, tree, "UpLeg")
    wrong = []
    if _on_both_sides(found, "ToeBase"):
        ahead = _middle(found, tree, "ToeBase") - _middle(found, tree, "Foot")
        seen = float(np.cross(ahead, down) @ across)  # down, left and ahead are right-handed
        width = float(np.linalg.norm(across))
        if seen < -SIDE_SEEN * width * float(np.linalg.norm(down)) * width:
            wrong.append("UpLeg")
    if _on_both_sides(found, "Arm") and _apart(found, tree, "Arm") @ across < 0.0:
        wrong.append("Arm")
    return wrong


def on_four_legs(found: Mapping[str, int], tree: JointTree) -> bool:
    """Whether the arms are legs that go down across the trunk, or two other limbs stand far from the feet."""
    if not _on_both_sides(found, "UpLeg", "Foot"):
        return False
    hips = _middle(found, tree, "UpLeg")
    ends = [_end(tree, found[side + "Foot"]) for side in SIDES]
    down = tree.positions[ends].mean(axis=0) - hips
    length = max(float(np.linalg.norm(down)), 1e-9)
    along = down / length
    if _on_both_sides(found, "Arm"):
        shoulders = _middle(found, tree, "Arm")
        ends = [_deepest(tree, found[side + "Arm"], along) for side in SIDES]
        front = tree.positions[ends].mean(axis=0)
        leaning, pointing = _cosine(along, shoulders - hips), _cosine(along, front - shoulders)
        if leaning > LEANING and pointing > ALIKE and float((front - hips) @ along) / length > DEEP:
            return True
    return _other_feet(found, tree, hips, along, length)


def _cosine(unit: AnyArray, vector: AnyArray) -> float:
    return float(unit @ vector) / max(float(np.linalg.norm(vector)), 1e-9)


def _other_feet(
    found: Mapping[str, int], tree: JointTree, hips: AnyArray, along: AnyArray, length: float
) -> bool:
    """Whether two ends of limbs that mirror each other stand on the ground before or behind the feet."""
    own = {*tree.under(found["LeftUpLeg"]), *tree.under(found["RightUpLeg"])}
    across = _apart(found, tree, "UpLeg")
    across = across / max(float(np.linalg.norm(across)), 1e-9)
    feet = _middle(found, tree, "Foot") - hips
    low = (tree.positions - hips) @ along > LOW * length
    ends = [joint for joint in tree.ends if low[joint] and joint not in own and tree.parents[joint] >= 0]
    for a, b in itertools.combinations(ends, 2):
        gap = tree.positions[a] - tree.positions[b]
        wide = float(np.linalg.norm(gap))
        away = 0.5 * (tree.positions[a] + tree.positions[b]) - hips - feet
        away = away - (away @ along) * along
        mirrored = wide > 0.1 * length and abs(gap @ across) > 0.9 * wide
        if mirrored and float(np.linalg.norm(away)) > APART * length:
            return True
    return False


def lopsided(found: Mapping[str, int], tree: JointTree, axes: AnyArray) -> float:
    """How far left and right limbs are from mirror images in `axes` `(3, 3)`, as a share of the body's size."""
    position = tree.positions @ axes.T
    middle = 0.5 * (position[found["LeftUpLeg"], 0] + position[found["RightUpLeg"], 0])
    gaps = []
    for bone in ("Leg", "Foot", "ForeArm", "Hand"):
        if _on_both_sides(found, bone):
            left, right = position[found[f"Left{bone}"]], position[found[f"Right{bone}"]]
            mirrored = np.array([2.0 * middle - left[0], left[1], left[2]])
            gaps.append(float(np.linalg.norm(mirrored - right)))
    return float(np.mean(gaps)) / max(float(np.ptp(position[:, 1])), 1e-9)


def _middle(found: Mapping[str, int], tree: JointTree, bone: str) -> AnyArray:
    return np.asarray(
        0.5 * (tree.positions[found["Left" + bone]] + tree.positions[found["Right" + bone]]), np.float64
    )


def _end(tree: JointTree, joint: int) -> int:
    """The end of the limb that goes on from a joint, the farthest one."""
    return max(tree.under(joint), key=lambda k: tree.distance(joint, k))


def _deepest(tree: JointTree, joint: int, along: AnyArray) -> int:
    return max(tree.under(joint), key=lambda k: float(tree.positions[k] @ along))
