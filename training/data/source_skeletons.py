"""Joint maps and rest-pose corrections of the skeletons that the known motion data sets use."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from types import MappingProxyType

import numpy as np

from runtime import rotations
from runtime.arrays import Array
from runtime.formats.bvh import BvhMotion
from runtime.skeleton import SPORT_SKELETON

_UP, _DOWN = np.array([0.0, 1.0, 0.0]), np.array([0.0, -1.0, 0.0])


def standing_rotations(points: Mapping[str, Array]) -> dict[str, Array]:
    """Our world rotations `(4,)` of a figure that stands upright, looking ahead, from its joints `(3,)` by our names.

    Trunk, head and feet face where the hips do; arms and legs point where they point, twisted as little as possible.
    """
    left = points["LeftUpLeg"] - points["RightUpLeg"]
    heading: Array = rotations.from_yaw(np.arctan2(-left[2], left[0]))
    result = {n: heading for n in ("Hips", "LowerBack", "Spine", "Spine1", "Neck", "Neck1", "Head")}
    for side, outwards in (("Left", 1.0), ("Right", -1.0)):
        result[side + "Shoulder"] = heading
        chain = [side + "Arm", side + "ForeArm", side + "Hand"]
        result |= _limb(heading, np.array([outwards, 0.0, 0.0]), chain, points)
        chain = [side + "UpLeg", side + "Leg", side + "Foot"]
        result |= _limb(heading, _DOWN, chain, points)
        result[side + "Foot"] = result[side + "ToeBase"] = heading
    return result


def _limb(heading: Array, rest: Array, chain: list[str], points: Mapping[str, Array]) -> dict[str, Array]:
    """Rotations of a limb's joints: each bone points to the next joint, the last one follows its parent."""
    result, current = {}, heading
    for joint, child in pairwise(chain):
        wanted = rotations.normalize(points[child] - points[joint])
        current = rotations.multiply(rotations.between(rotations.rotate(current, rest), wanted), current)
        result[joint] = current
    result[chain[-1]] = current
    return result


SIDES = ("Left", "Right")
# what each bone points along in the rest pose of the SPORT skeleton
_ARM_DIRECTION = {"Left": np.array([1.0, 0, 0]), "Right": np.array([-1.0, 0, 0])}
_LEG_DIRECTION = np.array([0.0, -1.0, 0.0])

LIMBS = ("Shoulder", "Arm", "ForeArm", "Hand", "UpLeg", "Leg", "Foot", "ToeBase")


@dataclass(frozen=True)
class SourceJoint:
    """Where a SPORT joint takes its world rotation from.

    The rotation is that of source joint `name`, or `blend` of the way from `name` to `towards`. `axes`, when given, says
    where the source joint's local X, Y and Z point while the character stands in our rest pose; `along`, when given, is
    the source's child joint whose offset is aligned with our bone (and the twist kept); with neither, the
    two rest frames agree. Feet need no more than a rough frame: `retarget.calibrate_feet` measures the rest.
    """

    name: str
    towards: str | None = None
    blend: float = 0.0
    axes: str | None = None  # such as "+Y -X +Z"
    along: str | None = None


@dataclass(frozen=True)
class SourceSkeleton:
    """A known hierarchy: how its joints drive ours, and how its toes behave."""

    name: str
    signature: frozenset[str]  # joint names that only this hierarchy has together
    joints: Mapping[str, SourceJoint]
    has_toe_rotation: bool = True
    toe_is_end_site: bool = False  # no toe joint: the foot's End Site marks the ball
    fixed_scale: float | None = None  # metres per file unit; None: by the ratio of leg lengths
    head_lift_degrees: float = 0.0  # tilt of neck and head that levels the gaze, see DataSet
    neck_base: str = "Neck"  # the joint at the top of the chest: the trunk leads to it
    # a take in the clip's folder whose first frame stands upright, or "" for the clip's own: corrections are measured there
    reference: str | None = None

    def corrections(self, motion: BvhMotion) -> dict[str, Array]:
        """Constant rotations C `(4,)` by SPORT joint: our world rotation is the source's times C.

        `motion` is the clip, or with `reference` the take that this names.
        """
        if self.reference is not None:
            return self._measured(motion)
        result = {}
        for target, joint in self.joints.items():
            if joint.axes:
                result[target] = rotations.inverse(rotations.from_matrix(_axes_matrix(joint.axes)))
            elif joint.along:
                offset = motion.skeleton.offsets[motion.skeleton.index(joint.along)]
                ours = _rest_direction(target)
                result[target] = rotations.between(ours, rotations.normalize(offset.astype(np.float64)))
            else:
                result[target] = rotations.identity().astype(np.float64)
        return result

    def _measured(self, motion: BvhMotion) -> dict[str, Array]:
        positions, world = (values[0].astype(np.float64) for values in motion.world())
        source = {target: motion.skeleton.index(joint.name) for target, joint in self.joints.items()}
        ours = standing_rotations({target: positions[j] for target, j in source.items()})
        return {t: rotations.multiply(rotations.inverse(world[j]), ours[t]) for t, j in source.items()}


