"""Prompts without key or network: part clauses are parsed, the rest comes from the nearest library entries."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Literal

import numpy as np

from runtime.assets import asset_path
from runtime.prompts.english import other_languages
from runtime.prompts.english.clauses import ParsedPrompt, parse_clauses
from runtime.prompts.english.compose import compose_elements, compose_neighbours, sources_note
from runtime.prompts.english.language import ENGLISH, is_foreign, knows_no_word
from runtime.prompts.english.library_data import (
    NEUTRAL_STYLE,
    LibraryEmbeddings,
    LibraryEntry,
    LibraryStyle,
    PromptLibrary,
    embed_library,
    library_hash,
    load_embeddings,
    load_prompt_library,
    load_styles,
)
from runtime.prompts.english.other_languages import OtherLanguages
from runtime.prompts.english.phrases import FIGURES, Element, PhraseIndex, Reading, read_phrases
from runtime.prompts.english.sides import lame_leg, lame_on, named_side, on_side
from runtime.prompts.english.spelling import Spelling
from runtime.prompts.english.words import PERSONS, PLACES, Word, plain_denials, words_of
from runtime.prompts.expander import Expansion, check_prompt
from runtime.prompts.parts import PartDescriptions
from runtime.prompts.shares import PhraseShares, shares_of
from runtime.prompts.text_encoder import TextEncoderLike
from runtime.skeleton import PART_NAMES

# Cosine similarities of prompts, set on the first lists of tests/helpers/prompt_lists.py.
NEAR = 0.62  # the best entry is taken whole
FAR = 0.45  # below, the prompt says nothing about a way of moving
GUESS = 0.56  # below, neighbours are a guess that is wrong more often than not: neutral
STRETCH = 0.56  # what is left of a prompt beside the phrases found names an entry
WHOLE = 0.3  # words that an entry must explain more than the phrases found do, to be taken in place of them
CERTAIN = 0.85  # an entry about body parts that shares a part's name only with the prompt needs as much
ONE_WORD = 0.72  # the same where that is a single word, whose neighbours are many
CLOSE = 0.8  # so near an entry a prompt is about a body, whatever the bodily score
PLAIN = 0.2  # neutral walks are like everything that "walks": what is asked for by a style is none
ANIMAL = 0.25  # how far below 0 the bodily score may lie where an animal is named: "a dog that has just had a bath"
UNSEEN = 0.15  # by which a sentence that no walk shows counts less than one that is shown whole
NEIGHBOURS = 4  # entries that vote for each part between FAR and NEAR
MAX_STRETCHES = 4  # embedded for one prompt
LIMP = "limping on the {s} leg"  # an entry of the library
_REMEDY = "Write English, choose a language model, or install sport-viewer[languages]."
_NOTHING = "Nothing was understood of"


@dataclass(frozen=True)
class _Library:
    content: PromptLibrary
    embeddings: LibraryEmbeddings
    phrases: PhraseIndex
    spelling: Spelling
    neutral: int  # its entry
    plain: list[int]  # entries that are neutral in one way or another

    @property
    def entries(self) -> tuple[LibraryEntry, ...]:
        return self.content.entries


class LibraryExpander:
    """Expands prompts by the library at `library_path` (with styles.json and library.npz beside it).

    Of sentences alike it takes those that a walk shows, by `shares` (default: those of the shipped model).
    Files are read at the first `expand`; without fitting stored embeddings they are computed then.
    """

    def __init__(
        self,
        encoder: TextEncoderLike,
        library_path: Path | None = None,
        shares: PhraseShares | None = None,
    ) -> None:
        self._encoder = encoder
        self._path = library_path
        self._measured = shares

    def expand(self, prompt: str) -> Expansion:
        """Six descriptions for any prompt; PromptError when it is empty, over-long or has control characters."""
        prompt = check_prompt(prompt)
        library = self._library
        whole = library.phrases.whole(prompt)
        if whole is not None:
            return _expansion(
                library.entries[whole].descriptions, self._near(self._rank(prompt), whole), {}, ""
            )
        if is_foreign(prompt, library.phrases.known):
            return self._in_another_language(prompt)
        text, read = library.spelling.corrected(prompt)
        expansion = self._expand_english(text)
        if not read:
            return expansion
        note = ", ".join(f"“{wrong}” read as “{right}”" for wrong, right in read.items())
        return replace(expansion, note=f"{note[0].upper()}{note[1:]}. {expansion.note}".strip())

    def _in_another_language(self, prompt: str, least: float = other_languages.NEAR) -> Expansion:
        """The entry nearest by meaning, where its multilingual encoder is installed; else neutral with the remedy."""
        ranked = self._languages.nearest(prompt)
        if ranked and ranked[0][1] >= least:
            near = self._near(ranked)
            note = (
                f"“{_short(prompt)}” is not English: nearest by meaning is “{near[0][0]}” ({near[0][1]:.0%})."
            )
            return _expansion(self._library.entries[ranked[0][0]].descriptions, near, {}, note)
        remedy = "Write English or choose a language model." if ranked else _REMEDY
        return self._neutral(
            (), {}, f"{_NOTHING} “{_short(prompt)}”, which is not English: neutral. {remedy}"
        )

    def nearest(self, text: str) -> tuple[tuple[str, float], ...]:
        """The library's prompts most like `text`, with their cosine similarity, best first; takes milliseconds."""
        return self._near(self._rank(check_prompt(text)))

    def _expand_english(self, prompt: str) -> Expansion:
        parsed = parse_clauses(plain_denials(prompt))
        parsed = replace(parsed, rest=self._library.phrases.plainly(parsed.rest))
        words = words_of(parsed.rest)
        if any(word.says for word in words):
            return self._expand_rest(parsed, words)
        if parsed.parts:
            return self._neutral((), parsed.parts, "", explicit=True)
        return self._neutral((), {}, "The prompt names no style: neutral.")

    def _expand_rest(self, parsed: ParsedPrompt, words: list[Word]) -> Expansion:
        """What a prompt says beside its clauses: by its phrases, by the nearest entries, or nothing."""
        reading = read_phrases(words, self._library.phrases)
        side = named_side(words) or parsed.side
        note, text = "", parsed.rest
        if reading.denied:
            note = f"Left out, as it is denied: “{_short(', '.join(reading.denied))}”."
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
            return self._by_neighbours(text, ranked, parsed.parts, note, side)
        library = self._library
        note = f"{note} {_unread_limbs(words, reading, elements)}".strip()
        made = compose_elements(
            elements, self._entries_on(side, parsed.parts), library.embeddings, library.neutral, self._worth
        )
        if len(set(made.sources.values())) > 1:
            # no similarity of single words: beside that of the whole prompt it is another figure for the same entry
            note = f"{sources_note(made.sources, library.entries, {})}. {note}".strip()
        return _expansion(made.descriptions, self._near(ranked), parsed.parts, note)

    def _nothing_bodily(self, text: str, words: list[Word], reading: Reading, best: float) -> str:
        """Why words beside a prompt's phrases name no way of moving, or "" where they do; `best` is the nearest's cosine."""
        if not any(words[i].says for i in reading.left) or self._about_a_person(words, reading.elements):
            return ""
        library = self._library
        if knows_no_word(text, library.phrases.known) and best < NEAR:
            return f"{_NOTHING} “{_short(text)}”, none of whose words is known: neutral. {_REMEDY}"
        animal = any(library.entries[e.entry].category == "animals" for e in reading.elements)
        if best < FAR or (best < CLOSE and self._bodily(text) < (-ANIMAL if animal else 0.0)):
            return _far(text, best)
        return ""

    def _nearest_says_more(
        self, words: list[Word], reading: Reading, elements: list[Element], nearest: tuple[int, float]
    ) -> bool:
        """Whether the entry nearest to the whole prompt explains more of its words than its phrases do."""
        entry, similarity = nearest
        if any(e.only for e in elements) or entry in reading.mentioned:
            return False
        # somebody named: "nurse" alone would lose the tiredness of "a tired nurse at the end of …"
        if self._library.entries[entry].category in FIGURES and entry in {e.entry for e in elements}:
            return False
        explained = sum(_saying(words, e) * e.similarity for e in elements)
        said = sum(words[i].says for i in reading.left) + sum(_saying(words, e) for e in reading.elements)
        return similarity >= NEAR and said * similarity >= explained + WHOLE

    def _by_neighbours(
        self, text: str, ranked: list[tuple[int, float]], stated: dict[str, str], note: str, side: str
    ) -> Expansion:
        """The nearest entry, or what the nearest ones agree on; neutral when they are far."""
        library = self._library
        best, near = ranked[0][1], self._near(ranked)
        if best < FAR:
            return self._neutral(near, stated, f"{_far(text, best)} {note}".strip())
        entries = self._entries_on(side, stated)
        if best < GUESS or self._only_a_part_in_common(text, ranked[0]):
            reason = f"“{_short(text)}” is only {best:.0%} like the nearest prompt, “{near[0][0]}”: neutral."
            return self._neutral(near, stated, f"{reason} {note}".strip())
        if best >= NEAR:
            return _expansion(entries[ranked[0][0]].descriptions, near, stated, note)
        made = compose_neighbours(ranked[:NEIGHBOURS], entries, library.embeddings, self._worth)
        parts = sources_note(made.sources, library.entries, dict(ranked))
        note = f"Composed from the nearest prompts, {best:.0%} like it at best: {parts}. {note}".strip()
        return _expansion(made.descriptions, near, stated, note)

    def _denied(self, denials: tuple[int, ...], stated: dict[str, str], note: str) -> Expansion:
        """A prompt that only says what is not: the opposite where the library has one, else neutral."""
        library = self._library
        opposite = next((library.entries[i].opposite for i in denials if library.entries[i].opposite), "")
        if not opposite:
            return self._neutral((), stated, note)
        entry = next(e for e in library.entries if e.prompt == opposite)
        return _expansion(
            entry.descriptions, ((opposite, 1.0),), stated, f"{note} In its place: “{opposite}”."
        )

    def _only_a_part_in_common(self, text: str, best: tuple[int, float]) -> bool:
        """Whether a text names a body part and shares no other word with an entry about parts: another instruction."""
        words = words_of(text)
        named = any(word.stem in PLACES for word in words) and not any(w.text in PERSONS for w in words)
        return named and best[1] < CERTAIN and not self._shares_a_word(words, best[0])

    def _shares_a_word(self, words: list[Word], number: int) -> bool:
        """Whether an entry about arms, legs or posture has one of the words, parts' names aside; True for others."""
        entry = self._library.entries[number]
        if entry.category not in ("arms", "steps", "posture"):
            return True
        own = {
            word.stem.removesuffix("ing")
            for prompt in (entry.prompt, *entry.also)
            for word in words_of(prompt)
        }
        return any(
            word.says and word.stem not in PLACES and word.stem.removesuffix("ing") in own for word in words
        )

    def _entries_on(self, side: str, stated: dict[str, str]) -> tuple[LibraryEntry, ...]:
        """The library's entries for a prompt that names one side of the body, "" for none, or states that one leg is lame."""
        entries = self._library.entries
        if side:
            return tuple(on_side(entry, side) for entry in entries)
        lame = lame_leg(stated)
        return tuple(lame_on(entry, lame) for entry in entries) if lame else entries

    def _stretches(self, words: list[Word], left: tuple[int, ...], named: list[Element]) -> list[Element]:
        """Entries that stretches beside a prompt's phrases are like: "lethargic" in "a lethargic robot"."""
        categories = [entry.category for entry in self._library.entries]
        elements = []
        for start, end in _runs(words, left)[:MAX_STRETCHES]:
            text = " ".join(word.text for word in words[start:end])
            entry, similarity = self._rank(text)[0]
            one = sum(word.says for word in words[start:end]) == 1
            if similarity < (ONE_WORD if one else STRETCH):
                continue
            if similarity < CERTAIN and not self._shares_a_word(words[start:end], entry):
                continue
            beside = {categories[e.entry] for e in named if start in (e.start, e.end) or end == e.start}
            if categories[entry] in beside & {"dances", "sports"}:
                continue  # "a basketball player dribbling" does one sport, which is named
            if not self._library.phrases.only_alone(words[start:end]) and self._bodily(text) > 0.0:
                elements.append(Element(entry, start, end, similarity))
        return elements

    def _about_a_person(self, words: list[Word], elements: Sequence[Element]) -> bool:
        """Whether a prompt names a person or asks for parts, so that it is about a body whatever else it says."""
        people = ("characters", "occupations", "ages")
        return any(word.text in PERSONS for word in words) or any(
            e.only or self._library.entries[e.entry].category in people for e in elements
        )

    def _worth(self, entry: int, part: str) -> float:
        """How much a sentence of an entry counts beside others: all, or less where walks do not show it."""
        share = self._shares.of(getattr(self._library.entries[entry].descriptions, part), part)
        return 1.0 if share is None else 1.0 - UNSEEN * (1.0 - share)

    @cached_property
    def _shares(self) -> PhraseShares:
        return shares_of() if self._measured is None else self._measured

    def _bodily(self, text: str) -> float:
        """Above 0 where a text is rather about somebody's body than about nothing bodily."""
        weights = self._library.embeddings.bodily
        return float(self._encoder.encode([text])[0] @ weights[:-1] + weights[-1])

    def _neutral(
        self,
        near: tuple[tuple[str, float], ...],
        stated: dict[str, str],
        note: str,
        explicit: bool = False,
    ) -> Expansion:
        base = self._library.entries[self._beside(stated)].descriptions
        return _expansion(base, near, stated, note, explicit)

    def _beside(self, stated: dict[str, str]) -> int:
        """The entry for what a prompt leaves open: neutral, but who limps does so with the whole body."""
        library = self._library
        sides = [side for side in ("left", "right") if "limping" in stated.get(f"{side}_leg", "")]
        limp = library.phrases.whole(LIMP.format(s=sides[0])) if len(sides) == 1 else None
        return library.neutral if limp is None else limp

    def _rank(self, text: str) -> list[tuple[int, float]]:
        """(entry, cosine similarity) of the nearest entries, best first; an entry counts by its best prompt."""
        embeddings = self._library.embeddings
        similarity = embeddings.prompts @ self._encoder.encode([text])[0]
        by_entry = np.full(len(self._library.entries), -1.0, np.float32)
        np.maximum.at(by_entry, embeddings.entry_of, similarity)
        by_entry[self._library.plain] -= PLAIN
        order = np.argsort(-by_entry, kind="stable")[: NEIGHBOURS + 1]
        return [(int(i), float(np.clip(by_entry[i], -1.0, 1.0))) for i in order]

    def _near(
        self, ranked: list[tuple[int, float]], first: int | None = None
    ) -> tuple[tuple[str, float], ...]:
        """Prompts and similarities; `first` is the entry that was asked for in so many words."""
        if first is not None:
            ranked = [(first, 1.0), *((i, s) for i, s in ranked if i != first)][: len(ranked)]
        return tuple((self._library.entries[i].prompt, similarity) for i, similarity in ranked)

    @cached_property
    def _library(self) -> _Library:
        path = self._library_path
        content = load_prompt_library(path, self._styles)
        stored = load_embeddings(
            path.with_suffix(".npz"), library_hash(content), self._encoder, len(content.entries)
        )
        styles = [entry.style for entry in content.entries]
        if NEUTRAL_STYLE not in styles:  # a library of one's own
            neutral = LibraryEntry(
                "neutral", (), self._styles[NEUTRAL_STYLE].descriptions[0], style=NEUTRAL_STYLE
            )
            content = replace(content, entries=(*content.entries, neutral))
            styles, stored = [*styles, NEUTRAL_STYLE], None
        embeddings = stored or embed_library(content, self._encoder)
        plain = [i for i, style in enumerate(styles) if style.startswith(NEUTRAL_STYLE)]
        phrases = PhraseIndex(content)
        spelling = Spelling(phrases.known | ENGLISH, embeddings.other_words)
        return _Library(content, embeddings, phrases, spelling, styles.index(NEUTRAL_STYLE), plain)

    @cached_property
    def _languages(self) -> OtherLanguages:
        return OtherLanguages(self._library_path.parent, self._library.content)

    @cached_property
    def _styles(self) -> dict[str, LibraryStyle]:
        return load_styles(self._library_path.with_name("styles.json"))

    @property
    def _library_path(self) -> Path:
        return asset_path("prompts/library.json") if self._path is None else self._path


