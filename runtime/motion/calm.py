"""A body that comes to rest: the network's own time runs slower there, so that nothing moves faster than a body at rest.

Left alone, the network's legs step on for two seconds after a stop and its trunk fidgets for ever; its feet then slide
under feet that are held. Slowing all of it alike, pose, phases and root, keeps every pose one of its own: nothing slides,
breathing (slower than the limit) is as it was, and the network goes on from there when the stick moves.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from runtime import rotations
from runtime.arrays import Array
from runtime.motion.features import FPS
from runtime.skeleton import SPORT_SKELETON, J
from runtime.spring import decay

LIMBS = [
    SPORT_SKELETON.index(name)
    for name in ("LeftHand", "RightHand", "Head", "LeftLeg", "RightLeg", "LeftFoot", "RightFoot")
]
# m/s of the limbs of a body at rest: hands and head (0.02 to 0.1 in captured idles), knees, and feet, which stand
AT_REST = np.array([0.07, 0.07, 0.07, 0.05, 0.05, 0.02, 0.02])
NEARLY = 0.3  # of the usual speed: a body that is nearly at rest comes over its feet
PATIENCE = 0.6  # more of its usual distance a foot may be held away at rest, where a body steps for no reason
UNSEEN = 0.05  # m beside its feet it may stay,
OVER_FEET_S = 0.4  # from farther away it comes in about this time,
SWAYS = 0.05  # m/s at most
FORGETS = 2.0  # seconds, half-life, in which a body forgets how fast its limbs were
LEAST_USUAL = 1.0  # m/s: as fast a body may come to rest that moved slower
SLOW = 0.25  # m/s of the plan: slower, a body comes to rest
WAITS = 0.2  # seconds after the last change of what is asked
EVEN = 0.05  # seconds, half-life, in which the rate changes while a body stops; at rest at once
SETTLES = 0.12  # seconds, half-life, in which the limit goes down,
WAKES = 0.05  # and up again
STEPS_ON = 0.6  # of its usual speed a body keeps until both feet stand


@dataclass
class Calm:
    """How slow the time of N characters runs, and the poses that they were in."""

    local: Array = field(
        metadata={"shape": (J, 4)}
    )  # (N, 31, 4) of the last frame, the hips seen from the root
    usual: Array = field(metadata={"shape": (len(LIMBS),), "most": 1000.0})  # (N, 7) m/s
    share: Array = field(metadata={"shape": ()})  # (N,) of it that is the limit, 1 while a body moves
    asked: Array = field(metadata={"shape": ()})  # (N,) seconds since something else was asked for
    rate: Array = field(metadata={"shape": ()})  # (N,) of this frame's time

    @staticmethod
    def awake(local: Array, yaw: Array) -> Calm:
        """Of characters that do not move: local rotations `(N, 31, 4)`, and the roots' yaw `(N,)`."""
        one = np.ones(len(local))
        usual = np.full((len(local), len(LIMBS)), LEAST_USUAL)
        return Calm(_turned(local, -yaw), usual, one, 0.0 * one, one)

    def slow(
        self,
        joints: Array,
        before: Array,
        free: NDArray[np.bool_],
        still: NDArray[np.bool_],
        grounded: NDArray[np.bool_],
    ) -> Array:
        """The rates `(N,)` of this frame, for joints `(N, 31, 3)` relative to the root and those of the last frame.

        `free` `(N,)`: nothing is asked of the body, which may be coming to rest; `still` `(N,)`: it is where it was
        asked to be; `grounded` `(N,)`: both feet stand where they may stay.
        """
        moved = (joints - before)[:, LIMBS]
        speed = np.sqrt((moved * moved).sum(-1)) * FPS
        usual = np.maximum(np.maximum(self.usual * decay(FORGETS), speed), LEAST_USUAL)
        self.usual = np.where(free[:, None], self.usual, usual)
        self.asked = np.where(free & still, self.asked + 1.0 / FPS, 0.0)
        settled = self.share * decay(SETTLES)
        settled = np.where(grounded, settled, np.maximum(settled, np.minimum(self.share, STEPS_ON)))
        awake = 1.0 + (self.share - 1.0) * decay(WAKES)
        self.share = np.where(self.asked > WAITS, settled, awake)
        limit = np.maximum(self.share[:, None] * self.usual, AT_REST)
        rate = np.minimum((limit / np.maximum(speed, 1e-9)).min(-1), 1.0)
        even = 0.5 ** (1.0 / (FPS * EVEN * np.maximum(self.share, 1e-3)))
        self.rate = rate + (self.rate - rate) * even
        return self.rate

    def between(self, local: Array, yaw: Array) -> Array:
        """Local rotations `(N, 31, 4)` on the way from the last frame's to these, by the rates; remembers them."""
        here = _turned(local, -yaw)
        turn = rotations.to_rotation_vector(rotations.multiply(here, rotations.inverse(self.local)))
        part = rotations.from_rotation_vector(turn * self.rate[:, None, None])
        slow = (self.rate < 1.0)[:, None, None]
        self.local = np.where(slow, rotations.multiply(part, self.local), here)
        return np.where(slow, _turned(self.local, yaw), local)


def _turned(local: Array, yaw: Array) -> Array:
    """Local rotations with the hips turned about the vertical by `yaw` `(N,)`."""
    result = local.copy()
    half = 0.5 * yaw
    about = np.stack([np.cos(half), 0.0 * half, np.sin(half), 0.0 * half], -1)
    result[:, 0] = rotations.multiply(about, local[:, 0])
    return result
