"""Sliders whose change is even: pairs of prompts are measured on a worker thread while the character walks on."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from runtime.motion.style import LINEAR, Shares, mixes
from runtime.session.prompt_blend import PromptBlend
from viewer.jobs import Jobs, Slot

Measure = Callable[[Any, Any], Shares]  # of the codes of two prompts


@dataclass
class EvenBlends:
    """Measures the pair of prompts that is blended, once; `revise` gets what puts its shares into a blend."""

    jobs: Jobs
    revise: Callable[[Callable[[PromptBlend], PromptBlend]], None]
    measure: Measure | None = None  # of the model in use; None: blends stay linear
    _pair: tuple[Any, Any] | None = None  # the pair's codes

    def use(self, measure: Measure | None) -> None:
        """Measure with another model."""
        self.measure, self._pair = measure, None

    def poll(self, blend: PromptBlend) -> None:
        """Have a new pair measured."""
        if blend.a is None or blend.b is None or blend.shares != LINEAR or not mixes(blend.weights):
            return
        a, b, measure = blend.a.z, blend.b.z, self.measure
        if measure is None or (self._pair is not None and self._pair[0] is a and self._pair[1] is b):
            return
        self._pair = a, b

        def evened(shares: Shares, other: PromptBlend) -> PromptBlend:
            same = other.a is not None and other.b is not None and other.a.z is a and other.b.z is b
            return dataclasses.replace(other, shares=shares) if same else other

        self.jobs.submit(
            Slot("blend"),
            lambda: measure(a, b),
            lambda shares: self.revise(lambda other: evened(shares, other)),
            lambda _: None,
        )
