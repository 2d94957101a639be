"""Styles, blended in the modulator's folded weights, and transitions between styles over time.

Between two codes Z^t the gating of the content experts acts as a switch: most of the change occurs within a sixth of the
range. Folded experts' weights are linear in the gating's result, so that a blend of folded weights changes evenly.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from math import inf
from typing import Protocol

import numpy as np

from runtime.arrays import Array, Float32Array
from runtime.edits.request import FOLD, PACED, ROW_TRUNK, SHAPE, range_of
from runtime.motion.calibration import Calibration
from runtime.motion.features import C
from runtime.motion.mirror import LIMBS, Ways, mirrored_code
from runtime.motion.swing import PLAIN
from runtime.scalar_math import smoothstep

Shares = tuple[float, ...]  # blend weights of the second of two styles, at even visible change

LINEAR: Shares = (0.0, 1.0)
NEUTRAL_M_PER_S = 1.3, 2.0  # speeds of a neutral walk and jog
MAX_CACHED_FOLDS = 16  # folded codes that are cached: a blend of six parts has seven


@dataclass(frozen=True)
class Style:
    """The prompt's input to every frame: the modulator's folded weights and the natural speeds."""

    z: Float32Array  # (6, 64), as encoded from the prompt, regardless of strength
    front_bias: Float32Array
    content_weight: Float32Array
    content_bias: Float32Array
    walk_speed: float  # m/s
    jog_speed: float
    # amplitude and turns a second (C, 2) of the phases at rest, from the arm descriptions; zeros if the model has none
    rest: Float32Array = field(default_factory=lambda: np.zeros((C, 2), np.float32))
    edits: Array = field(default_factory=lambda: np.zeros(SHAPE))  # edit targets of the body parts
    mirrored: bool = False  # folded from the mirror image of z: the network walks it mirrored
    # the same code folded for the opposite walk, if some limbs are taken from it
    opposite: Style | None = None
    limbs: tuple[float, ...] = (0.0,) * LIMBS  # weight of the opposite walk for each of the four limbs
    swings: tuple[float, ...] = PLAIN  # gains of `runtime.motion.swing.SWINGS`

    @cached_property
    def is_edited(self) -> tuple[bool, ...]:
        """Whether body edits are active, for each of `GAITS`."""
        asked = self.edits[..., 0].astype(bool)
        asked[:, FOLD[0], FOLD[1]] = asked[:, :ROW_TRUNK, PACED] = False
        return tuple(bool(gait.any()) for gait in asked)

    @cached_property
    def speeds(self) -> tuple[float, float]:
        """Walking and jogging speed (m/s), adjusted by the prompt's leg edits."""
        own = self.walk_speed, self.jog_speed
        walk, jog = (self._paced(k, each, NEUTRAL_M_PER_S[k]) for k, each in enumerate(own))
        return walk, jog

    def _paced(self, gait: int, own: float, neutral: float) -> float:
        changes = []
        for leg in self.edits[gait, :ROW_TRUNK, PACED].tolist():
            low, high = (neutral * end for end in range_of(leg))
            changes.append(leg[0] * (min(high - own, 0.0) + max(low - own, 0.0)))
        # the quick step of a limp affects one leg: only edits of both legs change the speed
        left, right = changes
        return float(own + 0.5 * (left + right)) if left * right > 0.0 else own

    @cached_property
    def folds(self) -> tuple[float, ...]:
        """Largest forward lean (degrees) of the trunk in each gait; infinite if unlimited."""
        found = [gait[FOLD].tolist() for gait in self.edits]
        return tuple(range_of(fold)[1] if fold[0] > 0.0 else inf for fold in found)

    @cached_property
    def asked(self) -> list[list[list[list[float]]]]:
        """The edit targets of each body part, for each of `GAITS`, as nested lists."""
        return self.edits.tolist()

    @property
    def ways(self) -> Ways:
        """Whether the style is folded for a mirrored walk, and whether limbs come from the opposite one."""
        return Ways(self.mirrored, self.opposite is not None)


