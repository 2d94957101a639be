"""Inertialization (Bollo, GDC 2018) of arms and trunk: what turns too fast is shown a little later.

Between two styles the network changes its mind at one moment, however slowly Z^t moves: an arm commanded overhead
is there within 0.15 s. The part of a frame's turn that is too fast goes into an offset on the shown rotation, which
a critically damped spring takes back to zero. A body that comes to rest is calmed in the same way: the network's arms
swing on for one to three seconds after a stop, those of captures for 0.6 at most.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from runtime import rotations
from runtime.arrays import Array
from runtime.motion.features import FPS
from runtime.skeleton import SPORT_SKELETON
from runtime.spring import spring

ARMS = [
    SPORT_SKELETON.index(side + name) for side in ("Left", "Right") for name in ("Shoulder", "Arm", "ForeArm")
]
TRUNK = [SPORT_SKELETON.index(name) for name in ("LowerBack", "Spine", "Spine1", "Neck", "Neck1", "Head")]
JOINTS = ARMS + TRUNK
FASTEST = 6.0  # rad/s; arms that swing in walking and jogging turn by up to that
HALF_LIFE = 0.2  # seconds in which about half of an offset is gone
AFTERWARDS = 0.5  # seconds after a blend in which the network may still change its mind
FASTEST_EVER = 20.0  # rad/s at any other time: arms of a captured dash reach 16 in 99 of 100 frames, a network that jumps 50
FASTEST_AT_REST = 0.15  # rad/s: breathing is slower, an arm that swings on is faster
HALF_LIFE_AT_REST = 0.35  # seconds
_DONE = 1e-3  # rad


@dataclass
class Inertialization:
    """The offsets of N characters, from frame to frame."""

    last: Array = field(
        metadata={"shape": (len(JOINTS), 4)}
    )  # (N, 12, 4) the network's rotations of the last frame
    offset: Array = field(
        metadata={"shape": (len(JOINTS), 3)}
    )  # (N, 12, 3) rotation vectors, rad, on the parent's side
    speed: Array = field(metadata={"shape": (len(JOINTS), 3)})  # (N, 12, 3) rad/s
    left: Array = field(metadata={"shape": ()})  # (N,) seconds in which the network may still change its mind

    @staticmethod
    def at_rest(local: Array) -> Inertialization:
        """Of characters whose local rotations `(N, 31, 4)` do not change."""
        still = np.zeros((len(local), len(JOINTS), 3))
        return Inertialization(local[:, JOINTS], still, still, np.zeros(len(local)))

    def apply(self, local: Array, blending: NDArray[np.bool_], rest: Array) -> NDArray[np.bool_]:
        """Turn arms and trunk of the network's local rotations `(N, 31, 4)` into those to show; which characters' are others `(N,)`.

        `rest` `(N,)` is 0 for a body that moves as it likes, to 1 for one that is to be calm.
        """
        self.left = np.where(blending, AFTERWARDS, np.maximum(0.0, self.left - 1.0 / FPS))
        arms = local[:, JOINTS]
        last, self.last = self.last, arms
        moving = (np.abs(self.offset) > _DONE).any((1, 2))
        fastest = np.where(self.left > 0.0, FASTEST, FASTEST_EVER)
        limit = (fastest * (FASTEST_AT_REST / fastest) ** rest)[:, None, None] / FPS
        jumps = (np.abs((arms * last).sum(-1)) < np.cos(0.5 * limit[..., 0])).any(-1)
        active = (self.left > 0.0) | moving | jumps | (rest > 0.0)
        if not active.any():
            if self.offset.any():
                self.offset = self.speed = np.zeros_like(self.offset)
            return active
        turn = rotations.to_rotation_vector(rotations.multiply(arms, rotations.inverse(last)))
        angle = np.sqrt((turn * turn).sum(-1, keepdims=True))
        excess = turn * np.maximum(0.0, 1.0 - limit / np.maximum(angle, 1e-9))
        offset = rotations.from_rotation_vector(self.offset)
        offset = rotations.multiply(offset, rotations.from_rotation_vector(-excess))
        vector = rotations.to_rotation_vector(offset)
        half_life = (HALF_LIFE * (HALF_LIFE_AT_REST / HALF_LIFE) ** rest)[:, None, None]
        offset, speed = spring(vector, self.speed, np.zeros(3), half_life, 1.0 / FPS)
        self.offset = np.where(active[:, None, None], offset, 0.0)
        self.speed = np.where(active[:, None, None], speed, 0.0)
        shown = rotations.multiply(rotations.from_rotation_vector(self.offset), arms)
        local[:, JOINTS] = np.where(active[:, None, None], shown, arms)
        return active
