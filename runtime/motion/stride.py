"""How much of the root's speed the feet carry, and how long strides become.

A network that is asked to go on at a speed moves its root at that speed, even where its legs take shorter steps: planted
feet then slide, and hands, hips and shoulders swing as little as such steps need. What a planted foot goes back at, seen
from the root, is the speed of the steps; the regulator holds that to the request, and the strides become long enough.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from runtime.arrays import Array
from runtime.feet.skating import SOLE_POINTS
from runtime.motion.features import FPS
from runtime.spring import decay

POINTS = list(SOLE_POINTS)  # left heel, left toe, right heel, right toe, as contacts
LEAST_CONTACT = 0.25  # sum of squared contacts: less is a flight, which says nothing
RANGE = (0.5, 1.5)  # of the share
SMOOTHING = 0.3  # seconds, half-life: about a step
SLOWEST = 0.3  # m/s: slower, feet may well rest
# what the regulator leaves of a difference in speed is taken up by longer or shorter strides, this much at most
STRETCH = (0.65, 1.25)
# of the plan: a smoothed request below that is a start, which longer strides would overshoot
SETTING_OFF = 0.5
SETTLED = 0.9  # of the plan: until the smoothed request is there,
WALK_START = 1.12  # times a walk's plan is the most that longer strides make of a speed


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


def stretch(
    smooth_request: Array,
    requested: Array,
    measured: Array,
    root: Array,
    jogs: NDArray[np.bool_],
    response: Array,
) -> Array:
    """How much longer strides become `(N,)`, for speeds in m/s: planned, smoothed and not, the root's, smoothed and not.

    `response` `(N,)` is 1 where a body may start at once.
    """
    longer = smooth_request / np.maximum(measured, 1e-9)
    going = smooth_request / np.maximum(requested, 1e-9)
    settled = np.minimum(np.maximum((going - SETTLED) / (1.0 - SETTLED), response), 1.0)
    going = np.minimum(np.maximum((going - SETTING_OFF) / (1.0 - SETTING_OFF), response), 1.0)
    longer = np.minimum(np.maximum(longer, STRETCH[0]), 1.0 + (STRETCH[1] - 1.0) * going)
    # a body that has caught up with its plan is not carried past it
    most = np.maximum(WALK_START * requested / np.maximum(root, 1e-9), 1.0)
    most = np.where(jogs, STRETCH[1], most)
    return np.where(settled < 1.0, np.minimum(longer, most + (STRETCH[1] - 1.0) * settled), longer)


def _across(joints: Array) -> Array:
    return joints[:, POINTS][..., [0, 2]]
