"""Which of the library's phrases a prompt contains, word for word: the part of understanding that needs no embedding."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass, replace

from runtime.prompts.english.library_data import NEUTRAL_STYLE, LibraryEntry, PromptLibrary
from runtime.prompts.english.words import (
    ABSENCES,
    DEGREES,
    LINKS,
    NEGATIONS,
    PART_WORDS,
    PERSONS,
    PREPOSITIONS,
    SLIGHT,
    STRONG,
    Word,
    distinct_words,
    finite_forms,
    key,
    stem,
    without_somebody,
    word_set,
    words_of,
)

_SIMILE = re.compile(r"\b(?:as )?(?P<adjective>\w+) as (?:an? |the )?(?P<thing>\w+)\b(?! (?:if|though))")
LONGEST = 9  # words of a phrase
FIGURES = ("characters", "animals", "occupations")  # categories of somebody
_QUALITIES = ("ages", "bodies", "emotions", "minds")  # categories of what somebody is like
SLIGHTLY, STRONGLY = 0.6, 1.2  # strength of "slightly drunk" and "very drunk" against "drunk"
_OBJECT_STARTS = word_set(
    "from by against toward towards of for after past to at with beside behind near before over on"
)
_OF_STYLE = word_set("style manner way walk gait fashion kind sort steps moves")
_AGAIN = word_set("like as imitating impersonating mimicking being playing half part acting")
# -ing forms that have no object: what follows "pretending to be" is the one who walks
_INTRANSITIVE = word_set(
    "acting playing imitating impersonating mimicking pretending feeling looking moving walking dancing turning "
    "becoming being running going standing something nothing everything"
)


@dataclass(frozen=True)
class Element:
    """An entry that a stretch of the prompt names: words `start` to `end`, cosine similarity, and strength by degree.

    `after_like` says that it is a comparison ("like a penguin"), `joined` that it stands next to another figure; `only`
    are the parts that it is named for ("arms like a robot"), () for what the entry defines.
    """

    entry: int
    start: int
    end: int
    similarity: float = 1.0
    degree: float = 1.0
    after_like: bool = False
    joined: bool = False
    only: tuple[str, ...] = ()


class PhraseIndex:
    """The library's prompts by their words."""

    def __init__(self, library: PromptLibrary) -> None:
        self.entries = library.entries
        self._alone = library.alone
        self._whole: dict[str, int] = {}
        self._phrases: dict[tuple[str, ...], int] = {}
        prompts: list[str] = []
        for number, entry in enumerate(library.entries):
            plain_walk = entry.style.startswith(NEUTRAL_STYLE)
            for text in (entry.prompt, *entry.also):
                prompts.append(text)
                words = words_of(text)
                self._whole.setdefault(key(words), number)
                says = any(word.says for word in words) or (len(words) > 1 and not plain_walk)
                if says and len(words) <= LONGEST:
                    self._phrases.setdefault(tuple(word.stem for word in words), number)
        for number, entry in enumerate(library.entries):  # what is named in so many words comes first
            self._whole.setdefault(key(without_somebody(words_of(entry.prompt))), number)
        described = [text for entry in library.entries for text in entry.descriptions.as_tuple()]
        # English words for sure
        self.known = distinct_words([*prompts, *described, *library.nothing]) | finite_forms().keys()

    def only_alone(self, words: list[Word]) -> bool:
        """Whether the words are one that names an entry only as a whole prompt."""
        saying = [word for word in words if word.says]
        return len(saying) == 1 and saying[0].stem in self._alone

    def whole(self, text: str) -> int | None:
        """The entry that a whole prompt names in so many words, or None."""
        words = words_of(text)
        entry = self._whole.get(key(words)) if words else None
        return entry if entry is not None or not words else self._whole.get(key(without_somebody(words)))

    def plainly(self, text: str) -> str:
        """A lower-case prompt without comparisons that only say how much: "light" for "light as a feather"."""

        def adjective(match: re.Match[str]) -> str:
            entry = self._phrases.get((stem(match["adjective"]),))
            said = entry is not None and self.entries[entry].category in (
                *_QUALITIES,
                "walks",
                "posture",
                "steps",
            )
            own = self.whole(match.group(0)) is not None or match["thing"] in (*NEGATIONS, "possible")
            return match["adjective"] if said and not own else match.group(0)

        return _SIMILE.sub(adjective, text)

    def find(self, words: list[Word]) -> list[Element]:
        """The entries named, without overlaps: as many saying words as possible, in as few phrases as possible."""
        gain = [0.0] * (len(words) + 1)
        chosen: list[Element | None] = [None] * (len(words) + 1)
        alone = sum(word.says for word in words) <= 1
        for start in range(len(words) - 1, -1, -1):
            gain[start] = gain[start + 1]
            for end in range(start + 1, min(start + LONGEST, len(words)) + 1):
                entry = self._entry_of(words[start:end], alone)
                if entry is None:
                    continue
                found = max(sum(word.says for word in words[start:end]), 0.5) - 0.1 + gain[end]
                if found > gain[start]:
                    gain[start], chosen[start] = found, Element(entry, start, end)
        elements, at = [], 0
        while at < len(words):
            element = chosen[at]
            if element is not None:
                elements.append(element)
            at = element.end if element is not None else at + 1
        return [
            replace(e, degree=_degree(words, e.start), only=_named_parts(words, e.start, e.end))
            for e in elements
        ]

    def _entry_of(self, words: list[Word], alone: bool) -> int | None:
        if len(words) == 1:
            word = words[0]
            if word.stem in self._alone and not alone:
                return None
            found = self._phrases.get((word.stem,))
            return found if found is not None else self._phrases.get((_adjective(word.text),))
        stems = tuple(word.stem for word in words)
        found = self._phrases.get(stems)
        if found is None and any(word.text in ("left", "right") for word in words[1:-1]):
            # "a wooden left leg": which side it is comes later
            return self._phrases.get(tuple(s for s in stems if s not in ("left", "right")))
        return found


