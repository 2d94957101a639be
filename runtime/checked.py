"""Checks of numbers and texts in untrusted JSON: ValueError, or a default instead."""

import math
from collections.abc import Mapping
from typing import Any

from runtime.safe_read import is_text

MAX_NUMBER = 1e18


def read_number(value: Any, most: float = 1e9) -> float:
    """Return the value as a number between `-most` and `most`; ValueError for any other value."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) <= most:
        raise ValueError(f"{str(value)[:20]}: expected a number up to {most:g}")
    return float(value)


def read_whole(value: Any, least: int = 0, most: int = 1 << 62) -> int:
    """Return the value if it is an integer from `least` to `most`; ValueError otherwise."""
    if type(value) is not int or not least <= value <= most:
        raise ValueError(f"{str(value)[:20]}: expected a whole number")
    return value


def read_text(value: Any, longest: float = math.inf) -> str:
    """Return the value if it is printable text without a zero byte; ValueError otherwise."""
    if not is_text(value) or "\0" in value or len(value) > longest:
        raise ValueError("expected text")
    return value


def number_field(value: Mapping[str, Any], field: str, default: float) -> float:
    """Return a field that is a finite number within `MAX_NUMBER`, else the default."""
    try:
        return read_number(value.get(field, default), MAX_NUMBER)
    except ValueError:
        return default


def text_field(value: Mapping[str, Any], field: str, default: str) -> str:
    """Return a field that is text, else the default."""
    found = value.get(field, default)
    return found if is_text(found) else default
