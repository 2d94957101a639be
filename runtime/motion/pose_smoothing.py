"""Smoothing of the network's pose over time: turns that are too fast are spread over time, and a body at rest moves slowly.

Inertialization (Bollo, GDC 2018): between two styles the network switches at one moment, however slowly Z^t changes:
an arm requested overhead gets there within 0.15 s. The excess of a frame's turn becomes an offset on the
shown rotation, which a critically damped spring returns to zero. When a body comes to rest its arms, which would
swing for another one to three seconds, are damped in the same way.

Settling: after a stop the network's legs keep stepping for two seconds and its trunk fidgets forever; its feet then
slide under feet that are held. Slowing pose, phases and root alike keeps every pose one of the network's: nothing
slides, breathing (below the speed limit) is unchanged, and the network continues from there when the stick moves.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from math import cos

import numpy as np

from runtime import rotations
from runtime.arrays import Array
from runtime.easing import spring
from runtime.motion.features import DT, FPS
from runtime.scalar_math import MIN_DIVISOR, decay
from runtime.skeleton import SPORT_SKELETON, J

ARMS = [
    SPORT_SKELETON.index(side + name) for side in ("Left", "Right") for name in ("Shoulder", "Arm", "ForeArm")
]
TRUNK = [SPORT_SKELETON.index(name) for name in ("LowerBack", "Spine", "Spine1", "Neck", "Neck1", "Head")]
JOINTS = np.array(ARMS + TRUNK)
MAX_ARM_SPEED_RAD_PER_S = 6.0  # arms in walking and jogging swing up to this speed
OFFSET_HALF_LIFE_S = 0.2  # in which about half of an offset decays
AFTER_BLEND_S = 0.5  # after a blend, in which the network may still switch
MAX_JOINT_SPEED_RAD_PER_S = 20.0  # else; captured dashing arms reach 16 in 99 of 100 frames, unstable ones 50
MAX_RESTING_SPEED_RAD_PER_S = 0.15  # faster than breathing, slower than an arm still swinging
RESTING_HALF_LIFE_S = 0.35  # seconds
_DONE_RAD = 1e-3  # rad


@dataclass
class Inertialization:
    """Inertialization offsets of N characters, carried from frame to frame."""

    # (N, 12, 4) the network's rotations of the last frame
    last: Array = field(metadata={"shape": (len(JOINTS), 4)})
    # (N, 12, 3) rotation vectors, rad, on the parent's side
    offset: Array = field(metadata={"shape": (len(JOINTS), 3)})
    speed: Array = field(metadata={"shape": (len(JOINTS), 3)})  # (N, 12, 3) rad/s
    left: Array = field(metadata={"shape": ()})  # (N,) seconds in which the network may still switch

    @staticmethod
    def at_rest(local: Array) -> Inertialization:
        """Return the state of characters at rest with local rotations `(N, 31, 4)`."""
        still = np.zeros((len(local), len(JOINTS), 3))
        return Inertialization(local[:, JOINTS], still, still, np.zeros(len(local)))

    def apply(self, local: Array, blending: Sequence[bool], rest: Sequence[float]) -> list[bool]:
        """Smooth arms and trunk of the network's local rotations `(N, 31, 4)` in place, and return which characters changed.

        `rest` is 0 for a body that moves freely, up to 1 for one that should be at rest.
        """
        left = [
            AFTER_BLEND_S if blends else max(0.0, each - DT)
            for each, blends in zip(self.left.tolist(), blending, strict=True)
        ]
        limits = [_fastest(*pair) for pair in zip(left, rest, strict=True)]
        arms = local.take(JOINTS, 1)
        same = np.minimum.reduce(
            np.abs(np.add.reduce(arms * self.last, -1)), -1
        ).tolist()  # cosines of half the limits
        held = np.maximum.reduce(np.abs(self.offset), (1, 2)).tolist()
        active = [
            left[i] > 0.0 or rest[i] > 0.0 or held[i] > _DONE_RAD or same[i] < cos(0.5 * limit)
            for i, limit in enumerate(limits)
        ]
        last, self.last, self.left = self.last, arms, np.array(left)
        if not any(active):
            if any(held):
                self.offset = self.speed = np.zeros_like(self.offset)
            return active
        limit, calm = np.array(limits)[:, None, None], np.array(rest)
        turn = rotations.to_rotation_vector(rotations.multiply(arms, rotations.inverse(last)))
        angle = np.sqrt((turn * turn).sum(-1, keepdims=True))
        excess = turn * np.maximum(0.0, 1.0 - limit / np.maximum(angle, MIN_DIVISOR))
        offset = rotations.from_rotation_vector(self.offset)
        offset = rotations.multiply(offset, rotations.from_rotation_vector(-excess))
        vector = rotations.to_rotation_vector(offset)
        half_life = (OFFSET_HALF_LIFE_S * (RESTING_HALF_LIFE_S / OFFSET_HALF_LIFE_S) ** calm)[:, None, None]
        offset, speed = spring(vector, self.speed, np.zeros(3), half_life, 1.0 / FPS)
        acts = np.array(active)[:, None, None]
        self.offset, self.speed = np.where(acts, offset, 0.0), np.where(acts, speed, 0.0)
        shown = rotations.multiply(rotations.from_rotation_vector(self.offset), arms)
        local[:, JOINTS] = np.where(acts, shown, arms)
        return active


def _fastest(left: float, rest: float) -> float:
    """Limit of a joint's turn per frame (radians) while the network may switch for `left` seconds; `rest` as in `apply`."""
    fastest = MAX_ARM_SPEED_RAD_PER_S if left > 0.0 else MAX_JOINT_SPEED_RAD_PER_S
    return DT * fastest * (MAX_RESTING_SPEED_RAD_PER_S / fastest) ** rest


