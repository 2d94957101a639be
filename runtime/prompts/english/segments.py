"""Finds where the clauses of a prompt begin, with or without commas.

"chin up chest out arms swinging long strides"   →  "chin up, chest out, arms swinging, long strides"
"head down and turned to the left"               →  "head down, head turned to the left"
"""

import re

from runtime.prompts.english.grammar import Match, grammar


def with_commas(text: str) -> str:
    """Return a lower-case prompt with a comma before every clause about a part or a way of stepping."""
    rules = grammar()
    starts = [0]
    for match in rules["clause_opening"].finditer(text):
        begin = max(starts[-1], _last_comma(text, match.start()))
        start = _opens(text[begin : match.start()], match)
        if start is not None and text[begin : begin + start].strip():
            starts.append(begin + start)
    clauses = [text[a:b].strip() for a, b in zip(starts, [*starts[1:], len(text)], strict=True)]
    return rules["same_subject"].sub(r"\g<clause>\n\g<subject> \g<what>", "\n".join(clauses))


def _last_comma(text: str, end: int) -> int:
    ends = [found.end() for found in re.finditer(r"[,;.:!?\n]| (?:and|while|with|but) ", text[:end])]
    return max(ends, default=0)


def _opens(before: str, match: Match) -> int | None:
    """Return where in `before`, the text up to a possible clause start, a clause begins; None if none does."""
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
    """Return where a clause begins before a verb that holds a part: "surgeon | holding his hands"."""
    rules, (*earlier, verb) = grammar(), words
    before = before.rstrip().removesuffix(verb)
    if not earlier or rules["noun_at_end"].search(before) or rules["no_opening_after"].fullmatch(earlier[-1]):
        return None
    return len(before)


def _before_posture(before: str, match: Match) -> int | None:
    """Return where a clause begins with a posture, or with a part's action."""
    if match["posture"] is None and not grammar()["part"].search(before):
        return None
    noun = grammar()["noun_at_end"].search(before)
    return None if noun and _is_subject(before, noun, match) else len(before)


def _before_subject(before: str, words: list[str]) -> int | None:
    """Return where a clause begins with a part and its action; `words` are those of `before`."""
    rules = grammar()
    last = words[-1]
    verb = rules["any_verb"].fullmatch(last)
    # "in the pockets |", "the limping left leg"
    if rules["attributive"].fullmatch("".join(words[-2:-1])):
        return None if verb or last.endswith("ing") else len(before)
    if rules["part"].fullmatch(last):
        return len(before)
    if rules["holding"].fullmatch(last):
        return None
    return _before_verb(before, words) if verb or rules["other_verb"].fullmatch(last) else len(before)


def _before_verb(before: str, words: list[str]) -> int | None:
    """Return where a clause begins at a verb after a part: before an unusual verb, as in "head up | sliding the feet along"."""
    rules, (*earlier, verb) = grammar(), words
    if not rules["part"].search(" ".join(earlier)):
        return None
    if rules["any_verb"].fullmatch(verb):
        return len(before)
    return None if rules["part"].fullmatch(earlier[-1]) else len(before.rstrip()) - len(verb)


def _is_subject(before: str, noun: Match, match: Match) -> bool:
    """Return whether the part at the end of `before` does what follows, unlike the knee in "bent knees looking left"."""
    rules = grammar()
    earlier = before[: noun.start()].strip()
    if rules["object_before"].search(earlier):
        return False
    described = rules["any_verb"].fullmatch(earlier.rpartition(" ")[2])
    return not described or rules["of_part"].fullmatch(f"{noun['noun']} {match.group()}") is not None
