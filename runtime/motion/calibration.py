"""Measured left-right preference of a model: for some style codes, whether it shows them better than their mirror images."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from runtime.arrays import Float32Array
from runtime.motion.mirror import LIMBS, TWINS, Ways, mirrored_code
from runtime.scalar_math import MIN_SIZE

MIRROR_LEAD_FRACTION = 0.3  # lead of the mirror image over the code from which the walk is mirrored
# the same for one limb, which costs a second run of the network
LIMB_LEAD_FRACTION = 0.4
# of a code's distance from neutral: a code farther away is unrelated and does not inherit its lead
SAME_SIDE_FRACTION = 0.6


@dataclass(frozen=True, eq=False)
class Calibration:
    """Measurements of how well a model shows some style codes of the left side; they hold for the mirrored codes too."""

    parts: NDArray[np.int64]  # (n,) index of each code's part in `PART_NAMES`
    codes: Float32Array  # (n, 64)
    leads: Float32Array  # (n,) how much better a code is shown than its mirror image, as a fraction
    neutral: Float32Array  # (6, 64)

    def side_leads(self, z: Float32Array) -> Float32Array:
        """Return, per part of Z^t `(6, 64)`, the lead over its mirror image (fraction) of the nearest measured code."""
        found = np.zeros(len(z), np.float32)
        for near in self._nearest(z):
            if near.off < SAME_SIDE_FRACTION:
                found[near.part] += near.sign * self.leads[near.code]
        return found

    def ways(self, leads: Float32Array) -> Ways:
        """Return whether a style with these `leads` `(6,)` is walked mirrored, and whether limbs come from the opposite walk."""
        mirrored = bool(leads.sum() < -MIRROR_LEAD_FRACTION)
        return Ways(mirrored, any(self.other_limbs(leads, mirrored)))

    def other_limbs(self, leads: Float32Array, mirrored: bool) -> tuple[float, ...]:
        """Return 1 for each limb that is shown much better in the opposite walk, mirrored or not, else 0."""
        better = (leads if mirrored else -leads)[:LIMBS] >= LIMB_LEAD_FRACTION
        return tuple(better.astype(float).tolist())

    def _nearest(self, z: Float32Array) -> Iterator[_Near]:
        """Yield the measured code nearest to each part, and to each part of the mirror image."""
        for sign, seen in ((1, z), (-1, mirrored_code(z))):
            for part in sorted(set(self.parts.tolist())):
                (own,) = np.nonzero(self.parts == part)
                far = np.linalg.norm(self.codes[own] - seen[part], axis=1)
                k = int(np.argmin(far))
                length = float(np.linalg.norm(self.codes[own[k]] - self.neutral[part]))
                off = float(far[k]) / max(length, MIN_SIZE)
                yield _Near(part if sign > 0 else TWINS[part], sign, int(own[k]), off)


@dataclass(frozen=True)
class _Near:
    """A part of a Z^t and the measured code nearest to it (`sign` -1: to its mirror image).

    `off` is their distance as a fraction of the code's distance from neutral.
    """

    part: int
    sign: int
    code: int
    off: float
