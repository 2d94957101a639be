"""Finds the library's phrases in a prompt word for word: the part of understanding without embeddings."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

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
    without_person,
    word_set,
    words_of,
)
from runtime.prompts.library_data import NEUTRAL_STYLE, LibraryEntry, PromptLibrary

_SIMILE = re.compile(r"\b(?:as )?(?P<adjective>\w+) as (?:an? |the )?(?P<thing>\w+)\b(?! (?:if|though))")
MAX_PHRASE_WORDS = 9  # words of a phrase
FIGURES = ("characters", "animals", "occupations")  # categories that say who walks
_THINGS = ("weather", "ground", "loads")
QUALITIES = ("ages", "bodies", "emotions", "minds")  # categories that say in which state
_SAID_OF_ONE = (*QUALITIES, "walks", "posture", "steps")
SLIGHT_STRENGTH, STRONG_STRENGTH = 0.6, 1.2  # of "slightly drunk" and "very drunk", relative to "drunk"
_OBJECT_STARTS = word_set(
    "from by against toward towards of for after past to at with beside behind near before over on"
)
_OF_STYLE = word_set("style manner way walk gait fashion kind sort steps moves")
_OR, _EXCEPT = word_set("or nor"), word_set("but while who")
_AGAIN = word_set("like as imitating impersonating mimicking being playing half part acting")
_HALVES = {"upper": ("left_arm", "right_arm", "torso", "head"), "lower": ("left_leg", "right_leg")}
# -ing forms without an object: what follows "pretending to be" is the walking figure
_INTRANSITIVE = word_set(
    "acting playing imitating impersonating mimicking pretending feeling looking moving walking dancing turning "
    "becoming being running going standing something nothing everything"
)


@dataclass(frozen=True)
class Element:
    """A library entry named by words `start` to `end` of a prompt, with its cosine similarity and its strength by degree.

    `after_like`: it is a comparison ("like a penguin"); `joined`: it is next to another figure; `only` are the parts
    that it is named for ("arms like a robot"), () for all that the entry defines.
    """

    entry: int
    start: int
    end: int
    similarity: float = 1.0
    degree: float = 1.0
    after_like: bool = False
    joined: bool = False
    only: tuple[str, ...] = ()


def numbers_of(elements: Sequence[Element]) -> set[int]:
    """Return the indices of the words covered by some elements."""
    return {i for e in elements for i in range(e.start, e.end)}


class PhraseIndex:
    """Index of the library's prompts by their words."""

    def __init__(self, library: PromptLibrary) -> None:
        self.entries = library.entries
        self._alone = library.alone
        self._whole: dict[str, int] = {}
        self._phrases: dict[tuple[str, ...], int] = {}
        named = [(text, i) for i, e in enumerate(library.entries) for text in (e.prompt, *e.also)]
        for text, number in named:
            words = words_of(text)
            self._whole.setdefault(key(words), number)
            plain_walk = library.entries[number].style.startswith(NEUTRAL_STYLE)
            if len(words) <= MAX_PHRASE_WORDS and (_says(words) or (len(words) > 1 and not plain_walk)):
                self._phrases.setdefault(tuple(word.stem for word in words), number)
        for number, entry in enumerate(library.entries):  # exact names come first
            self._whole.setdefault(key(without_person(words_of(entry.prompt))), number)
        described = [" . ".join(entry.descriptions.as_tuple()) for entry in library.entries]
        # known English words
        texts = [*dict(named), *described, *library.nothing]
        self.known = distinct_words(texts) | finite_forms().keys()

    def only_alone(self, words: list[Word]) -> bool:
        """Return whether the prompt is a single word that names an entry only when it stands alone."""
        saying = [word for word in words if word.says]
        return len(saying) == 1 and saying[0].stem in self._alone

    def whole(self, text: str) -> int | None:
        """Return the entry that the whole prompt names word for word, or None."""
        words = words_of(text)
        entry = self._whole.get(key(words)) if words else None
        return entry if entry is not None or not words else self._whole.get(key(without_person(words)))

    def plainly(self, text: str) -> str:
        """Return a lower-case prompt with comparisons of degree shortened: "light as a feather" becomes "light"."""

        def adjective(match: re.Match[str]) -> str:
            entry = self._phrases.get((stem(match["adjective"]),))
            said = entry is not None and self.entries[entry].category in _SAID_OF_ONE
            own = self.whole(match.group(0)) is not None or match["thing"] in (*NEGATIONS, "possible")
            return match["adjective"] if said and not own else match.group(0)

        return _SIMILE.sub(adjective, text)

    def find(self, words: list[Word]) -> list[Element]:
        """Return the entries named, without overlaps, covering as many meaningful words with as few phrases as possible."""
        gain = [0.0] * (len(words) + 1)
        chosen: list[Element | None] = [None] * (len(words) + 1)
        alone = sum(word.says for word in words) <= 1
        for start in range(len(words) - 1, -1, -1):
            gain[start] = gain[start + 1]
            for end in range(start + 1, min(start + MAX_PHRASE_WORDS, len(words)) + 1):
                entry = self._entry_of(words[start:end], alone)
                found = max(sum(word.says for word in words[start:end]), 0.5) - 0.1 + gain[end]
                if entry is not None and found > gain[start]:
                    gain[start], chosen[start] = found, Element(entry, start, end)
        elements, at = [], 0
        while at < len(words):
            element = chosen[at]
            if element is not None:
                only = _named_parts(words, element.start, element.end)
                elements.append(replace(element, degree=_degree(words, element.start), only=only))
            at = element.end if element is not None else at + 1
        return elements

    def _entry_of(self, words: list[Word], alone: bool) -> int | None:
        stems = tuple(word.stem for word in words)
        if len(words) == 1:
            if stems[0] in self._alone and not alone:
                return None
            return self._phrases.get(stems, self._phrases.get((_adjective(words[0].text),)))
        # "a wooden left leg": its side is resolved later
        sideless = (stems[0], *(s for s in stems[1:-1] if s not in ("left", "right")), stems[-1])
        return self._phrases.get(stems, self._phrases.get(sideless))


