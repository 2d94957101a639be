"""Phrase measurements from captured clips whose captions use the phrase: `assets/prompts/phrase_measures.json`.

The file, written by `python -m training.text.phrase_measures`, has the range of each target (`runtime.edits.request`) for
every captured style and gait, for every caption phrase the range over the styles that use it, and the usual
ranges of a gait. Captions are the descriptions of styles.json.
"""

import json
from collections.abc import Container, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cache
from typing import Any

from runtime.assets import asset_path
from runtime.edits.request import GAITS, PARTS
from runtime.errors import FileError
from runtime.prompts.library_data import LibraryStyle, load_styles
from runtime.prompts.parts import PartDescriptions

PHRASE_MEASURES = "prompts/phrase_measures.json"
# what a caption requests in gaits other than walk: what the network adds when it jogs a style's walk
OF_CAPTIONS = ("lean", "bounce", "elbow", "elbow_out")
OWN_CLAUSE_WORDS = 4  # shorter clauses are common to many styles
MOVING_HAND_M = 0.12  # peak to peak: a captured hand that moves farther has no fixed place
Range = tuple[float, float]
Ranges = tuple[Range | None, ...]  # by `GAITS`; None where nothing was captured
Measured = Mapping[str, Range]  # by target
Clause = tuple[str, str]  # a part, and a caption or one of its clauses


@dataclass(frozen=True)
class CapturedPhrases:
    """Measures of captured styles and phrases, with the captions they belong to."""

    # style, gait, part
    styles: Mapping[str, Mapping[str, Mapping[str, Measured]]] = field(default_factory=dict)
    # kind, target, phrase
    phrases: Mapping[str, Mapping[str, Mapping[str, Ranges]]] = field(default_factory=dict)
    usual_of: Mapping[str, Measured] = field(default_factory=dict)  # of trunks, by gait
    captions: Mapping[Clause, frozenset[str]] = field(default_factory=dict)  # styles by whole caption
    clauses: Mapping[Clause, frozenset[str]] = field(default_factory=dict)  # and by clause

    def is_caption(self, part: str, sentence: str) -> bool:
        """Return whether a description is the caption of a captured style."""
        return _words(part, sentence) in self.captions

    def styles_of(self, descriptions: PartDescriptions) -> frozenset[str]:
        """Return the captured styles with captions equal to the descriptions of all parts."""
        none: frozenset[str] = frozenset()
        return frozenset.intersection(
            *(self.captions.get(_words(part, getattr(descriptions, part)), none) for part in PARTS)
        )

    def caption(self, part: str, sentence: str, among: frozenset[str] = frozenset()) -> dict[str, Ranges]:
        """Return, by target, the ranges captured in the styles with this description as caption, preferably those `among`."""
        styles = self.captions.get(_words(part, sentence), frozenset())
        styles = styles & among or styles
        return {name: self._over(styles, part, name) for name in self._names(styles, part)}

    def clause(self, part: str, clause: str, target: str) -> Ranges | None:
        """Return the range of the only style whose captions contain a clause; None if several do."""
        styles = self.clauses.get((part, clause), frozenset())
        own = len(styles) == 1 and len(clause.split()) >= OWN_CLAUSE_WORDS
        found = self._over(styles, part, target) if own else ()
        return found if any(found) else None

    def phrase(self, kind: str, phrase: str, target: str) -> Ranges | None:
        """Return the range of a phrase used in captions, or None."""
        return self.phrases.get(kind, {}).get(target, {}).get(phrase)

    def moves(self, part: str, clause: str) -> bool:
        """Return whether the hand moves too far for a fixed place in every style whose captions contain the clause."""
        styles = self.clauses.get((part, clause), frozenset())
        hands = [self.styles[style]["walk"].get(part, {}).get("hand_range", (0.0, 0.0)) for style in styles]
        return bool(hands) and min(low for low, _ in hands) > MOVING_HAND_M

    def usual(self, gait: str) -> Measured:
        """Return the usual trunk measures in the captured clips of a gait."""
        return self.usual_of.get(gait, {})

    def _names(self, styles: frozenset[str], part: str) -> list[str]:
        rows = [row.get(part, {}) for style in styles for row in self.styles.get(style, {}).values()]
        return [name for name in OF_CAPTIONS if any(name in row for row in rows)]

    def _over(self, styles: frozenset[str], part: str, target: str) -> Ranges:
        """Return, by gait, the union of several styles' ranges."""
        found = []
        for gait in GAITS:
            rows = [self.styles.get(style, {}).get(gait, {}).get(part, {}).get(target) for style in styles]
            ends = [row for row in rows if row is not None]
            found.append((min(e[0] for e in ends), max(e[1] for e in ends)) if ends else None)
        return tuple(found)


def _words(part: str, sentence: str) -> Clause:
    return part, " ".join(sentence.lower().split())


@cache
def captured() -> CapturedPhrases:
    """Return the phrases of the shipped file; FileError if it is malformed."""
    path = asset_path(PHRASE_MEASURES)
    styles = load_styles(asset_path("prompts/styles.json"))
    try:
        tree = json.loads(path.read_text("utf-8"))
        measured = {s: _by_part(gaits) for s, gaits in tree["styles"].items() if "walk" in gaits}
        captions, clauses = _styles_by_words(styles, measured)
        return CapturedPhrases(
            measured,
            {k: {t: _by_phrase(of) for t, of in targets.items()} for k, targets in tree["phrases"].items()},
            {gait: _ranges(measures) for gait, measures in tree["usual"].items()},
            captions,
            clauses,
        )
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise FileError(f"{path}: not readable as measures ({error!r}).", "Restore the file.") from error


def _styles_by_words(
    styles: Mapping[str, LibraryStyle], walked: Container[str]
) -> tuple[dict[Clause, frozenset[str]], ...]:
    """Return the styles that have each caption, and each clause; a style captured standing is no evidence for walks."""
    captions: dict[Clause, set[str]] = {}
    clauses: dict[Clause, set[str]] = {}
    for name, part, sentence in captions_by_style(styles):
        if name in walked:
            captions.setdefault((part, sentence), set()).add(name)
            for clause in sentence.split(", "):
                clauses.setdefault((part, clause), set()).add(name)
    return tuple({key: frozenset(names) for key, names in of.items()} for of in (captions, clauses))


def captions_by_style(styles: Mapping[str, LibraryStyle]) -> Iterator[tuple[str, str, str]]:
    """Yield (style, part, lower-case description) of every caption, and of its mirror image for symmetric styles."""
    for name, style in styles.items():
        sided = any(side in name for side in ("left", "right"))
        for descriptions in style.descriptions:
            for words in (descriptions,) if sided else (descriptions, descriptions.mirrored()):
                for part in PARTS:
                    yield name, part, getattr(words, part).lower()


def _ranges(measures: Mapping[str, Any]) -> dict[str, Range]:
    return {name: _range(value) for name, value in measures.items()}


def _by_part(gaits: Mapping[str, Any]) -> dict[str, dict[str, Measured]]:
    return {gait: {part: _ranges(own) for part, own in parts.items()} for gait, parts in gaits.items()}


def _by_phrase(phrases: Mapping[str, Any]) -> dict[str, Ranges]:
    return {
        phrase: tuple(_range(of[gait]) if gait in of else None for gait in GAITS)
        for phrase, of in phrases.items()
    }


def _range(value: Any) -> Range:
    low, high = map(float, value)
    if not low <= high:
        raise ValueError(f"range of {value}")
    return low, high
