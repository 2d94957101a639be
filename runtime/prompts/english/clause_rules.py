"""The rules by which a prompt says outright what a body part does, read from assets/prompts/clauses.toml."""

from __future__ import annotations

import re
import tomllib
from dataclasses import dataclass
from functools import cache
from typing import Any

from runtime.assets import asset_path
from runtime.errors import FileError

Sentences = str | tuple[str, str, str]  # one, or slightly, plainly and far
Rules = tuple[tuple[re.Pattern[str], Sentences], ...]  # searched in order, the first match counts


@dataclass(frozen=True)
class Group:
    """A kind of body part: its nouns as a pattern, what it does and what it does when that is denied."""

    nouns: str
    actions: Rules
    denied: Rules


class Grammar:
    """The rules of a file: `groups` by name, `phrases` (pattern, whose action, what is looked up), `targets` of gestures.

    `relations` are patterns and the clauses that they stand for, with {side}, {other} and the pattern's groups;
    `first_relations` are those that name a hand, to which "the other" may refer.
    """

    def __init__(self, file: dict[str, Any]) -> None:
        self._sentences: dict[str, str] = file["sentences"]
        self._patterns = {name.upper(): _joined(text) for name, text in file["patterns"].items()}
        names = ("arm", "leg", "torso", "head")
        self._patterns["NOUNS"] = "|".join(file[name]["nouns"] for name in names)
        self._patterns["TARGETS"] = "|".join(text for text, _ in file["gestures"]["targets"])
        self.groups = {
            name: Group(file[name]["nouns"], *(self._rules(file[name][key]) for key in ("actions", "denied")))
            for name in names
        }
        self.phrases = [(self._compiled(p), target, asked) for p, target, asked in file["phrases"]["rules"]]
        self.targets = self._rules(file["gestures"]["targets"])
        self.first_relations, self.relations = (
            [(self._compiled(pattern), clauses) for pattern, clauses in file["relations"][key]]
            for key in ("first", "rules")
        )
        self._found: dict[str, re.Pattern[str]] = {}

    def __getitem__(self, name: str) -> re.Pattern[str]:
        """A pattern by its name, compiled at first use."""
        if name not in self._found:
            self._found[name] = self._compiled(self._patterns[name.upper()])
        return self._found[name]

    def _rules(self, rules: list[list[Any]]) -> Rules:
        return tuple((self._compiled(pattern), self._sentences_of(said)) for pattern, said in rules)

    def _sentences_of(self, said: Any) -> Any:
        """Sentences in place of their names; a sentence without a name is its own."""
        return (
            self._sentences.get(said, said) if isinstance(said, str) else tuple(map(self._sentences_of, said))
        )

    def _compiled(self, pattern: str) -> re.Pattern[str]:
        text = _joined(pattern)
        while re.search("%[A-Z_0-9]+%", text):
            text = re.sub("%([A-Z_0-9]+)%", lambda match: self._patterns[match[1]], text)
        return re.compile(text, re.IGNORECASE)


@cache
def grammar() -> Grammar:
    """The shipped rules; FileError when their file is damaged."""
    path = asset_path("prompts/clauses.toml")
    try:
        return Grammar(tomllib.loads(path.read_text("utf-8")))
    except (OSError, ValueError, KeyError, TypeError, re.error) as error:
        raise FileError(
            f"{path}: not readable as the rules of clauses ({error}).", "Restore the file."
        ) from error


def _joined(pattern: str) -> str:
    """A pattern without the line ends at which the file wraps it."""
    return re.sub(r"\n *", "", f"\n{pattern}")
