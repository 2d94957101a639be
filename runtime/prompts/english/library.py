"""Prompts without key or network: body-part clauses are parsed, the rest comes from the nearest library entries."""

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Literal

import numpy as np

from runtime.assets import asset_path
from runtime.errors import FileError
from runtime.prompts.edit_targets import HAND, targets_of
from runtime.prompts.english import other_languages
from runtime.prompts.english.clauses import ParsedPrompt, parse_clauses
from runtime.prompts.english.compose import (
    compose_elements,
    compose_neighbours,
    is_idle,
    lame_leg,
    lame_on,
    on_side,
    pace_as_stated,
    sources_note,
    with_figure,
    words_of_parts,
)
from runtime.prompts.english.grammar import grammar
from runtime.prompts.english.other_languages import OtherLanguages
from runtime.prompts.english.phrases import (
    FIGURES,
    QUALITIES,
    Element,
    PhraseIndex,
    Reading,
    numbers_of,
    read_phrases,
)
from runtime.prompts.english.sides import OPPOSITE, named_side
from runtime.prompts.english.spelling import ENGLISH, Spelling, is_foreign, knows_no_word
from runtime.prompts.english.words import PERSONS, PLACES, Word, plain_denials, words_of
from runtime.prompts.expander import Expansion, check_prompt
from runtime.prompts.library_data import (
    NEUTRAL_STYLE,
    LibraryEmbeddings,
    LibraryEntry,
    PromptLibrary,
    embed_library,
    load_embeddings,
    load_library,
    load_styles,
)
from runtime.prompts.parts import PartDescriptions, mirror_text
from runtime.prompts.phrasing import adherence_of
from runtime.prompts.text_encoder import TextEncoderLike
from runtime.skeleton import PART_NAMES

# Cosine similarities, tuned on the first lists of tests/runtime/prompts/bodily_prompts.txt.
NEAR_COSINE = 0.62  # the best entry is used as a whole
GUESS_COSINE = 0.56  # below it, neighbours are wrong more often than not
# how many more words an entry must explain than the phrases found, to replace them
WHOLE_ENTRY_FRACTION = 0.3
CERTAIN_COSINE = 0.85  # needed by an entry that shares only a part's name with the prompt
# the same for a single word, or one next to a part's name, which have many neighbours
ONE_WORD_COSINE = 0.72
CLOSE_COSINE = 0.8  # a prompt so near an entry is about a body, whatever its bodily score
PLAIN_PENALTY_SCORE = 0.2  # of neutral entries, which are similar to any prompt with "walks"
ANIMAL_MARGIN_SCORE = 0.25  # allowed below a bodily score of 0 if an animal is named: "a dog after a bath"
# penalty on a sentence that no walk shows
UNSEEN_PENALTY_FRACTION = 0.15
MAX_NEIGHBOURS = 4  # entries that vote for each part between GUESS and NEAR
DENIED_COSINE = 0.75  # of a figure's sentence with one that the prompt denies
SAME_GESTURE_COSINE = 0.66  # between two sentences of an arm that describe the same gesture
MAX_STRETCHES = 4  # embedded per prompt
_MOVEMENTS = ("arms", "steps", "posture", "walks", "injuries")  # categories named by what the body does
_OF_ONE_ARM = re.compile(r"\b(?:left|right|one)\b")
LIMP = "limping on the {s} leg"  # a library entry
_REMEDY = "Write English, choose a language model, or install sport-viewer[languages]."
_NOTHING = "Nothing was understood of"
Near = tuple[tuple[str, float], ...]  # library prompts with their cosine similarity, best first


@dataclass(frozen=True)
class _Library:
    content: PromptLibrary
    embeddings: LibraryEmbeddings
    phrases: PhraseIndex
    spelling: Spelling
    neutral: int  # index of its entry
    plain: list[int]  # indices of entries that are variants of neutral

    @property
    def entries(self) -> tuple[LibraryEntry, ...]:
        return self.content.entries


