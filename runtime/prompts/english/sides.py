"""Left and right of an entry: "a heavy bag on the left shoulder" mirrors one that was written for the right."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace

from runtime.prompts.english.library_data import LibraryEntry
from runtime.prompts.english.words import PART_WORDS, Word, word_set
from runtime.skeleton import PART_NAMES

_LIMBS = word_set("arm hand elbow shoulder wrist leg foot feet knee hip ankle side thigh heel toe")
_OTHER = {"left": "right", "right": "left"}
_IDLE_ARM = re.compile(r"\bhanging\b|\bswinging (?:naturally|gently|little|lightly|evenly)")
_BUSY_LEG = re.compile(
    r"limping|dragging|trailing|hopping|springing off|off the ground|stiff and straight|low kick|hanging"
)


def side_asked(words: Sequence[Word]) -> str:
    """The one side of a body that a prompt names, "" for none and for both.

    It is named with a limb ("the left foot", "foot left") or as "on the left", "left side"; a direction is none.
    """
    named: set[str] = set()
    for i, word in enumerate(words):
        if word.text not in _OTHER:
            continue
        after = words[i + 1].stem if i + 1 < len(words) else ""
        before = words[i - 1] if i else None
        of_limb = after in _LIMBS or (
            before is not None and before.stem in _LIMBS | {"on"} and after not in PART_WORDS
        )
        # "a wooden left leg", "the paralysed left": between them an adjective at most
        if of_limb or (i + 2 < len(words) and words[i + 2].stem in _LIMBS):
            named.add(word.text)
    return named.pop() if len(named) == 1 else ""


def entry_side(entry: LibraryEntry) -> str:
    """The side on which an entry does what makes it so, "" where both sides do the like.

    Its name says it ("limping on the left leg"), else the limb that is not idle.
    """
    spoken = {side for side in _OTHER if re.search(rf"\b{side}\b", entry.prompt)}
    if spoken:
        return spoken.pop() if len(spoken) == 1 else ""
    said = entry.descriptions
    legs = [side for side in _OTHER if _BUSY_LEG.search(getattr(said, f"{side}_leg"))]
    arms = [side for side in _OTHER if not _IDLE_ARM.search(getattr(said, f"{side}_arm"))]
    for sides in (legs, arms):
        if len(sides) == 1:
            return sides[0]
    return ""


def on_side(entry: LibraryEntry, side: str) -> LibraryEntry:
    """The entry with its descriptions mirrored if it is one of the other side."""
    own = entry_side(entry)
    if not side or not own or own == side:
        return entry
    return replace(entry, descriptions=entry.descriptions.mirrored(), defines=_mirrored(entry.defines))


def _mirrored(parts: tuple[str, ...]) -> tuple[str, ...]:
    swapped = {f"{_OTHER[p.split('_')[0]]}_{p.split('_')[1]}" if "_" in p else p for p in parts}
    return tuple(part for part in PART_NAMES if part in swapped)
