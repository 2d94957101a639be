"""All edits of one body: what they remember, and the pose that they make of an incoming one."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from runtime.arrays import Array
from runtime.edits.legs import LegEdit
from runtime.edits.request import EditRequest
from runtime.edits.trunk import TrunkEdit
from runtime.feet.leg import LegPose, leg_bones, leg_forward

_BONES = leg_bones(0), leg_bones(1)


class EditedPose(NamedTuple):
    """The pose for the foot lock: `hips` (3,), `local` (31, 4), `contacts` (4,), and where legs are to stand; None: as they come."""

    hips: Array
    local: Array
    contacts: Array
    legs: tuple[LegPose, LegPose] | None = None


@dataclass
class BodyEdits:
    """The edits of one character, `apply`d once per simulated frame, in order."""

    legs: LegEdit = field(default_factory=LegEdit)
    trunk: TrunkEdit = field(default_factory=TrunkEdit)

    @property
    def active(self) -> bool:
        """Whether anything is added."""
        return self.legs.active or self.trunk.active

    def apply(self, hips: Array, local: Array, contacts: Array, request: EditRequest) -> EditedPose:
        """The pose with what its words ask for and it lacks; hips `(3,)`, local rotations `(31, 4)`, contacts `(4,)`."""
        x, y, z = (float(v) for v in hips)
        rotations, chances = np.asarray(local, np.float64).tolist(), np.asarray(contacts, np.float64).tolist()
        left, right = (leg_forward(bones, (x, y, z), rotations) for bones in _BONES)
        up, (left, right) = self.legs.apply(y, (left, right), chances, request)
        east, south, local = self.trunk.apply((x, y, z), local, request)
        moved = np.array([x + east, y + up, z + south])
        return EditedPose(
            moved, local, np.array(chances), (_under(left, east, south), _under(right, east, south))
        )

    def reset(self) -> None:
        """Forget all: what is shown is no walk."""
        vars(self).update(vars(BodyEdits()))


def _under(leg: LegPose, east: float, south: float) -> LegPose:
    """The leg under hips that have moved by metres of X and Z over feet that stay."""
    hip, knee = ((p[0] + east, p[1], p[2] + south) for p in (leg.hip, leg.knee))
    return leg._replace(hip=hip, knee=knee)