@dataclass(frozen=True, eq=False)
class StyleMix:
    """Codes Z^t `(6, 64)` with weights that sum to one, and the edit targets of the body parts (`runtime.edits.request`)."""

    weights: tuple[float, ...]
    codes: tuple[Float32Array, ...]
    edits: Array = field(default_factory=lambda: np.zeros(SHAPE))


def even_weights(fractions: Shares, weights: Sequence[float]) -> Shares:
    """Return the blend weights of the second style that give these fractions, 0 to 1, of the visible change.

    `fractions` are the weights measured by `runtime.motion.perceptual_weights`.
    """
    return tuple(np.interp(weights, np.linspace(0.0, 1.0, len(fractions)), fractions).tolist())


def turned_round(fractions: Shares) -> Shares:
    """Return the measured weights for the same two styles in reverse order."""
    return tuple(1.0 - fraction for fraction in reversed(fractions))


def mixes(weights: Sequence[float]) -> bool:
    """Return whether any part mixes both styles."""
    return any(0.0 < weight < 1.0 for weight in weights)


def mixed(styles: Sequence[Style], weights: Sequence[float]) -> Style:
    """Return the weighted mean of folded styles, all folded with the same mirroring; a single style is returned unchanged."""
    if len(styles) == 1:
        return styles[0]

    def mean(name: str) -> Float32Array:
        total = np.float32(weights[0]) * getattr(styles[0], name)
        for fraction, style in zip(weights[1:], styles[1:], strict=True):
            total += np.float32(fraction) * getattr(style, name)
        return total

    walk, jog = (
        sum(fraction * getattr(style, name) for fraction, style in zip(weights, styles, strict=True))
        for name in ("walk_speed", "jog_speed")
    )
    z, front_bias, weight, bias = (mean(n) for n in ("z", "front_bias", "content_weight", "content_bias"))
    swings = tuple((np.array(weights) @ np.array([style.swings for style in styles])).tolist())
    made = Style(
        z, front_bias, weight, bias, walk, jog, mean("rest"), mirrored=styles[0].mirrored, swings=swings
    )
    opposites = [style.opposite for style in styles if style.opposite is not None]
    if len(opposites) < len(styles):
        return made
    limbs = np.array(weights) @ np.array([style.limbs for style in styles])
    return replace(made, opposite=mixed(opposites, weights), limbs=tuple(limbs.tolist()))


class StyleFolder:
    """Folds codes and mixes at one strength, each code once, mirrored as the model's `calibration` prefers."""

    def __init__(
        self,
        fold: Callable[[Float32Array, float], Style],
        strength: float,
        calibration: Calibration | None = None,
    ) -> None:
        self._fold = fold
        self._calibration = calibration
        self.strength = strength
        self._known: dict[tuple[bytes, bool], Style] = {}

    def fold(self, style: Float32Array | StyleMix, like: Ways | None = None) -> Style:
        """Fold a style for the walk, mirrored or not, that shows it better, or for the walk that `like` names.

        Raises ModelError if a code does not fit the model.
        """
        mix = style if isinstance(style, StyleMix) else StyleMix((1.0,), (style,))
        return replace(self._mixed(mix, like), edits=mix.edits)

    def _mixed(self, mix: StyleMix, like: Ways | None) -> Style:
        measured = self._calibration
        if measured is None:
            return mixed([self._folded(z, False) for z in mix.codes], mix.weights)
        leads = np.array(mix.weights, np.float32) @ np.stack([measured.side_leads(z) for z in mix.codes])
        ways = measured.ways(leads) if like is None else like
        limbs = measured.other_limbs(leads, ways.mirrored)
        made = mixed([self._folded(z, ways.mirrored) for z in mix.codes], mix.weights)
        if not ways.both:
            return made
        opposite = mixed([self._folded(z, not ways.mirrored) for z in mix.codes], mix.weights)
        return replace(made, opposite=opposite, limbs=limbs)

    def _folded(self, z: Float32Array, mirrored: bool) -> Style:
        key = np.ascontiguousarray(z, np.float32).tobytes(), mirrored
        found = self._known.pop(key, None)
        if found is None:
            found = self._fold(mirrored_code(z) if mirrored else z, self.strength)
            found = replace(found, z=z, mirrored=True) if mirrored else found
        self._known[key] = found  # the most recent last
        if len(self._known) > MAX_CACHED_FOLDS:
            del self._known[next(iter(self._known))]
        return found


