"""The network's pose from frame to frame: turns that are too fast are shown later, and a body at rest moves slowly.

Inertialization (Bollo, GDC 2018): between two styles the network changes its mind at one moment, however slowly Z^t moves:
an arm commanded overhead is there within 0.15 s. The part of a frame's turn that is too fast goes into an offset on the
shown rotation, which a critically damped spring takes back to zero. The arms of a body that comes to rest, which would
swing on for one to three seconds, are damped in the same way.

Settling: left alone, the network's legs step on for two seconds after a stop and its trunk fidgets for ever; its feet then
slide under feet that are held. Slowing all of it alike, pose, phases and root, keeps every pose one of its own: nothing
slides, breathing (slower than the limit) is as it was, and the network goes on from there when the stick moves.
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
MAX_ARM_SPEED_RAD_PER_S = 6.0  # rad/s; arms that swing in walking and jogging turn by up to that
OFFSET_HALF_LIFE_S = 0.2  # seconds in which about half of an offset is gone
AFTER_BLEND_S = 0.5  # seconds after a blend in which the network may still change its mind
MAX_JOINT_SPEED_RAD_PER_S = 20.0  # rad/s at any other time: arms of a captured dash reach 16 in 99 of 100 frames, a network that jumps 50
MAX_RESTING_SPEED_RAD_PER_S = 0.15  # rad/s: breathing is slower, an arm that swings on is faster
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
    left: Array = field(metadata={"shape": ()})  # (N,) seconds in which the network may still change its mind

    @staticmethod
    def at_rest(local: Array) -> Inertialization:
        """Return the state of characters at rest with local rotations `(N, 31, 4)`."""
        still = np.zeros((len(local), len(JOINTS), 3))
        return Inertialization(local[:, JOINTS], still, still, np.zeros(len(local)))

    def apply(self, local: Array, blending: Sequence[bool], rest: Sequence[float]) -> list[bool]:
        """Smooth arms and trunk of the network's local rotations `(N, 31, 4)` in place, and return which characters changed.

        `rest` is 0 for a body that moves freely, up to 1 for one that should be calm.
        """
        left = [
            AFTER_BLEND_S if blends else max(0.0, each - DT)
            for each, blends in zip(self.left.tolist(), blending, strict=True)
        ]
        limits = [_fastest(*pair) for pair in zip(left, rest, strict=True)]
        arms = local.take(JOINTS, 1)
        same = np.minimum.reduce(
            np.abs(np.add.reduce(arms * self.last, -1)), -1
        ).tolist()  # cosines of half the fastest turns
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
    """Radians that a joint turns in a frame, where the network may change its mind for `left` seconds; `rest` as in `apply`."""
    fastest = MAX_ARM_SPEED_RAD_PER_S if left > 0.0 else MAX_JOINT_SPEED_RAD_PER_S
    return DT * fastest * (MAX_RESTING_SPEED_RAD_PER_S / fastest) ** rest


WATCHED = np.array(
    [
        SPORT_SKELETON.index(name)
        for name in ("LeftHand", "RightHand", "Head", "LeftLeg", "RightLeg", "LeftFoot", "RightFoot")
    ]
)
# m/s of the limbs of a body at rest: hands and head (0.02 to 0.1 in captured idles), knees, and feet, which stand
AT_REST = (0.07, 0.07, 0.07, 0.05, 0.05, 0.02, 0.02)
NEARLY_AT_REST_FRACTION = 0.3  # of the usual speed: a body that is nearly at rest comes over its feet
# more of its usual distance a foot may be held away at rest, where a body steps for no reason
ADDED_PATIENCE_FRACTION = 0.6
UNSEEN_M = 0.05  # m away from its feet it may stay,
OVER_FEET_S = 0.4  # from farther away it comes in about this time,
MAX_SWAY_M_PER_S = 0.05  # m/s at most
RANGE_HALF_LIFE_S = 2.0  # seconds, half-life, in which a body forgets how fast its limbs were
MIN_USUAL_SPEED_M_PER_S = 1.0  # m/s: as fast a body may come to rest that moved slower
RESTING_SPEED_M_PER_S = 0.25  # m/s of the plan: slower, a body comes to rest
SETTLING_DELAY_S = 0.2  # seconds after the last change of the request
RATE_HALF_LIFE_S = 0.05  # seconds, half-life, in which the rate changes while a body stops; at rest at once
SETTLE_HALF_LIFE_S = 0.12  # seconds, half-life, in which the limit goes down,
WAKE_HALF_LIFE_S = 0.05  # and up again
WHOLE_FRAME_FRACTION = 1.0 - 1e-6  # of a frame's time: more is all of it
MIN_RATE_FRACTION = 1e-3  # of it: slower counts as this
STEPPING_ON_FRACTION = 0.6  # of its usual speed a body keeps until both feet stand
_FORGETS, _SETTLES, _WAKES = decay(RANGE_HALF_LIFE_S), decay(SETTLE_HALF_LIFE_S), decay(WAKE_HALF_LIFE_S)


@dataclass
class Settling:
    """Playback rate and last pose of N characters that come to rest."""

    local: Array = field(metadata={"shape": (J, 4)})  # (N, 31, 4) of the last frame, relative to the root
    usual: Array = field(metadata={"shape": (len(WATCHED),), "most": 1000.0})  # (N, 7) m/s
    fraction: Array = field(metadata={"shape": ()})  # (N,) of it that is the limit, 1 while a body moves
    waited: Array = field(metadata={"shape": ()})  # (N,) seconds since something else was requested
    rate: Array = field(metadata={"shape": ()})  # (N,) of this frame's time

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
        """Return how slowly each character's time runs in this frame, `(N,)`, 1 at full speed.

        `joints` and those of the last frame are `(N, 31, 3)`, relative to the root. `free`: nothing is requested of the body,
        so it may come to rest; `still`: it has reached its requested place; `grounded`: both feet stand where they may stay.
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
            # unless it comes to rest, none of its limbs is faster than usual
            limits = zip(usual[i], AT_REST, speed, strict=True) if free[i] or fractions[i] < 1.0 else ()
            slow = (max(fractions[i] * each, least) / max(now, MIN_DIVISOR) for each, least, now in limits)
            rate = min(1.0, min(slow, default=1.0))
            even = 0.5 ** (1.0 / (FPS * RATE_HALF_LIFE_S * max(fractions[i], MIN_RATE_FRACTION)))
            rate += (float(self.rate[i]) - rate) * even
            rates.append(
                rate if rate < WHOLE_FRAME_FRACTION else 1.0
            )  # rounding would keep it below 1 for ever
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
