"""Entries of the library on one side of the body: "sword in the left hand" is "sword in the right hand" mirrored."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace

from runtime.prompts.english.library_data import LibraryEntry
from runtime.prompts.english.sides import OPPOSITE
from runtime.prompts.english.words import PART_WORDS, Word, word_set
from runtime.prompts.parts import PartDescriptions
from runtime.skeleton import PART_NAMES

_SIDED_NOUNS = word_set(
    "arm hand elbow shoulder wrist leg foot feet knee hip ankle side thigh heel toe collarbone"
)
_IDLE_ARM = re.compile(
    r"\bbehind the back\b|\bhanging\b(?!.*\bpulled\b)|\bswinging (?:naturally|gently|little|lightly|evenly)"
)
_BUSY_LEG = re.compile(
    r"limping|dragging|trailing|hopping|springing off|off the ground|stiff and straight|low kick|hanging"
)


def named_side(words: Sequence[Word]) -> str:
    """The one side of a body that a prompt names, "" for none and for both.

    It is named with a limb ("the left foot", "foot left") or as "on the left", "left side"; a direction is none.
    """
    named: set[str] = set()
    for i, word in enumerate(words):
        if word.text not in OPPOSITE:
            continue
        after = words[i + 1].stem if i + 1 < len(words) else ""
        before = words[i - 1] if i else None
        of_limb = after in _SIDED_NOUNS or (
            before is not None and before.stem in _SIDED_NOUNS | {"on"} and after not in PART_WORDS
        )
        # "a wooden left leg", "the paralysed left": between them an adjective at most
        if of_limb or (i + 2 < len(words) and words[i + 2].stem in _SIDED_NOUNS):
            named.add(word.text)
    return named.pop() if len(named) == 1 else ""


def entry_side(entry: LibraryEntry) -> str:
    """The side on which an entry does what makes it so, "" where both sides do the like.

    Its name says it ("limping on the left leg"), else the one leg that it defines, else the limb that is not idle.
    """
    spoken = {side for side in OPPOSITE if re.search(rf"\b{side}\b", entry.prompt)}
    if not spoken and not {"left_leg", "right_leg"} <= set(entry.defines):
        spoken = {side for side in OPPOSITE if f"{side}_leg" in entry.defines}
    if spoken:
        return spoken.pop() if len(spoken) == 1 else ""
    said = entry.descriptions.to_mapping()
    arms = [side for side in OPPOSITE if not _IDLE_ARM.search(said[f"{side}_arm"])]
    return lame_leg(said) or (arms[0] if len(arms) == 1 else "")


def lame_leg(said: Mapping[str, str]) -> str:
    """The side of the one leg that limps, drags, hops or is stiff by the descriptions of some parts, "" for none and for both."""
    lame = [side for side in OPPOSITE if _BUSY_LEG.search(said.get(f"{side}_leg", ""))]
    return lame[0] if len(lame) == 1 else ""


def lame_on(entry: LibraryEntry, side: str) -> LibraryEntry:
    """The entry, mirrored if it is lame on the other side: a pirate who drags the left leg has no wooden right one."""
    return on_side(entry, side) if lame_leg(entry.descriptions.to_mapping()) else entry


def on_side(entry: LibraryEntry, side: str) -> LibraryEntry:
    """The entry with its descriptions mirrored if it is one of the other side."""
    own = entry_side(entry)
    if not side or not own or own == side:
        return entry
    mirrored = {
        part: text.replace("left angle", "right angle")
        for part, text in entry.descriptions.mirrored().to_mapping().items()
    }
    return replace(entry, descriptions=PartDescriptions(**mirrored), defines=_mirrored(entry.defines))


def _mirrored(parts: tuple[str, ...]) -> tuple[str, ...]:
    swapped = {f"{OPPOSITE[p.split('_')[0]]}_{p.split('_')[1]}" if "_" in p else p for p in parts}
    return tuple(part for part in PART_NAMES if part in swapped)
