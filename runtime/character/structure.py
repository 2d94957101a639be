"""Identifies joints without usable names, from the hierarchy and the rest pose."""

from dataclasses import dataclass

import numpy as np

from runtime.arrays import AnyArray
from runtime.character.tree import JointTree

# fractions of the height of all joints
GROUND_FRACTION = 0.2  # ends of legs
LEG_TOP_FRACTION = 0.25  # tops of legs
LEG_FRACTION = 0.2  # from top to end
ANKLE_FRACTION = 0.15  # the first joint of a leg below this is its ankle
# of the distance from the first joint to the knee: where the thigh begins; joints beyond are twists
BUTTOCK_FRACTIONS = (0.01, 0.2)
TOE_FRACTION = 0.03  # from ankle to toe, along the ground
SIDE_TOLERANCE = 0.1  # between left and right
# fractions of an arm's length from its first joint to its tip
UPPER_ARM_FRACTION = 0.47  # joints up to here may be the upper arm, those beyond are twists
FINGERS_FRACTION = 0.25  # maximum length of a hand without separate fingers beyond the wrist
HEAD_FRACTION = 0.8  # from chest to crown; joints above are ends and hair


@dataclass(frozen=True)
class _Leg:
    top: int
    tip: int
    foot: int  # of its own if it is attached to another joint, -1 otherwise

    @property
    def end(self) -> int:
        return self.tip if self.foot < 0 else self.foot


Legs = tuple[_Leg, ...]  # exactly two
Arms = tuple[list[int], list[int]]  # joints of each arm, from the chest outwards


def guess_by_structure(tree: JointTree, vertices: AnyArray) -> dict[str, int]:
    """Guess the index of each SPORT joint from hierarchy and rest pose; empty unless an upright body with two legs and arms is found.

    `vertices` `(V, 3)` are the mesh in that pose. Left and right follow from the direction of the feet.
    """
    forks = _leg_forks(tree)
    if len(forks) != 1:
        return {}
    hips, legs = forks[0]
    if hips < 0:
        return {}
    across = _across(tree, legs)
    chest, arms = _arms(tree, hips, legs, across)
    if chest < 0:
        return {}
    left = _left(tree, legs, vertices)
    if left @ across < 0.0:
        legs, arms = (legs[1], legs[0]), (arms[1], arms[0])
    found = {"Hips": hips, **_trunk(tree, hips, chest, legs, arms, vertices)}
    for side, leg, arm in zip(("Left", "Right"), legs, arms, strict=True):
        for bone, joint in {**_leg_joints(tree, leg, hips), **_arm_joints(tree, arm, chest, across)}.items():
            found[side + bone] = joint
    return found if len(set(found.values())) == len(found) else {}


def leg_count(tree: JointTree) -> int:
    """Count the legs: limbs that end on the ground."""
    return sum(len(legs) for _, legs in _leg_forks(tree))


def _leg_forks(tree: JointTree) -> list[tuple[int, Legs]]:
    """Return joints from which legs go down, each with two of them."""
    forks: list[tuple[int, Legs]] = []
    taken: set[int] = set()
    for joint in reversed(tree.order):  # the deepest first
        legs = [leg for child in tree.children[joint] if (leg := _leg(tree, child, taken)) is not None]
        pair = _pair(tree, joint, legs)
        if pair is not None:
            forks.append((joint, pair))
            taken.update(tree.ancestors(joint))
    return _in_the_middle(tree, forks)


def _in_the_middle(tree: JointTree, forks: list[tuple[int, Legs]]) -> list[tuple[int, Legs]]:
    """Keep the forks whose legs stand on both sides of one plane, unlike two fingers of a hand."""
    if len(forks) < 2:
        return forks
    ends = tree.positions[[[leg.end for leg in legs] for _, legs in forks]]  # (forks, 2, 3)
    gaps = ends[:, 0] - ends[:, 1]
    widest = int(np.linalg.norm(gaps, axis=1).argmax())
    middles = ends.mean(axis=1) @ gaps[widest] / np.linalg.norm(gaps[widest])
    near = np.abs(middles - middles[widest]) < SIDE_TOLERANCE * tree.size
    return [forks[k] for k in np.flatnonzero(near)]


def _leg(tree: JointTree, top: int, taken: set[int]) -> _Leg | None:
    if top in taken:
        return None
    tip, limit = tree.lowest(top), tree.floor + GROUND_FRACTION * tree.size
    joints = tree.along(tree.chain(top, tip))
    length = 0.0 if len(joints) < 2 else float(joints[-1])
    if (
        length < LEG_FRACTION * tree.size
        or tree.positions[top, 1] < tree.floor + LEG_TOP_FRACTION * tree.size
    ):
        return None
    if tree.positions[tip, 1] < limit:
        return _Leg(top, tip, -1) if len(joints) > 2 else None
    foot = _loose_foot(tree, top, tip, limit)
    return None if foot < 0 else _Leg(top, tip, foot)


