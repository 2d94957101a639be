"""Joint names of several conventions, and the alignment of a character's rest pose with ours."""

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from runtime import rotations
from runtime.arrays import Array
from runtime.skeleton import ANKLE_HEIGHT, SPORT_SKELETON, J

_SIDED = ("Left", "Right")
# SPORT joint names in other conventions, reduced to lower-case letters and digits: {s} is left, {i} is l
_JOINTS = [
    "Hips", "LowerBack", "Spine", "Spine1", "Neck1", "Head", "{S}Shoulder", "{S}Arm", "{S}ForeArm", "{S}Hand",
    "{S}HandIndex1", "{S}UpLeg", "{S}Leg", "{S}Foot", "{S}ToeBase",
]  # fmt: skip
_VRM = (
    "hips spine chest upperchest neck head {s}shoulder {s}upperarm {s}lowerarm {s}hand {s}middleproximal "
    "{s}upperleg {s}lowerleg {s}foot {s}toes"
)
_SMPL = (
    "pelvis spine1 spine2 spine3 neck head {s}collar {s}shoulder {s}elbow {s}wrist {s}middle1 {s}hip {s}knee "
    "{s}ankle {s}foot"
)
_NAMES = {
    "Mixamo": "hips spine spine1 spine2 neck head {s}shoulder {s}arm {s}forearm {s}hand {s}handmiddle1 {s}upleg {s}leg {s}foot {s}toebase",
    "VRM": _VRM,
    "VRoid": " ".join(f"jbip{'' if '{' in name else 'c'}{name.replace('{s}', '{i}')}" for name in _VRM.split()),
    "Unreal": "pelvis spine01 spine02 spine03 neck01 head clavicle{i} upperarm{i} lowerarm{i} hand{i} middle01{i} thigh{i} calf{i} foot{i} ball{i}",
    "SMPL": _SMPL,
    "SMPL short": _SMPL.replace("{s}", "{i}"),
    "Rigify": "spine spine001 spine002 spine003 spine004 spine006 shoulder{i} upperarm{i} forearm{i} hand{i} fmiddle01{i} thigh{i} shin{i} foot{i} toe{i}",
    "CMU": "root lowerback upperback thorax upperneck head {i}clavicle {i}humerus {i}radius {i}hand {i}fingers {i}femur {i}tibia {i}foot {i}toes",
    # as in UpperArm_L, of Unity and of Bandai Namco's motions
    "Unity": " ".join(name.replace("{s}", "") + "{i}" * ("{s}" in name) for name in _VRM.split()),
    "DAZ": "hip abdomen - chest neck head {i}collar {i}shldr {i}forearm {i}hand {i}mid1 {i}thigh {i}shin {i}foot {i}toe",
}  # fmt: skip


def _both_sides(names: str) -> dict[str, str]:
    """Return SPORT joint -> name in a convention, for both sides."""
    return {
        joint.format(S=side): name.format(s=side.lower(), i=side[:1].lower())
        for joint, name in zip(_JOINTS, names.split(), strict=True)
        for side in (_SIDED if "{S}" in joint else ("",))
        if name != "-"
    }


CONVENTIONS = {
    "SPORT": {name: re.sub(r"[^a-z0-9]", "", name.lower()) for name in SPORT_SKELETON.names},
    **{convention: _both_sides(names) for convention, names in _NAMES.items()},
}
NEEDED = ("Hips", "Head", *(s + bone for s in _SIDED for bone in ("UpLeg", "Leg", "Foot", "Arm", "ForeArm")))
MAX_LIFT_M = 0.6  # maximum depth of the soles under the ankles
REQUIRED = (*NEEDED, *(side + "Hand" for side in _SIDED))  # required for a match by names


def simple_name(name: str) -> str:
    """Return a joint name without namespace, case and punctuation: "mixamorig:LeftArm" becomes "leftarm"."""
    bare = re.split(r"[:|]", name)[-1]
    bare = re.sub(r"^(DEF|ORG)[-_]", "", bare)  # Rigify's bone layers
    return re.sub(r"^mixamorig\d*|[^a-z0-9]", "", bare.lower())


def name_variants(name: str) -> set[str]:
    """Return the simple forms of a joint name: the whole name, and the part after each separator."""
    cuts = [0, *(cut.end() for cut in re.finditer(r"[-_:|. ]", name))]
    return {simple_name(name[cut:]) for cut in cuts}


