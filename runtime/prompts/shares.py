"""How much of what a sentence says a model shows: measured once on walks, shipped as `shares.json`.

The file has, for every model by name and for arm, leg, torso and head, shares (0 to 1) of whole sentences and of single
clauses; limbs are described as the left ones. Where a limb shows less or more than that of the other side, `left_arm` and
the like have its own. `python -m training.evaluation.text.prompt_adherence` writes it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any

from runtime.assets import DEFAULT_MODEL, asset_path
from runtime.prompts.parts import PartDescriptions
from runtime.prompts.sentence_tables import as_left_limb, load_tables, rows_of
from runtime.skeleton import PART_NAMES

HARDLY = 0.3  # share under which a sentence is said to be hardly shown
FILE = "prompts/shares.json"


@dataclass(frozen=True)
class PhraseShares:
    """Shares of one model: `sentences` and `clauses` map (group, words) to 0 to 1; group is arm, leg, torso or head, or a
    limb by its name.
    """

    sentences: Mapping[tuple[str, str], float] = field(default_factory=dict)
    clauses: Mapping[tuple[str, str], float] = field(default_factory=dict)

    def of(self, sentence: str, part: str) -> float | None:
        """Share of what `sentence` says of `part` that a walk shows; None where it was not measured.

        A sentence that is not in the table has the mean of its clauses, if any is.
        """
        group, words = as_left_limb(sentence, part)
        whole = _share_in(self.sentences, part, group, words)
        if whole is not None:
            return whole
        shares = (_share_in(self.clauses, part, group, clause.strip()) for clause in words.split(","))
        known = [share for share in shares if share is not None]
        return sum(known) / len(known) if known else None

    def weakly_shown(self, descriptions: PartDescriptions) -> dict[str, float]:
        """Parts whose sentences are shown by less than `HARDLY`, with their shares."""
        found = {part: self.of(getattr(descriptions, part), part) for part in PART_NAMES}
        return {part: share for part, share in found.items() if share is not None and share < HARDLY}

    def note(self, descriptions: PartDescriptions) -> str:
        """A sentence for the user about what is hardly shown, or ""."""
        weak = self.weakly_shown(descriptions)
        if not weak:
            return ""
        listed = (
            f"{part.replace('_', ' ')} “{getattr(descriptions, part)}” ({weak[part]:.0%})" for part in weak
        )
        return f"Hardly shown by this model: {'; '.join(listed)}."


def _share_in(table: Mapping[tuple[str, str], float], part: str, group: str, words: str) -> float | None:
    """That of the part itself, else that of both sides."""
    return table.get((part, words), table.get((group, words)))


def phrase_share(sentence: str, part: str, model: str = DEFAULT_MODEL) -> float | None:
    """Share (0 to 1) of what `sentence` says of `part` that `model` shows on a walk; None where it was not measured."""
    return shares_of(model).of(sentence, part)


def shares_of(model: str = DEFAULT_MODEL) -> PhraseShares:
    """The shipped table of a model by its name; empty where it has none. FileError when the file is malformed."""
    return _load(asset_path(FILE)).get(model, PhraseShares())


def load_shares(path: Path) -> dict[str, PhraseShares]:
    """Tables by model; none where there is no file. FileError when it is malformed."""
    return load_tables(path, _read, "shares")


def _read(tables: Any) -> PhraseShares:
    return PhraseShares(_shares(tables["sentences"]), _shares(tables["clauses"]))


def _shares(groups: Mapping[str, Mapping[str, Any]]) -> dict[tuple[str, str], float]:
    found = {row: float(share) for row, share in rows_of(groups).items()}
    if not all(0.0 <= share <= 1.0 for share in found.values()):
        raise ValueError("a share is not between 0 and 1")
    return found


@lru_cache(maxsize=2)
def _load(path: Path) -> dict[str, PhraseShares]:
    return load_shares(path)