def _axes_matrix(axes: str) -> Array:
    """Matrix whose columns are the directions of local X, Y, Z, from "+Y -X +Z"."""
    columns = [np.eye(3)["XYZ".index(word[1])] * (1.0 if word[0] == "+" else -1.0) for word in axes.split()]
    return np.stack(columns, axis=1)


def _rest_direction(joint: str) -> Array:
    if "Arm" in joint or "Hand" in joint:
        return _ARM_DIRECTION["Left" if joint.startswith("Left") else "Right"]
    return _LEG_DIRECTION


def same_rest(**names: str) -> dict[str, SourceJoint]:
    """Source joints whose rest frames are ours, by our names."""
    return {target: SourceJoint(source) for target, source in names.items()}


def limbs(
    parts: Mapping[str, str] | Sequence[str],
    name: Callable[[str, str], str] = str.__add__,
    axes: Mapping[str, str] | str | None = None,
    along: Mapping[str, str] = MappingProxyType({}),
) -> dict[str, SourceJoint]:
    """Source joints of both sides: `parts` by our names, spelled by `name` of side and part.

    `axes` are those of all, or by side; `along` names the part that our bone is aligned with, see `SourceJoint`.
    """
    named = parts if isinstance(parts, Mapping) else {part: part for part in parts}
    return {
        side + target: SourceJoint(
            name(side, part),
            axes=axes[side] if isinstance(axes, Mapping) else axes,
            along=name(side, along[target]) if target in along else None,
        )
        for side in SIDES
        for target, part in named.items()
    }


def same_limbs() -> dict[str, SourceJoint]:
    """Limbs that are named as ours and whose bones we turn along the source's own, from joint to joint."""
    return limbs(LIMBS, along={"Arm": "ForeArm", "ForeArm": "Hand", "UpLeg": "Leg", "Leg": "Foot"})


# --- the skeletons of the data sets --------------------------------------------------------------------------------

# a trunk of four joints under the neck
_FOUR = {
    "Hips": "Hips", "LowerBack": "Spine1", "Spine": "Spine2", "Spine1": "Spine3", "Neck1": "Neck", "Head": "Head",
}  # fmt: skip
_STYLE100_LIMBS = {
    "UpLeg": "Hip", "Leg": "Knee", "Foot": "Ankle", "ToeBase": "Toe",
    "Shoulder": "Collar", "Arm": "Shoulder", "ForeArm": "Elbow", "Hand": "Wrist",
}  # fmt: skip
# arms, legs and feet as Bandai Namco and José Luis Pontón name them
_PARTS_OF_LIMBS = (
    {"Shoulder": "Shoulder", "Arm": "UpperArm", "ForeArm": "LowerArm", "Hand": "Hand"},
    {"UpLeg": "UpperLeg", "Leg": "LowerLeg"},
    {"Foot": "Foot", "ToeBase": "Toes"},
)


def _bandai_skeleton() -> SourceSkeleton:
    trunk = {"Spine": "Spine", "Spine1": "Chest", "Neck1": "Neck", "Head": "Head"}
    joints = {"Hips": SourceJoint("Hips", axes="+Y -X +Z")}
    joints |= {target: SourceJoint(name, axes="+Y +Z +X") for target, name in trunk.items()}
    arm = {"Left": "+X +Y +Z", "Right": "+X -Y -Z"}
    leg = {"Left": "-Y +X +Z", "Right": "+Y +X -Z"}
    foot = {"Left": "+Z +X +Y", "Right": "-Z +X -Y"}
    for parts, axes in zip(_PARTS_OF_LIMBS, (arm, leg, foot), strict=True):
        joints |= limbs(parts, lambda side, part: f"{part}_{side[0]}", axes)
    return SourceSkeleton("bandai_namco", frozenset({"joint_Root", "UpperArm_L"}), joints)


def _daz_skeleton() -> SourceSkeleton:
    joints = same_rest(Hips="hip", Spine="abdomen", Spine1="chest", Neck1="neck", Head="head")
    joints["LowerBack"] = SourceJoint("hip", "abdomen", 0.5)
    parts = {
        "UpLeg": "Thigh", "Leg": "Shin", "Foot": "Foot",
        "Shoulder": "Collar", "Arm": "Shldr", "ForeArm": "ForeArm", "Hand": "Hand",
    }  # fmt: skip
    along = {"UpLeg": "Shin", "Leg": "Foot", "Arm": "ForeArm", "ForeArm": "Hand", "Hand": "Mid1"}
    joints |= limbs(parts, lambda side, part: side[0].lower() + part, along=along)
    return SourceSkeleton(
        "cmu_daz",
        frozenset({"abdomen", "lShldr"}),
        joints,
        has_toe_rotation=False,
        toe_is_end_site=True,
        neck_base="neck",
    )


