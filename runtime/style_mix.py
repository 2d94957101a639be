"""Styles between styles, mixed where the network uses them: in the modulator's folded weights.

Between two codes Z^t the gating of the content experts is a switch: most of the change comes within a sixth of the way.
What the experts' weights are folded into is linear in the gating's result, so that a mix of folded weights changes evenly.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from sport.runtime.errors import PromptError
from sport.runtime.motion.model import Style
from sport.runtime.prompts.blend import check_weights
from sport.runtime.skeleton import PART_NAMES

Array = NDArray[np.float32]

CACHED = 16  # folded codes that are kept: a blend of six parts has seven


@dataclass(frozen=True, eq=False)
class StyleMix:
    """Codes Z^t `(6, 64)` with their shares, which sum to one."""

    shares: tuple[float, ...]
    codes: tuple[Array, ...]


def mix_of_parts(z_a: Array, z_b: Array, weights: Sequence[float]) -> StyleMix:
    """The mix in which part k is `weights[k]` (0 to 1) of the way from prompt A to prompt B.

    Its codes have each part wholly of A or of B: those of B come in the order of their weights. Equal weights give the
    straight line from A to B, weights of 0 and 1 exactly one code. PromptError when the codes differ in shape or a
    weight is not in 0..1.
    """
    a, b = np.asarray(z_a, np.float32), np.asarray(z_b, np.float32)
    if a.shape != b.shape or a.ndim != 2 or len(a) != len(PART_NAMES):
        raise PromptError(
            f"Blend: codes of shape {a.shape} and {b.shape}, expected two of ({len(PART_NAMES)}, D).",
            "Encode both prompts with the same model.",
        )
    w = np.array(check_weights(dict(zip(PART_NAMES, weights, strict=True))))
    steps = [0.0, *sorted(set(w.tolist()) - {0.0, 1.0}), 1.0]
    shares, codes = [], []
    for low, high in pairwise(steps):
        shares.append(high - low)
        codes.append(np.where((w >= high)[:, None], b, a))
    return StyleMix(tuple(shares), tuple(codes))


def mixed(styles: Sequence[Style], shares: Sequence[float]) -> Style:
    """The weighted mean of folded styles; one style alone is handed back as it is."""
    if len(styles) == 1:
        return styles[0]

    def mean(name: str) -> Array:
        total = np.float32(shares[0]) * getattr(styles[0], name)
        for share, style in zip(shares[1:], styles[1:], strict=True):
            total += np.float32(share) * getattr(style, name)
        return total

    walk, jog = (
        sum(share * getattr(style, name) for share, style in zip(shares, styles, strict=True))
        for name in ("walk_speed", "jog_speed")
    )
    return Style(mean("z"), mean("front_bias"), mean("content_weight"), mean("content_bias"), walk, jog)


class StyleFolder:
    """Folds codes and mixes at one strength, each code once."""

    def __init__(self, fold: Callable[[Array, float], Style], strength: float) -> None:
        self._fold = fold
        self.strength = strength
        self._known: dict[bytes, Style] = {}

    def fold(self, style: Array | StyleMix) -> Style:
        """The folded style; ModelError where a code does not fit the model."""
        if not isinstance(style, StyleMix):
            return self._folded(style)
        return mixed([self._folded(z) for z in style.codes], style.shares)

    def _folded(self, z: Array) -> Style:
        key = np.ascontiguousarray(z, np.float32).tobytes()
        found = self._known.pop(key, None) or self._fold(z, self.strength)
        self._known[key] = found  # the latest last
        if len(self._known) > CACHED:
            del self._known[next(iter(self._known))]
        return found
