"""The regulator of the root's speed: every style has a pace of its own, and the network is asked for more or less than
the stick says until the root goes as fast as that.

Proportional and integral, on the difference from what a body that sets off can be expected to do. The integral alone
swung around the requested speed for as long as one walked, because the network follows a changed request a second later.
"""

from __future__ import annotations

import numpy as np

from runtime.motion.features import FPS
from runtime.motion.trajectory import decay

RANGE = (0.35, 2.0)  # of the gain
PROPORTIONAL = 2.0  # gain for a relative error of one
INTEGRAL = 0.6  # change of the gain per second and relative error
SMOOTHING = 0.12  # seconds, half-life of the measured speed: a stride speeds up and slows down
SETTING_OFF = 0.4  # seconds in which a body covers half of a change of speed
SLOWEST = 0.12  # m/s; slower requests have no relative error
# A style that is to go much slower than it ever does may go on standing: it is asked for more until it sets off.
STANDING_SHARE = 0.4  # of the expected speed
STANDING_SECONDS = 0.7
STANDING_GAIN = 3.0  # at most


class SpeedRegulator:
    """The gain on the stick's speed, from frame to frame."""

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Stand: what one walk needed says nothing of the next."""
        self._expected = self._measured = self._stood = 0.0
        self._integral = 1.0

    def update(self, requested: float, speed: float) -> float:
        """The gain for this frame, given the requested speed and the root's in the last frame, m/s."""
        self._expected += (requested - self._expected) * (1.0 - decay(SETTING_OFF))
        self._measured += (speed - self._measured) * (1.0 - decay(SMOOTHING))
        stands = self._measured < STANDING_SHARE * self._expected
        self._stood = self._stood + 1.0 / FPS if stands else 0.0
        least, most = RANGE
        if self._stood > STANDING_SECONDS:
            most = STANDING_GAIN
        error = float(np.clip((self._expected - self._measured) / max(requested, SLOWEST), -1.0, 1.0))
        self._integral = float(np.clip(self._integral + INTEGRAL * error / FPS, least, most))
        return float(np.clip(self._integral + PROPORTIONAL * error, least, most))