@dataclass(frozen=True)
class Reading:
    """The entries found in a prompt: `elements` in order, indices of the words `left` over, and the words `denied`.

    `mentioned` are entries of other beings (the bear in "afraid of a bear"); `denials` are the denied ones.
    """

    elements: tuple[Element, ...]
    left: tuple[int, ...]
    denied: tuple[str, ...]
    mentioned: tuple[int, ...]
    denials: tuple[Element, ...] = ()

    def affirmed(self, words: list[Word]) -> str:
        """Return the prompt without its denials, or "" if nothing meaningful is left."""
        kept = sorted({*self.left, *numbers_of(self.elements)})
        return " ".join(words[i].text for i in kept) if any(words[i].says for i in kept) else ""


def read_phrases(words: list[Word], index: PhraseIndex) -> Reading:
    """Return the entries that a prompt names, except those it denies ("not angry") or merely mentions."""
    found = index.find(words)
    covered = numbers_of(found)
    gone, denied, denials = _denials(words, found, covered)
    kept = [e for e in found if gone.isdisjoint(range(e.start, e.end))]
    left = tuple(i for i in range(len(words)) if i not in gone | covered)
    subjects = _subjects(words, kept, index.entries)
    named = {element.entry for element in subjects}
    mentioned = tuple(e.entry for e in kept if e.entry not in named)
    return Reading(subjects, left, tuple(denied), mentioned, tuple(denials))


def _denials(
    words: list[Word], found: list[Element], covered: set[int]
) -> tuple[set[int], list[str], list[Element]]:
    """Return indices of the words that deny or are denied, the denied texts, and the elements among them."""
    gone: set[int] = set()
    denied: list[str] = []
    found_denied: list[Element] = []
    for at in range(len(words)):
        if at in covered | gone or not _denies(words, at):
            continue
        elements = _denied_elements(words, found, at)
        found_denied += elements
        # without any, "no energy" describes by negation
        for reach in _reaches(words, elements, at):
            if gone.isdisjoint(reach):
                denied.append(" ".join(words[i].text for i in reach))
            gone.update((at, *reach))
        if at in gone and words[at + 1].text == "longer":
            gone.add(at + 1)
    return gone, denied, found_denied


def _reaches(words: list[Word], elements: list[Element], at: int) -> list[list[int]]:
    """Return indices of the words that a denial at `at` denies: an element's, else the rest of its clause."""
    if elements:
        return [list(range(e.start, e.end)) for e in elements]
    rest = _clause_rest(words, at) if words[at].text in NEGATIONS else []
    return [rest] if rest else []


def _denies(words: list[Word], at: int) -> bool:
    trying = at + 1 < len(words) and words[at + 1].text == "to"  # "trying not to fall" is a way to walk
    return words[at].text in NEGATIONS | ABSENCES and not trying


def _denied_elements(words: list[Word], elements: list[Element], at: int) -> list[Element]:
    """Return the next element of the clause, and those joined to it by "or" and "nor"."""
    denied: list[Element] = []
    for element in (e for e in elements if e.start > at):
        between = words[(denied[-1].end if denied else at + 1) : element.start]
        joined = _any_in(between, _OR) if denied else sum(word.says for word in between) <= 1
        if not joined or _any_in(between, _EXCEPT) or words[element.start].clause != words[at].clause:
            break
        denied.append(element)
    return denied


def _clause_rest(words: list[Word], at: int) -> list[int]:
    """Return up to three words after `at`, to the end of its clause."""
    reach = []
    for i in range(at + 1, min(at + 4, len(words))):
        if words[i].clause != words[at].clause or words[i].text in LINKS:
            break
        reach.append(i)
    return reach


