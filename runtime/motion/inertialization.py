"""Inertialization of the arms while styles blend (Bollo, GDC 2018): what turns too fast is shown a little later.

Between two styles the network changes its mind at one moment, however slowly Z^t moves: an arm commanded overhead
is there within 0.15 s. The part of a frame's turn that is too fast goes into an offset on the shown rotation, which
a critically damped spring takes back to zero.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from runtime import rotations
from runtime.motion.features import FPS
from runtime.skeleton import SPORT_SKELETON
from runtime.spring import spring

Array = NDArray[np.floating]

ARMS = [
    SPORT_SKELETON.index(side + name) for side in ("Left", "Right") for name in ("Shoulder", "Arm", "ForeArm")
]
FASTEST = 6.0  # rad/s; arms that swing in walking and jogging turn by up to that
HALF_LIFE = 0.2  # seconds in which about half of an offset is gone
AFTERWARDS = 0.5  # seconds after a blend in which the network may still change its mind
FASTEST_EVER = 20.0  # rad/s at any other time: arms of a captured dash reach 16 in 99 of 100 frames, a network that jumps 50
_DONE = 1e-3  # rad


class Inertialization:
    """The offsets, from frame to frame."""

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget the motion so far."""
        self._last: Array | None = None
        self._offset: Array = np.zeros((len(ARMS), 3))  # rotation vectors, rad, on the parent's side
        self._speed: Array = np.zeros((len(ARMS), 3))
        self._left = 0.0

    def apply(self, local: Array, blending: bool) -> Array:
        """Local rotations `(31, 4)` to show in place of the network's, which are handed back where nothing is held back."""
        self._left = AFTERWARDS if blending else max(0.0, self._left - 1.0 / FPS)
        arms = local[ARMS]
        last, self._last = self._last, arms
        moving = bool(np.any(np.abs(self._offset) > _DONE))
        limit = (FASTEST if self._left > 0.0 else FASTEST_EVER) / FPS
        jumps = last is not None and bool(np.any(np.abs((arms * last).sum(-1)) < np.cos(0.5 * limit)))
        if last is None or not (self._left > 0.0 or moving or jumps):
            self._offset[:] = self._speed[:] = 0.0
            return local
        offset = rotations.from_rotation_vector(self._offset)
        if jumps:
            turn = rotations.to_rotation_vector(rotations.multiply(arms, rotations.inverse(last)))
            angle = np.linalg.norm(turn, axis=-1, keepdims=True)
            excess = turn * np.maximum(0.0, 1.0 - limit / np.maximum(angle, 1e-9))
            offset = rotations.multiply(offset, rotations.from_rotation_vector(-excess))
        vector = rotations.to_rotation_vector(offset)
        self._offset, self._speed = spring(vector, self._speed, np.zeros(3), HALF_LIFE, 1.0 / FPS)
        shown = local.copy()
        shown[ARMS] = rotations.multiply(rotations.from_rotation_vector(self._offset), arms)
        return shown