def _loose_foot(tree: JointTree, top: int, tip: int, limit: float) -> int:
    """Return a foot attached to the root, as in rigs whose feet are IK targets; -1 if none stands under the leg."""
    below, own, above = tree.positions[tip], set(tree.under(top)), set(tree.ancestors(top))
    for joint in range(len(tree.parents)):
        gap = tree.positions[joint] - below
        if joint in own or tree.children[joint] or tree.positions[joint, 1] >= limit:
            continue
        if tree.parents[joint] not in above:  # part of another limb
            continue
        if np.hypot(gap[0], gap[2]) < 0.15 * tree.size and -gap[1] < 0.45 * tree.size:
            return joint
    return -1


def _pair(tree: JointTree, joint: int, legs: list[_Leg]) -> Legs | None:
    """Return the two most similar legs that stand side by side."""
    best, least = None, SIDE_TOLERANCE * tree.size
    for i, a in enumerate(legs):
        for b in legs[:i]:
            apart = (tree.positions[a.end] - tree.positions[b.end])[[0, 2]]
            length = tree.distance(a.top, a.end) - tree.distance(b.top, b.end)
            differ = max(abs(length), abs(float(tree.positions[a.top, 1] - tree.positions[b.top, 1])))
            if np.hypot(*apart) > 0.02 * tree.size and a.end != b.end and differ < least:
                best, least = (a, b), differ
    return best


def _across(tree: JointTree, legs: Legs) -> AnyArray:
    """Unit direction along the ground from the second leg to the first."""
    first, second = (_leg_joints(tree, leg, tree.parents[leg.top])["UpLeg"] for leg in legs)
    gap = (tree.positions[first] - tree.positions[second]) * (1.0, 0.0, 1.0)
    return np.asarray(gap / max(float(np.linalg.norm(gap)), 1e-9))


def _left(tree: JointTree, legs: Legs, vertices: AnyArray) -> AnyArray:
    """Direction of the character's left: up times the direction of its toes, or of its feet's vertices."""
    across = _across(tree, legs)
    forward = np.zeros(3)
    for leg in legs:
        joints = _leg_joints(tree, leg, tree.parents[leg.top])
        if "ToeBase" in joints:
            forward += tree.positions[joints["ToeBase"]] - tree.positions[joints["Foot"]]
    ankles = np.mean([tree.positions[leg.end] for leg in legs], axis=0)
    soles = vertices[vertices[:, 1] < tree.floor + 0.05 * tree.size]
    if np.linalg.norm(forward * (1.0, 0.0, 1.0)) < TOE_FRACTION * tree.size and len(soles):
        forward = 0.5 * (soles.max(axis=0) + soles.min(axis=0)) - ankles
    forward = forward - (forward @ across) * across
    if np.hypot(forward[0], forward[2]) < 0.005 * tree.size:
        forward = np.array([0.0, 0.0, 1.0])  # the front of a glTF file
    return np.cross([0.0, 1.0, 0.0], forward)


def _leg_joints(tree: JointTree, leg: _Leg, hips: int) -> dict[str, int]:
    chain = tree.chain(leg.top, leg.tip)
    at = tree.positions[chain]
    if leg.foot >= 0:
        return {"UpLeg": chain[0], "Leg": chain[1], "Foot": leg.foot}
    low = np.flatnonzero(at[:, 1] < tree.floor + ANKLE_FRACTION * tree.size)
    ankle = max(int(low[0]) if len(low) else len(chain) - 1, 2)
    offset = np.linalg.norm((at - tree.positions[hips])[:, [0, 2]], axis=1)
    first = next((i for i in range(ankle - 1) if offset[i] > 0.15 * offset[ankle]), 0)
    knee = max(range(first + 1, ankle), key=lambda i: _shorter(tree, chain[first], chain[i], chain[ankle]))
    reach = tree.along(chain[first : knee + 1])
    shares, (least, most) = reach / max(float(reach[-1]), 1e-9), BUTTOCK_FRACTIONS
    near = np.flatnonzero((least < shares) & (shares < most))
    first += int(near[-1]) if len(near) else 0  # a short bone before the thigh
    joints = {"UpLeg": chain[first], "Leg": chain[knee], "Foot": chain[ankle]}
    ahead = np.hypot(*(at[ankle + 1 :] - at[ankle])[:, [0, 2]].T)
    toe = np.flatnonzero(ahead > TOE_FRACTION * tree.size)
    if len(toe):
        joints["ToeBase"] = chain[ankle + 1 + int(toe[0])]
    return joints


def _shorter(tree: JointTree, a: int, b: int, c: int) -> float:
    """Length of the shorter of two bones."""
    return min(tree.distance(a, b), tree.distance(b, c))


