"""Parser for clauses that say what a part does: "left arm hanging", "limping on the right leg", "hands on hips"."""

from __future__ import annotations

import re
from dataclasses import dataclass

from runtime.prompts.english.clause_rules import Rules, grammar
from runtime.prompts.english.sides import OPPOSITE, hand_at, name_sides
from runtime.prompts.english.words import continuous
from runtime.prompts.parts import MAX_CHARACTERS
from runtime.skeleton import PART_NAMES


def take_gestures(text: str) -> tuple[dict[str, str], str]:
    """The arms that gestures in a lower-case prompt move, and the prompt without those gestures.

    The hand is the one that is named, else that of the target's side (across from it on an arm), else the right one.
    """
    rules = grammar()
    parts: dict[str, str] = {}

    def take(match: re.Match[str]) -> str:
        before = re.split(r"[,;.:!?]", text[: match.start()])[-1]
        if rules["gesture_hand_spoken_of"].search(before) or rules["gesture_denied"].search(before):
            return match.group(0)  # a clause about that hand, or a denial
        target = match["target"]
        if target == "head" and match["verb"].startswith("scratch"):
            target = "hair"  # a head is scratched on its top and wiped at its front
        template = str(next(said for names, said in rules.targets if names.fullmatch(target)))
        for side in _matched_sides(match):
            parts.setdefault(f"{side}_arm", template.replace("{s}", side))
        return " , "

    rest = rules["gesture"].sub(take, text)
    return {part: parts[part] for part in PART_NAMES if part in parts}, rest


def _matched_sides(match: re.Match[str]) -> tuple[str, ...]:
    if match["side"] == "both":
        return tuple(OPPOSITE)
    if match["side"] in OPPOSITE:
        return (match["side"],)
    return (hand_at(match["target_side"], match["target"]) if match["target_side"] else "right",)


_LIMBS = ("arm", "leg")
_NAMED = (
    "fist",
    "elbow",
    "nose",
    "heel",
    "toe",
    "hip",
    "chin",
    "shoulder",
    "eye",
    "gaze",
    "palm",
    "forearm",
    "chest",
)  # whose actions are not those of the whole part


@dataclass(frozen=True)
class ParsedPrompt:
    """`parts`: part name → description that the prompt states; `rest`: the prompt without those clauses.

    `side` is the one that somebody "left-handed" prefers, "" where nothing is said of it.
    """

    parts: dict[str, str]
    rest: str
    side: str = ""


def parse_clauses(prompt: str) -> ParsedPrompt:
    """Take the statements about body parts out of a prompt; several on one part are joined."""
    rules = grammar()
    text = rules["both_sides"].sub("both", prompt.lower())
    text = text.replace("left and right", "side to side").replace("’", "'")
    text = continuous(text)
    text = rules["timing"].sub(lambda match: match.group(0) if match["halts"] else "", text)
    text = rules["two_nouns"].sub(r"\g<first> \g<rest>, \g<second> \g<rest>", text)
    text = rules["trunk"].sub("torso", text)
    text, hand = name_sides(text)
    parts, text = take_gestures(text)
    pieces = rules["separators"].split(text)
    denied: set[str] = set()  # parts of which no more is known than what they do not do
    rest: list[str] = []
    for i in range(0, len(pieces), 2):
        found, remainder = _parse_clause(pieces[i].strip())
        denies = bool(rules["denies"].search(pieces[i]))
        if i and rules["except"].search(pieces[i - 1]):
            _take_back(parts, found)
        for part, description in found.items():
            if part not in parts or (part in denied and not denies):
                parts[part] = description
                (denied.add if denies else denied.discard)(part)
            elif not denies:  # "head down, never looks up": what is denied adds nothing to what is said
                parts[part] = _joined(parts[part], description)
        if remainder:
            if rest and i > 0:
                rest.append(pieces[i - 1])
            rest.append(remainder)
    return ParsedPrompt(parts, _tidy("".join(rest)), hand)


def _take_back(parts: dict[str, str], found: dict[str, str]) -> None:
    """Forget what was said of two limbs together where an exception follows: "both arms swing but the right one barely"."""
    for limb in _LIMBS:
        pair = [f"{side}_{limb}" for side in OPPOSITE]
        if sum(part in found for part in pair) == 1 and all(part in parts for part in pair):
            parts.pop(next(part for part in pair if part in found))