@dataclass(frozen=True)
class Reading:
    """What a prompt's words name: `elements` in their order, numbers of the words `left` over, and what is `denied`.

    `mentioned` are entries of somebody or something else: the bear of "afraid of a bear"; `denials` are the entries denied.
    """

    elements: tuple[Element, ...]
    left: tuple[int, ...]
    denied: tuple[str, ...]
    mentioned: tuple[int, ...]
    denials: tuple[int, ...] = ()

    def affirmed(self, words: list[Word]) -> str:
        """The prompt without what it denies, "" where nothing is left that says anything."""
        kept = sorted({*self.left, *(i for e in self.elements for i in range(e.start, e.end))})
        return " ".join(words[i].text for i in kept) if any(words[i].says for i in kept) else ""


def read_phrases(words: list[Word], index: PhraseIndex) -> Reading:
    """The entries that a prompt names, without what it denies ("not angry") and whom it only mentions."""
    found = index.find(words)
    covered = {i for e in found for i in range(e.start, e.end)}
    gone: set[int] = set()
    denied: list[str] = []
    denials: list[int] = []
    for at, word in enumerate(words):
        if at in (covered | gone) or word.text not in NEGATIONS | ABSENCES:
            continue
        if at + 1 < len(words) and words[at + 1].text == "to":
            continue  # "trying not to fall" is a way to walk
        named_after = list(_denied_elements(words, found, at))
        denials += [e.entry for e in named_after]
        reaches = [list(range(e.start, e.end)) for e in named_after]
        if not reaches and word.text in NEGATIONS:
            reaches = [_clause_rest(words, at)]
        for reach in filter(None, reaches):  # without any, "no energy" says what is there by what is not
            if gone.isdisjoint(reach):
                denied.append(" ".join(words[i].text for i in reach))
            gone.update((at, *reach))
        if at in gone and words[at + 1].text == "longer":
            gone.add(at + 1)
    kept = [e for e in found if gone.isdisjoint(range(e.start, e.end))]
    left = tuple(i for i in range(len(words)) if i not in gone and i not in covered)
    subjects = _subjects(words, kept, index.entries)
    named = {element.entry for element in subjects}
    mentioned = tuple(e.entry for e in kept if e.entry not in named)
    return Reading(tuple(subjects), left, tuple(denied), mentioned, tuple(denials))


def _denied_elements(words: list[Word], elements: list[Element], at: int) -> Iterable[Element]:
    """The next element of the clause, and those joined to it by "or" and "nor"."""
    previous = at
    for element in elements:
        if element.start <= at:
            continue
        between = {w.text for w in words[previous + 1 : element.start]}
        if words[element.start].clause != words[at].clause or between & {"but", "while", "who"}:
            return
        if previous != at and not between & {"or", "nor"}:
            return
        if previous == at and len([w for w in words[at + 1 : element.start] if w.says]) > 1:
            return
        previous = element.end - 1
        yield element


def _clause_rest(words: list[Word], at: int) -> list[int]:
    """Up to three words after `at`, to the end of its clause."""
    reach = []
    for i in range(at + 1, min(at + 4, len(words))):
        if words[i].clause != words[at].clause or words[i].text in LINKS:
            break
        reach.append(i)
    return reach


