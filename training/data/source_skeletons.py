"""Joint maps and rest-pose corrections of the skeletons that the known motion data sets use."""

from __future__ import annotations

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
    """Source joints of both sides, as `skeletons.toml` says."""

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