def match_names(names: Sequence[str]) -> tuple[dict[str, int], str]:
    """Return the index into `names` of each SPORT joint and the naming convention used, the one that matches most joints."""
    best: tuple[dict[str, int], str] = ({}, "")
    for bare in (tuple(map(simple_name, names)), tuple(map(simple_name, _without_prefix(names)))):
        index: dict[str, int] = {}
        for i, name in enumerate(bare):
            index.setdefault(name, i)
        for convention, table in CONVENTIONS.items():
            found = {joint: index[simple] for joint, simple in table.items() if simple in index}
            if _score(found) > _score(best[0]):
                best = (found, convention)
    return best


def match_centre(names: Sequence[str], found: Mapping[str, int]) -> dict[str, int]:
    """Find hips and head named in another convention than the limbs, for files that mix two ("Pelvis" above "LeftUpLeg")."""
    free = {simple_name(name): k for k, name in enumerate(names) if k not in found.values()}
    matched = {}
    for joint in ("Hips", "Head"):
        known = [table[joint] for table in CONVENTIONS.values() if table[joint] in free]
        if joint not in found and known:
            matched[joint] = free[known[0]]
    return matched


def _without_prefix(names: Sequence[str]) -> list[str]:
    """Return names without a prefix common to most, up to a separator: "m_avg_L_Hip" becomes "L_Hip"."""
    counts = Counter(name[: cut.end()] for name in names for cut in re.finditer(r"[-_:|. ]", name))
    common = [prefix for prefix, count in counts.items() if count > 0.6 * len(names)]
    longest = max(common, key=len, default="")
    return [name.removeprefix(longest) for name in names]


def _score(found: Mapping[str, int]) -> tuple[int, int]:
    return sum(name in found for name in REQUIRED), len(found)


Indices = NDArray[np.int64]


@dataclass(frozen=True)
class Alignment:
    """Mapping of a SPORT pose to the joint transforms of a character with K joints.

    A driven joint turns with SPORT joint `source` by `world_rotation * turn`; every other joint moves rigidly with
    its nearest driven ancestor `driver`. All lengths are already in the metres of the SPORT character.
    """

    order: tuple[int, ...]  # driven joints, ancestors first; the hips come first
    source: Indices  # (K,) SPORT joint of a driven joint, -1 otherwise
    driver: Indices  # (K,) the joint itself if driven
    anchor: Indices  # (K,) driven joint that carries this joint's pivot
    turns: Array  # (K, 4) rest-pose alignment of driven joints
    arms: Array  # (K, 3) from the anchor's pivot to this joint's pivot, aligned rest pose
    basis: Array  # (K, 3, 3) rest-pose axes with scale
    hips_offset: Array  # (3,) from the middle of the hip joints to the hips, aligned rest pose
    lift: float  # metres added to the height, so that the soles match ours
    native: bool  # the joints are exactly SPORT_SKELETON
    units: float  # file units per metre of ours: ratio of its leg length to ours


def align(found: Mapping[str, int], parents: Sequence[int], rest_world: Array, vertices: Array) -> Alignment:
    """Align a rest pose: `found` joints, `rest_world` `(K, 4, 4)`, mesh `vertices` `(V, 3)` in that pose.

    Rest poses in A-pose, of another size, facing, or up axis are turned and scaled onto the SPORT rest pose.
    """
    facing = canonical_axes(found, rest_world[:, :3, 3].astype(np.float64))
    scale = _leg_scale(found, rest_world[:, :3, 3])
    position = rest_world[:, :3, 3] @ facing.T * scale
    source = np.full(len(parents), -1)
    for name, k in found.items():
        source[k] = SPORT_SKELETON.index(name)
    hips = found["Hips"]
    driver = _drivers(parents, source, hips)
    anchor = np.array(
        [driver[p] if source[k] >= 0 and (p := parents[k]) >= 0 else driver[k] for k in range(len(parents))]
    )
    _attach_to_limbs(found, anchor, parents)
    order = _carriers_first([int(k) for k in np.flatnonzero(source >= 0)], anchor, hips)
    turns = _turns(found, order, anchor, source, position)
    legs = 0.5 * (position[found["LeftUpLeg"]] + position[found["RightUpLeg"]])
    ankle = 0.5 * (position[found["LeftFoot"]] + position[found["RightFoot"]])
    native = len(found) == len(parents) == J and bool(
        np.array_equal(source, np.arange(J))
        and np.allclose(position - position[hips], SPORT_SKELETON.rest_positions, atol=1e-4)
        and np.allclose(rest_world[:, :3, :3], np.eye(3), atol=1e-5)
    )
    sole = float((vertices @ facing[1]).min()) * scale
    lift = 0.0 if native else float(np.clip(ankle[1] - sole - ANKLE_HEIGHT, -MAX_LIFT_M, MAX_LIFT_M))
    arms, basis = position - position[anchor], scale * facing @ rest_world[:, :3, :3]
    offset = position[hips] - legs
    return Alignment(order, source, driver, anchor, turns, arms, basis, offset, lift, native, 1.0 / scale)


