"""The network's own state: what is fed back from frame to frame, relative to the root."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from runtime.motion.features import PHASE_OFFSETS, C

Array = NDArray[np.floating]


@dataclass
class Body:
    """Pose and phases of the last frame."""

    joints: Array  # (31, 3)
    velocities: Array  # (31, 3)
    phase: Array  # (121, 5, 2) dense ±60 frames

    @staticmethod
    def standing(joints: Array, phases: Array) -> Body:
        """At rest: `joints` `(31, 3)`, and phases at the network's samples (130 numbers), which are filled in between."""
        samples = phases.reshape(len(PHASE_OFFSETS), -1)
        dense = np.arange(PHASE_OFFSETS[0], PHASE_OFFSETS[-1] + 1)
        filled = np.stack([np.interp(dense, PHASE_OFFSETS, column) for column in samples.T], -1)
        return Body(joints, np.zeros_like(joints), filled.reshape(-1, C, 2))
