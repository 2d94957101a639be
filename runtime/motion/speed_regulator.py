"""The regulator of the root's speed: every style has a pace of its own, and the network is asked for more or less than
the stick says until the root goes as fast as that.

Proportional and integral, on the difference from what a body that sets off can be expected to do. The integral alone
swung around the requested speed for as long as one walked, because the network follows a changed request a second later.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from runtime.arrays import Array
from runtime.motion.features import FPS
from runtime.spring import decay

RANGE = (0.35, 2.0)  # of the gain
PROPORTIONAL = 2.0  # gain for a relative error of one
INTEGRAL = 0.6  # change of the gain per second and relative error
SMOOTHING = 0.12  # seconds, half-life of the measured speed: a stride speeds up and slows down
SETTING_OFF = 0.36  # seconds in which a body has followed half of a change of its plan
SLOWEST = 0.12  # m/s; slower requests have no relative error
# A style that is to go much slower than it ever does may go on standing: it is asked for more until it sets off.
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
        self.expected = self.expected + (requested - self.expected) * (1.0 - decay(SETTING_OFF))
        self.measured = self.measured + (speed - self.measured) * (1.0 - decay(SMOOTHING))
        stands = self.measured < STANDING_SHARE * self.expected
        self.stood = np.where(stands & moving, self.stood + 1.0 / FPS, 0.0)
        least = RANGE[0]
        most = np.where(self.stood > STANDING_SECONDS, STANDING_GAIN, RANGE[1])
        error = np.clip((self.expected - self.measured) / np.maximum(requested, SLOWEST), -1.0, 1.0)
        self.integral = np.clip(self.integral + INTEGRAL * error / FPS, least, most)
        gain = np.clip(self.integral + PROPORTIONAL * error, least, most)
        if not moving.all():
            self.expected, self.measured = np.where(moving, (self.expected, self.measured), 0.0)
            self.integral, gain = np.where(moving, (self.integral, gain), 1.0)
        return gain