# the joint at the end of a limb's bone
_AIM = dict(Arm="ForeArm", ForeArm="Hand", Hand="HandIndex1", UpLeg="Leg", Leg="Foot", Foot="ToeBase")


def _attach_to_limbs(found: Mapping[str, int], anchor: Indices, parents: Sequence[int]) -> None:
    """Attach feet and hands whose parent is the root, such as IK targets, to their limbs."""
    for side in _SIDED:
        for above, bone in _AIM.items():
            k, carrier = found.get(side + bone, -1), found.get(side + above, -1)
            node = k
            while node >= 0 and node != carrier:
                node = parents[node]
            if k >= 0 and carrier >= 0 and node < 0 and bone != "HandIndex1":
                anchor[k] = carrier


def canonical_axes(found: Mapping[str, int], position: Array) -> Array:
    """Return the rotation `(3, 3)` in quarter turns that brings the character's left to +X and its head to +Y."""
    left = position[found["LeftUpLeg"]] - position[found["RightUpLeg"]]
    up = position[found["Head"]] - position[found["Hips"]]
    rows = np.zeros((3, 3))
    for row, direction in ((0, left), (1, up)):
        axis = int(np.argmax(np.abs(direction)))
        rows[row, axis] = np.sign(direction[axis]) or 1.0
    rows[2] = np.cross(rows[0], rows[1])
    return rows if abs(np.linalg.det(rows) - 1.0) < 1e-6 else np.eye(3)


def _leg_scale(found: Mapping[str, int], position: Array) -> float:
    length = 0.0
    for side in _SIDED:
        hip, knee, ankle = (position[found[side + bone]] for bone in ("UpLeg", "Leg", "Foot"))
        length += 0.5 * float(np.linalg.norm(hip - knee) + np.linalg.norm(knee - ankle))
    shin_and_foot = [SPORT_SKELETON.index(name) for name in ("LeftLeg", "LeftFoot")]
    ours = float(np.linalg.norm(SPORT_SKELETON.offsets[shin_and_foot], axis=1).sum())
    return ours / max(length, 1e-6)


def _drivers(parents: Sequence[int], source: Indices, hips: int) -> Indices:
    driver = np.empty(len(parents), np.int64)
    for k in range(len(parents)):
        j = k
        while j >= 0 and source[j] < 0:
            j = parents[j]
        driver[k] = hips if j < 0 else j
    return driver


def _carriers_first(joints: list[int], anchor: Indices, hips: int) -> tuple[int, ...]:
    """Return driven joints, each after its anchor; joints in a cycle are attached to the hips."""

    def depth(k: int) -> int:
        steps = 0
        while k != hips and steps <= len(joints):
            k, steps = int(anchor[k]), steps + 1
        return steps

    depths = {k: depth(k) for k in joints}
    for k in joints:
        if depths[k] > len(joints):
            anchor[k], depths[k] = hips, 1
    return (hips, *sorted((k for k in joints if k != hips), key=lambda k: depths[k]))


def _turns(
    found: Mapping[str, int], order: Sequence[int], anchor: Indices, source: Indices, position: Array
) -> Array:
    """Return the rest alignment `(K, 4)`: limb bones are rotated to the SPORT rest directions, feet only about the vertical."""
    turns = rotations.identity((len(source),)).astype(np.float64)
    rest = SPORT_SKELETON.rest_positions
    for k in order:
        side, bone = re.findall("(Left|Right|)(.+)", SPORT_SKELETON.names[source[k]])[0]
        if not side or bone in ("Shoulder", "HipJoint", "ToeBase"):
            continue
        aim = side + _AIM.get(bone, "")
        turns[k] = rotations.identity() if bone == "Foot" else turns[anchor[k]]
        if aim in found:
            level = np.array((1, 0, 1) if bone == "Foot" else (1, 1, 1))
            wanted = rotations.normalize((rest[SPORT_SKELETON.index(aim)] - rest[source[k]]) * level)
            theirs = rotations.normalize((position[found[aim]] - position[k]) * level)
            turn = rotations.between(rotations.rotate(turns[k], theirs), wanted)
            turns[k] = rotations.multiply(turn, turns[k])
    for side in _SIDED:  # toes keep the foot's alignment
        if side + "ToeBase" in found:
            turns[found[side + "ToeBase"]] = turns[found[side + "Foot"]]
    return turns
