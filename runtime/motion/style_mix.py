"""Styles between styles, mixed where the network uses them: in the modulator's folded weights.

Between two codes Z^t the gating of the content experts is a switch: most of the change comes within a sixth of the way.
What the experts' weights are folded into is linear in the gating's result, so that a mix of folded weights changes evenly.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from runtime.arrays import Float32Array
from runtime.motion.features import C

Shares = tuple[float, ...]  # of the second of two styles, at even parts of the change from the first

LINEAR: Shares = (0.0, 1.0)
CACHED = 16  # folded codes that are kept: a blend of six parts has seven


@dataclass(frozen=True)
class Style:
    """What a prompt contributes to every frame: the modulator's folded weights and the natural speeds."""

    z: Float32Array  # (6, 64), as it came from the prompt, whatever the strength
    front_bias: Float32Array
    content_weight: Float32Array
    content_bias: Float32Array
    walk_speed: float  # m/s
    jog_speed: float
    # amplitude and turns a second (C, 2) of the phases at rest, by what the arms are to do; zeros of a model that does not tell
    rest: Float32Array = field(default_factory=lambda: np.zeros((C, 2), np.float32))


@dataclass(frozen=True, eq=False)
class StyleMix:
    """Codes Z^t `(6, 64)` with their shares, which sum to one."""

    shares: tuple[float, ...]
    codes: tuple[Float32Array, ...]


def even_weights(shares: Shares, weights: Sequence[float]) -> Shares:
    """The shares of the second style at which these parts (0 to 1) of the change are done; 0 and 1 stay what they are."""
    return tuple(np.interp(weights, np.linspace(0.0, 1.0, len(shares)), shares).tolist())


def turned_round(shares: Shares) -> Shares:
    """The shares of the same pair, the other style first."""
    return tuple(1.0 - share for share in reversed(shares))


def mixes(weights: Sequence[float]) -> bool:
    """Whether any part is of both styles; else there is nothing to measure."""
    return any(0.0 < weight < 1.0 for weight in weights)


def mixed(styles: Sequence[Style], shares: Sequence[float]) -> Style:
    """The weighted mean of folded styles; one style alone is handed back as it is."""
    if len(styles) == 1:
        return styles[0]

    def mean(name: str) -> Float32Array:
        total = np.float32(shares[0]) * getattr(styles[0], name)
        for share, style in zip(shares[1:], styles[1:], strict=True):
            total += np.float32(share) * getattr(style, name)
        return total

    walk, jog = (
        sum(share * getattr(style, name) for share, style in zip(shares, styles, strict=True))
        for name in ("walk_speed", "jog_speed")
    )
    z, front_bias, weight, bias = (mean(n) for n in ("z", "front_bias", "content_weight", "content_bias"))
    return Style(z, front_bias, weight, bias, walk, jog, mean("rest"))


class StyleFolder:
    """Folds codes and mixes at one strength, each code once."""

    def __init__(self, fold: Callable[[Float32Array, float], Style], strength: float) -> None:
        self._fold = fold
        self.strength = strength
        self._known: dict[bytes, Style] = {}

    def fold(self, style: Float32Array | StyleMix) -> Style:
        """The folded style; ModelError where a code does not fit the model."""
        if not isinstance(style, StyleMix):
            return self._folded(style)
        return mixed([self._folded(z) for z in style.codes], style.shares)

    def _folded(self, z: Float32Array) -> Style:
        key = np.ascontiguousarray(z, np.float32).tobytes()
        found = self._known.pop(key, None) or self._fold(z, self.strength)
        self._known[key] = found  # the latest last
        if len(self._known) > CACHED:
            del self._known[next(iter(self._known))]
        return found
