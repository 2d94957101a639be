"""Phrases of the edits in longer sentences, as people and the prompt library write them.

The catalogue says "left hand on the hip"; a prompt says "left hand on the hip, held still". A clause that adds nothing
to the pose should not change what the phrase means, and two clauses of the head or the torso should both count.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

from training.layering.catalog import PartEdit
from training.layering.more_words import more_words
from training.layering.recipes import trained_edits

# What can be added to a posture, and to a movement, without another pose.
_STILL: dict[str, tuple[str, ...]] = {
    "arm": (
        "held still",
        "still",
        "not swinging",
        "hardly swinging",
        "held tightly",
        "arm still",
        "arm tense",
        "moving little",
        "elbow slightly bent",
        "fist closed",
        "hand relaxed",
        "palm open",
        "trembling",
    ),
    "leg": (
        "steps of normal length",
        "stepping evenly",
        "foot landing flat",
        "walking on",
    ),
    "torso": (
        "held still",
        "nearly still",
        "tense",
        "stiff",
        "hardly turning",
        "relaxed",
    ),
    "head": (
        "held still",
        "held steady",
        "steady",
        "stiff",
        "neck long",
        "swaying slightly",
        "moving little",
    ),
}
_BENT = ("elbow bent", "elbow bent sharply", "elbow out to the side")  # where the hand is near the body
_MOVING: dict[str, tuple[str, ...]] = {
    "arm": ("with every step", "elbow slightly bent", "arm loose", "again and again"),
    "leg": (
        "with every step",
        "steps of normal length",
        "stepping evenly",
    ),
    "torso": ("with every step", "loosely", "again and again"),
    "head": ("with every step", "again and again"),
}
# The same to rhythm, which says itself how long and quick the steps are.
_IN_RHYTHM: dict[str, tuple[str, ...]] = {
    "leg": ("walking on", "again and again", "foot rolling from heel to toe"),
    "torso": ("upright", "relaxed", "back straight"),
}
_MOVEMENTS = (
    "swing",
    "side_swing",
    "hand_level_range",
    "foot_lift",
    "roll_range",
    "turn_range",
    "pitch_range",
    "twist_range",
    "bounce",
)
_SLOTS = {"left_leg": "leg", "right_leg": "leg", "legs": "leg", "left_arm": "arm", "right_arm": "arm"}
_DOUBLE = ("torso", "head")
_ACROSS = ("turn", "roll")  # measures of what goes to one side; the others are of forward and back


@dataclass(frozen=True)
class LongerSentence:
    """A sentence of `part` that means what the phrases `of` mean together, or what each of these `alike` means."""

    part: str
    text: str
    of: tuple[str, ...]
    alike: bool = False


def longer_sentences() -> list[LongerSentence]:
    """Every trained phrase with each clause that fits it, and two clauses of head and torso in either order."""
    found = []
    for edit in trained_edits():
        for part, phrases in edit.phrases.items():
            for phrase, clause in product(phrases, _clauses(edit, part)):
                found.append(LongerSentence(part, f"{phrase}, {clause}", (phrase,)))
    for slot in _DOUBLE:
        upright = _postures(slot, across=False)
        sideways = _postures(slot, across=True)
        for one, other in product(upright, sideways):
            for first, second in ((one, other), (other, one)):
                text = f"{first}, {second.removeprefix(slot + ' ')}"
                found.append(LongerSentence(slot, text, (one, other)))
    return found + _with_rhythm()


def other_sentences() -> list[LongerSentence]:
    """Other words for what the phrases of an edit say."""
    edits = {e.name: e for e in trained_edits()}
    return [
        LongerSentence(part, text, edits[name].phrases[part], alike=True)
        for (name, part), texts in more_words().items()
        for text in texts
    ]


def _with_rhythm() -> list[LongerSentence]:
    """A posture of legs or torso and what its steps are like, in either order; the first phrase of each."""
    found = []
    for part in ("left_leg", "right_leg", "torso"):
        subject = part.replace("_", " ")
        own = [e for e in trained_edits() if part in e.phrases]
        postures = [e.phrases[part][0] for e in own if not e.of_steps]
        rhythm = [e.phrases[part][0] for e in own if e.of_steps]
        for one, other in product(postures, rhythm):
            for first, second in ((one, other), (other, one)):
                text = f"{first}, {second.removeprefix(subject + ' ')}"
                found.append(LongerSentence(part, text, (one, other)))
    return found


def _clauses(edit: PartEdit, part: str) -> tuple[str, ...]:
    slot = _SLOTS.get(edit.slot, edit.slot)
    if edit.of_steps:
        return _IN_RHYTHM[_SLOTS.get(part, part)]
    if edit.measure[1] in _MOVEMENTS:
        return _MOVING[slot]
    return _STILL[slot] + (_BENT if edit.measure[1] == "elbow_bend" else ())


def _postures(slot: str, across: bool) -> list[str]:
    edits = [
        e for e in trained_edits() if e.slot == slot and e.measure[1] not in _MOVEMENTS and not e.of_steps
    ]
    return [p for e in edits if (e.measure[1] in _ACROSS) == across for p in e.phrases[slot]]
