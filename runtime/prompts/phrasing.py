"""What a model was measured to do with sentences: how much of one it shows, and the words that it follows.

Tables are JSON files by model, then by group of a body part: torso, head, arm and leg, with limbs described as the left
ones. Where a limb does other than that of the other side, `left_arm` and the like have their own.
`python -m training.export.words` writes `shares.json` and `wording.json` of `assets/prompts`.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any, TypeVar

from runtime.assets import DEFAULT_MODEL, asset_path
from runtime.errors import FileError
from runtime.prompts.parts import PartDescriptions, mirror_text
from runtime.skeleton import PART_NAMES

HARDLY_SHOWN_FRACTION = 0.3  # fraction under which a sentence is hardly shown
ADHERENCE, PHRASINGS = "prompts/shares.json", "prompts/wording.json"
Key = tuple[str, str]  # group, words
Table = TypeVar("Table")


@dataclass(frozen=True)
class PromptAdherence:
    """How much of a sentence one model shows on walks (0 to 1), for whole sentences and for single clauses."""

    sentences: Mapping[Key, float] = field(default_factory=dict)
    clauses: Mapping[Key, float] = field(default_factory=dict)

    def of(self, sentence: str, part: str) -> float | None:
        """Return fraction of what `sentence` says of `part` that a walk shows; None where it was not measured.

        A sentence that is not in the table has the mean of its clauses, if any is.
        """
        group, words = as_left_limb(sentence, part)
        whole = self.sentences.get((part, words), self.sentences.get((group, words)))
        if whole is not None:
            return whole
        clauses = [clause.strip() for clause in words.split(",")]
        found = [self.clauses.get((part, clause), self.clauses.get((group, clause))) for clause in clauses]
        known = [fraction for fraction in found if fraction is not None]
        return sum(known) / len(known) if known else None

    def weakly_shown(self, descriptions: PartDescriptions) -> dict[str, float]:
        """Return parts whose sentences are shown by less than `HARDLY_SHOWN_FRACTION`, with their fractions."""
        found = {part: self.of(text, part) for part, text in descriptions.to_mapping().items()}
        return {
            part: value
            for part, value in found.items()
            if value is not None and value < HARDLY_SHOWN_FRACTION
        }

    def note(
        self, descriptions: PartDescriptions, read: PartDescriptions, edited: frozenset[str] = frozenset()
    ) -> str:
        """Return a sentence for the user about what is hardly shown of `descriptions`, or "".

        `read` is what the model reads in their place; parts that are `edited` show what they say.
        """
        weak = [
            f"{part.replace('_', ' ')} “{getattr(descriptions, part)}” ({value:.0%})"
            for part, value in self.weakly_shown(read).items()
            if part not in edited
        ]
        return f"Hardly shown by this model: {'; '.join(weak)}." if weak else ""


@dataclass(frozen=True)
class ModelPhrasing:
    """Sentences that one model hardly shows, and those of the same meaning in their place."""

    table: Mapping[Key, str] = field(default_factory=dict)

    def of(self, sentence: str, part: str) -> str:
        """Return the sentence that the model reads for `part`."""
        group, words = as_left_limb(sentence, part)
        other = self.table.get((part, words), self.table.get((group, words)))
        if other is None:
            return sentence
        return mirror_text(other) if part.startswith("right") else other

    def followed(self, descriptions: PartDescriptions) -> PartDescriptions:
        """Return the six sentences that the model reads."""
        return PartDescriptions(
            **{part: self.of(text, part) for part, text in descriptions.to_mapping().items()}
        )


def as_left_limb(sentence: str, part: str) -> Key:
    """Return the group of a part, and its sentence as it describes the left limb; ValueError for an unknown part."""
    if part not in PART_NAMES:
        raise ValueError(f"unknown body part {part!r}")
    side, _, limb = part.partition("_")
    text = " ".join(sentence.lower().split())
    return (limb or side), (mirror_text(text) if side == "right" else text)


@lru_cache(maxsize=8)
def adherence_of(model: str = DEFAULT_MODEL) -> PromptAdherence:
    """Return the shipped table of a model by its name; empty where it has none. FileError when the file is malformed."""
    return load_adherence(asset_path(ADHERENCE)).get(model, PromptAdherence())


@lru_cache(maxsize=8)
def phrasing_of(model: str) -> ModelPhrasing:
    """Return the shipped table of a model by its name; empty where it has none. FileError when the file is malformed."""
    return load_phrasings(asset_path(PHRASINGS)).get(model, ModelPhrasing())


def load_adherence(path: Path) -> dict[str, PromptAdherence]:
    """Return tables by model; none where there is no file. FileError when it is malformed."""
    return _load(path, lambda of: PromptAdherence(_fractions(of["sentences"]), _fractions(of["clauses"])))


def load_phrasings(path: Path) -> dict[str, ModelPhrasing]:
    """Return tables by model; none where there is no file. FileError when it is malformed."""
    return _load(
        path, lambda groups: ModelPhrasing(_rows(groups, lambda text: isinstance(text, str) and text))
    )


def _fractions(groups: Any) -> dict[Key, float]:
    return _rows(groups, lambda value: 0.0 <= value <= 1.0)


def _rows(groups: Any, usable: Callable[[Any], object]) -> dict[Key, Any]:
    rows = {(group, words): row for group, own in groups.items() for words, row in own.items()}
    wrong = [key for key, row in rows.items() if not usable(row)]
    if wrong:
        raise ValueError(f"{wrong[0]} is out of range")
    return rows


def _load(path: Path, read: Callable[[Any], Table]) -> dict[str, Table]:
    if not path.is_file():
        return {}
    try:
        return {model: read(value) for model, value in json.loads(path.read_text("utf-8")).items()}
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise FileError(f"{path}: not a table by model ({error!r}).", "Restore the file.") from error
