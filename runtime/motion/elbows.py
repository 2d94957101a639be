"""Elbows of the shown pose that do not pop: a network far from its data bends one by 6 to 9 degrees in a single frame.

What is shown follows the incoming flexion as fast as an elbow speeds up and slows down; the network is fed its own pose. Hardly a
frame of a captured style's walk is changed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from math import radians

import numpy as np

from runtime import rotations
from runtime.arrays import Array
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
        w, x, y, z = np.moveaxis(local[:, FOREARMS], -1, 0)
        # across the upper arm, in which its bone is +-X: where the forearm points
        up, ahead = 2.0 * (x * y + w * z), 2.0 * (x * z - w * y)
        sine = np.hypot(up, ahead)
        flexion = np.arctan2(sine, 1.0 - 2.0 * (y * y + z * z))
        behind = self.incoming - self.shown
        step = np.sign(behind) * np.minimum(
            np.abs(behind), np.sqrt(2.0 * BRAKING_RAD_PER_FRAME2 * np.abs(behind))
        )
        change = flexion - self.incoming + step - self.speed
        follows = (np.abs(change) > MAX_BEND_RAD_PER_FRAME2) | (step != behind)
        follows &= (sine > STRAIGHT_SINE) & ((self.known > 0.0) & np.array(free))[:, None]
        bent = self.shown + self.speed + np.clip(change, -MAX_BEND_RAD_PER_FRAME2, MAX_BEND_RAD_PER_FRAME2)
        bent = np.where(follows, np.maximum(bent, 0.0), flexion)
        if follows.any():
            axis = np.stack([np.zeros_like(up), -ahead, up], -1) / np.maximum(sine, STRAIGHT_SINE)[..., None]
            turn = rotations.from_rotation_vector(axis * (bent - flexion)[..., None])
            turned = rotations.multiply(turn, local[:, FOREARMS])
            local[:, FOREARMS] = np.where(follows[..., None], turned, local[:, FOREARMS])
        self.speed = np.where(self.known[:, None] > 0.0, bent - self.shown, 0.0)
        self.shown, self.incoming, self.known = bent, flexion, np.ones_like(self.known)
