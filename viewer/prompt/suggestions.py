"""What to suggest while a prompt is typed: pure functions over the library's prompts and the user's own."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

MAX_HISTORY = 50
MAX_SUGGESTIONS = 7
MAX_RECENT = 2  # of the user's own among the suggestions for typed words
MIN_NEAR = 2  # lines kept for prompts that mean the like, where there are any
MIN_SIMILARITY = 0.3  # cosine; less alike is no suggestion


@dataclass(frozen=True)
class Suggestion:
    """One line of the list; `similarity` is a cosine for those found by meaning."""

    text: str
    recent: bool = False
    similarity: float | None = None


def suggest(
    typed: str,
    prompts: Sequence[str],
    history: Sequence[str] = (),
    near: Iterable[tuple[str, float]] = (),
) -> tuple[Suggestion, ...]:
    """Suggestions for what is typed: own prompts, then those that begin so, have these words, or mean the like.

    Without typed words the latest own prompts.
    """
    if not typed.strip():
        return tuple(Suggestion(text, recent=True) for text in history[:MAX_SUGGESTIONS])
    found: dict[str, Suggestion] = {}

    def add(suggestion: Suggestion) -> None:
        key = _folded(suggestion.text)
        if key != _folded(typed):
            found.setdefault(key, suggestion)

    alike = [pair for pair in sorted(near, key=lambda pair: -pair[1]) if pair[1] >= MIN_SIMILARITY]
    for text in matching(typed, history)[:MAX_RECENT]:
        add(Suggestion(text, recent=True))
    for text in matching(typed, prompts)[: MAX_SUGGESTIONS - min(len(alike), MIN_NEAR)]:
        add(Suggestion(text))
    for text, similarity in alike:
        add(Suggestion(text, similarity=similarity))
    return tuple(found.values())[:MAX_SUGGESTIONS]


def matching(typed: str, prompts: Iterable[str]) -> list[str]:
    """Prompts that begin with what is typed, then those in which each typed word begins a word; in their own order."""
    start, words = _folded(typed), _folded(typed).split()
    begin, within = [], []
    for prompt in prompts:
        folded = _folded(prompt)
        if folded.startswith(start):
            begin.append(prompt)
        elif words and all(f" {word}" in f" {folded}" for word in words):
            within.append(prompt)
    return begin + within


def remember(history: Sequence[str], prompt: str) -> list[str]:
    """The history with a prompt in front, once, and no longer than `MAX_HISTORY`."""
    prompt = " ".join(prompt.split())
    if not prompt:
        return list(history)
    others = [text for text in history if _folded(text) != _folded(prompt)]
    return [prompt, *others][:MAX_HISTORY]


def _folded(text: str) -> str:
    return " ".join(text.casefold().split())
