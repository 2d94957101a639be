"""Parser for clauses that describe a body part: "left arm hanging", "limping on the right leg", "hands on hips"."""

import re
from dataclasses import dataclass

from runtime.prompts.english.grammar import Match, grammar, replaced
from runtime.prompts.english.segments import with_commas
from runtime.prompts.english.sides import OPPOSITE, Known, name_sides, only_side
from runtime.prompts.english.words import continuous, word_set
from runtime.prompts.parts import MAX_CHARACTERS
from runtime.skeleton import PART_NAMES

_LIMBS = ("arm", "leg")
_OF_A_PERSON = word_set("left right both two his her their its my your")  # owners of a limb
_PAIRS = {"arms": "arm", "legs": "leg", "one_leg": "leg"}  # phrase targets and their parts


@dataclass(frozen=True)
class ParsedPrompt:
    """A parsed prompt: `parts` maps part names to stated descriptions; `rest` is the prompt without those clauses.

    `side` is the preferred side of a "left-handed" person, or "".
    """

    parts: dict[str, str]
    rest: str
    side: str = ""


def parse_clauses(prompt: str, known: Known = lambda _: False) -> ParsedPrompt:
    """Split clauses about body parts off a prompt; several about one part are joined. `known`: see `name_sides`."""
    rules = grammar()
    text, hand = name_sides(_plain(prompt), known)
    pieces = rules["separators"].split(with_commas(text))
    leg = only_side(match["side"] for match in rules["sided_leg"].finditer(text)) or "right"
    parts: dict[str, str] = {}
    denied: set[str] = set()  # parts known only by what they do not do
    rest: list[str] = []
    for i in range(0, len(pieces), 2):
        link = pieces[i - 1] if i else ""
        found, remainder = _parse_clause(pieces[i].strip(), leg)
        if rules["except"].search(link):
            _take_back(parts, found)
        _add(parts, found, denied, denies=bool(rules["denies"].search(pieces[i])))
        if remainder:
            rest += [link, remainder] if rest else [remainder]
    return ParsedPrompt(parts, _tidy("".join(rest)), hand)


def _plain(prompt: str) -> str:
    rules = grammar()
    text = rules["both_sides"].sub("both", prompt.lower())
    text = text.replace("left and right", "side to side").replace("’", "'")
    text = rules["timing"].sub(_without_timing, continuous(text))
    text = rules["described_noun"].sub(_without_idle_words, text)
    text = rules["two_nouns"].sub(r"\g<first> \g<rest>, \g<second> \g<rest>", text)
    return rules["trunk"].sub("torso", text)


def _without_timing(match: Match) -> str:
    """Return nothing, or a clause end where another clause follows: "bouncing with each step, knees bent"."""
    if match["halts"]:
        return match.group()
    return "," if grammar()["clause_opening"].match(match.string, match.end() + 1) else ""


def _without_idle_words(match: Match) -> str:
    """Return "his hands" for "his freshly washed hands", unless a rule of the part uses the words before it."""
    rules = grammar()
    group = rules.groups[rules.group_of(match["noun"])]
    told = rules.sentence(group.actions, match["words"]) or rules["told"].search(match["words"])
    return match.group() if told else f"{match['owner']} {match['noun']}"


def _add(parts: dict[str, str], found: dict[str, str], denied: set[str], denies: bool) -> None:
    for part, description in found.items():
        if part not in parts or (part in denied and not denies):
            parts[part] = description
            (denied.add if denies else denied.discard)(part)
        elif not denies:  # "head down, never looks up": a denial adds nothing to a statement
            parts[part] = _joined(parts[part], description)


def _take_back(parts: dict[str, str], found: dict[str, str]) -> None:
    """Drop the description of both limbs if an exception follows: "both arms swing but the right one barely"."""
    for limb in _LIMBS:
        pair = {f"{side}_{limb}" for side in OPPOSITE}
        if pair <= parts.keys() and len(pair & found.keys()) == 1:
            del parts[(pair & found.keys()).pop()]


def _parse_clause(clause: str, leg: str) -> tuple[dict[str, str], str]:
    """Return the parts that a clause describes, and the rest of the clause; `leg` limps if no leg is named."""
    for name in ("noun_clause", "loose_clause"):
        noun = grammar()[name].match(clause)
        # "head teacher", "back pain" do not describe head and back
        if noun and name == "loose_clause" and not set(noun["owners"].split()) & _OF_A_PERSON:
            continue
        if noun and (stated := _noun_parts(noun, noun["rest"], verbatim=name == "noun_clause")):
            return stated, ""
    parts, clause = _verb_parts(clause)
    found: list[tuple[int, dict[str, str]]] = []

    def take(match: Match, rule: tuple[str, str]) -> str:
        found.append((match.start(), _phrase_parts(match, *rule, leg)))
        return ""

    rest = replaced(clause, grammar().phrases, take)
    for _, stated in sorted(found, key=lambda one: one[0]):
        parts |= {part: _joined(parts.get(part), text) for part, text in stated.items()}
    return parts, rest.strip()


