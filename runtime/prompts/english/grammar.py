"""Grammar of explicit statements about body parts in prompts, read from assets/prompts/clauses.toml."""

import re
import tomllib
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cache
from typing import Any

from runtime.assets import asset_path
from runtime.errors import FileError

Sentences = str | tuple[str, str, str]  # one sentence, or those for slightly, plainly and strongly
Rules = tuple[tuple[re.Pattern[str], Sentences], ...]  # unordered: the longest match wins
Match = re.Match[str]


@dataclass(frozen=True)
class Group:
    """A kind of body part: a pattern of its nouns, and the rules for what it does and does not do."""

    nouns: re.Pattern[str]
    actions: Rules
    denied: Rules


class Grammar:
    """The rules of clauses.toml: `groups` by name, `phrases` (pattern, group of the action, what is looked up), and relations.

    Relations are patterns with a replacement, which may use {side}, {other} and the pattern's groups. `before` are applied
    before limbs are assigned sides, `after` afterwards, `things` if the library does not know the thing itself.
    """

    def __init__(self, file: dict[str, Any]) -> None:
        self._sentences: dict[str, str] = file["sentences"]
        self._patterns = {name.upper(): _joined(text) for name, text in file["patterns"].items()}
        names = ("arm", "leg", "torso", "head")
        self._patterns["NOUNS"] = "|".join(file[name]["nouns"] for name in names)
        self.groups = {name: self._group(**file[name]) for name in names}
        self.phrases = [(self._compiled(p), (target, words)) for p, target, words in file["phrases"]["rules"]]
        self.before, self.after, self.things = (
            [(self._compiled(pattern), words) for pattern, words in file["relations"][key]]
            for key in ("before", "after", "things")
        )
        self._found: dict[str, re.Pattern[str]] = {}

    def __getitem__(self, name: str) -> re.Pattern[str]:
        """Return a pattern by its name, compiled at first use."""
        if name not in self._found:
            self._found[name] = self._compiled(self._patterns[name.upper()])
        return self._found[name]

    def said(self) -> set[str]:
        """Return every sentence in the rules, with {s} for the side."""
        rules = (rule for group in self.groups.values() for rule in (*group.actions, *group.denied))
        return {text for _, said in rules for text in ([said] if isinstance(said, str) else said)}

    def group_of(self, noun: str) -> str:
        """Return the name of the group that contains a noun."""
        return next(name for name, group in self.groups.items() if group.nouns.fullmatch(noun))

    def sentence(self, rules: Rules, words: str) -> str | None:
        """Return the sentence of the rule with the longest match, for its degree such as "slightly"."""
        found = [(*_rank(match), said) for pattern, said in rules for match in pattern.finditer(words)]
        said = max(found, key=lambda one: one[:-1])[-1] if found else None
        if said is None or isinstance(said, str):
            return said
        slightly, plainly, far = said
        if self["slightly"].search(words):
            return slightly
        return far if self["far"].search(words) else plainly

    def _group(self, nouns: str, actions: list[list[Any]], denied: list[list[Any]]) -> Group:
        return Group(self._compiled(nouns), self._rules(actions), self._rules(denied))

    def _rules(self, rules: list[list[Any]]) -> Rules:
        return tuple((self._compiled(pattern), self._named(said)) for pattern, said in rules)

    def _named(self, said: Any) -> Any:
        """Return named sentences by their names; an unknown name is itself the sentence."""
        return self._sentences.get(said, said) if isinstance(said, str) else tuple(map(self._named, said))

    def _compiled(self, pattern: str) -> re.Pattern[str]:
        text = _joined(pattern)
        while re.search("%[A-Z_0-9]+%", text):
            text = re.sub("%([A-Z_0-9]+)%", lambda match: self._patterns[match[1]], text)
        return re.compile(text, re.IGNORECASE)


@cache
def grammar() -> Grammar:
    """Return the shipped rules; FileError if their file is damaged."""
    path = asset_path("prompts/clauses.toml")
    try:
        return Grammar(tomllib.loads(path.read_text("utf-8")))
    except (OSError, ValueError, KeyError, TypeError, re.error) as error:
        problem = f"{path}: not readable as the rules of clauses ({error})."
        raise FileError(problem, "Restore the file.") from error


def replaced(
    text: str, rules: Iterable[tuple[re.Pattern[str], Any]], words: Callable[[Match, Any], str | None]
) -> str:
    """Replace matches of the rules by `words` (None: keep the match); of overlapping matches the longest wins.

    A group named "start" is context: it is matched and kept.
    """
    found = [(match, rule) for pattern, rule in rules for match in pattern.finditer(text) if match.group()]
    found.sort(key=lambda one: _rank(one[0]), reverse=True)
    taken: list[tuple[int, int, str]] = []
    for match, rule in found:
        start, end = _start(match), match.end()
        if all(end <= s or start >= e for s, e, _ in taken):
            new = words(match, rule)
            if new is not None:
                taken.append((start, end, new))
    for start, end, new in sorted(taken, reverse=True):
        text = text[:start] + new + text[end:]
    return text


def _start(match: Match) -> int:
    return match.end("start") if "start" in match.re.groupindex else match.start()


def _rank(match: Match) -> tuple[int, int, int, str]:
    """Return the sort key of matches: longer first, then earlier, then longer pattern."""
    start = _start(match)
    return match.end() - start, -start, len(match.re.pattern), match.re.pattern


def _joined(pattern: str) -> str:
    """Return a pattern without the file's line breaks."""
    return re.sub(r"\n *", "", f"\n{pattern}")
