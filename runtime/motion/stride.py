"""How much of the root's speed the feet carry.

A network that is asked to go on at a speed moves its root at that speed, even where its legs take shorter steps: planted
feet then slide, and hands, hips and shoulders swing as little as such steps need. What a planted foot goes back at, seen
from the root, is the speed of the steps; the regulator holds that to the request, and the strides become long enough.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from runtime.arrays import Array
from runtime.feet.skating import SOLE_POINTS
from runtime.motion.features import FPS
from runtime.motion.trajectory import decay

POINTS = list(SOLE_POINTS)  # left heel, left toe, right heel, right toe, as contacts
LEAST_CONTACT = 0.25  # sum of squared contacts: less is a flight, which says nothing
RANGE = (0.5, 1.5)  # of the share
SMOOTHING = 0.3  # seconds, half-life: about a step
SLOWEST = 0.3  # m/s: slower, feet may well rest


@dataclass
class StrideState:
    """The speed of the planted feet over that of the root, of N characters, from frame to frame."""

    feet: Array = field(metadata={"shape": (4, 2)})  # (N, 4, 2) in XZ, relative to the root
    share: Array = field(metadata={"shape": ()})  # (N,)

    @staticmethod
    def at_rest(joints: Array) -> StrideState:
        """Of characters whose joints `(N, 31, 3)` do not move."""
        return StrideState(_across(joints), np.ones(len(joints)))

    def carried(self, joints: Array, contacts: Array) -> tuple[Array, Array]:
        """Velocities `(N, 2)` that planted feet carry the roots at since the last `update`, m/s in their frames, and the weights `(N,)` on them."""
        weights = np.square(np.minimum(np.maximum(contacts, 0.0), 1.0))
        total = weights.sum(-1)
        back = (weights[:, :, None] * (_across(joints) - self.feet)).sum(1)
        return -back * FPS / np.maximum(total, LEAST_CONTACT)[:, None], total

    def update(self, joints: Array, contacts: Array, speed: Array) -> Array:
        """The shares `(N,)`, of joints `(N, 31, 3)` relative to the root, contacts `(N, 4)` and the roots' smoothed speeds in m/s."""
        carried, total = self.carried(joints, contacts)
        self.feet = _across(joints)
        back = np.sqrt((carried * carried).sum(-1))
        share = np.minimum(np.maximum(back / np.maximum(speed, SLOWEST), RANGE[0]), RANGE[1])
        share = np.where(total > LEAST_CONTACT, share, self.share)  # a flight says nothing
        share = np.where(speed < SLOWEST, 1.0, share)
        self.share = self.share + (share - self.share) * (1.0 - decay(SMOOTHING))
        return self.share


def _across(joints: Array) -> Array:
    return joints[:, POINTS][..., [0, 2]]