class LibraryExpander:
    """Expands prompts with the library at `library_path` (with styles.json and library.npz next to it).

    Of similar sentences it prefers those that the shipped model shows best. Files are read at the first `expand`;
    embeddings are computed then if the stored ones do not fit.
    """

    def __init__(self, encoder: TextEncoderLike, library_path: Path | None = None) -> None:
        self._encoder = encoder
        self._path = asset_path("prompts/library.json") if library_path is None else library_path

    def expand(self, prompt: str) -> Expansion:
        """Return six descriptions for any prompt; PromptError if it is empty, too long or has control characters."""
        prompt = check_prompt(prompt)
        library = self._library
        whole = library.phrases.whole(prompt)
        if whole is not None:
            # any prompt that walks is similar to a neutral one, here and below
            ranked = [] if whole in library.plain else self._rank(prompt)
            others = [(i, s) for i, s in ranked if i != whole][:MAX_NEIGHBOURS]
            return self._expansion(whole, self._near([(whole, 1.0), *others]), {}, "")
        if is_foreign(prompt, library.phrases.known):
            return self._in_another_language(prompt)
        text, read = library.spelling.corrected(prompt)
        expansion = self._expand_english(text)
        if not read:
            return expansion
        note = ", ".join(f"“{wrong}” read as “{right}”" for wrong, right in read.items())
        return replace(expansion, note=f"{note[0].upper()}{note[1:]}. {expansion.note}".strip())

    def _in_another_language(self, prompt: str) -> Expansion:
        """Return the entry nearest in meaning if the multilingual encoder is installed; else neutral with the remedy."""
        ranked = self._languages.nearest(prompt)
        if ranked and ranked[0][1] >= other_languages.NEAR_COSINE:
            near = self._near(ranked)
            note = (
                f"“{_short(prompt)}” is not English: nearest by meaning is “{near[0][0]}” ({near[0][1]:.0%})."
            )
            return self._expansion(ranked[0][0], near, {}, note)
        remedy = "Write English or choose a language model." if ranked else _REMEDY
        note = f"{_NOTHING} “{_short(prompt)}”, which is not English: neutral. {remedy}"
        return self._neutral((), {}, note)

    def nearest(self, text: str) -> tuple[tuple[str, float], ...]:
        """Return the library prompts most similar to `text`, with their cosine similarity, best first; takes milliseconds."""
        return self._near(self._rank(check_prompt(text)))

    def _expand_english(self, prompt: str) -> Expansion:
        parsed = parse_clauses(plain_denials(prompt), self._knows_thing)
        parsed = replace(parsed, rest=self._library.phrases.plainly(parsed.rest))
        words = words_of(parsed.rest)
        if any(word.says for word in words):
            whole = self._library.phrases.whole(parsed.rest)
            if whole in self._library.plain:
                return self._expansion(whole, self._near([(whole, 1.0)]), parsed.parts, "")
            expansion = self._expand_rest(parsed, words)
            return self._with_one_gesture(expansion) if _OF_ONE_ARM.search(prompt.lower()) else expansion
        note = "" if parsed.parts else "The prompt names no style: neutral."
        expansion = self._neutral((), parsed.parts, note)
        return replace(expansion, source="explicit") if parsed.parts else expansion

    def _knows_thing(self, text: str) -> bool:
        """Return whether a library phrase contains the last word of a text: the "cart" of "pushing the cart"."""
        words = words_of(text)
        return any(e.end == len(words) for e in read_phrases(words, self._library.phrases).elements)

    def _expand_rest(self, parsed: ParsedPrompt, words: list[Word]) -> Expansion:
        """Expand the rest of a prompt without its clauses: by its phrases, by the nearest entries, or not at all."""
        reading = read_phrases(words, self._library.phrases)
        entries = self._entries_on(named_side(_text(words)) or parsed.side, parsed.parts)
        note, text = "", parsed.rest
        if reading.denied:
            note = f"Ignored, because it is denied: “{_short(', '.join(reading.denied))}”."
            text = reading.affirmed(words)
            if not text:
                return self._denied(reading.denials, parsed.parts, note)
        ranked = self._rank(text)
        nothing = self._nothing_bodily(text, words, reading, ranked[0][1])
        if nothing:
            return self._neutral((), parsed.parts, f"{nothing} {note}".strip())
        elements = list(reading.elements)
        if elements:
            elements += self._stretches(words, reading.left, elements)
        if not elements or self._nearest_says_more(words, reading, elements, ranked[0]):
            return self._by_neighbours(text, ranked, entries, parsed.parts, note)
        library = self._library
        elements, paced = pace_as_stated(elements, reading.elements, library.entries)
        chosen = compose_elements(elements, entries, library.embeddings, library.neutral, self._worth)
        self._drop_denied(chosen, reading.denials)
        # without similarities of single words, which would be a second number beside that of the whole prompt
        sources = sources_note(chosen, library.entries, {}) if len(set(chosen.values())) > 1 else ""
        notes = (sources and f"{sources}.", note, _unread_limbs(words, reading, elements))
        return self._expansion(
            words_of_parts(chosen, entries),
            self._near(ranked * bool(set(chosen.values()).difference(library.plain))),
            paced | parsed.parts,
            " ".join(filter(None, notes)),
        )

    def _drop_denied(self, sources: dict[str, int], denials: Sequence[Element]) -> None:
        """Make a part neutral where a figure or mood does what is denied: "an old woman, no stoop"."""
        library = self._library
        for denied in denials:
            entry = library.entries[denied.entry]
            for part in (denied.only or entry.defines) if entry.category in _MOVEMENTS else ():
                sentences = library.embeddings.parts[:, PART_NAMES.index(part)]
                alike = sentences @ sentences[denied.entry]
                does = alike[sources[part]] > max(DENIED_COSINE, alike[library.neutral])
                if does and library.entries[sources[part]].category in (*FIGURES, *QUALITIES):
                    sources[part] = library.neutral

    def _nothing_bodily(self, text: str, words: list[Word], reading: Reading, best: float) -> str:
        """Return why words beside a prompt's phrases describe no movement, or "" if they do; `best` is the nearest cosine."""
        if not any(words[i].says for i in reading.left) or self._about_a_person(words, reading.elements):
            return ""
        if knows_no_word(text, self._library.phrases.known) and best < NEAR_COSINE:
            return f"{_NOTHING} “{_short(text)}”, none of whose words is known: neutral. {_REMEDY}"
        least = -ANIMAL_MARGIN_SCORE if "animals" in self._categories(reading.elements) else 0.0
        if best >= CLOSE_COSINE or self._bodily(text) >= least:
            return ""
        return f"“{_short(text)}” says nothing about a body, {best:.0%} like the nearest prompt: neutral."

    def _nearest_says_more(
        self, words: list[Word], reading: Reading, elements: list[Element], nearest: tuple[int, float]
    ) -> bool:
        """Return whether the entry nearest to the whole prompt explains more of its words than the phrases found."""
        entry, similarity = nearest
        # a figure: "nurse" alone would lose the tiredness of "a tired nurse at the end of …"
        figure = self._library.entries[entry].category in FIGURES and entry in {e.entry for e in elements}
        if figure or any(e.only for e in elements) or entry in reading.mentioned:
            return False
        if self._only_a_part_in_common(_text(words), nearest):
            return False
        explained = _explained(words, elements)
        said = sum(words[i].says for i in reading.left) + _explained(words, reading.elements)
        return similarity >= NEAR_COSINE and said * similarity >= explained + WHOLE_ENTRY_FRACTION

    def _by_neighbours(
        self,
        text: str,
        ranked: list[tuple[int, float]],
        entries: tuple[LibraryEntry, ...],
        stated: dict[str, str],
        note: str,
    ) -> Expansion:
        """Return the nearest entry, or the consensus of the nearest ones; neutral if they are far."""
        if all(word.stem in PLACES for word in words_of(text)):
            reason = f"“{_short(text)}” names a body part, but nothing that it does: neutral."
            return self._neutral((), stated, f"{reason} {note}".strip())
        best, near = ranked[0][1], self._near(ranked)
        if best < GUESS_COSINE or self._only_a_part_in_common(text, ranked[0]):
            reason = f"“{_short(text)}” is only {best:.0%} like the nearest prompt, “{near[0][0]}”: neutral."
            return self._neutral(near, stated, f"{reason} {note}".strip())
        if best >= NEAR_COSINE:
            return self._expansion(entries[ranked[0][0]].descriptions, near, stated, note)
        chosen = compose_neighbours(ranked[:MAX_NEIGHBOURS], self._library.embeddings, self._worth)
        parts = sources_note(chosen, self._library.entries, dict(ranked))
        note = f"Composed from the nearest prompts, {best:.0%} like it at best: {parts}. {note}".strip()
        return self._expansion(words_of_parts(chosen, entries), near, stated, note)

    def _denied(self, denials: tuple[Element, ...], stated: dict[str, str], note: str) -> Expansion:
        """Expand a prompt that only denies: the opposite if the library has one, else neutral."""
        entries = self._library.entries
        opposite = next((entries[e.entry].opposite for e in denials if entries[e.entry].opposite), "")
        if not opposite:
            return self._neutral((), stated, note)
        entry = next(i for i, e in enumerate(entries) if e.prompt == opposite)
        return self._expansion(entry, ((opposite, 1.0),), stated, f"{note} In its place: “{opposite}”.")

    def _only_a_part_in_common(self, text: str, best: tuple[int, float]) -> bool:
        """Return whether a text and an entry about parts share only a part's name: it then asks for something else."""
        words = words_of(text)
        named = any(word.stem in PLACES for word in words) and not any(w.text in PERSONS for w in words)
        return named and best[1] < CERTAIN_COSINE and not self._has_a_word_of(words, best[0])

    def _has_a_word_of(self, words: list[Word], number: int) -> bool:
        """Return whether an entry about arms, legs or posture shares a word besides parts' names; True for other entries."""
        entry = self._library.entries[number]
        if entry.category not in ("arms", "steps", "posture"):
            return True
        texts = entry.prompt, *entry.also
        own = {word.stem.removesuffix("ing") for text in texts for word in words_of(text)}
        saying = [word for word in words if word.says and word.stem not in PLACES]
        return any(word.stem.removesuffix("ing") in own for word in saying)

    def _entries_on(self, side: str, stated: dict[str, str]) -> tuple[LibraryEntry, ...]:
        """Return the library's entries on the body side that a prompt names, "" for none, or on the side of its lame leg."""
        entries = self._library.entries
        if side:
            return tuple(on_side(entry, side) for entry in entries)
        lame = lame_leg(stated)
        return tuple(lame_on(entry, lame) for entry in entries) if lame else entries

    def _stretches(self, words: list[Word], left: tuple[int, ...], named: list[Element]) -> list[Element]:
        """Return entries similar to stretches of words next to a prompt's phrases: "lethargic" in "a lethargic robot"."""
        elements = []
        for start, end in _runs(words, left)[:MAX_STRETCHES]:
            entry, similarity = self._rank(_text(words[start:end]))[0]
            neighbours = [e for e in named if start in (e.start, e.end) or end == e.start]
            # "a basketball player dribbling" does one sport, which is already named
            named_sport = self._categories(neighbours) & {"dances", "sports"}
            other = self._library.entries[entry].category in named_sport
            if not other and self._names(words[start:end], entry, similarity):
                elements.append(Element(entry, start, end, similarity))
        return elements

    def _names(self, words: list[Word], entry: int, similarity: float) -> bool:
        """Return whether words with this similarity to an entry name it."""
        # "with jerky arms" is similar to everything with arms
        one = sum(word.says for word in words) == 1 or any(word.stem in PLACES for word in words)
        least = ONE_WORD_COSINE if one else GUESS_COSINE
        alike = similarity >= least and (similarity >= CERTAIN_COSINE or self._has_a_word_of(words, entry))
        return alike and not self._library.phrases.only_alone(words) and self._bodily(_text(words)) > 0.0

    def _categories(self, elements: Iterable[Element]) -> set[str]:
        return {self._library.entries[e.entry].category for e in elements}

    def _about_a_person(self, words: list[Word], elements: Sequence[Element]) -> bool:
        """Return whether a prompt names a person or describes parts, so that it is about a body in any case."""
        person = bool(self._categories(elements) & {"characters", "occupations", "ages"})
        return person or any(word.text in PERSONS for word in words) or any(e.only for e in elements)

    def _worth(self, entry: int, part: str) -> float:
        """Return the weight of an entry's sentence: 1, or less if walks do not show it."""
        shown = adherence_of().of(getattr(self._library.entries[entry].descriptions, part), part)
        return 1.0 if shown is None else 1.0 - UNSEEN_PENALTY_FRACTION * (1.0 - shown)

    def _bodily(self, text: str) -> float:
        """Return a score that is positive for texts about a body."""
        weights = self._library.embeddings.bodily
        return float(self._encoder.encode([text])[0] @ weights[:-1] + weights[-1])

    def _neutral(self, near: Near, stated: dict[str, str], note: str) -> Expansion:
        """Return the neutral entry with the stated parts; a limp involves the whole body."""
        sides = [side for side in OPPOSITE if re.match("limping (?!slightly)", stated.get(f"{side}_leg", ""))]
        limp = self._library.phrases.whole(LIMP.format(s=sides[0])) if len(sides) == 1 else None
        return self._expansion(self._library.neutral if limp is None else limp, near, stated, note)

    def _expansion(
        self, base: PartDescriptions | int, near: Near, stated: dict[str, str], note: str
    ) -> Expansion:
        """Return the descriptions `base`, or those of the entry with that index, with the stated parts replaced."""
        said = self._library.entries[base].descriptions if isinstance(base, int) else base
        parts = tuple(part for part in PART_NAMES if part in stated)
        source: Literal["library", "explicit"] = "explicit" if parts == PART_NAMES else "library"
        figure = said.to_mapping()
        words = PartDescriptions(**figure | with_figure(stated, figure))
        return Expansion(words, source, near, note, parts)

    def _with_one_gesture(self, expansion: Expansion) -> Expansion:
        """Return the expansion with a swinging other arm if the stated arm already does that arm's gesture.

        "Left palm on the forehead, as if having a headache": the headache's right hand is then not on the head too.
        """
        said = expansion.descriptions
        arms = [part for part in expansion.explicit_parts if part.endswith("arm")]
        other = {"left_arm": "right_arm", "right_arm": "left_arm"}.get(arms[0]) if len(arms) == 1 else None
        if other is None or is_idle(getattr(said, other)):
            return expansion
        does = getattr(said, arms[0]), mirror_text(getattr(said, other))
        one, two = self._encoder.encode(list(does))
        place, other_place = (targets_of(arms[0], words).get(HAND) for words in does)
        if float(one @ two) < SAME_GESTURE_COSINE and not (place and place == other_place):
            return expansion
        idle = getattr(self._library.entries[self._library.neutral].descriptions, other)
        return replace(expansion, descriptions=said.replace(other, idle))

    def _rank(self, text: str) -> list[tuple[int, float]]:
        """Return (entry, cosine similarity) of the nearest entries, best first; an entry counts by its best prompt."""
        embeddings = self._library.embeddings
        similarity = embeddings.prompts @ self._encoder.encode([text])[0]
        by_entry = np.full(len(self._library.entries), -1.0, np.float32)
        np.maximum.at(by_entry, embeddings.entry_of, similarity)
        by_entry[self._library.plain] -= PLAIN_PENALTY_SCORE
        order = np.argsort(-by_entry, kind="stable")[: MAX_NEIGHBOURS + 1]
        return [(int(i), float(np.clip(by_entry[i], -1.0, 1.0))) for i in order]

    def _near(self, ranked: list[tuple[int, float]]) -> Near:
        return tuple((self._library.entries[i].prompt, similarity) for i, similarity in ranked)

    @cached_property
    def _library(self) -> _Library:
        styles = load_styles(self._path.with_name("styles.json"))
        content = load_library(self._path, styles)
        embeddings = load_embeddings(self._path.with_suffix(".npz"), content, self._encoder)
        embeddings = embeddings or embed_library(content, self._encoder)
        names = [entry.style for entry in content.entries]
        if NEUTRAL_STYLE not in names:
            raise FileError(f"{self._path}: has no entry of the style 'neutral'.", "Restore the file.")
        plain = [i for i, style in enumerate(names) if style.startswith(NEUTRAL_STYLE)]
        phrases = PhraseIndex(content)
        spelling = Spelling(
            phrases.known | ENGLISH, (*embeddings.other_words, *grammar()["seldom"].pattern.split("|"))
        )
        return _Library(content, embeddings, phrases, spelling, names.index(NEUTRAL_STYLE), plain)

    @cached_property
    def _languages(self) -> OtherLanguages:
        return OtherLanguages(self._path.parent, self._library.content)


