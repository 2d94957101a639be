"""Joint maps and rest-pose corrections of the skeletons of known motion data sets."""

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from runtime import rotations
from runtime.arrays import Array
from runtime.formats.bvh import BvhMotion

_UP, _DOWN = np.array([0.0, 1.0, 0.0]), np.array([0.0, -1.0, 0.0])


def standing_rotations(points: Mapping[str, Array]) -> dict[str, Array]:
    """Return our world rotations `(4,)` of an upright figure that looks ahead, from its joints `(3,)` by our names.

    Trunk, head and feet face as the hips do; arms and legs keep their directions, with minimal twist.
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
    """Return rotations of a limb's joints: each bone points to the next joint, the last one follows its parent."""
    result, current = {}, heading
    for joint, child in pairwise(chain):
        wanted = rotations.normalize(points[child] - points[joint])
        current = rotations.multiply(rotations.between(rotations.rotate(current, rest), wanted), current)
        result[joint] = current
    result[chain[-1]] = current
    return result


SIDES = ("Left", "Right")
# directions of the bones in the rest pose of the SPORT skeleton
_ARM_DIRECTION = {"Left": np.array([1.0, 0, 0]), "Right": np.array([-1.0, 0, 0])}
_LEG_DIRECTION = np.array([0.0, -1.0, 0.0])

LIMBS = ("Shoulder", "Arm", "ForeArm", "Hand", "UpLeg", "Leg", "Foot", "ToeBase")


@dataclass(frozen=True)
class SourceJoint:
    """Source of the world rotation of a SPORT joint.

    The rotation is that of source joint `name`, or interpolated by `blend` from `name` to `towards`. `axes`: directions
    of the source joint's local X, Y and Z while the character is in our rest pose. `along`: the source's child joint whose
    offset is aligned with our bone, keeping the twist. Without either, the two rest frames agree. A rough frame is enough
    for feet: `retarget.calibrate_feet` measures the rest.
    """

    name: str
    towards: str | None = None
    blend: float = 0.0
    axes: str | None = None  # such as "+Y -X +Z"
    along: str | None = None


@dataclass(frozen=True)
class SourceSkeleton:
    """A known hierarchy, with its mapping to our joints and the behaviour of its toes."""

    name: str
    signature: frozenset[str]  # joint names that identify this hierarchy
    joints: Mapping[str, SourceJoint]
    has_toe_rotation: bool = True
    toe_is_end_site: bool = False  # no toe joint: the foot's end site is at the ball of the foot
    fixed_scale: float | None = None  # metres per file unit; None: from the ratio of leg lengths
    head_lift_degrees: float = 0.0  # tilt of neck and head that levels the gaze, see DataSet
    neck_base: str = "Neck"  # the joint at the top of the trunk
    # take in the clip's folder (or "": the clip itself) whose upright first frame gives the corrections
    reference: str | None = None

    def corrections(self, motion: BvhMotion) -> dict[str, Array]:
        """Return constant rotations C `(4,)` by SPORT joint: our world rotation is the source's times C.

        `motion` is the clip, or the take named by `reference`.
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
    """Return the matrix whose columns are the directions of local X, Y, Z, from a text such as "+Y -X +Z"."""
    columns = [np.eye(3)["XYZ".index(word[1])] * (1.0 if word[0] == "+" else -1.0) for word in axes.split()]
    return np.stack(columns, axis=1)


def _rest_direction(joint: str) -> Array:
    if "Arm" in joint or "Hand" in joint:
        return _ARM_DIRECTION["Left" if joint.startswith("Left") else "Right"]
    return _LEG_DIRECTION


@cache
def known_skeletons() -> tuple[SourceSkeleton, ...]:
    """Return the hierarchies of `skeletons.toml`, in the order in which files are recognised."""
    text = Path(__file__).with_name("skeletons.toml").read_text("utf-8")
    return tuple(_skeleton(name, **entry) for name, entry in tomllib.loads(text).items())


def _skeleton(
    name: str,
    signature: Sequence[str],
    trunk: Mapping[str, str],
    limbs: Sequence[Mapping[str, Any]],
    joints: Mapping[str, Mapping[str, Any]] = MappingProxyType({}),
    trunk_axes: str | None = None,
    **settings: Any,
) -> SourceSkeleton:
    found = {target: SourceJoint(source, axes=trunk_axes) for target, source in trunk.items()}
    for group in limbs:
        found |= _limbs(**group)
    found |= {target: SourceJoint(**joint) for target, joint in joints.items()}
    return SourceSkeleton(name, frozenset(signature), found, **settings)


_ALL_PARTS = MappingProxyType({part: part for part in LIMBS})


def _limbs(
    parts: Mapping[str, str] = _ALL_PARTS,
    name: str = "{side}{part}",
    axes: Mapping[str, str] | str | None = None,
    along: Mapping[str, str] = MappingProxyType({}),
) -> dict[str, SourceJoint]:
    """Return the source joints of both sides from an entry of `skeletons.toml`."""

    def spelled(side: str, part: str) -> str:
        return name.format(side=side, part=part, letter=side[0], small=side[0].lower())

    return {
        side + target: SourceJoint(
            spelled(side, part),
            axes=axes[side] if isinstance(axes, Mapping) else axes,
            along=spelled(side, along[target]) if target in along else None,
        )
        for side in SIDES
        for target, part in parts.items()
    }
