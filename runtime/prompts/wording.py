"""The wording that a model follows: of a sentence that it hardly shows, one of the same meaning that it shows.

The file has, for every model by name and for torso, head, leg and either arm, sentences with what is told to the model in
their place; limbs are described as the left ones. `python -m training.evaluation.text.wording` measures and writes it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any

from runtime.assets import asset_path
from runtime.prompts.parts import PartDescriptions, mirror_text
from runtime.prompts.sentence_tables import as_left_limb, load_tables, rows_of
from runtime.skeleton import PART_NAMES

FILE = "prompts/wording.json"


@dataclass(frozen=True)
class Wording:
    """Of one model: (group, words) and the words in their place; group is leg, torso, head, or an arm by its name."""

    table: Mapping[tuple[str, str], str] = field(default_factory=dict)

    def of(self, sentence: str, part: str) -> str:
        """The sentence that the model is told of `part`."""
        group, words = as_left_limb(sentence, part)
        told = self.table.get((part, words), self.table.get((group, words)))
        if told is None:
            return sentence
        return mirror_text(told) if part.startswith("right") else told

    def followed(self, descriptions: PartDescriptions) -> PartDescriptions:
        """The six sentences that the model is told."""
        return PartDescriptions(**{part: self.of(getattr(descriptions, part), part) for part in PART_NAMES})


def wording_of(model: str) -> Wording:
    """The shipped table of a model by its name; empty where it has none. FileError when the file is malformed."""
    return _load(asset_path(FILE)).get(model, Wording())


def load_wordings(path: Path) -> dict[str, Wording]:
    """Tables by model; none where there is no file. FileError when it is malformed."""
    return load_tables(path, _read, "wordings")


def _read(groups: Any) -> Wording:
    rows = rows_of(groups)
    if not all(isinstance(told, str) and told for told in rows.values()):
        raise ValueError("a wording is no text")
    return Wording(rows)


@lru_cache(maxsize=2)
def _load(path: Path) -> dict[str, Wording]:
    return load_wordings(path)