def _runs(words: list[Word], left: tuple[int, ...]) -> list[tuple[int, int]]:
    """Return runs (start, end) of adjacent words in one clause among `left` that may name something."""
    runs: list[list[int]] = []
    for i in left:
        if runs and runs[-1][-1] == i - 1 and words[i].clause == words[i - 1].clause:
            runs[-1].append(i)
        else:
            runs.append([i])
    return [
        (run[0], run[-1] + 1)
        for run in runs
        if any(words[i].says and words[i].stem not in PLACES for i in run)
    ]


def _explained(words: list[Word], elements: Iterable[Element]) -> float:
    """Return the number of meaningful words of some elements, weighted by similarity."""
    return sum(sum(word.says for word in words[e.start : e.end]) * e.similarity for e in elements)


def _unread_limbs(words: list[Word], reading: Reading, elements: Sequence[Element]) -> str:
    """Return the text about a body part that no rule and no phrase covers, or ""."""
    taken = numbers_of(elements)
    unread = [
        _text(words[start:end])
        for start, end in _runs(words, tuple(i for i in reading.left if i not in taken))
        if any(words[i].stem in PLACES for i in range(start, end))
    ]
    return f"Not understood: “{_short('”, “'.join(unread), 60)}”." if unread else ""


def _short(text: str, limit: int = 40) -> str:
    return text if len(text) <= limit else text[: limit - 1] + "…"


def _text(words: Sequence[Word]) -> str:
    return " ".join(word.text for word in words)