def _subjects(words: list[Word], elements: list[Element], entries: tuple[LibraryEntry, ...]) -> list[Element]:
    """Elements that say how the one who walks moves, without somebody else: "afraid of a bear" is no bear."""
    objects, places = _zones(words, elements)
    covered = {i for e in elements for i in range(e.start, e.end)}
    kept: list[Element] = []
    dropped_at = -1
    for element in reversed(elements):  # an adjective goes with the noun behind it
        category = entries[element.entry].category
        follows = words[element.end] if element.end < len(words) else None
        somebody = category in (*FIGURES, "ages") or element.end == dropped_at
        if element.only:
            kept.insert(0, element)
            continue
        if element.start in objects and (somebody or (follows is not None and follows.text in PERSONS)):
            dropped_at = element.start
            continue
        of_thing = follows is not None and follows.says and element.end not in covered
        if element.start in places and category in _QUALITIES and of_thing:
            continue  # "in an old house"
        kept.insert(0, element)
    # "dancing" says no more in "dancing samba"
    kept = [e for i, e in enumerate(kept) if not _same_doing(kept[i : i + 2], entries)]
    for i, element in enumerate(kept):
        before = {word.text for word in words[max(element.start - 2, 0) : element.start]}
        joined = i > 0 and kept[i - 1].end == element.start
        kept[i] = replace(element, after_like=bool(before & _AGAIN), joined=joined)
    return kept


def _same_doing(two: list[Element], entries: tuple[LibraryEntry, ...]) -> bool:
    """Whether two elements are one dance or sport in neighbouring words."""
    if len(two) < 2 or two[0].end != two[1].start:
        return False
    categories = {entries[element.entry].category for element in two}
    shorter = two[0].end - two[0].start <= two[1].end - two[1].start
    return shorter and len(categories) == 1 and categories <= {"dances", "sports"}


def _zones(words: list[Word], elements: list[Element]) -> tuple[set[int], set[int]]:
    """Numbers of the words that follow "from", "with", "hunting" and the like, and of those that follow any
    preposition; up to a link or the clause's end.
    """
    covered = {i for e in elements for i in range(e.start, e.end)}
    objects: set[int] = set()
    places: set[int] = set()
    of_object = of_place = False
    for i, word in enumerate(words):
        if (i and word.clause != words[i - 1].clause) or (word.text in LINKS and i not in covered):
            of_object = of_place = False
        if of_object:
            objects.add(i)
        if of_place:
            places.add(i)
        if i in covered:
            continue
        of_style = word.text == "of" and i > 0 and words[i - 1].text in _OF_STYLE
        verb = word.text.endswith("ing") and len(word.text) > 4 and word.text not in _INTRANSITIVE
        of_object = of_object or verb or (word.text in _OBJECT_STARTS and not of_style)
        of_place = of_place or (word.text in PREPOSITIONS and not of_style)
    return objects, places


def _named_parts(words: list[Word], start: int, end: int) -> tuple[str, ...]:
    """The parts named right behind a phrase, or before it with "like" or "of": "robot arms", "the legs of a penguin"."""
    clause = words[start].clause
    if end < len(words) and words[end].clause == clause and words[end].stem in PART_WORDS:
        at = end
    elif start >= 2 and words[start - 1].text in ("like", "of", "as") and words[start - 2].clause == clause:
        at = start - 2
        if words[at].stem not in PART_WORDS:
            return ()
    else:
        return ()
    parts = PART_WORDS[words[at].stem]
    if words[at - 1].text == "upper":
        return ("left_arm", "right_arm", "torso", "head")
    if words[at - 1].text == "lower":
        return ("left_leg", "right_leg")
    sided = tuple(part for part in parts if at and part.startswith(words[at - 1].text + "_"))
    return sided or parts


def _degree(words: list[Word], start: int) -> float:
    """Strength by the degree words right before an element."""
    for word in reversed(words[max(start - 3, 0) : start]):
        if word.text in SLIGHT:
            return SLIGHTLY
        if word.text in STRONG:
            return STRONGLY
        if word.text not in DEGREES:
            break
    return 1.0


def _adjective(word: str) -> str:
    """ "proudly" → "proud", "happily" → "happy" ("" for other words)."""
    if len(word) > 4 and word.endswith("ily"):
        return stem(word[:-3] + "y")
    return stem(word[:-2]) if len(word) > 4 and word.endswith("ly") else ""
