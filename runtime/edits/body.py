"""All edits of one body: their state, and the edited pose."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import cos, sin
from typing import NamedTuple

import numpy as np

from runtime.arrays import Array
from runtime.edits.arms import ArmEdit, ArmPose, Axes, Body
from runtime.edits.legs import LegEdit
from runtime.edits.request import LEG, ROW_ARMS, EditRequest, asks
from runtime.edits.trunk import TrunkEdit
from runtime.feet.foot_lock import carrying_rise
from runtime.feet.leg import LegPose, leg_bones, leg_forward
from runtime.feet.reach import span
from runtime.scalar_math import Quaternion, Vector, add, dot, multiply, relative, rotate, subtract
from runtime.skeleton import SPORT_SKELETON

_BONES = leg_bones(0), leg_bones(1)
_AT = SPORT_SKELETON.index
_ARMS = tuple(
    (sign, tuple(_AT(f"{side}{name}") for name in ("Shoulder", "Arm", "ForeArm", "Hand")))
    for side, sign in (("Left", 1.0), ("Right", -1.0))
)
_SPINE, _NECK = tuple(map(_AT, ("LowerBack", "Spine", "Spine1"))), tuple(map(_AT, ("Neck", "Neck1", "Head")))
_OFFSETS: tuple[Vector, ...] = tuple((float(x), float(y), float(z)) for x, y, z in SPORT_SKELETON.offsets)


class EditedPose(NamedTuple):
    """The edited pose for the foot lock: `hips` (3,), `local` (31, 4), `contacts` (4,), and the edited `legs` or None."""

    hips: Array
    local: Array
    contacts: Array
    legs: tuple[LegPose, LegPose] | None = None

    def moved(self, by: Vector) -> EditedPose:
        """Return the pose with its hips shifted by `by` (metres) and its feet in place; the hips rise if the legs would bend more."""
        east, up, south = by
        x, y, z = (float(v) for v in self.hips)
        rotations = np.asarray(self.local, np.float64).tolist()
        left, right = self.legs or (leg_forward(bones, (x, y, z), rotations) for bones in _BONES)
        heel, toe, other_heel, other_toe = self.contacts.tolist()
        ends, bears = (
            [(add(leg.hip, by), leg.ankle) for leg in (left, right)],
            (max(heel, toe), max(other_heel, other_toe)),
        )
        up += carrying_rise(ends, (span(left), span(right)), bears)
        legs = _under(left, (east, up, south)), _under(right, (east, up, south))
        return self._replace(hips=np.array((x + east, y + up, z + south)), legs=legs)


@dataclass
class BodyEdits:
    """The body edits of one character; call `apply` once per simulated frame, in order."""

    legs: LegEdit = field(default_factory=LegEdit)
    trunk: TrunkEdit = field(default_factory=TrunkEdit)
    arms: tuple[ArmEdit, ArmEdit] = field(default_factory=lambda: (ArmEdit(), ArmEdit()))

    @property
    def active(self) -> bool:
        """Whether any edit currently changes the pose."""
        return self.legs.active or self.trunk.active or any(arm.active for arm in self.arms)

    def apply(self, hips: Array, local: Array, contacts: Array, request: EditRequest) -> EditedPose:
        """Return the pose with the requested edits; hips `(3,)`, local rotations `(31, 4)`, contacts `(4,)`."""
        x, y, z = (float(v) for v in hips)
        rotations, chances = np.asarray(local, np.float64).tolist(), np.asarray(contacts, np.float64).tolist()
        targets = request.targets
        left, right = (leg_forward(bones, (x, y, z), rotations) for bones in _BONES)
        ahead = (sin(request.yaw), 0.0, cos(request.yaw))
        strides = [dot(subtract(leg.ankle, (x, y, z)), ahead) for leg in (right, left)]
        rise = 0.0
        if self.legs.active or any(asks(leg[: len(LEG)]) for leg in targets[:2]):
            rise, (left, right) = self.legs.apply(y, (left, right), chances, request)
        elif self.legs.height:
            self.legs = LegEdit()  # a later request starts from new measurements
        east, up, south, local = self.trunk.apply((x, y, z), local, request)
        moved = (x + east, y + rise + up, z + south)
        if any(arm.active or asks(row) for arm, row in zip(self.arms, targets[ROW_ARMS:], strict=True)):
            local = self._with_arms(moved, local, strides, request)
        legs = (_under(left, (east, up, south)), _under(right, (east, up, south)))
        return EditedPose(np.array(moved), local, np.array(chances), legs)

    def _with_arms(self, hips: Vector, local: Array, strides: list[float], request: EditRequest) -> Array:
        rotations: list[Quaternion] = [tuple(q) for q in local.tolist()]
        side: Vector = (cos(request.yaw), 0.0, -sin(request.yaw))  # towards the left
        ahead: Vector = (sin(request.yaw), 0.0, cos(request.yaw))
        facing = (cos(0.5 * request.yaw), 0.0, sin(0.5 * request.yaw), 0.0)
        pelvis = Axes(hips, rotations[0])
        chest = _along(pelvis, _SPINE, rotations)
        axes = (Axes(hips, facing), pelvis, chest, _along(chest, _NECK, rotations))
        result = np.array(local, copy=True)
        for k, (edit, (sign, joints)) in enumerate(zip(self.arms, _ARMS, strict=True)):
            arm = _arm(chest, sign, joints, rotations)
            edited = edit.apply(arm, Body(axes, side, ahead, strides[k]), request.targets[ROW_ARMS + k])
            if edited is not None:
                result[joints[1]] = relative(arm.collar, edited.upper)
                result[joints[2]] = relative(edited.upper, edited.lower)
                result[joints[3]] = edited.hand
        return result

    def reset(self) -> None:
        """Reset all measurements and edits, when the shown motion is not a walk."""
        vars(self).update(vars(BodyEdits()))


def _along(start: Axes, joints: tuple[int, ...], rotations: list[Quaternion]) -> Axes:
    """Return position and rotation of the last joint of a chain that begins at `start`."""
    at, turned = start
    for joint in joints:
        at, turned = add(at, rotate(turned, _OFFSETS[joint])), multiply(turned, rotations[joint])
    return Axes(at, turned)


def _arm(chest: Axes, sign: float, joints: tuple[int, ...], rotations: list[Quaternion]) -> ArmPose:
    collar, shoulder, elbow, hand = joints
    at, base = _along(chest, (collar,), rotations)
    at = add(at, rotate(base, _OFFSETS[shoulder]))
    upper = multiply(base, rotations[shoulder])
    middle = add(at, rotate(upper, _OFFSETS[elbow]))
    lower = multiply(upper, rotations[elbow])
    wrist = add(middle, rotate(lower, _OFFSETS[hand]))
    return ArmPose(sign, base, upper, lower, rotations[hand], at, middle, wrist)


def _under(leg: LegPose, by: Vector) -> LegPose:
    """Return the leg with its hips moved `by` metres and its foot in place."""
    return LegPose(*leg[:4], add(leg.hip, by), add(leg.knee, by), *leg[6:])
