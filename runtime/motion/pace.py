"""Root speed: its regulator, the speed implied by planted feet, and detection of stalled gaits."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from math import dist, hypot

import numpy as np

from runtime.arrays import Array
from runtime.feet.skating import SOLE_POINTS
from runtime.motion.features import FPS
from runtime.scalar_math import MIN_DIVISOR, decay

GAIN_RANGE = (0.35, 2.0)  # of the gain
PROPORTIONAL_GAIN = 0.8  # gain for a relative error of one: more of it makes long slow strides leap
INTEGRAL_GAIN_PER_S = 0.5  # change of the gain per second and relative error
# of the plan: until the expected speed gets there, a body that lags is still starting, and the integral would overshoot
EXPECTED_FRACTION = 0.6
SPEED_HALF_LIFE_S = 0.12  # of the measured speed, which varies within a stride
SETS_OFF_S = 0.36  # time constant of the expected speed after a change of the plan
MIN_REQUEST_M_PER_S = 0.12  # slower requests have no relative error
# A style asked to go much slower than its own speed may not start at all: its request is raised until it starts.
STANDING_SPEED_FRACTION = 0.4  # of the expected speed
STANDING_SECONDS = 0.7
STANDING_GAIN = 3.0  # at most
_NUMBERS = {"shape": ()}
_SETS_OFF, _MEASURES = 1.0 - decay(SETS_OFF_S), 1.0 - decay(SPEED_HALF_LIFE_S)


@dataclass
class SpeedRegulator:
    """State of the speed regulators of N characters, all `(N,)`."""

    expected: Array = field(metadata=_NUMBERS)  # m/s
    measured: Array = field(metadata=_NUMBERS)  # m/s
    stood: Array = field(metadata=_NUMBERS)  # seconds that a body has stood although it should move
    integral: Array = field(metadata=_NUMBERS)

    @staticmethod
    def at_rest(count: int = 1) -> SpeedRegulator:
        """Return the state of standing characters; every walk starts afresh."""
        return SpeedRegulator(np.zeros(count), np.zeros(count), np.zeros(count), np.ones(count))

    def update(
        self, requested: Sequence[float], speed: Sequence[float], moving: Sequence[bool]
    ) -> list[float]:
        """Return the factor on each character's requested speed in this frame that gives its root the requested speed; 1 at rest.

        `requested` and last frame's root `speed` are in m/s.
        """
        numbers = (each.tolist() for each in (self.expected, self.measured, self.stood, self.integral))
        made, gains = [], []
        for wanted, shown, moves, expected, measured, stood, integral in zip(
            requested, speed, moving, *numbers, strict=True
        ):
            expected += (wanted - expected) * _SETS_OFF
            measured += (shown - measured) * _MEASURES
            if not moves:
                made.append((0.0, 0.0, 0.0, 1.0))
                gains.append(1.0)
                continue
            stood = stood + 1.0 / FPS if measured < STANDING_SPEED_FRACTION * expected else 0.0
            least, most = GAIN_RANGE
            if stood > STANDING_SECONDS:
                most = STANDING_GAIN
            error = min(max((expected - measured) / max(wanted, MIN_REQUEST_M_PER_S), -1.0), 1.0)
            if error < 0.0 or expected >= EXPECTED_FRACTION * wanted or stood > 0.0:
                integral = min(max(integral + INTEGRAL_GAIN_PER_S * error / FPS, least), most)
            made.append((expected, measured, stood, integral))
            gains.append(min(max(integral + PROPORTIONAL_GAIN * error, least), most))
        self.expected, self.measured, self.stood, self.integral = np.array(made).T
        return gains


POINTS = np.array(SOLE_POINTS)  # left heel, left toe, right heel, right toe, as contacts
MIN_CONTACT_WEIGHT = 0.25  # sum of squared contacts: less is a flight, which gives no measurement
SPEED_RATIO_RANGE = (0.5, 1.5)  # limits of the speed ratio
STRIDE_HALF_LIFE_S = 0.3  # about a step
MIN_STRIDE_SPEED_M_PER_S = 0.3  # slower, feet may rest
# limits of the stride scaling, which corrects the speed difference that the regulator leaves
STRETCH = (0.65, 1.18)
# of the plan: a smoothed request below it is a start, which longer strides would overshoot
SETTING_OFF_FRACTION = 0.5
SETTLED_FRACTION = 0.97  # of the plan: until the smoothed request gets there,
WALK_START_RATIO = 1.08  # a walk goes at this ratio of its plan at most
_STRIDES = 1.0 - decay(STRIDE_HALF_LIFE_S)


@dataclass
class StrideState:
    """Ratio of planted-foot speed to root speed of N characters, carried from frame to frame."""

    feet: Array = field(metadata={"shape": (4, 2)})  # (N, 4, 2) in XZ, relative to the root
    fraction: Array = field(metadata={"shape": ()})  # (N,)

    @staticmethod
    def at_rest(joints: Array) -> StrideState:
        """Return the state of characters at rest with joints `(N, 31, 3)`."""
        return StrideState(_across(joints), np.ones(len(joints)))

    def carried(
        self, joints: Array, contacts: Array, flying: Sequence[bool]
    ) -> list[tuple[float, float, float]]:
        """Return the root velocity implied by planted feet since the last `update`: m/s across and along, and the feet's weight.

        Joints `(N, 31, 3)` are relative to the root, contacts `(N, 4)`; feet of `flying` characters have no weight.
        """
        moved, result = (_across(joints) - self.feet).tolist(), []
        for feet, chances, flies in zip(moved, contacts.tolist(), flying, strict=True):
            x = z = total = 0.0
            for (foot_x, foot_z), chance in zip(feet, chances, strict=True):
                weight = 0.0 if flies else min(max(chance, 0.0), 1.0) ** 2
                x, z, total = x + weight * foot_x, z + weight * foot_z, total + weight
            by = -FPS / max(total, MIN_CONTACT_WEIGHT)
            result.append((by * x, by * z, total))
        return result

    def update(
        self, joints: Array, carried: Sequence[tuple[float, float, float]], speeds: Sequence[float]
    ) -> None:
        """Store the joints relative to the root, and update the speed ratio with `carried` and the roots' smoothed speeds (m/s)."""
        self.feet = _across(joints)
        fractions = self.fraction.tolist()
        for i, ((x, z, total), speed) in enumerate(zip(carried, speeds, strict=True)):
            fraction = fractions[i]  # unchanged in a flight
            if speed < MIN_STRIDE_SPEED_M_PER_S:
                fraction = 1.0
            elif total > MIN_CONTACT_WEIGHT:
                fraction = min(max(hypot(x, z) / speed, SPEED_RATIO_RANGE[0]), SPEED_RATIO_RANGE[1])
            fractions[i] += (fraction - fractions[i]) * _STRIDES
        self.fraction = np.array(fractions)


