"""Prompts without key or network: part clauses are parsed, the rest comes from the nearest library entries."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from runtime.assets import asset_path
from runtime.prompts.clauses import is_filler, parse_clauses
from runtime.prompts.expander import Expansion, check_prompt
from runtime.prompts.library_data import (
    NEUTRAL_STYLE,
    LibraryEmbeddings,
    LibraryEntry,
    Style,
    embed_library,
    library_hash,
    load_embeddings,
    load_library,
    load_styles,
)
from runtime.prompts.parts import PartDescriptions
from runtime.prompts.text_encoder import TextEncoderLike
from runtime.skeleton import PART_NAMES

# Cosine similarities of prompts, set on the examples of tests/test_prompts.py.
SAME = 0.97  # the prompt is the entry's, clauses included
NEAR = 0.62  # the best entry is taken whole
FAR = 0.40  # below, the prompt says nothing about a way of moving
NEIGHBOURS = 4  # entries that vote for each part in between
TEMPERATURE = 0.06  # of the softmax over their similarities
SECOND_GAIN = 0.06  # rise of the cosine that makes a second entry worth mixing in: "a depressed robot"
MOOD_PARTS = ("torso", "head")  # posture tells a mood, limbs tell a character


@dataclass(frozen=True)
class _Library:
    entries: tuple[LibraryEntry, ...]
    embeddings: LibraryEmbeddings
    neutral: PartDescriptions


class LibraryExpander:
    """Expands prompts by the library at `library_path` (with styles.json and library.npz beside it).

    Files are read at the first `expand`; without fitting stored embeddings they are computed then.
    """

    def __init__(self, encoder: TextEncoderLike, library_path: Path | None = None) -> None:
        self._encoder = encoder
        self._path = library_path

    def expand(self, prompt: str) -> Expansion:
        """Six descriptions for any prompt; PromptError when it is empty, over-long or has control characters."""
        prompt = check_prompt(prompt)
        ranked = self._rank(prompt)
        if ranked[0][1] >= SAME and _sides(prompt) == _sides(self._library.entries[ranked[0][0]].prompt):
            return _expansion(self._library.entries[ranked[0][0]].descriptions, self._near(ranked), {}, "")
        parsed = parse_clauses(prompt)
        if is_filler(parsed.rest):
            if parsed.parts:
                return _expansion(self._library.neutral, (), parsed.parts, "", explicit=True)
            return _expansion(self._library.neutral, (), {}, "The prompt names no style: neutral.")
        if parsed.parts:
            ranked = self._rank(parsed.rest)
        best = ranked[0][1]
        near = self._near(ranked)
        if best < FAR:
            note = f"Nothing in the library is like “{_short(parsed.rest)}” ({best:.2f}): neutral."
            return _expansion(self._library.neutral, near, parsed.parts, note)
        mixed = self._mixed(parsed.rest, *ranked[0])
        if mixed is not None:
            return _expansion(mixed[0], near, parsed.parts, mixed[1])
        if best >= NEAR:
            return _expansion(self._library.entries[ranked[0][0]].descriptions, near, parsed.parts, "")
        note = f"Composed from the nearest prompts; the best is only {best:.2f} like it."
        return _expansion(self._compose(ranked[:NEIGHBOURS]), near, parsed.parts, note)

    @property
    def ready_prompts(self) -> tuple[str, ...]:
        """The training styles' prompts, for a list to choose from."""
        return tuple(style.prompt for style in self._styles.values())

    def nearest(self, text: str) -> tuple[tuple[str, float], ...]:
        """The library's prompts most like `text`, with their cosine similarity, best first; takes milliseconds."""
        return self._near(self._rank(check_prompt(text)))

    def _rank(self, text: str) -> list[tuple[int, float]]:
        """(entry, cosine similarity) of the nearest entries, best first; an entry counts by its best prompt."""
        embeddings = self._library.embeddings
        similarity = embeddings.prompts @ self._encoder.encode([text])[0]
        by_entry = np.full(len(self._library.entries), -1.0, np.float32)
        np.maximum.at(by_entry, embeddings.entry_of, similarity)
        order = np.argsort(-by_entry, kind="stable")[: NEIGHBOURS + 1]
        return [(int(i), float(np.clip(by_entry[i], -1.0, 1.0))) for i in order]

    def _near(self, ranked: list[tuple[int, float]]) -> tuple[tuple[str, float], ...]:
        return tuple((self._library.entries[i].prompt, similarity) for i, similarity in ranked)

    def _mixed(self, text: str, first: int, similarity: float) -> tuple[PartDescriptions, str] | None:
        """A mood on a character with a note, where the two together say clearly more of `text` than `first`."""
        entries = self._library.entries
        second, joint = self._best_partner(text, first, similarity)
        if joint < max(similarity + SECOND_GAIN, NEAR):
            return None
        mood, character = sorted((entries[first], entries[second]), key=lambda e: not e.mood)
        if character.descriptions in self._plain:  # "an angry man": a man walks no way of his own
            return mood.descriptions, f"Taken as “{mood.prompt}”."
        mixed = character.descriptions
        for part in MOOD_PARTS:
            mixed = mixed.replace(part, getattr(mood.descriptions, part))
        return mixed, f"“{character.prompt}” with torso and head of “{mood.prompt}”."

    def _best_partner(self, text: str, first: int, s1: float) -> tuple[int, float]:
        """Entry that best completes `first` for `text`, and the cosine of `text` with the plane of both."""
        embeddings, entries = self._library.embeddings, self._library.entries
        query = self._encoder.encode([text])[0]
        own = np.flatnonzero(embeddings.entry_of == first)
        e1 = embeddings.prompts[own[np.argmax(embeddings.prompts[own] @ query)]]
        s2, c = embeddings.prompts @ query, embeddings.prompts @ e1
        plane = np.sqrt(np.maximum(s1**2 + s2**2 - 2 * s1 * s2 * c, 0) / np.maximum(1 - c**2, 0.05))
        mood = np.array([entry.mood for entry in entries])[embeddings.entry_of]
        # both must point towards the text, and one be a mood, the other a character
        useless = (s2 < FAR) | (s2 < s1 * c) | (s1 < s2 * c) | (mood == entries[first].mood)
        plane = np.where(useless, 0.0, plane)
        best = int(np.argmax(plane))
        return int(embeddings.entry_of[best]), float(plane[best])

    def _compose(self, ranked: list[tuple[int, float]]) -> PartDescriptions:
        """For each part the neighbour's words that the neighbours, weighted by their similarity, agree on most."""
        indices = [i for i, _ in ranked]
        weights = softmax(np.array([s for _, s in ranked], np.float32) / TEMPERATURE)
        vectors = self._library.embeddings.parts[indices]  # (k, 6, D)
        words = {}
        for p, part in enumerate(PART_NAMES):
            agreement = weights * (vectors[:, p] @ (vectors[:, p].T @ weights))
            winner = indices[int(np.argmax(agreement))]
            words[part] = getattr(self._library.entries[winner].descriptions, part)
        return PartDescriptions(**words)

    @cached_property
    def _library(self) -> _Library:
        path = self._library_path
        entries = load_library(path, self._styles)
        digest = library_hash(path, path.with_name("styles.json"))
        stored = load_embeddings(path.with_suffix(".npz"), digest, self._encoder, len(entries))
        neutral = self._styles[NEUTRAL_STYLE].descriptions[0]
        return _Library(entries, stored or embed_library(entries, self._encoder), neutral)

    @cached_property
    def _plain(self) -> frozenset[PartDescriptions]:
        """Descriptions of people who walk in no way in particular."""
        plain = [s.descriptions[0] for name, s in self._styles.items() if name.startswith(NEUTRAL_STYLE)]
        return frozenset(plain)

    @cached_property
    def _styles(self) -> dict[str, Style]:
        return load_styles(self._library_path.with_name("styles.json"))

    @property
    def _library_path(self) -> Path:
        return asset_path("prompts/library.json") if self._path is None else self._path


def softmax(x: NDArray[np.float32]) -> NDArray[np.float32]:
    """Softmax over the last axis."""
    e = np.exp(x - x.max(axis=-1, keepdims=True))
    return np.asarray(e / e.sum(axis=-1, keepdims=True), np.float32)


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


def _sides(text: str) -> set[str]:
    """Left and right, which sentence embeddings hardly tell apart."""
    return {"left", "right"} & set(text.lower().replace(",", " ").split())


def _short(text: str, limit: int = 40) -> str:
    return text if len(text) <= limit else text[: limit - 1] + "…"
