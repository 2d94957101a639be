"""Limits the acceleration of the elbows: a network far from its data bends them by 6 to 9 degrees in a single frame.

The shown flexion follows the incoming one with limited acceleration and braking; the network is fed its own pose. In captured
styles hardly a frame changes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from math import atan2, copysign, hypot, radians, sqrt

import numpy as np

from runtime.arrays import Array
from runtime.scalar_math import Quaternion, from_vector, multiply, scale
from runtime.skeleton import SPORT_SKELETON

FOREARMS = [SPORT_SKELETON.index("LeftForeArm"), SPORT_SKELETON.index("RightForeArm")]
MAX_BEND_RAD_PER_FRAME2 = radians(5.5)  # captured elbows stay below 6 degrees
BRAKING_RAD_PER_FRAME2 = radians(3.0)  # deceleration towards the incoming flexion
STRAIGHT_SINE = 0.05  # of the flexion: a straighter elbow has no axis


def _unknown() -> Array:
    return np.zeros((1, 2))


@dataclass
class Elbows:
    """Flexion of the left and the right elbow of N characters, radians `(N, 2)`, from frame to frame."""

    shown: Array = field(default_factory=_unknown, metadata={"shape": (2,)})
    speed: Array = field(default_factory=_unknown, metadata={"shape": (2,)})  # of the shown one, per frame
    incoming: Array = field(default_factory=_unknown, metadata={"shape": (2,)})
    known: Array = field(default_factory=lambda: np.zeros(1), metadata={"shape": ()})  # 1 where known

    def apply(self, local: Array, free: Sequence[bool]) -> None:
        """Bend the elbows of local rotations `(N, 31, 4)` in place; a character that is not `free` holds on to something."""
        pairs = []
        numbers = zip(self.shown.tolist(), self.speed.tolist(), self.incoming.tolist(), strict=True)
        bodies = zip(local.take(FOREARMS, 1).tolist(), numbers, self.known.tolist(), free, strict=True)
        for i, (arms, each, known, lets) in enumerate(bodies):
            for joint, q, shown, speed, incoming in zip(FOREARMS, arms, *each, strict=True):
                local[i, joint], flexion, bent = _followed(q, shown, speed, incoming, bool(known) and lets)
                pairs.append((bent, bent - shown if known else 0.0, flexion))
        self.shown, self.speed, self.incoming = np.array(pairs).reshape(-1, 2, 3).transpose(2, 0, 1)
        self.known = np.ones_like(self.known)


def _followed(
    q: Quaternion, shown: float, speed: float, incoming: float, follows: bool
) -> tuple[Quaternion, float, float]:
    """Return the shown local rotation of a forearm, its flexion and flexion speed, from the incoming rotation `q` (radians)."""
    w, x, y, z = q
    # direction of the forearm across the upper arm, whose bone is +-X
    up, ahead = 2.0 * (x * y + w * z), 2.0 * (x * z - w * y)
    sine = hypot(up, ahead)
    flexion = atan2(sine, 1.0 - 2.0 * (y * y + z * z))
    behind = incoming - shown
    step = copysign(min(abs(behind), sqrt(2.0 * BRAKING_RAD_PER_FRAME2 * abs(behind))), behind)
    change = flexion - incoming + step - speed
    most = MAX_BEND_RAD_PER_FRAME2
    if not follows or sine <= STRAIGHT_SINE or (abs(change) <= most and step == behind):
        return q, flexion, flexion
    bent = max(shown + speed + min(max(change, -most), most), 0.0)
    return multiply(from_vector(scale((0.0, -ahead, up), (bent - flexion) / sine)), q), flexion, bent