class Fold(Protocol):
    """Folds a code or a mix for the walk, mirrored or not, that shows it better, or for the requested one."""

    def __call__(self, style: Float32Array | StyleMix, like: Ways | None = None) -> Style: ...


@dataclass(frozen=True, eq=False)
class StyleCodes:
    """The start and goal of a style transition, and its progress."""

    start: StyleMix | Style  # a blend that starts during another one starts with the folded style shown then
    goal: StyleMix
    seconds: float = 0.0
    progress: float = 1.0  # 0 to 1
    strength: float = 1.0

    @property
    def fraction(self) -> float:
        """Fraction of the goal, eased at both ends."""
        return smoothstep(self.progress)


@dataclass(frozen=True, eq=False)
class StyleBlend:
    """A style transition with its folded weights at start, goal and this frame."""

    codes: StyleCodes
    ends: tuple[Style, Style]
    style: Style

    @staticmethod
    def of(codes: StyleCodes, fold: Fold) -> StyleBlend:
        """Return the blend of `codes`, folded; ModelError if a code does not fit the model.

        A transition between a mirrored and an unmirrored style is mirrored like its goal from the beginning.
        """
        goal, start = fold(codes.goal), codes.start
        if codes.progress < 1.0 and not isinstance(start, Style):
            start = fold(start)
        if not isinstance(start, Style):
            return StyleBlend(codes, (goal, goal), goal)
        ways = Ways(goal.mirrored, goal.opposite is not None or start.opposite is not None)
        if ways != start.ways:
            start = fold(_mix(start) if isinstance(codes.start, Style) else codes.start, ways)
        if ways != goal.ways:
            goal = fold(codes.goal, ways)
        ends = start, goal
        return StyleBlend(codes, ends, _between(ends, codes))

    @staticmethod
    def constant(style: Float32Array | StyleMix, strength: float, fold: Fold) -> StyleBlend:
        """Return a blend of one constant style; ModelError if a code does not fit the model."""
        return StyleBlend.of(StyleCodes(_mix(style), _mix(style), strength=strength), fold)

    def towards(self, style: Float32Array | StyleMix, seconds: float, fold: Fold) -> StyleBlend:
        """Return the transition from the style shown now to another; ModelError if a code does not fit the model."""
        if seconds <= 0.0:
            return StyleBlend.constant(style, self.codes.strength, fold)
        start = self.style if self.blending else self.codes.goal
        return StyleBlend.of(StyleCodes(start, _mix(style), seconds, 0.0, self.codes.strength), fold)

    def at_strength(self, strength: float, fold: Fold) -> StyleBlend:
        """Return the same blend at another strength; `fold` folds at that strength."""
        start = self.codes.start
        start = _mix(start) if isinstance(start, Style) else start
        return StyleBlend.of(replace(self.codes, start=start, strength=strength), fold)

    def advanced(self, dt: float) -> StyleBlend:
        """Return the blend `dt` seconds later."""
        if not self.blending:
            return self
        codes = replace(self.codes, progress=min(1.0, self.codes.progress + dt / self.codes.seconds))
        return StyleBlend(codes, self.ends, _between(self.ends, codes))

    @property
    def blending(self) -> bool:
        """Whether the transition is still in progress."""
        return self.codes.progress < 1.0


def _mix(style: Float32Array | StyleMix | Style) -> StyleMix:
    """Return a code `(6, 64)`, or that of a folded style, as a mix of one."""
    if isinstance(style, Style):
        return StyleMix((1.0,), (style.z,), style.edits)
    return style if isinstance(style, StyleMix) else StyleMix((1.0,), (np.array(style, np.float32),))


def _between(ends: tuple[Style, Style], codes: StyleCodes) -> Style:
    if codes.fraction <= 0.0 or codes.fraction >= 1.0:
        return ends[codes.fraction >= 1.0]
    edits = (1.0 - codes.fraction) * ends[0].edits + codes.fraction * ends[1].edits
    return replace(mixed(ends, (1.0 - codes.fraction, codes.fraction)), edits=edits)
