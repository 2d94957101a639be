"""Six body-part descriptions, the form in which a prompt is embedded (Sec. III-C)."""

from __future__ import annotations

import dataclasses
import json
import re
import unicodedata
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from runtime.errors import PromptError
from runtime.safe_read import parse_json, reason
from runtime.skeleton import PART_NAMES

MAX_CHARACTERS = 300
_SWAPPED_PARTS = {
    "left_arm": "right_arm",
    "right_arm": "left_arm",
    "left_leg": "right_leg",
    "right_leg": "left_leg",
}
_SWAPPED_WORDS = {
    a + end: b + end for a, b in (("left", "right"), ("right", "left")) for end in ("", "ward", "wards")
}


@dataclass(frozen=True)
class PartDescriptions:
    """One sentence for each body part, in the order of `PART_NAMES`; PromptError if one is invalid."""

    left_arm: str
    right_arm: str
    left_leg: str
    right_leg: str
    torso: str
    head: str

    def __post_init__(self) -> None:
        for part in PART_NAMES:
            text = check_text(getattr(self, part), f"description of {part}", MAX_CHARACTERS)
            object.__setattr__(self, part, text)

    @classmethod
    def from_mapping(cls, values: Mapping[str, Any]) -> PartDescriptions:
        """Return descriptions from a mapping with exactly the six part names; PromptError otherwise."""
        missing = [part for part in PART_NAMES if part not in values]
        unknown = sorted(str(key) for key in values if key not in PART_NAMES)
        if missing or unknown:
            raise PromptError(
                f"Part descriptions: missing {missing}, unknown {[name[:40] for name in unknown[:6]]}.",
                f"Give exactly {', '.join(PART_NAMES)}.",
            )
        return cls(**{part: values[part] for part in PART_NAMES})

    @classmethod
    def from_json(cls, text: str) -> PartDescriptions:
        """Return descriptions from the text of a JSON object; PromptError if it is invalid."""
        try:
            values = parse_json(text)
        except ValueError as error:
            problem = f"Part descriptions: not JSON ({reason(error)})."
            raise PromptError(problem, "Give a JSON object.") from error
        if not isinstance(values, dict):
            raise PromptError("Part descriptions: not a JSON object.", "Give an object of six strings.")
        return cls.from_mapping(values)

    def to_mapping(self) -> dict[str, str]:
        """Return part name → description, in the order of `PART_NAMES`."""
        return {part: getattr(self, part) for part in PART_NAMES}

    def to_json(self) -> str:
        """Return the JSON text that `from_json` reads."""
        return json.dumps(self.to_mapping(), ensure_ascii=False)

    def as_tuple(self) -> tuple[str, ...]:
        """Return the six descriptions in the order of `PART_NAMES`."""
        return tuple(getattr(self, part) for part in PART_NAMES)

    def mirrored(self) -> PartDescriptions:
        """Return the descriptions of the mirrored motion: limbs swapped, and the words left and right swapped."""
        return PartDescriptions(
            **{_SWAPPED_PARTS.get(part, part): mirror_text(text) for part, text in self.to_mapping().items()}
        )

    def replace(self, part: str, text: str) -> PartDescriptions:
        """Return a copy with one description replaced; PromptError for an unknown part or invalid text."""
        if part not in PART_NAMES:
            raise PromptError(f"Unknown body part {part!r}.", f"Use one of {', '.join(PART_NAMES)}.")
        return dataclasses.replace(self, **{part: text})


def mirror_text(text: str) -> str:
    """Return `text` with the words left and right swapped, keeping capitals."""

    def swap(match: re.Match[str]) -> str:
        word = match.group(0)
        other = _SWAPPED_WORDS[word.lower()]
        if word.isupper():
            return other.upper()
        return other.capitalize() if word[0].isupper() else other

    return re.sub(r"\b(?:left|right)(?:wards?)?\b", swap, text, flags=re.IGNORECASE)


def check_text(text: object, field: str, limit: int) -> str:
    """Return `text` with its white space collapsed; PromptError if it is empty, too long or has control characters."""
    if not isinstance(text, str):
        raise PromptError(f"The {field} is {type(text).__name__}, expected text.", "Give a string.")
    if len(text) > limit:
        raise PromptError(
            f"The {field} has {len(text)} characters, at most {limit} are read.", "Shorten it to a sentence."
        )
    clean = " ".join(text.split())
    if not clean:
        raise PromptError(f"The {field} is empty.", "Describe a way of moving, e.g. 'an exhausted soldier'.")
    # control characters, and lone surrogates that no tokenizer can encode
    odd = "" if clean.isprintable() else clean
    bad = next((c for c in odd if unicodedata.category(c) in ("Cc", "Cs")), None)
    if bad is not None:
        raise PromptError(
            f"The {field} contains the control character U+{ord(bad):04X}.", "Type it as plain text."
        )
    return clean
