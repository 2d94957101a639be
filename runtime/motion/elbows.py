"""Elbows of the shown pose that do not pop: a network far from its data bends one by 6 to 9 degrees in a single frame.

What is shown follows the incoming flexion as fast as an elbow speeds up and slows down; the network is fed its own pose. Hardly a
frame of a captured style's walk is changed.
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
BRAKING_RAD_PER_FRAME2 = radians(3.0)  # with which one comes to what is requested
STRAIGHT_SINE = 0.05  # of the flexion: a straighter elbow has no axis


def _unknown() -> Array:
    return np.zeros((1, 2))


@dataclass
class Elbows:
    """Flexion of the left and the right elbow of N characters, radians `(N, 2)`, from frame to frame."""

    shown: Array = field(default_factory=_unknown, metadata={"shape": (2,)})
    speed: Array = field(default_factory=_unknown, metadata={"shape": (2,)})  # of the shown one, a frame
    incoming: Array = field(default_factory=_unknown, metadata={"shape": (2,)})
    known: Array = field(default_factory=lambda: np.zeros(1), metadata={"shape": ()})  # 1 where these are

    def apply(self, local: Array, free: Sequence[bool]) -> None:
        """Bend the elbows of local rotations `(N, 31, 4)` in place; who is not `free` holds on to something."""
        came, pairs = local.take(FOREARMS, 1).tolist(), []
        numbers = zip(self.shown.tolist(), self.speed.tolist(), self.incoming.tolist(), strict=True)
        for i, (known, lets, arms, each) in enumerate(
            zip(self.known.tolist(), free, came, numbers, strict=True)
        ):
            for joint, q, shown, speed, incoming in zip(FOREARMS, arms, *each, strict=True):
                turn, flexion, bent = _followed(q, shown, speed, incoming, bool(known) and lets)
                if turn is not None:
                    local[i, joint] = multiply(turn, q)
                pairs.append((bent, bent - shown if known else 0.0, flexion))
        shown, self.speed, self.incoming = np.array(pairs).reshape(-1, 2, 3).transpose(2, 0, 1)
        self.shown, self.known = shown, np.ones_like(self.known)


def _followed(
    q: Quaternion, shown: float, speed: float, incoming: float, follows: bool
) -> tuple[Quaternion | None, float, float]:
    """Return the turn of a forearm that comes with local rotation `q`, or None, its flexion and that to show (radians)."""
    w, x, y, z = q
    # across the upper arm, in which its bone is +-X: where the forearm points
    up, ahead = 2.0 * (x * y + w * z), 2.0 * (x * z - w * y)
    sine = hypot(up, ahead)
    flexion = atan2(sine, 1.0 - 2.0 * (y * y + z * z))
    behind = abs(incoming - shown)
    step = copysign(min(behind, sqrt(2.0 * BRAKING_RAD_PER_FRAME2 * behind)), incoming - shown)
    change = flexion - incoming + step - speed
    if (
        not follows
        or sine <= STRAIGHT_SINE
        or (abs(change) <= MAX_BEND_RAD_PER_FRAME2 and abs(step) == behind)
    ):
        return None, flexion, flexion
    change = min(max(change, -MAX_BEND_RAD_PER_FRAME2), MAX_BEND_RAD_PER_FRAME2)
    bent = max(shown + speed + change, 0.0)
    return from_vector(scale((0.0, -ahead, up), (bent - flexion) / sine)), flexion, bent