def _subjects(
    words: list[Word], elements: list[Element], entries: tuple[LibraryEntry, ...]
) -> tuple[Element, ...]:
    """Return elements about how the walking figure moves: "afraid of a bear" does not make it a bear."""
    kept = _without_objects(words, elements, entries)
    # "dancing" adds nothing in "dancing samba"
    kept = [e for i, e in enumerate(kept) if not _same_doing(kept[i : i + 2], entries)]
    ends = {element.end for element in kept}
    return tuple(
        replace(e, after_like=_any_in(words[max(e.start - 2, 0) : e.start], _AGAIN), joined=e.start in ends)
        for e in kept
    )


def _without_objects(
    words: list[Word], elements: list[Element], entries: tuple[LibraryEntry, ...]
) -> list[Element]:
    covered = numbers_of(elements)
    objects, places = _zone(words, covered, _opens_object), _zone(words, covered, _opens_place)
    kept: list[Element] = []
    dropped_at = -1
    for element in reversed(elements):  # an adjective belongs to the following noun
        follows = words[element.end : element.end + 1]
        figure = entries[element.entry].category in (*FIGURES, "ages") or element.end == dropped_at
        figure = figure or _any_in(follows, PERSONS)
        if element.start in objects and figure and not element.only:
            dropped_at = element.start
        elif (
            element.only or element.start not in places or not _of_thing(element, elements, entries, follows)
        ):
            # skips "in an old house"
            kept.insert(0, element)
    return kept


def _of_thing(
    element: Element, elements: list[Element], entries: tuple[LibraryEntry, ...], follows: list[Word]
) -> bool:
    """Return whether an element is an attribute of a following thing, or of something unknown to the library."""
    if entries[element.entry].category not in QUALITIES or not _says(follows):
        return False
    thing = next((e for e in elements if e.start == element.end), None)
    return thing is None or entries[thing.entry].category in _THINGS


def _says(words: Sequence[Word]) -> bool:
    return any(word.says for word in words)


def _any_in(words: Sequence[Word], texts: frozenset[str]) -> bool:
    return any(word.text in texts for word in words)


def _same_doing(two: list[Element], entries: tuple[LibraryEntry, ...]) -> bool:
    """Return whether two elements name one dance or sport in adjacent words."""
    if len(two) < 2 or two[0].end != two[1].start:
        return False
    categories = {entries[element.entry].category for element in two}
    shorter = two[0].end - two[0].start <= two[1].end - two[1].start
    return shorter and len(categories) == 1 and categories <= {"dances", "sports"}


def _zone(words: list[Word], covered: set[int], opens: Callable[[list[Word], int], bool]) -> set[int]:
    """Return indices of the words after one that `opens` a zone, up to a conjunction or the clause's end."""
    zone: set[int] = set()
    inside = False
    for i, word in enumerate(words):
        if (i and word.clause != words[i - 1].clause) or (word.text in LINKS and i not in covered):
            inside = False
        if inside:
            zone.add(i)
        inside = inside or (i not in covered and opens(words, i))
    return zone


def _opens_object(words: list[Word], i: int) -> bool:
    """Return whether another person may follow: after "from", "with", "hunting" and the like."""
    text = words[i].text
    verb = text.endswith("ing") and len(text) > 4 and text not in _INTRANSITIVE
    return verb or (text in _OBJECT_STARTS and not _of_style(words, i))


def _opens_place(words: list[Word], i: int) -> bool:
    return words[i].text in PREPOSITIONS and not _of_style(words, i)


def _of_style(words: list[Word], i: int) -> bool:
    return words[i].text == "of" and i > 0 and words[i - 1].text in _OF_STYLE


def _named_parts(words: list[Word], start: int, end: int) -> tuple[str, ...]:
    """Return the parts named right after a phrase, or before it with "like" or "of": "robot arms", "the legs of a penguin"."""
    before = words[max(start - 2, 0) : start]
    at = end
    if len(before) == 2 and before[1].text in ("like", "of", "as") and not _is_part(words, end, start):
        at = start - 2
    if not _is_part(words, at, start):
        return ()
    side = words[at - 1].text if at else ""
    parts = PART_WORDS[words[at].stem]
    return _HALVES.get(side) or tuple(part for part in parts if part.startswith(f"{side}_")) or parts


def _is_part(words: list[Word], at: int, start: int) -> bool:
    return at < len(words) and words[at].clause == words[start].clause and words[at].stem in PART_WORDS


def _degree(words: list[Word], start: int) -> float:
    """Return the strength given by degree words right before an element."""
    for word in reversed(words[max(start - 3, 0) : start]):
        if word.text in SLIGHT:
            return SLIGHT_STRENGTH
        if word.text in STRONG:
            return STRONG_STRENGTH
        if word.text not in DEGREES:
            break
    return 1.0


def _adjective(word: str) -> str:
    """Return "proud" for "proudly", "happy" for "happily", "" for other words."""
    if len(word) > 4 and word.endswith("ily"):
        return stem(word[:-3] + "y")
    return stem(word[:-2]) if len(word) > 4 and word.endswith("ly") else ""
