"""Parser for clauses that say what a part does: "left arm hanging", "limping on the right leg", "hands on hips"."""

from __future__ import annotations

import re
from dataclasses import dataclass

from runtime.prompts import clause_rules as rules
from runtime.prompts.parts import MAX_CHARACTERS
from runtime.skeleton import PART_NAMES

_GROUPS = (
    ("arm", rules.ARM_NOUNS, rules.ARM_ACTIONS),
    ("leg", rules.LEG_NOUNS, rules.LEG_ACTIONS),
    ("torso", rules.TORSO_NOUNS, rules.TORSO_ACTIONS),
    ("head", rules.HEAD_NOUNS, rules.HEAD_ACTIONS),
)
_NOUNS = "|".join(nouns for _, nouns, _ in _GROUPS)
_OWNERS = r"(?:his|her|their|the|its|my|your|a|an|one|both|left|right|two)"
_CLAUSE_START = (
    rf"(?:{_OWNERS}\b|(?:{_NOUNS})s?\b|(?:{rules.LEADING_VERBS})\b|look|lean|limp|hunch|crouch|no |on )"
)
_POSTURE_VERBS = r"(?:looking|looks|staring|gazing|leaning|limping|hobbling|dragging)"
# "and" separates clauses only where a new one begins, so that "up and down" stays whole
_SEPARATOR = rf"\s*[,;.:!?\n]+\s*|(?<!limping)(?<!hobbling)(?<!limps)\s+(?:with|while|but|whose)\s+|\s+and\s+(?={_CLAUSE_START})|\s+(?={_POSTURE_VERBS}\b)"
_NOUN_CLAUSE = (
    rf"^(?:(?:with|and|has|having|keeping|holding|keeps|holds)\s+)?"
    rf"(?P<owners>(?:{_OWNERS}\s+)*)(?P<noun>{_NOUNS})s?\s+(?P<rest>(?:\w+ing|\w+ed|{rules.FOLLOWING_WORDS})\b.*)$"
)
_VERB_CLAUSE = (
    rf"\b(?P<verb>{rules.LEADING_VERBS})\s+(?P<owners>(?:{_OWNERS}\s+)*)(?P<noun>{_NOUNS})s?\b(?P<rest>.*)$"
)


@dataclass(frozen=True)
class ParsedPrompt:
    """`parts`: part name → description that the prompt states; `rest`: the prompt without those clauses."""

    parts: dict[str, str]
    rest: str


def parse_clauses(prompt: str) -> ParsedPrompt:
    """Take the statements about body parts out of a prompt; several on one part are joined."""
    text = rules.compiled(rf"\bleft and right(?=\s+(?:{_NOUNS}))").sub("both", prompt.lower())
    text = text.replace("left and right", "side to side")
    pieces = rules.compiled(f"({_SEPARATOR})").split(text)
    parts: dict[str, str] = {}
    rest: list[str] = []
    for i in range(0, len(pieces), 2):
        found, remainder = _parse_clause(pieces[i].strip())
        for part, description in found.items():
            parts[part] = _joined(parts.get(part), description)
        if remainder:
            if rest and i > 0:
                rest.append(pieces[i - 1])
            rest.append(remainder)
    return ParsedPrompt(parts, _tidy("".join(rest)))


def _parse_clause(clause: str) -> tuple[dict[str, str], str]:
    parts: dict[str, str] = {}
    noun = rules.compiled(_NOUN_CLAUSE).match(clause)
    if noun:
        stated = _noun_parts(noun, noun["rest"], verbatim=True)
        if stated:
            return stated, ""
    for pattern, target, words in rules.IDIOMS:
        match = rules.compiled(pattern).search(clause)
        if match:
            for part, description in _idiom_parts(target, words or match.group(0), match).items():
                parts[part] = _joined(parts.get(part), description)
            clause = f"{clause[: match.start()]} {clause[match.end() :]}".strip()
    verb = rules.compiled(_VERB_CLAUSE).search(clause)
    if verb:
        stated = _noun_parts(verb, f"{verb['verb']} {verb['rest']}", verbatim=False)
        if stated:
            parts.update(stated)
            clause = clause[: verb.start()].strip()
    return parts, clause


def _noun_parts(match: re.Match[str], action: str, verbatim: bool) -> dict[str, str]:
    """Descriptions of a clause with a part's name; the clause itself where no rule knows its action."""
    noun = match["noun"]
    group, _, actions = next(g for g in _GROUPS if re.fullmatch(g[1], noun))
    template = _lookup(actions, f"{noun} {action}" if noun == "fist" else action)
    if template is None:
        if not verbatim:
            return {}
        singular = "foot" if noun == "feet" else noun
        template = f"{'{s} ' if group in ('arm', 'leg') else ''}{singular} {action}"[: MAX_CHARACTERS - 3]
    if group in ("torso", "head"):
        return {group: template}
    # "hands", "feet" and "both" mean two sides; a single limb without a side is the right one
    plural = noun == "feet" or match.string[match.end("noun") : match.end("noun") + 1] == "s"
    return _sided(group, _sides(match["owners"], plural), template)


def _idiom_parts(target: str, words: str, match: re.Match[str]) -> dict[str, str]:
    group = {"arms": "arm", "legs": "leg", "one_leg": "leg"}.get(target, target)
    template = _lookup(next(actions for name, _, actions in _GROUPS if name == group), words)
    if template is None:
        return {}
    if target in ("torso", "head"):
        return {target: template}
    if target in ("arms", "legs"):
        return _sided(group, ("left", "right"), template)
    return _sided(group, ("right",) if target == "one_leg" else (match["side"],), template)


def _sides(owners: str, plural: bool) -> tuple[str, ...]:
    words = owners.split()
    if "left" in words or "right" in words:
        return tuple(side for side in ("left", "right") if side in words)
    return ("left", "right") if plural or "both" in words or "two" in words else ("right",)


def _sided(group: str, sides: tuple[str, ...], template: str) -> dict[str, str]:
    # str.replace and not format: the user's own words may hold braces
    found = {f"{side}_{group}": template.replace("{s}", side) for side in sides}
    return {part: found[part] for part in PART_NAMES if part in found}


def _joined(old: str | None, new: str) -> str:
    joined = f"{old}, {new}" if old and old != new else new
    return joined if len(joined) <= MAX_CHARACTERS else new


def _lookup(actions: tuple[tuple[str, str], ...], words: str) -> str | None:
    return next((text for pattern, text in actions if rules.compiled(pattern).search(words)), None)


def _tidy(rest: str) -> str:
    rest = re.sub(r"\s+", " ", rest).strip(" ,;.:!?-")
    rest = re.sub(r"(?:\s+(?:and|with|while|but|whose|who|is|has|in|on|the|a|his|her|their))+$", "", rest)
    return re.sub(r"^(?:and|with|while|but)\s+", "", rest)


def is_filler(rest: str) -> bool:
    """Whether what is left of a prompt names no style: "", "a person", "someone walking"."""
    filler = rules.FILLER_WORDS.split()
    return all(word in filler for word in re.findall(r"[^\W_]+", rest.lower()))
