"""Weakens styles that cannot be walked: they are mixed with neutral walking until the walk works.

Styles composed from words may lie where the network has seen no motion: both feet leave the ground in a walk, one stays in
the air, or the hips leap. No captured walk does. Such faults are detected in the shown pose, and the
style is mixed with neutral walking until they are gone; it keeps that weight until another style is requested.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache

import numpy as np

from runtime.arrays import Array
from runtime.motion.features import DT
from runtime.motion.model import MotionModel
from runtime.motion.style import Style, StyleBlend, mixed
from runtime.scalar_math import decay

MIN_STYLE_WEIGHT = 0.5  # minimum weight of the requested style
STYLE_WEIGHT_STEPS = 20  # resolution of the weight: each step is mixed once
STYLE_LOSS_PER_S = 0.8  # while a fault is detected
STYLE_GAIN_PER_S = 1.0  # during the transition to another style
MAX_FLIGHT_S = 0.05  # with both feet off the ground in a walk
MAX_SWING_S = 0.8  # of a foot off the ground in a walk
MAX_RISE_M = 0.055  # root mean square of the hips' height about its mean: a range of 16 cm
RISE_HALF_LIFE_S = 0.6
_FOLLOWS = 1.0 - decay(RISE_HALF_LIFE_S)


@dataclass
class WalkableShare:
    """Weight of the style of each of N characters, and measurements of its walk."""

    share: Array = field(default_factory=lambda: np.ones(1), metadata={"shape": (), "most": 1.0})
    # seconds that the left, the right and both feet have been in the air
    in_air: Array = field(default_factory=lambda: np.zeros((1, 3)), metadata={"shape": (3,)})
    # mean (m) and mean square (m2) of the hips' height
    height: Array = field(default_factory=lambda: np.zeros((1, 2)), metadata={"shape": (2,)})

    def styles(self, model: MotionModel, blends: Sequence[StyleBlend]) -> list[Style]:
        """Return the style of each character for this frame, weakened towards neutral if its walk fails."""
        steps = [round(share * STYLE_WEIGHT_STEPS) for share in self.share.tolist()]
        return [
            blend.style if share >= STYLE_WEIGHT_STEPS else _weakened(model, blend, share)
            for blend, share in zip(blends, steps, strict=True)
        ]

    def update(
        self,
        heights: Array,
        stands: Sequence[tuple[bool, bool]],
        walks: Sequence[bool],
        steady: Sequence[bool],
        blending: Sequence[bool],
    ) -> None:
        """Update with one frame: hips `heights` `(N,)` over the ground, and whether the left and right foot stand.

        `walks` marks characters that must have a foot on the ground, `steady` those whose walk is judged, `blending`
        those in a transition to a new style.
        """
        made = []
        for height, feet, on_foot, goes, changes, air, (mean, square), share in zip(
            heights.tolist(), stands, walks, steady, blending,
            self.in_air.tolist(), self.height.tolist(), self.share.tolist(), strict=True,
        ):  # fmt: skip
            downs = *feet, any(feet)
            air = [each + DT if goes and not down else 0.0 for each, down in zip(air, downs, strict=True)]
            mean = mean + _FOLLOWS * (height - mean) if goes else height
            square = square + _FOLLOWS * ((height - mean) ** 2 - square) if goes else 0.0
            flies = on_foot and (max(air[:2]) > MAX_SWING_S or air[2] > MAX_FLIGHT_S)
            if changes:
                share = min(share + STYLE_GAIN_PER_S * DT, 1.0)
            elif goes and (square > MAX_RISE_M**2 or flies):
                share = max(share - STYLE_LOSS_PER_S * DT, MIN_STYLE_WEIGHT)
            made.append((*air, mean, square, share))
        values = np.array(made)
        self.in_air, self.height, self.share = values[:, :3], values[:, 3:5], values[:, 5]


@lru_cache(maxsize=16)
def _weakened(model: MotionModel, blend: StyleBlend, steps: int) -> Style:
    """Return a blend's style mixed with neutral walking of the same mirroring; the prompt's body edits stay."""
    style, fraction = blend.style, steps / STYLE_WEIGHT_STEPS
    neutral = model.neutral_style(style.mirrored)
    if style.opposite is not None:
        opposite = model.neutral_style(not style.mirrored)
        neutral = replace(neutral, opposite=opposite, limbs=style.limbs)
    return replace(mixed((neutral, style), (1.0 - fraction, fraction)), z=style.z, edits=style.edits)
