"""Tables of what models were measured to do with sentences: JSON files by model, then by group of a body part.

Limbs share a group, and are described as the left ones.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TypeVar

from runtime.errors import FileError
from runtime.prompts.parts import mirror_text
from runtime.skeleton import PART_NAMES

Row = TypeVar("Row")
Table = TypeVar("Table")


def as_left_limb(sentence: str, part: str) -> tuple[str, str]:
    """Group of a part, and its sentence as it describes the left limb; ValueError for an unknown part."""
    if part not in PART_NAMES:
        raise ValueError(f"unknown body part {part!r}")
    side, _, limb = part.partition("_")
    text = " ".join(sentence.lower().split())
    return (limb or side), (mirror_text(text) if side == "right" else text)


def rows_of(groups: Mapping[str, Mapping[str, Row]]) -> dict[tuple[str, str], Row]:
    """The rows of all groups by (group, words)."""
    return {(group, words): row for group, own in groups.items() for words, row in own.items()}


def load_tables(path: Path, read: Callable[[Any], Table], what: str) -> dict[str, Table]:
    """What `read` makes of every model's value; none where there is no file. FileError when it is malformed."""
    if not path.is_file():
        return {}
    try:
        values: dict[str, Any] = json.loads(path.read_text("utf-8"))
        return {model: read(value) for model, value in values.items()}
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise FileError(f"{path}: not a table of {what} ({error!r}).", "Restore the file.") from error
