"""Longer sentences with phrases of edits, as users and the prompt library write them.

The catalogue says "left hand on the hip", a prompt "left hand on the hip, held still". A clause without influence on
the pose should not change the meaning of the phrase, and of two clauses about head or torso both should have effect.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product

from runtime.measures.table import kind_of
from training.augmentation.catalogue import PartEdit, catalogue


@dataclass(frozen=True)
class LongerSentence:
    """A sentence of `part` that means the phrases `of` combined, or, if `alike`, the same as each of them."""

    part: str
    text: str
    of: tuple[str, ...]
    alike: bool = False


def longer_sentences() -> list[LongerSentence]:
    """Return every trained phrase with each fitting clause, and pairs of phrases, in either order."""
    return [
        *_with_clauses(),
        *_two_postures("torso"),
        *_two_postures("head"),
        *_posture_and_rhythm("left_leg"),
        *_posture_and_rhythm("right_leg"),
        *_posture_and_rhythm("torso"),
    ]


def other_sentences() -> list[LongerSentence]:
    """Return synonyms of the phrases of edits."""
    edits = catalogue().edits
    return [
        LongerSentence(part, text, edits[name].phrases[part], alike=True)
        for (name, part), texts in catalogue().other_words.items()
        for text in texts
    ]


def _with_clauses() -> Iterator[LongerSentence]:
    for edit in catalogue().trained:
        for part, phrases in edit.phrases.items():
            for phrase, clause in product(phrases, _clauses(edit, part)):
                yield LongerSentence(part, f"{phrase}, {clause}", (phrase,))


def _two_postures(slot: str) -> Iterator[LongerSentence]:
    """Yield pairs of a posture forwards or backwards and one to a side."""
    upright: list[str] = []
    sideways: list[str] = []
    for edit in catalogue().trained:
        if edit.slot == slot and not edit.shown_by.moves and not edit.does.of_steps:
            (sideways if edit.shown_by.sided else upright).extend(edit.phrases[slot])
    return _either_order(slot, upright, sideways)


def _posture_and_rhythm(part: str) -> Iterator[LongerSentence]:
    """Yield pairs of a posture and a rhythm, with the first phrase of each."""
    own = [e for e in catalogue().trained if part in e.phrases]
    postures = [e.phrases[part][0] for e in own if not e.does.of_steps]
    rhythm = [e.phrases[part][0] for e in own if e.does.of_steps]
    return _either_order(part, postures, rhythm)


def _either_order(part: str, ones: list[str], others: list[str]) -> Iterator[LongerSentence]:
    subject = part.replace("_", " ") + " "
    for one, other in product(ones, others):
        for first, second in ((one, other), (other, one)):
            yield LongerSentence(part, f"{first}, {second.removeprefix(subject)}", (one, other))


def _clauses(edit: PartEdit, part: str) -> tuple[str, ...]:
    clauses, kind, shown = catalogue().clauses, kind_of(part), edit.shown_by
    if edit.does.of_steps:
        return clauses["in_rhythm"][kind]
    if shown.moves:
        return clauses["moving"][kind]
    return clauses["still"][kind] + (clauses["bent_arm"][kind] if shown.name == "elbow_bend" else ())
