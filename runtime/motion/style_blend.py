"""The style of a character from frame to frame: a blend from one mix of codes to another over some seconds."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from runtime.arrays import Float32Array
from runtime.easing import smooth
from runtime.motion.mirror import Ways
from runtime.motion.style_mix import Style, StyleMix, mixed


class Fold(Protocol):
    """Folds a code or a mix the ways round that it is walked best, or those asked for."""

    def __call__(self, style: Float32Array | StyleMix, like: Ways | None = None) -> Style: ...


@dataclass(frozen=True, eq=False)
class StyleCodes:
    """What a style was, what it becomes, and how far it is."""

    start: StyleMix | Style  # a blend that began in the middle of another begins with what was shown, folded
    goal: StyleMix
    seconds: float = 0.0
    progress: float = 1.0  # 0 to 1
    strength: float = 1.0

    @property
    def share(self) -> float:
        """Of the goal, eased at both ends."""
        return smooth(self.progress)


@dataclass(frozen=True, eq=False)
class StyleBlend:
    """Codes with what follows from them: the folded weights of start and goal, and those of this frame."""

    codes: StyleCodes
    ends: tuple[Style, Style]
    style: Style

    @staticmethod
    def of(codes: StyleCodes, fold: Fold) -> StyleBlend:
        """Folded by a model at the codes' strength; ModelError where a code does not fit the model.

        A blend to a style that is walked in the mirror is in it from the beginning, and the reverse.
        """
        goal, start = fold(codes.goal), codes.start
        if codes.progress < 1.0 and not isinstance(start, Style):
            start = fold(start)
        if not isinstance(start, Style):
            return StyleBlend(codes, (goal, goal), goal)
        ways = Ways(goal.mirrored, goal.beside is not None or start.beside is not None)
        if ways != start.ways:
            start = fold(start.z if isinstance(codes.start, Style) else codes.start, ways)
        if ways != goal.ways:
            goal = fold(codes.goal, ways)
        ends = start, goal
        return StyleBlend(codes, ends, _between(ends, codes))

    @staticmethod
    def constant(style: Float32Array | StyleMix, strength: float, fold: Fold) -> StyleBlend:
        """One style that holds; ModelError where a code does not fit the model."""
        return StyleBlend.of(StyleCodes(_mix(style), _mix(style), strength=strength), fold)

    def towards(self, style: Float32Array | StyleMix, seconds: float, fold: Fold) -> StyleBlend:
        """From what is shown now to another style; ModelError where a code does not fit the model."""
        if seconds <= 0.0:
            return StyleBlend.constant(style, self.codes.strength, fold)
        start = self.style if self.blending else self.codes.goal
        return StyleBlend.of(StyleCodes(start, _mix(style), seconds, 0.0, self.codes.strength), fold)

    def at_strength(self, strength: float, fold: Fold) -> StyleBlend:
        """The same blend at another strength, by which `fold` folds."""
        start = self.codes.start
        start = _mix(start.z) if isinstance(start, Style) else start
        return StyleBlend.of(replace(self.codes, start=start, strength=strength), fold)

    def advanced(self, dt: float) -> StyleBlend:
        """The blend `dt` seconds on."""
        if not self.blending:
            return self
        codes = replace(self.codes, progress=min(1.0, self.codes.progress + dt / self.codes.seconds))
        return StyleBlend(codes, self.ends, _between(self.ends, codes))

    @property
    def blending(self) -> bool:
        """Whether it still changes."""
        return self.codes.progress < 1.0


def _mix(style: Float32Array | StyleMix) -> StyleMix:
    """A code `(6, 64)` as a mix of one."""
    return style if isinstance(style, StyleMix) else StyleMix((1.0,), (np.array(style, np.float32),))


def _between(ends: tuple[Style, Style], codes: StyleCodes) -> Style:
    if codes.share <= 0.0 or codes.share >= 1.0:
        return ends[codes.share >= 1.0]
    return mixed(ends, (1.0 - codes.share, codes.share))