def _arms(tree: JointTree, hips: int, legs: Legs, across: AnyArray) -> tuple[int, Arms]:
    """Return the joint where the arms fork, and each arm's chain to its farthest end; -1 if there are none."""
    middle = 0.5 * (tree.positions[legs[0].top] + tree.positions[legs[1].top])
    in_legs = _joints_in_legs(tree, legs)
    top = _trunk_root(tree, hips, in_legs)
    out = {
        joint: float((tree.positions[joint] - middle) @ across)
        for joint in tree.ends_under(top)
        if joint not in in_legs and len(tree.chain(top, joint)) > 3
    }
    nothing: tuple[int, Arms] = (-1, ([], []))
    if not out:
        return nothing
    first, second = max(out, key=out.__getitem__), min(out, key=out.__getitem__)
    chest = tree.meeting(first, second)
    if chest < 0 or min(out[first], -out[second]) < 0.1 * tree.size:
        return nothing
    arms = tree.chain(chest, first)[1:], tree.chain(chest, second)[1:]
    if min(map(len, arms)) < 2:
        return nothing
    above = min(float(tree.positions[chain[0], 1]) for chain in arms) - middle[1] > 0.1 * tree.size
    return (chest, arms) if above else nothing


def _joints_in_legs(tree: JointTree, legs: Legs) -> set[int]:
    return {joint for leg in legs for joint in (*tree.under(leg.top), leg.foot)}


def _trunk_root(tree: JointTree, hips: int, in_legs: set[int]) -> int:
    """Return the hips, or the joint above them if the spine is attached beside them."""
    for joint in tree.ancestors(hips):
        rest = [each for each in tree.under(joint) if each not in in_legs]
        if max(float(tree.positions[each, 1]) for each in rest) > tree.floor + 0.7 * tree.size:
            return joint
    return hips


def _arm_joints(tree: JointTree, chain: list[int], chest: int, across: AnyArray) -> dict[str, int]:
    out = np.abs((tree.positions[chain] - tree.positions[chest]) @ across)
    if len(chain) > 3 and out[0] < 0.5 * out[1]:
        return {"Shoulder": chain[0], **_free_arm(tree, chain[1:])}
    return _free_arm(tree, chain)


def _free_arm(tree: JointTree, chain: list[int]) -> dict[str, int]:
    along = tree.along(chain)
    if len(chain) == 2 or along[-1] <= 0.0:
        return {"Arm": chain[0], "ForeArm": chain[1]}  # the hand has no joint
    hand = _wrist(tree, chain, along / along[-1])
    elbow = max(range(1, hand), key=lambda i: _shorter(tree, chain[0], chain[i], chain[hand]))
    reach = along[: elbow + 1] / max(float(along[elbow]), 1e-9)
    upper = max(i for i in range(elbow) if reach[i] < UPPER_ARM_FRACTION)
    joints = {"Arm": chain[upper], "ForeArm": chain[elbow]}
    if upper:
        joints["Shoulder"] = chain[0]
    above = chain[hand - 1]
    far = 0.85 * tree.distance(above, chain[hand])
    if sum(tree.distance(above, each) > far for each in tree.children[above]) > 2:
        return joints  # parts of a hand without a joint of its own
    joints["Hand"] = chain[hand]
    if hand + 1 < len(chain):
        joints["HandIndex1"] = chain[hand + 1]
    return joints


def _wrist(tree: JointTree, chain: list[int], share: AnyArray) -> int:
    """Return the first joint of the outer half with several fingers, else the first one near the tip."""
    for i in range(2, len(chain)):
        fingers = sum(tree.heights[child] >= 1 for child in tree.children[chain[i]])
        if share[i] > 0.5 and fingers >= 2:
            return i
    return next(i for i in range(2, len(chain)) if 1.0 - share[i] < FINGERS_FRACTION or i == len(chain) - 1)


def _trunk(
    tree: JointTree, hips: int, chest: int, legs: Legs, arms: Arms, vertices: AnyArray
) -> dict[str, int]:
    """Return spine, neck and head joints."""
    found: dict[str, int] = {}
    if hips in tree.ancestors(chest):
        spine = tree.chain(hips, chest)[1:]
        names = ("Spine1", "Spine", "LowerBack")  # from the chest down
        picks = spine[::-1] if len(spine) <= 3 else [spine[-1], spine[len(spine) // 2], spine[0]]
        found |= dict(zip(names, picks, strict=False))
    elif chest != hips:
        found["Spine1"] = chest
    limbs = _joints_in_legs(tree, legs).union(*(tree.under(chain[0]) for chain in arms))
    above = [joint for joint in tree.under(chest) if joint not in limbs and joint != chest]
    if not above:
        return found
    top = max(above, key=lambda joint: float(tree.positions[joint, 1]))
    chain = tree.chain(chest, top)[1:]
    head = _head(tree, chain, float(tree.positions[chest, 1]), vertices)
    found["Head"] = head
    between = chain[: chain.index(head)]
    return found | ({"Neck1": between[-1]} if between else {})


def _head(tree: JointTree, chain: list[int], low: float, vertices: AnyArray) -> int:
    """Return the joint above the chest, at height `low`, with several children, else the last below the crown."""
    crown = float(tree.positions[chain[-1], 1])
    crown = max(float(vertices[:, 1].max()) if len(vertices) else 0.0, crown)
    below = [j for j in chain if tree.positions[j, 1] - low <= HEAD_FRACTION * (crown - low)] or chain[:1]
    return next((j for j in below if sum(tree.heights[c] > 0 for c in tree.children[j]) > 1), below[-1])