WATCHED = np.array(
    [
        SPORT_SKELETON.index(name)
        for name in ("LeftHand", "RightHand", "Head", "LeftLeg", "RightLeg", "LeftFoot", "RightFoot")
    ]
)
# m/s, limb speeds of a body at rest: hands and head (0.02 to 0.1 in captured idles), knees, and feet, which stand
REST_M_PER_S = (0.07, 0.07, 0.07, 0.05, 0.05, 0.02, 0.02)
NEARLY_AT_REST_FRACTION = 0.3  # of the usual speed: below it, a body at rest is moved over its feet
# extra distance, relative to the usual one, that a held foot may be off at rest, to avoid needless steps
ADDED_PATIENCE_FRACTION = 0.6
UNSEEN_M = 0.05  # distance from its feet at which the body may stay,
OVER_FEET_S = 0.4  # and time constant to correct a larger one,
MAX_SWAY_M_PER_S = 0.05  # with this limit
RANGE_HALF_LIFE_S = 2.0  # in which the usual limb speeds are forgotten
MIN_USUAL_SPEED_M_PER_S = 1.0  # minimum of the usual speed: a slower body may speed up to it while stopping
RESTING_SPEED_M_PER_S = 0.25  # of the plan: slower, a body comes to rest
SETTLING_DELAY_S = 0.2  # after the last change of the request
RATE_HALF_LIFE_S = 0.05  # of the playback rate while a body stops; immediate at rest
SETTLE_HALF_LIFE_S = 0.12  # of the speed limit when it falls,
WAKE_HALF_LIFE_S = 0.05  # and when it rises
WHOLE_FRAME_FRACTION = 1.0 - 1e-6  # of a frame's time: more counts as a whole frame
MIN_RATE_FRACTION = 1e-3  # of a frame's time: the lowest rate
STEPPING_ON_FRACTION = 0.6  # of its usual speed: the limit until both feet stand
_FORGETS, _SETTLES, _WAKES = decay(RANGE_HALF_LIFE_S), decay(SETTLE_HALF_LIFE_S), decay(WAKE_HALF_LIFE_S)


