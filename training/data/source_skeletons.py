"""Joint maps and rest-pose corrections of the skeletons that the known motion data sets use."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from runtime import rotations
from runtime.errors import FileError
from runtime.formats.bvh import BvhMotion
from runtime.skeleton import SPORT_SKELETON
from training.data.reference_pose import standing_rotations

Array = NDArray[np.floating]

_SIDES = ("Left", "Right")
# what each bone points along in the rest pose of the SPORT skeleton
_ARM_DIRECTION = {"Left": np.array([1.0, 0, 0]), "Right": np.array([-1.0, 0, 0])}
_LEG_DIRECTION = np.array([0.0, -1.0, 0.0])

# Degrees by which faces are tilted up, by capture. Measured as the median face pitch (elevation of the head's +Z) over
# neutral walks after retargeting: -22 in 100STYLE, -12 to -14 in the second Bandai Namco data set, -11 in JLPM, -23 (walking
# frames) to -29 (all) in the few takes of PFNN, so that everybody looked at the ground. The tilt brings it to about -6
# (PFNN: -3 to -9); -12 to -22 in O3DE and -12 to -17 of ACCAD's man. The other captures, at -2 to +3, stay as they are.
HEAD_LIFT_DEGREES: Mapping[str, float] = MappingProxyType(
    {"100style": 16.0, "bandai2": 7.0, "pfnn": 20.0, "jlpm": 5.0, "o3de": 10.0, "accad_male1": 8.0}
)
# A take of each capture in which somebody stands upright at the first frame.
REFERENCES: Mapping[str, str] = MappingProxyType(
    {"accad_female1": "Female1_A01_Stand.bvh", "accad_male1": "Male1_A1_Stand.bvh"}
)


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
    head_lift_degrees: float = 0.0  # tilt of neck and head that levels the gaze, see HEAD_LIFT_DEGREES
    neck_base: str = "Neck"  # the joint at the top of the chest: the trunk leads to it
    # a take beside the clip whose first frame stands upright, or "" for the clip's own: corrections are measured there
    reference: str | None = None
    notes: str = field(default="")

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


def _plain(**names: str) -> dict[str, SourceJoint]:
    return {target: SourceJoint(source) for target, source in names.items()}


def _style100() -> SourceSkeleton:
    joints = _plain(
        Hips="Hips", LowerBack="Chest", Spine="Chest3", Spine1="Chest4", Neck1="Neck", Head="Head"
    )
    pairs = {
        "UpLeg": "Hip", "Leg": "Knee", "Foot": "Ankle", "ToeBase": "Toe",
        "Shoulder": "Collar", "Arm": "Shoulder", "ForeArm": "Elbow", "Hand": "Wrist",
    }  # fmt: skip
    for side in _SIDES:
        joints |= {side + ours: SourceJoint(side + theirs) for ours, theirs in pairs.items()}
    return SourceSkeleton("100style", frozenset({"Chest4", "LeftAnkle"}), joints, has_toe_rotation=False)


def _bandai() -> SourceSkeleton:
    trunk = "+Y +Z +X"
    joints = {
        "Hips": SourceJoint("Hips", axes="+Y -X +Z"),
        "Spine": SourceJoint("Spine", axes=trunk),
        "Spine1": SourceJoint("Chest", axes=trunk),
        "Neck1": SourceJoint("Neck", axes=trunk),
        "Head": SourceJoint("Head", axes=trunk),
    }
    arm = {"Left": "+X +Y +Z", "Right": "+X -Y -Z"}
    leg = {"Left": "-Y +X +Z", "Right": "+Y +X -Z"}
    foot = {"Left": "+Z +X +Y", "Right": "-Z +X -Y"}
    for side in _SIDES:
        end = "_" + side[0]
        names = {"Shoulder": "Shoulder", "Arm": "UpperArm", "ForeArm": "LowerArm", "Hand": "Hand"}
        joints |= {side + o: SourceJoint(t + end, axes=arm[side]) for o, t in names.items()}
        names = {"UpLeg": "UpperLeg", "Leg": "LowerLeg"}
        joints |= {side + o: SourceJoint(t + end, axes=leg[side]) for o, t in names.items()}
        names = {"Foot": "Foot", "ToeBase": "Toes"}
        joints |= {side + o: SourceJoint(t + end, axes=foot[side]) for o, t in names.items()}
    return SourceSkeleton("bandai_namco", frozenset({"joint_Root", "UpperArm_L"}), joints)


def _daz() -> SourceSkeleton:
    joints = _plain(Hips="hip", Spine="abdomen", Spine1="chest", Neck1="neck", Head="head")
    joints["LowerBack"] = SourceJoint("hip", "abdomen", 0.5)
    for side in _SIDES:
        s = side[0].lower()
        joints[side + "UpLeg"] = SourceJoint(s + "Thigh", along=s + "Shin")
        joints[side + "Leg"] = SourceJoint(s + "Shin", along=s + "Foot")
        joints[side + "Foot"] = SourceJoint(s + "Foot")
        joints[side + "Shoulder"] = SourceJoint(s + "Collar")
        joints[side + "Arm"] = SourceJoint(s + "Shldr", along=s + "ForeArm")
        joints[side + "ForeArm"] = SourceJoint(s + "ForeArm", along=s + "Hand")
        joints[side + "Hand"] = SourceJoint(s + "Hand", along=s + "Mid1")
    return SourceSkeleton(
        "cmu_daz",
        frozenset({"abdomen", "lShldr"}),
        joints,
        has_toe_rotation=False,
        toe_is_end_site=True,
        neck_base="neck",
    )


def _cmu_plain() -> SourceSkeleton:
    joints = _plain(
        Hips="Hips",
        LowerBack="lowerback",
        Spine="Chest",
        Spine1="Chest2",
        Neck="lowerneck",
        Neck1="Neck",
        Head="Head",
    )
    for side in _SIDES:
        joints[side + "UpLeg"] = SourceJoint(side + "Hip", along=side + "Knee")
        joints[side + "Leg"] = SourceJoint(side + "Knee", along=side + "Ankle")
        joints[side + "Foot"] = SourceJoint(side + "Ankle")
        joints[side + "ToeBase"] = SourceJoint(side + "Toe")
        joints[side + "Shoulder"] = SourceJoint(side + "Collar")
        joints[side + "Arm"] = SourceJoint(side + "Shoulder", along=side + "Elbow")
        joints[side + "ForeArm"] = SourceJoint(side + "Elbow", along=side + "Wrist")
        joints[side + "Hand"] = SourceJoint(side + "Wrist", along=side[0] + "Fingers")
    return SourceSkeleton("cmu_plain", frozenset({"lowerback", "LHipJoint"}), joints, neck_base="lowerneck")


def _jlpm() -> SourceSkeleton:
    trunk = "-X +Y -Z"
    names = {
        "Hips": "Hips", "LowerBack": "Spine", "Spine": "Chest", "Spine1": "UpperChest", "Neck1": "Neck", "Head": "Head",
    }  # fmt: skip
    joints = {ours: SourceJoint(theirs, axes=trunk) for ours, theirs in names.items()}
    arm = {"Left": "+Z +X +Y", "Right": "-Z -X +Y"}
    for side in _SIDES:
        names = {"Shoulder": "Shoulder", "Arm": "UpperArm", "ForeArm": "LowerArm", "Hand": "Hand"}
        joints |= {side + o: SourceJoint(side + t, axes=arm[side]) for o, t in names.items()}
        names = {"UpLeg": "UpperLeg", "Leg": "LowerLeg"}
        joints |= {side + o: SourceJoint(side + t, axes="+X -Y -Z") for o, t in names.items()}
        names = {"Foot": "Foot", "ToeBase": "Toes"}
        joints |= {side + o: SourceJoint(side + t, axes="+X +Z -Y") for o, t in names.items()}
    return SourceSkeleton("jlpm", frozenset({"UpperChest", "LeftUpperLeg"}), joints)


def _pfnn() -> SourceSkeleton:
    same = [n for n in SPORT_SKELETON.names if not n.startswith(("LeftUpLeg", "RightUpLeg"))]
    joints = {name: SourceJoint(name) for name in same}
    for side in _SIDES:
        joints[side + "UpLeg"] = SourceJoint(side + "UpLeg", along=side + "Leg")
        joints[side + "Leg"] = SourceJoint(side + "Leg", along=side + "Foot")
    return SourceSkeleton("pfnn", frozenset({"LHipJoint", "LowerBack"}), joints)


def _o3de() -> SourceSkeleton:
    joints = _plain(
        Hips="Hips", LowerBack="Spine1", Spine="Spine2", Spine1="Spine3", Neck1="Neck", Head="Head"
    )
    for side in _SIDES:
        joints[side + "Shoulder"] = SourceJoint(side + "Shoulder")
        joints[side + "Arm"] = SourceJoint(side + "Arm", along=side + "ForeArm")
        joints[side + "ForeArm"] = SourceJoint(side + "ForeArm", along=side + "Hand")
        joints[side + "Hand"] = SourceJoint(side + "Hand")
        joints[side + "UpLeg"] = SourceJoint(side + "UpLeg", along=side + "Leg")
        joints[side + "Leg"] = SourceJoint(side + "Leg", along=side + "Foot")
        joints[side + "Foot"] = SourceJoint(side + "Foot")
        joints[side + "ToeBase"] = SourceJoint(side + "ToeBase")
    return SourceSkeleton(
        "o3de", frozenset({"Spine3", "Neck1", "LeftToeBase"}), joints, has_toe_rotation=False
    )


_LIMBS = ("Shoulder", "Arm", "ForeArm", "Hand", "UpLeg", "Leg", "Foot", "ToeBase")


def _accad() -> SourceSkeleton:
    joints = _plain(Hips="Hips", Spine="Spine", Spine1="Spine1", Neck1="Neck", Head="Head")
    joints |= {side + limb: SourceJoint(side + limb) for side in _SIDES for limb in _LIMBS}
    return SourceSkeleton("accad", frozenset({"ToSpine", "LeftToeBase"}), joints, reference="")


def _cmu91() -> SourceSkeleton:
    joints = _plain(Hips="Hips", Spine="Spine", Spine1="Spine1", Neck1="Neck", Head="Head")
    joints |= {side + limb: SourceJoint(side + limb) for side in _SIDES for limb in _LIMBS[:-1]}
    return SourceSkeleton(
        "cmu91",
        frozenset({"LeftHipJoint", "Spine1"}),
        joints,
        has_toe_rotation=False,
        toe_is_end_site=True,
        reference="",
    )


def _fair() -> SourceSkeleton:
    axes = "+X -Z +Y"  # lies on its back: the file's Z is up, its -Y ahead
    names = {"Hips": "Hips", "LowerBack": "Spine1", "Spine": "Spine2", "Spine1": "Spine3", "Neck1": "Neck"}
    joints = {ours: SourceJoint(theirs, axes=axes) for ours, theirs in (names | {"Head": "Head"}).items()}
    joints |= {side + limb: SourceJoint(side + limb, axes=axes) for side in _SIDES for limb in _LIMBS}
    return SourceSkeleton("fair", frozenset({"LeftHandThumb1", "Spine3"}), joints, has_toe_rotation=False)


def known_skeletons() -> tuple[SourceSkeleton, ...]:
    """Every hierarchy the importer can retarget without a map from the user."""
    return (
        _style100(), _bandai(), _daz(), _cmu_plain(), _jlpm(), _pfnn(), _o3de(), _accad(), _cmu91(), _fair(),
    )  # fmt: skip


def of_capture(skeleton: SourceSkeleton, capture: str) -> SourceSkeleton:
    """`skeleton` with the constants of one capture (`ClipSource.capture`), which a hierarchy alone does not tell."""
    return replace(
        skeleton,
        reference=REFERENCES.get(capture, skeleton.reference),
        head_lift_degrees=HEAD_LIFT_DEGREES.get(capture, 0.0),
        # the terrain of the rollouts is in centimetres
        fixed_scale=0.01 if capture == "pfnn_rollouts" else skeleton.fixed_scale,
    )


def recognise(motion: BvhMotion, file_name: str) -> SourceSkeleton:
    """The known skeleton of a BVH; FileError names the file when there is none."""
    names = set(motion.skeleton.names)
    for skeleton in known_skeletons():
        if skeleton.signature <= names:
            missing = {j.name for j in skeleton.joints.values()} - names
            if missing:
                raise FileError(
                    f"{file_name}: joints {sorted(missing)} are missing.", "Export the clip again."
                )
            return skeleton
    raise FileError(
        f"{file_name}: none of the known skeletons.", "Give a joint map (SourceSkeleton) for this file."
    )
