"""Sentences put in terms of one side only: what "right" means is what "left" means, mirrored.

A body is its own mirror image. The words of a right limb are read as those of the left one, and "head turned to the
right" as "head turned to the left" with a sign, so that what a network learned of one side holds for the other.
"""

from __future__ import annotations

import re

from runtime.prompts.parts import mirror_text

_SIDE = re.compile(r"\b(left|right)(?:wards?)?\b", re.IGNORECASE)
_BOTH = re.compile(
    r"\b(?:left (?:and|or|to|then) (?:the )?right|right (?:and|or|to|then) (?:the )?left)\b", re.IGNORECASE
)


def one_sided(part: str, text: str) -> tuple[str, float]:
    """A part's sentence as it would be said of the left, and its sign.

    A limb's sign is 1. Of torso and head it is 1 to the left, -1 to the right (the first side named counts), and 0 where
    no side is named, or both alike ("from left to right").
    """
    if part.startswith("left_"):
        return text, 1.0
    if part.startswith("right_"):
        return mirror_text(text), 1.0
    side = _SIDE.search(_BOTH.sub("", text))
    if side is None:
        return text, 0.0
    return (text, 1.0) if side.group(1).lower() == "left" else (mirror_text(text), -1.0)
