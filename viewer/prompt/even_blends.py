"""Sliders whose change is even: pairs of prompts are measured on a worker thread while the character walks on."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from runtime.motion.style_mix import LINEAR, Shares, mixes
from viewer.jobs import Jobs, Slot
from viewer.prompt.style_edit import StyleEdit

Measure = Callable[[Any, Any], Shares]  # of the codes of two prompts


@dataclass
class EvenBlends:
    """Measures the pair of prompts that is blended, once."""

    jobs: Jobs
    measure: Measure | None = None  # of the model in use; None: blends stay linear
    _pair: tuple[Any, Any] | None = None  # the pair's codes

    def use(self, measure: Measure | None) -> None:
        """Measure with another model."""
        self.measure, self._pair = measure, None

    def poll(self, edit: StyleEdit, measured: Callable[[Callable[[StyleEdit], StyleEdit]], None]) -> None:
        """Have a new pair measured; `measured` is called with what puts its shares into an edit."""
        if edit.a is None or edit.b is None or edit.shares != LINEAR or not mixes(edit.weights):
            return
        a, b, measure = edit.a.z, edit.b.z, self.measure
        if measure is None or (self._pair is not None and self._pair[0] is a and self._pair[1] is b):
            return
        self._pair = a, b

        def evened(shares: Shares, other: StyleEdit) -> StyleEdit:
            same = other.a is not None and other.b is not None and other.a.z is a and other.b.z is b
            return dataclasses.replace(other, shares=shares) if same else other

        self.jobs.submit(
            Slot("blend"),
            lambda: measure(a, b),
            lambda shares: measured(lambda other: evened(shares, other)),
            lambda _: None,
        )