def _cmu_plain_skeleton() -> SourceSkeleton:
    joints = same_rest(
        Hips="Hips",
        LowerBack="lowerback",
        Spine="Chest",
        Spine1="Chest2",
        Neck="lowerneck",
        Neck1="Neck",
        Head="Head",
    )
    along = {"UpLeg": "Knee", "Leg": "Ankle", "Arm": "Elbow", "ForeArm": "Wrist"}
    joints |= limbs(_STYLE100_LIMBS, along=along)
    for side in SIDES:
        joints[side + "Hand"] = SourceJoint(side + "Wrist", along=side[0] + "Fingers")
    return SourceSkeleton("cmu_plain", frozenset({"lowerback", "LHipJoint"}), joints, neck_base="lowerneck")


def _cmu91_skeleton() -> SourceSkeleton:
    joints = same_rest(Hips="Hips", Spine="Spine", Spine1="Spine1", Neck1="Neck", Head="Head")
    return SourceSkeleton(
        "cmu91",
        frozenset({"LeftHipJoint", "Spine1"}),
        joints | limbs(LIMBS[:-1]),
        has_toe_rotation=False,
        toe_is_end_site=True,
        reference="",
    )


def _fair_skeleton() -> SourceSkeleton:
    axes = "+X -Z +Y"  # lies on its back: the file's Z is up, its -Y ahead
    joints = {target: SourceJoint(name, axes=axes) for target, name in _FOUR.items()} | limbs(
        LIMBS, axes=axes
    )
    return SourceSkeleton(
        "fair", frozenset({"LeftHandThumb1", "LeftToeBase", "Spine3"}), joints, has_toe_rotation=False
    )


def _biped_skeleton() -> SourceSkeleton:
    joints = same_rest(**_FOUR | {"Hips": "Pelvis"}) | limbs(LIMBS)
    for side in SIDES:
        joints[side + "ToeBase"] = SourceJoint(side + "FootThumb1")
    joints["LeftHand"] = SourceJoint("Lefthand")  # as the files spell it
    return SourceSkeleton(
        "biped", frozenset({"Lefthand", "LeftFootThumb1"}), joints, has_toe_rotation=False, reference=""
    )


def _jlpm_skeleton() -> SourceSkeleton:
    trunk = {
        "Hips": "Hips", "LowerBack": "Spine", "Spine": "Chest", "Spine1": "UpperChest", "Neck1": "Neck", "Head": "Head",
    }  # fmt: skip
    joints = {target: SourceJoint(name, axes="-X +Y -Z") for target, name in trunk.items()}
    arm = {"Left": "+Z +X +Y", "Right": "-Z -X +Y"}
    arms, legs, feet = _PARTS_OF_LIMBS
    joints |= limbs(arms, axes=arm) | limbs(legs, axes="+X -Y -Z") | limbs(feet, axes="+X +Z -Y")
    return SourceSkeleton("jlpm", frozenset({"UpperChest", "LeftUpperLeg"}), joints)


def _pfnn_skeleton() -> SourceSkeleton:
    same = [n for n in SPORT_SKELETON.names if not n.startswith(("LeftUpLeg", "RightUpLeg"))]
    joints = {name: SourceJoint(name) for name in same}
    joints |= limbs(("UpLeg", "Leg"), along={"UpLeg": "Leg", "Leg": "Foot"})
    return SourceSkeleton("pfnn", frozenset({"LHipJoint", "LowerBack"}), joints)


O3DE = SourceSkeleton(
    "o3de",
    frozenset({"Spine3", "Neck1", "LeftToeBase"}),
    same_rest(**_FOUR) | same_limbs(),
    has_toe_rotation=False,
)
ACCAD = SourceSkeleton(
    "accad",
    frozenset({"ToSpine", "LeftToeBase"}),
    same_rest(Hips="Hips", Spine="Spine", Spine1="Spine1", Neck1="Neck", Head="Head") | limbs(LIMBS),
    reference="",
)
STYLE100 = SourceSkeleton(
    "100style",
    frozenset({"Chest4", "LeftAnkle"}),
    same_rest(**_FOUR | {"LowerBack": "Chest", "Spine": "Chest3", "Spine1": "Chest4"})
    | limbs(_STYLE100_LIMBS),
    has_toe_rotation=False,
)
TRANSFORMS = SourceSkeleton(
    "transforms",
    frozenset({"Spine3", "LeftToeBase"}),
    same_rest(**_FOUR) | same_limbs(),
    has_toe_rotation=False,
)
BANDAI = _bandai_skeleton()
CMU_DAZ = _daz_skeleton()
CMU_PLAIN = _cmu_plain_skeleton()
CMU91 = _cmu91_skeleton()
FAIR = _fair_skeleton()
BIPED = _biped_skeleton()
JLPM = _jlpm_skeleton()
PFNN = _pfnn_skeleton()
