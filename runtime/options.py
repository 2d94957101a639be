"""Allowed values of an option and how it is chosen, declared once on the dataclass field that holds it."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from runtime.safe_read import is_text

MAX_NUMBER = 1e300  # larger numbers are refused, like NaN
MAX_TEXT = 4096  # characters of a text


@dataclass(frozen=True)
class Spec:
    """Allowed values of an option and how it is chosen: by a widget of a panel, or a `flag` of the command line."""

    low: float = -math.inf
    high: float = math.inf
    choices: Mapping[Any, str] | None = None  # allowed value: its name in the panel
    label: str = ""  # of the widget; a format string if it shows a number
    hint: str = ""
    factor: float = 1.0  # the widget shows the value times this
    whole: bool = False  # the widget rounds what it shows to a whole number
    logarithmic: bool = False
    speed: float = 0.01  # of dragging, per pixel
    flag: str = ""
    unit: str = ""
    formats: frozenset[str] = frozenset()  # endings of the files that have it

    def allows(self, value: Any) -> bool:
        """Return whether a text or number is allowed."""
        if self.choices is not None:
            return value in self.choices
        return isinstance(value, str) or (abs(value) < MAX_NUMBER and self.low <= value <= self.high)

    def read(self, value: Any, default: Any) -> Any:
        """Return an untrusted JSON value as the type of `default` if it is allowed, else the default."""
        if self.choices is not None:
            known = value is None or _is_short_text(value) or _is_number(value)
            return next((choice for choice in self.choices if known and choice == value), default)
        if not _is_of_type(value, default):
            return default
        if isinstance(default, bool):
            return value
        return type(default)(value) if self.allows(value) else default


def _is_of_type(value: Any, default: Any) -> bool:
    if isinstance(default, bool):
        return isinstance(value, bool)
    return _is_short_text(value) if isinstance(default, str) else _is_number(value)


def _is_short_text(value: Any) -> bool:
    return is_text(value) and len(value) < MAX_TEXT and "\0" not in value


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def specified(default: Any, low: float = -math.inf, high: float = math.inf, **spec: Any) -> Any:
    """Return a dataclass field with its `Spec`."""
    return field(default=default, metadata={"spec": Spec(low, high, **spec)})


def spec_of(owner: Any, name: str) -> Spec:
    """Return the `Spec` of a dataclass field; a field without one has no limits."""
    spec: Spec = owner.__dataclass_fields__[name].metadata.get("spec", Spec())
    return spec