def stretch(planned: tuple[float, float], shown: tuple[float, float], jogs: bool, response: float) -> float:
    """Return the factor on stride length, for `planned` and `shown` speeds (m/s), each as (smoothed, current).

    `response` 1 allows an immediate start.
    """
    (smooth, requested), (measured, root) = planned, shown
    going = smooth / max(requested, MIN_DIVISOR)
    settled = min(max((going - SETTLED_FRACTION) / (1.0 - SETTLED_FRACTION), response), 1.0)
    going = min(max((going - SETTING_OFF_FRACTION) / (1.0 - SETTING_OFF_FRACTION), response), 1.0)
    longer = min(max(smooth / max(measured, MIN_DIVISOR), STRETCH[0]), 1.0 + (STRETCH[1] - 1.0) * going)
    if settled == 1.0:
        return longer
    most = STRETCH[1] if jogs else WALK_START_RATIO * requested / max(root, MIN_DIVISOR)
    return min(longer, most + (STRETCH[1] - 1.0) * settled)


def _across(joints: Array) -> Array:
    return joints.take(POINTS, 1)[..., ::2]


STALLED_SPEED_FRACTION = 0.35  # of the requested speed, at which feet normally move relative to the root
STALLED_SECONDS = 0.25  # longer than feet rest relative to the root in the slowest step
FEET_HALF_LIFE_S = 0.1  # of the feet's speed
STALLED_RATE_HZ = 2.0  # rate of the phases while stalled
_FEET = 1.0 - decay(FEET_HALF_LIFE_S)


@dataclass
class Stall:
    """Foot movement of N characters, to detect a stalled gait."""

    feet: Array = field(metadata={"shape": (4, 3)})  # (N, 4, 3) relative to the root
    speed: Array = field(metadata={"shape": ()})  # (N,) of the feet, m/s, smoothed
    seconds: Array = field(metadata={"shape": ()})  # (N,) seconds that they have been slow

    @staticmethod
    def at_rest(joints: Array) -> Stall:
        """Return the state of characters at rest with joints `(N, 31, 3)`."""
        return Stall(joints[:, POINTS], np.zeros(len(joints)), np.zeros(len(joints)))

    def update(self, joints: Array, requested: Sequence[float]) -> list[bool]:
        """Return which gaits have stalled, from joints `(N, 31, 3)` relative to the root and `requested` speeds (m/s, 0 at rest)."""
        feet = joints.take(POINTS, 1)
        speeds, seconds = self.speed.tolist(), self.seconds.tolist()
        for i, (wanted, *places) in enumerate(zip(requested, feet.tolist(), self.feet.tolist(), strict=True)):
            speeds[i] += (sum(map(dist, *places)) * (FPS / len(POINTS)) - speeds[i]) * _FEET
            slow = wanted > 0.0 and speeds[i] < STALLED_SPEED_FRACTION * wanted
            seconds[i] = seconds[i] + 1.0 / FPS if slow else 0.0
        self.feet, self.speed, self.seconds = feet, np.array(speeds), np.array(seconds)
        return [each > STALLED_SECONDS for each in seconds]


def advance_by_cycles(phase: Array, cycles: float) -> Array:
    """Return phase vectors `(..., 2)` (amplitude times sine and cosine) advanced by `cycles`."""
    angle = 2.0 * np.pi * cycles
    sine, cosine = np.sin(angle), np.cos(angle)
    s, c = phase[..., 0], phase[..., 1]
    return np.stack([s * cosine + c * sine, c * cosine - s * sine], axis=-1)
