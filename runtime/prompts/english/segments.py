"""Where the clauses of a prompt begin, whether or not it has commas.

"chin up chest out arms swinging long strides"   →  "chin up, chest out, arms swinging, long strides"
"head down and turned to the left"               →  "head down, head turned to the left"
"""

from __future__ import annotations

import re

from runtime.prompts.english.grammar import Match, grammar


def with_commas(text: str) -> str:
    """A lower-case prompt with a comma before every clause about a part or a way of stepping."""
    rules = grammar()
    starts = [0]
    for match in rules["clause_opening"].finditer(text):
        begin = max(starts[-1], _last_comma(text, match.start()))
        start = _opens(text[begin : match.start()], match)
        if start is not None and text[begin : begin + start].strip():
            starts.append(begin + start)
    clauses = [text[a:b].strip() for a, b in zip(starts, [*starts[1:], len(text)], strict=True)]
    return rules["same_subject"].sub(_with_subject, "\n".join(clauses))


def _last_comma(text: str, end: int) -> int:
    ends = [found.end() for found in re.finditer(r"[,;.:!?\n]| (?:and|while|with|but) ", text[:end])]
    return max(ends, default=0)


def _opens(before: str, match: Match) -> int | None:
    """Where in `before`, the words of the clause up to a possible opening, a new one begins; None where none does."""
    rules = grammar()
    degree = rules["degree_at_end"].search(before)
    if degree and match["subject"] is None:  # "arms crossed | slightly leaning"
        before = before[: degree.start()]
    words = before.split()
    if not words:
        return None
    if match["subject"] is not None and rules["keeping"].fullmatch(words[-1]):
        return _before_keeping(before, words)
    if rules["no_opening_after"].fullmatch(words[-1]) and not rules["particle_at_end"].search(before.strip()):
        return None
    return _before_posture(before, match) if match["subject"] is None else _before_subject(before, words)


def _before_keeping(before: str, words: list[str]) -> int | None:
    """The same before a verb that keeps a part: "surgeon | holding his hands"."""
    rules, (*earlier, verb) = grammar(), words
    before = before.rstrip().removesuffix(verb)
    if not earlier or rules["noun_at_end"].search(before) or rules["no_opening_after"].fullmatch(earlier[-1]):
        return None
    return len(before)


def _before_posture(before: str, match: Match) -> int | None:
    """The same where a posture, or what a part does, may open the clause."""
    if match["posture"] is None and not grammar()["part"].search(before):
        return None
    noun = grammar()["noun_at_end"].search(before)
    return None if noun and _is_subject(before, noun, match) else len(before)


def _before_subject(before: str, words: list[str]) -> int | None:
    """The same where a part with what it does may open the clause; `words` are those of `before`."""
    rules = grammar()
    last, spoken = words[-1], rules["part"].search(" ".join(words[:-1]))
    verb, other_verb = rules["any_verb"].fullmatch(last), rules["other_verb"].fullmatch(last)
    # "in the pockets |", "the limping left leg"
    if len(words) > 1 and rules["attributive"].fullmatch(words[-2]):
        return None if verb or last.endswith("ing") else len(before)
    if rules["part"].fullmatch(last):
        return len(before)
    if rules["holding"].fullmatch(last):
        return None
    if other_verb and not verb:
        return _before_verb(before, words) if spoken else None
    return len(before) if spoken or not verb else None


def _before_verb(before: str, words: list[str]) -> int | None:
    """The same where the last word opens the clause itself: "head up | sliding the feet along"."""
    if len(words) < 2 or grammar()["part"].fullmatch(words[-2]):
        return None
    return len(before.rstrip()) - len(words[-1])


def _is_subject(before: str, noun: Match, match: Match) -> bool:
    """Whether the part that `before` ends with does what follows: not "on the hip", and in "bent knees looking left" no knee."""
    rules = grammar()
    earlier = before[: noun.start()].strip()
    if rules["object_before"].search(earlier):
        return False
    described = rules["any_verb"].fullmatch(earlier.rpartition(" ")[2])
    return not described or rules["of_part"].fullmatch(f"{noun['noun']} {match.group()}") is not None


def _with_subject(match: Match) -> str:
    return f"{match['clause']}\n{match['subject']} {match['what']}"