@dataclass
class Settling:
    """Playback rate and last pose of N characters that come to rest."""

    local: Array = field(metadata={"shape": (J, 4)})  # (N, 31, 4) of the last frame, relative to the root
    usual: Array = field(metadata={"shape": (len(WATCHED),), "most": 1000.0})  # (N, 7) m/s
    fraction: Array = field(metadata={"shape": ()})  # (N,) limit as a fraction of `usual`
    waited: Array = field(metadata={"shape": ()})  # (N,) seconds since the request last changed
    rate: Array = field(metadata={"shape": ()})  # (N,) playback rate of this frame

    @staticmethod
    def awake(local: Array) -> Settling:
        """Return the state of moving characters with local rotations `(N, 31, 4)` relative to the root."""
        one = np.ones(len(local))
        usual = np.full((len(local), len(WATCHED)), MIN_USUAL_SPEED_M_PER_S)
        return Settling(local, usual, one, 0.0 * one, one)

    def slow(
        self,
        joints: Array,
        before: Array,
        free: Sequence[bool],
        still: Sequence[bool],
        grounded: Sequence[bool],
    ) -> Array:
        """Return the playback rate of each character `(N,)`, 1 at full speed.

        `joints` and those of the last frame are `(N, 31, 3)`, relative to the root. `free`: nothing is requested of the body,
        so it may come to rest; `still`: it has reached its goal; `grounded`: both feet stand where they may stay.
        """
        moved = joints.take(WATCHED, 1) - before.take(WATCHED, 1)
        speeds = (np.sqrt(np.add.reduce(moved * moved, -1)) * FPS).tolist()
        usual, fractions = self.usual.tolist(), self.fraction.tolist()
        waits, rates = self.waited.tolist(), []
        for i, (speed, was) in enumerate(zip(speeds, fractions, strict=True)):
            waits[i] = waits[i] + DT if free[i] and still[i] else 0.0
            if waits[i] > SETTLING_DELAY_S:
                fractions[i] = max(was * _SETTLES, 0.0 if grounded[i] else min(was, STEPPING_ON_FRACTION))
            else:
                fractions[i] = 1.0 + (was - 1.0) * _WAKES
            if not free[i]:
                usual[i] = [
                    max(each * _FORGETS, now, MIN_USUAL_SPEED_M_PER_S)
                    for each, now in zip(usual[i], speed, strict=True)
                ]
            # while coming to rest, limbs may not exceed their usual speed
            limits = zip(usual[i], REST_M_PER_S, speed, strict=True) if free[i] or fractions[i] < 1.0 else ()
            slow = (max(fractions[i] * each, least) / max(now, MIN_DIVISOR) for each, least, now in limits)
            rate = min(1.0, min(slow, default=1.0))
            even = 0.5 ** (1.0 / (FPS * RATE_HALF_LIFE_S * max(fractions[i], MIN_RATE_FRACTION)))
            rate += (float(self.rate[i]) - rate) * even
            rates.append(
                rate if rate < WHOLE_FRAME_FRACTION else 1.0
            )  # rounding would keep it below 1 forever
        self.usual, self.fraction, self.waited = np.array(usual), np.array(fractions), np.array(waits)
        self.rate = np.array(rates)
        return self.rate

    def between(self, local: Array) -> Array:
        """Return local rotations `(N, 31, 4)` interpolated from the last frame's by the playback rates, and store them."""
        if min(self.rate.tolist()) < 1.0:
            turn = rotations.to_rotation_vector(rotations.multiply(local, rotations.inverse(self.local)))
            part = rotations.from_rotation_vector(turn * self.rate[:, None, None])
            slow = (self.rate < 1.0)[:, None, None]
            local = np.where(slow, rotations.multiply(part, self.local), local)
        self.local = local
        return local.copy()
