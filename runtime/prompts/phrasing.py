"""Measured adherence of a model to sentences, and better phrasings for those it shows badly.

Tables are JSON files keyed by model, then by group of body part: torso, head, arm and leg, with limbs described as left
ones. Where the two sides of a limb differ, they have groups of their own such as `left_arm`.
`python -m training.export.words` writes `shares.json` and `wording.json` of `assets/prompts`.
"""

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

HARDLY_SHOWN_FRACTION = 0.3  # under which a sentence counts as hardly shown
ADHERENCE, PHRASINGS = "prompts/shares.json", "prompts/wording.json"
Key = tuple[str, str]  # group, words
Table = TypeVar("Table")


@dataclass(frozen=True)
class PromptAdherence:
    """How well (0 to 1) a model shows a sentence in walks, for whole sentences and for single clauses."""

    sentences: Mapping[Key, float] = field(default_factory=dict)
    clauses: Mapping[Key, float] = field(default_factory=dict)

    def of(self, sentence: str, part: str) -> float | None:
        """Return the fraction of `sentence` that a walk shows for `part`; None if unknown.

        A sentence that is not in the table gets the mean of its measured clauses.
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
        """Return the parts whose sentences are shown by less than `HARDLY_SHOWN_FRACTION`, with their fractions."""
        found = {part: self.of(text, part) for part, text in descriptions.to_mapping().items()}
        return {
            part: value
            for part, value in found.items()
            if value is not None and value < HARDLY_SHOWN_FRACTION
        }

    def note(
        self, descriptions: PartDescriptions, read: PartDescriptions, edited: frozenset[str] = frozenset()
    ) -> str:
        """Return a sentence for the user about descriptions that are hardly shown, or "".

        `read` are the sentences that the model reads instead; parts in `edited` are shown by body edits.
        """
        weak = [
            f"{part.replace('_', ' ')} “{getattr(descriptions, part)}” ({value:.0%})"
            for part, value in self.weakly_shown(read).items()
            if part not in edited
        ]
        return f"Hardly shown by this model: {'; '.join(weak)}." if weak else ""


@dataclass(frozen=True)
class ModelPhrasing:
    """Sentences that a model shows badly, each with a better phrasing."""

    table: Mapping[Key, str] = field(default_factory=dict)

    def of(self, sentence: str, part: str) -> str:
        """Return the sentence to give the model for `part` instead of this one."""
        group, words = as_left_limb(sentence, part)
        other = self.table.get((part, words), self.table.get((group, words)))
        if other is None:
            return sentence
        return mirror_text(other) if part.startswith("right") else other

    def followed(self, descriptions: PartDescriptions) -> PartDescriptions:
        """Return the six sentences to give the model."""
        return PartDescriptions(
            **{part: self.of(text, part) for part, text in descriptions.to_mapping().items()}
        )


def as_left_limb(sentence: str, part: str) -> Key:
    """Return the part's group and its sentence phrased for the left limb; ValueError for an unknown part."""
    if part not in PART_NAMES:
        raise ValueError(f"unknown body part {part!r}")
    side, _, limb = part.partition("_")
    text = " ".join(sentence.lower().split())
    return (limb or side), (mirror_text(text) if side == "right" else text)


@lru_cache(maxsize=8)
def adherence_of(model: str = DEFAULT_MODEL) -> PromptAdherence:
    """Return the shipped adherence table of a model; empty if there is none. FileError if the file is malformed."""
    return load_adherence(asset_path(ADHERENCE)).get(model, PromptAdherence())


@lru_cache(maxsize=8)
def phrasing_of(model: str) -> ModelPhrasing:
    """Return the shipped phrasing table of a model; empty if there is none. FileError if the file is malformed."""
    return load_phrasings(asset_path(PHRASINGS)).get(model, ModelPhrasing())


def load_adherence(path: Path) -> dict[str, PromptAdherence]:
    """Read adherence tables by model; empty if the file is missing. FileError if it is malformed."""
    return _load(path, lambda of: PromptAdherence(_fractions(of["sentences"]), _fractions(of["clauses"])))


def load_phrasings(path: Path) -> dict[str, ModelPhrasing]:
    """Read phrasing tables by model; empty if the file is missing. FileError if it is malformed."""
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