def _expansion(
    base: PartDescriptions,
    near: tuple[tuple[str, float], ...],
    stated: dict[str, str],
    note: str,
    explicit: bool = False,
) -> Expansion:
    words = {**base.to_mapping(), **stated}
    source: Literal["library", "explicit"] = (
        "explicit" if explicit or len(stated) == len(PART_NAMES) else "library"
    )
    return Expansion(
        PartDescriptions(**words), source, near, note, tuple(p for p in PART_NAMES if p in stated)
    )


def _runs(words: list[Word], left: tuple[int, ...]) -> list[tuple[int, int]]:
    """Stretches (start, end) of neighbouring words of one clause among `left`, those that can name something."""
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


def _saying(words: list[Word], element: Element) -> int:
    return sum(word.says for word in words[element.start : element.end])


def _far(text: str, best: float) -> str:
    return f"“{_short(text)}” says nothing about a body, {best:.0%} like the nearest prompt: neutral."


def _unread_limbs(words: list[Word], reading: Reading, elements: Sequence[Element]) -> str:
    """What is said of a body part that no rule and no phrase took, or ""."""
    taken = {i for e in elements for i in range(e.start, e.end)}
    unread = [
        " ".join(words[i].text for i in range(start, end))
        for start, end in _runs(words, tuple(i for i in reading.left if i not in taken))
        if any(words[i].stem in PLACES for i in range(start, end))
    ]
    return f"Not understood: “{_short('”, “'.join(unread), 60)}”." if unread else ""


def _short(text: str, limit: int = 40) -> str:
    return text if len(text) <= limit else text[: limit - 1] + "…"
