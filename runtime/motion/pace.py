"""How fast a body goes: the regulator of the root's speed, the speed that planted feet carry, and gaits that stall."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from runtime.arrays import Array
from runtime.feet.skating import SOLE_POINTS
from runtime.motion.features import FPS
from runtime.scalar_math import decay

GAIN_RANGE = (0.35, 2.0)  # of the gain
PROPORTIONAL = 2.0  # gain for a relative error of one
INTEGRAL = 0.6  # change of the gain per second and relative error
SPEED_SMOOTHING = 0.12  # seconds, half-life of the measured speed: a stride speeds up and slows down
SETS_OFF_S = 0.36  # seconds in which a body has followed half of a change of its plan
SLOWEST_REQUEST = 0.12  # m/s; slower requests have no relative error
# A style that is to go much slower than it ever does may go on standing: it is requested more until it sets off.
STANDING_SHARE = 0.4  # of the expected speed
STANDING_SECONDS = 0.7
STANDING_GAIN = 3.0  # at most
_NUMBERS = {"shape": ()}


@dataclass
class SpeedRegulator:
    """What the regulators of N characters remember, all `(N,)`."""

    expected: Array = field(metadata=_NUMBERS)  # m/s
    measured: Array = field(metadata=_NUMBERS)  # m/s
    stood: Array = field(metadata=_NUMBERS)  # seconds that a body stands which is to move
    integral: Array = field(metadata=_NUMBERS)

    @staticmethod
    def at_rest(count: int = 1) -> SpeedRegulator:
        """Of standing characters: what one walk needed says nothing of the next."""
        return SpeedRegulator(np.zeros(count), np.zeros(count), np.zeros(count), np.ones(count))

    def update(self, requested: Array, speed: Array, moving: NDArray[np.bool_]) -> Array:
        """The gains `(N,)` for this frame, of the requested speeds and the roots' in the last frame, m/s; 1 at rest."""
        self.expected = self.expected + (requested - self.expected) * (1.0 - decay(SETS_OFF_S))
        self.measured = self.measured + (speed - self.measured) * (1.0 - decay(SPEED_SMOOTHING))
        stands = self.measured < STANDING_SHARE * self.expected
        self.stood = np.where(stands & moving, self.stood + 1.0 / FPS, 0.0)
        least = GAIN_RANGE[0]
        most = np.where(self.stood > STANDING_SECONDS, STANDING_GAIN, GAIN_RANGE[1])
        error = np.clip((self.expected - self.measured) / np.maximum(requested, SLOWEST_REQUEST), -1.0, 1.0)
        self.integral = np.clip(self.integral + INTEGRAL * error / FPS, least, most)
        gain = np.clip(self.integral + PROPORTIONAL * error, least, most)
        if not moving.all():
            self.expected, self.measured = np.where(moving, (self.expected, self.measured), 0.0)
            self.integral, gain = np.where(moving, (self.integral, gain), 1.0)
        return gain


POINTS = list(SOLE_POINTS)  # left heel, left toe, right heel, right toe, as contacts
LEAST_CONTACT = 0.25  # sum of squared contacts: less is a flight, which says nothing
SHARE_RANGE = (0.5, 1.5)  # of the fraction
STRIDE_SMOOTHING = 0.3  # seconds, half-life: about a step
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
    fraction: Array = field(metadata={"shape": ()})  # (N,)

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
        """The fractions `(N,)`, of joints `(N, 31, 3)` relative to the root, contacts `(N, 4)` and the roots' smoothed speeds in m/s."""
        carried, total = self.carried(joints, contacts)
        self.feet = _across(joints)
        back = np.sqrt((carried * carried).sum(-1))
        fraction = np.minimum(np.maximum(back / np.maximum(speed, SLOWEST), SHARE_RANGE[0]), SHARE_RANGE[1])
        fraction = np.where(total > LEAST_CONTACT, fraction, self.fraction)  # a flight says nothing
        fraction = np.where(speed < SLOWEST, 1.0, fraction)
        self.fraction = self.fraction + (fraction - self.fraction) * (1.0 - decay(STRIDE_SMOOTHING))
        return self.fraction


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


POINTS = list(SOLE_POINTS)
STALLED_SHARE = 0.35  # of the requested speed; in a gait feet move against the root about as fast as the root
STALLED_SECONDS = 0.25  # longer than feet rest against the root in the slowest step
FEET_SMOOTHING = 0.1  # seconds, half-life of the feet's speed
CYCLES_PER_SECOND = 2.0  # of the phases while stalled


@dataclass
class Stall:
    """What is remembered of the feet of N characters."""

    feet: Array = field(metadata={"shape": (4, 3)})  # (N, 4, 3) relative to the root
    speed: Array = field(metadata={"shape": ()})  # (N,) of the feet, m/s, smoothed
    seconds: Array = field(metadata={"shape": ()})  # (N,) for which they have been slow

    @staticmethod
    def at_rest(joints: Array) -> Stall:
        """Of characters whose joints `(N, 31, 3)` do not move."""
        return Stall(joints[:, POINTS], np.zeros(len(joints)), np.zeros(len(joints)))

    def update(self, joints: Array, requested: Array) -> NDArray[np.bool_]:
        """Which gaits stall `(N,)`, given joints `(N, 31, 3)` relative to the root and the `requested` speeds in m/s, 0 at rest."""
        feet = joints[:, POINTS]
        moved = feet - self.feet
        speed = np.sqrt((moved * moved).sum(-1)).sum(-1) * (FPS / len(POINTS))
        self.speed = self.speed + (speed - self.speed) * (1.0 - decay(FEET_SMOOTHING))
        self.feet = feet
        slow = (requested > 0.0) & (self.speed < STALLED_SHARE * requested)
        self.seconds = np.where(slow, self.seconds + 1.0 / FPS, 0.0)
        return np.asarray(self.seconds > STALLED_SECONDS)


def advance_by_cycles(phase: Array, cycles: float) -> Array:
    """Phase vectors `(..., 2)`, amplitude times sine and cosine, advanced by `cycles`."""
    angle = 2.0 * np.pi * cycles
    sine, cosine = np.sin(angle), np.cos(angle)
    s, c = phase[..., 0], phase[..., 1]
    return np.stack([s * cosine + c * sine, c * cosine - s * sine], axis=-1)