def _parse_clause(clause: str) -> tuple[dict[str, str], str]:
    """Parts that a clause describes, and what of it does not."""
    rules = grammar()
    parts: dict[str, str] = {}
    noun = rules["noun_clause"].match(clause)
    if noun:
        stated = _noun_parts(noun, noun["rest"], verbatim=True)
        if stated:
            return stated, ""
    verb = rules["verb_clause"].search(clause)
    if verb:
        before = rules["verb_at_end"].search(clause[: verb.start()])  # "dragging a stiff left leg"
        action = (
            f"{before['verb'] if before else ''} {verb['degree'] or ''}{verb['verb']} {verb['rest']}".strip()
        )
        stated = _noun_parts(verb, action, verbatim=False)
        if stated:
            parts.update(stated)
            clause = _without_denial(clause[: before.start() if before else verb.start()].strip())
    for pattern, target, looked_up in rules.phrases:
        match = pattern.search(clause)
        if match:
            for part, description in _idiom_parts(target, looked_up or match.group(0), match).items():
                parts[part] = _joined(parts.get(part), description)
            clause = f"{clause[: match.start()]} {clause[match.end() :]}".strip()
    return parts, clause


def _noun_parts(match: re.Match[str], action: str, verbatim: bool) -> dict[str, str]:
    """Descriptions of a clause with a part's name; the clause itself where no rule knows its action."""
    rules = grammar()
    noun = match["noun"]
    if rules["no_clause"].search(match["rest"].strip()):
        return {}
    group = next(name for name, group in rules.groups.items() if re.fullmatch(group.nouns, noun))
    # "hands", "feet" and "both" mean two sides; a single limb without a side is the right one
    plural = noun == "feet" or match.string[match.end("noun") : match.end("noun") + 1] == "s"
    owners = match["owners"].split()
    before = match.string[: match.start(2) if match.re.groups > 1 else 0]
    denial = rules["denies"].search(f"{' '.join(before.split()[-3:])} {match['owners']}")
    words = f"{noun} {action}" if noun in _NAMED else action
    stated = _described(group, _sides(owners, plural), f"{denial.group(0)} {words}" if denial else words)
    if stated or not verbatim or not (owners or plural):
        return stated
    singular = "foot" if noun == "feet" else noun
    template = f"{'{s} ' if group in _LIMBS else ''}{singular} {action}"[: MAX_CHARACTERS - 3]
    return _sided(group, _sides(owners, plural), template)


def _idiom_parts(target: str, words: str, match: re.Match[str]) -> dict[str, str]:
    group = {"arms": "arm", "legs": "leg", "one_leg": "leg"}.get(target, target)
    denied = match.groupdict().get("denied") and target != "arms"
    words = f"not {words}" if denied and not grammar()["denies"].search(words) else words
    sides = ("left", "right") if target in ("arms", "legs") else ("right",)
    if target in _LIMBS:
        sides = (match["side"],)
    return _described(group, sides, words)


def _described(group: str, sides: tuple[str, ...], words: str) -> dict[str, str]:
    """The trained sentences for an action of a group's parts, or {} when no rule knows it."""
    rules = grammar()
    found = rules.groups[group]
    if rules["denies"].search(words):
        rest = rules["denies"].sub(" ", words)
        known = _lookup(found.actions, rest) or re.search("mov|leav", rest)
        template = _lookup(found.denied, rest) if known else None
    else:
        template = _lookup(found.actions, words)
    return {} if template is None else _sided(group, sides, template)


def _sides(owners: list[str], plural: bool) -> tuple[str, ...]:
    if "left" in owners or "right" in owners:
        return tuple(side for side in ("left", "right") if side in owners)
    both = plural or {"both", "two", "neither", "either", "no", "any"} & set(owners)
    return ("left", "right") if both else ("right",)


def _sided(group: str, sides: tuple[str, ...], template: str) -> dict[str, str]:
    if group not in _LIMBS:
        return {group: template}
    # str.replace and not format: the user's own words may hold braces
    found = {f"{side}_{group}": template.replace("{s}", side) for side in sides}
    return {part: found[part] for part in PART_NAMES if part in found}


def _joined(old: str | None, new: str) -> str:
    joined = f"{old}, {new}" if old and old != new else new
    return joined if len(joined) <= MAX_CHARACTERS else new


def _lookup(actions: Rules, words: str) -> str | None:
    """The sentence of the first rule that matches, in the degree that the words give it."""
    rules = grammar()
    found = next((text for pattern, text in actions if pattern.search(words)), None)
    if found is None or isinstance(found, str):
        return found
    slightly, plainly, far = found
    if rules["slightly"].search(words):
        return slightly
    return far if rules["far"].search(words) else plainly


def _without_denial(clause: str) -> str:
    return grammar()["denial_at_end"].sub("", clause)


_EVERY_STEP = re.compile(r"^(?:(?:he|she|they|it|and) )*(?:with|at|on) (?:every|each|all) steps?$")


def _tidy(rest: str) -> str:
    rest = re.sub(r"\s+", " ", rest).strip(" ,;.:!?-")
    rest = _EVERY_STEP.sub("", rest)
    rest = re.sub(
        r"(?:(?:^|\s+)(?:and|with|while|but|whose|who|is|has|in|on|the|a|his|her|their))+$", "", rest
    )
    return re.sub(r"^(?:and|with|while|but)\s+", "", rest)