def _verb_parts(clause: str) -> tuple[dict[str, str], str]:
    """Return the parts described by a verb before their name, and the clause before it: "a zombie with raised arms"."""
    rules = grammar()
    verb = rules["verb_clause"].search(clause)
    if not verb:
        return {}, clause
    before = rules["verb_at_end"].search(clause[: verb.start()])  # "dragging a stiff left leg"
    words = (before["verb"] if before else "", verb["degree"], verb["verb"], verb["rest"])
    stated = _noun_parts(verb, " ".join(word.strip() for word in words if word), verbatim=False)
    if not stated:
        return {}, clause
    return stated, rules["denial_at_end"].sub("", clause[: (before or verb).start()].strip())


def _noun_parts(match: Match, action: str, verbatim: bool) -> dict[str, str]:
    """Return descriptions from a clause with a part's name; the clause itself if no rule knows its action."""
    rules = grammar()
    noun, owners = match["noun"], match["owners"].split()
    if rules["no_clause"].search(match["rest"].strip()):  # "hand in hand"
        return {}
    group = rules.group_of(noun)
    # "hands", "feet" and "both" mean two sides; a single limb without a side is the right one
    plural = noun == "feet" or match.string[match.end("noun") :].startswith("s")
    sides = _sides(owners, plural)
    own = f"{noun} " if rules["own_actions"].fullmatch(noun) else ""
    stated = _described(group, sides, f"{_denial(match)}{own}{action}")
    if stated or not verbatim or not (owners or plural):
        return stated
    template = f"{'{s} ' if group in _LIMBS else ''}{noun.replace('feet', 'foot')} {action}"
    return _sided(group, sides, template[: MAX_CHARACTERS - 3])


def _denial(match: Match) -> str:
    """Return the denial among a part's owners and the three words before them: "never" in "never moving the arms"."""
    before = match.string[: match.start(2) if match.re.groups > 1 else 0].split()[-3:]
    denial = grammar()["denies"].search(" ".join([*before, match["owners"]]))
    return f"{denial.group()} " if denial else ""


def _phrase_parts(match: Match, target: str, looked_up: str, leg: str) -> dict[str, str]:
    words = looked_up or match.group()
    denied = match.groupdict().get("denied") and target != "arms"
    words = f"not {words}" if denied and not grammar()["denies"].search(words) else words
    side = match["side"] if target in _LIMBS else leg
    return _described(
        _PAIRS.get(target, target), tuple(OPPOSITE) if target in ("arms", "legs") else (side,), words
    )


def _described(group: str, sides: tuple[str, ...], words: str) -> dict[str, str]:
    """Return the trained sentences for an action of a group's parts, or {} if no rule knows it."""
    rules = grammar()
    found = rules.groups[group]
    if rules["denies"].search(words):
        rest = rules["denies"].sub(" ", words)
        known = rules.sentence(found.actions, rest) or re.search("mov|leav|com|touch|reach", rest)
        template = rules.sentence(found.denied, rest) if known else None
    else:
        template = rules.sentence(found.actions, words)
    return {} if template is None else _sided(group, sides, template)


def _sides(owners: list[str], plural: bool) -> tuple[str, ...]:
    named = tuple(side for side in OPPOSITE if side in owners)
    both = plural or {"both", "two", "neither", "either", "no", "any"} & set(owners)
    return named or (tuple(OPPOSITE) if both else ("right",))


def _sided(group: str, sides: tuple[str, ...], template: str) -> dict[str, str]:
    if group not in _LIMBS:
        return {group: template}
    # str.replace, because the user's words may contain braces
    found = {f"{side}_{group}": template.replace("{s}", side) for side in sides}
    return {part: found[part] for part in PART_NAMES if part in found}


def _joined(old: str | None, new: str) -> str:
    joined = f"{old}, {new}" if old and old != new else new
    return joined if len(joined) <= MAX_CHARACTERS else new


def _tidy(rest: str) -> str:
    rest = re.sub(r"\s+", " ", rest).strip(" ,;.:!?-")
    rest = grammar()["loose_end"].sub("", grammar()["every_step"].sub("", rest))
    return re.sub(r"^(?:and|with|while|but)\s+", "", rest)
