"""Sides and relations: which limb a prompt speaks of, and the library's entries on that side.

`name_sides` puts every side in so many words before the clauses are read:

    "one hand on the left hip, the other arm hanging"   →  "left hand on the left hip, right arm hanging"
    "raises the right arm and limps on the opposite leg" →  "... right arm and limps on the left leg"
    "favouring the right leg"                            →  "limping on the right leg"

Words of such relations that stand for one action (weight, injuries, loads) are rules of assets/prompts/clauses.toml.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

from runtime.prompts.english.clause_rules import grammar
from runtime.prompts.english.library_data import LibraryEntry
from runtime.prompts.english.words import PART_WORDS, Word, word_set
from runtime.prompts.parts import PartDescriptions
from runtime.skeleton import PART_NAMES

OPPOSITE = {"left": "right", "right": "left"}
_ARM = "arm|hand|fist|elbow|wrist|palm|forearm|finger"
_LEG = "leg|foot|feet|knee|thigh|ankle|heel|toe|shin|calf"
_OF_ARM = re.compile(_ARM)
# "L arm up, r. hand in the pocket"
_ABBREVIATED = re.compile(rf"\b(?P<side>[lr])\.? (?=(?:upper ?arm|shoulder|hip|{_ARM}|{_LEG})s?\b)")
_HANDED = re.compile(r"\b(?:(?P<side>left|right)[- ]?hand(?:ed|er)|(?P<southpaw>southpaw|lefty))\b")
# "sword arm dangling": the right one of somebody right-handed
_BY_USE = re.compile(
    r"(?<!left )(?<!right )\b(?:(?P<leading>sword|gun|throwing|dominant|weapon|bowling|pitching|writing)|shield|non-?dominant|weak)"
    r"[- ](?P<limb>arm|hand)\b"
)
# "a hand ..., the left one"; "the hand of the same side"; "a peg leg on the right": the side comes after its limb
_SIDE_BEHIND = re.compile(
    rf"\b(?P<words>(?:(?:one|a|an|the|his|her|their|its) )+(?:(?!left|right)\w+ )?)(?P<limb>(?:{_ARM}|{_LEG}|shoulder|hip))\b"
    r"(?P<between>(?:[^,;.:!?]*,)?) "
    r"(?:(?:the|his|her|their) (?P<one>left|right) one"
    r"|(?:of|on) (?:the|his|her|their) (?P<relation>same|other|opposite) side"
    r"|on (?:the|his|her|their) (?P<side>left|right)(?= side\b| *(?:[,;.:!?]|$)| and\b)(?: side)?)"
)
_LIMB = re.compile(
    r"(?P<place>\b(?:on|over|behind|under|at|to|against|across|near|beside|above|around|of|from|"
    r"hold(?:s|ing)|grip(?:s|ping)|clutch(?:es|ing)) )?"
    r"(?P<owners>(?:\b(?:the|a|an|his|her|their|its|my|your|one|both|two|each|other|opposite|same|left|right|own) )*)"
    rf"(?:(?<=\bone )|(?<=\bother )|(?<=\bsame )|(?<=\bopposite )|(?<=\bleft )|(?<=\bright )|(?=(?:{_ARM}|{_LEG})s?\b))"
    rf"(?P<adjective>(?!(?:{_ARM}|{_LEG})s?\b)(?!on\b|in\b|at\b|to\b|of\b|and\b|is\b|hip|should|side)\w+ )?"
    rf"\b(?P<limb>(?:{_ARM}|{_LEG}))(?P<plural>s)?\b"
)
_BARE = (  # "the other hanging"; "right hand up, left down"; "her left hangs"
    r"\b(?:the (?:other|opposite)(?: one)?|(?:the )?(?P<one>left|right) one)(?= (?:\w+ing|\w+ed|%(verbs)s)\b)"
    r"|(?:^|(?<=[,;.:] )|(?<=(?<!left )(?<!right )\band )|(?<=\bwhile )|(?<=\bbut )|(?<=\bbecause )|(?<=\bsince ))"
    r"(?P<whose>(?:the|his|her|their) )?(?P<bare>left|right)(?= (?:\w+ing|\w+ed|%(verbs)s)\b)"
)
_THAT = (
    r"\b(?P<that>(?:that|the same) (?=(?:side|shoulder|hip|knee|ear|pocket)\b))"  # of the limb spoken of last
)
# "gesturing with the left"
_WITH_SIDE = re.compile(
    r"\b(?:(?P<kick>kick|stomp|stamp|hop|step|limp)|gestur|gesticulat|wav|point|hold|carr|push|pull|punch|shield|reach|grab|"
    r"touch|support|cover|rub|greet|salut|clutch|grop)\w* (?:[^,;.:!?]* )?"
    r"with (?:(?:the|his|her|their) )?(?:left|right|other)(?= *(?:[,;.:!?]|$| and\b| while\b))"
)
_OF_LEGS = re.compile(r" (?:limp|drag|stomp|stamp|kick|step|shuffl)")
_RELATIVE = ("one", "other", "opposite", "same")  # words that name a side by another
_EACH_OTHER = re.compile(r" (?:before|in front of|after|behind|over|across) the other\b")  # both, in turn
_IN_LINE = re.compile(r"\bone (?:foot|leg)(?=(?: \w+){0,3} (?:in front of|before) the other\b)")
_CLAUSE_END = re.compile(r"[,;.:!?]| and | while | with | but ")
_SAME_SIDE = r"hip|thigh|pocket|waist|side|knee|ear|eye|temple|cheek|breast|chest"
_OTHER_SIDE = r"shoulder|arm|elbow|wrist|hand|forearm|armpit"
_PLACE = re.compile(
    rf"\b(?P<side>left|right) (?:(?P<same>{_SAME_SIDE})|(?P<across>{_OTHER_SIDE}))\b"
    r"|\b(?:to|towards?|on) (?:the|his|her|their) (?P<direction>left|right)\b"
)
# "right hand on the left shoulder, left hand on the right": what the second rests on is the first's
_ELLIPSIS = re.compile(
    rf"(?P<first>\b(?:on|at|over) (?:the |his |her |their )?(?:left|right) (?P<noun>{_SAME_SIDE}|{_OTHER_SIDE})\b.*?"
    r"\b(?:on|at|over) (?:the |his |her |their )?(?:left|right))(?= *(?:[,;.:!?]|$))"
)
_SIDED_NOUNS = word_set(
    "arm hand elbow shoulder wrist leg foot feet knee hip ankle side thigh heel toe collarbone"
)
_IDLE_ARM = re.compile(
    r"\bbehind the back\b|\bhanging\b(?!.*\bpulled\b)|\bswinging (?:naturally|gently|little|lightly|evenly)"
)
_BUSY_LEG = re.compile(
    r"limping|dragging|trailing|hopping|springing off|off the ground|stiff and straight|low kick|hanging"
)


@dataclass
class _Spoken:
    """The limb that was spoken of last: "arm" or "leg" with its noun and side."""

    noun: str = "arm"
    side: str = "right"
    named: bool = False  # whether a limb was spoken of at all

    @property
    def is_arm(self) -> bool:
        return _OF_ARM.fullmatch(self.noun) is not None


def name_sides(prompt: str) -> tuple[str, str]:
    """A lower-case prompt with the side of each limb before its noun, and the side that it prefers ("left-handed"), or
    that carries something, or "".

    A single limb of which nothing tells the side stays as it is; it is read as the right one.
    """
    handed = _HANDED.search(prompt)
    hand = (handed["side"] or "left") if handed else ""
    text = _HANDED.sub("", prompt) if handed else prompt
    text = _ABBREVIATED.sub(lambda found: "left " if found["side"] == "l" else "right ", text)
    text = re.sub(rf"\b(left|right) (?:arm|leg)'s (?=(?:{_ARM}|{_LEG})s?\b)", r"\1 ", text)
    text = re.sub(rf"\beach ((?:{_ARM}|{_LEG}))\b", r"both \1s", text).replace("foots", "feet")
    text = _BY_USE.sub(
        lambda found: (
            f"{(hand or 'right') if found['leading'] else OPPOSITE[hand or 'right']} {found['limb']}"
        ),
        text,
    )
    text = _IN_LINE.sub("both feet", re.sub(r"\bits (?:partner|counterpart|twin)\b", "the other", text))
    text = _ELLIPSIS.sub(r"\g<first> \g<noun>", text)
    text = _WITH_SIDE.sub(lambda found: f"{found[0]} {'foot' if found['kick'] else 'hand'}", text)
    text = _SIDE_BEHIND.sub(_put_side_before, text)
    loaded = ""
    for pattern, clauses in grammar().first_relations:
        found = pattern.search(text)
        loaded = loaded or (found["side"] if found else "")
        text = pattern.sub(partial(_relation, clauses=clauses, hand=hand), text)
    text = _with_sides(text, hand)
    for pattern, clauses in grammar().relations:
        text = pattern.sub(partial(_relation, clauses=clauses, hand=hand), text)
    return text, hand or loaded


def hand_at(side: str, target: str) -> str:
    """The hand that lies on a target of one side: the same one on a hip, the other one on an arm."""
    return OPPOSITE[side] if re.fullmatch(_OTHER_SIDE, target) else side


def _put_side_before(match: re.Match[str]) -> str:
    side = match["one"] or match["side"] or match["relation"]
    words = re.sub(r"\b(?:one|a|an|the)\s+", "", match["words"])
    return f"{side} {words}{match['limb']}{match['between']}".rstrip(",")


def _relation(match: re.Match[str], clauses: str, hand: str) -> str:
    """The clauses that a relation stands for, with its side, the other side, and what else the pattern names."""
    values = {name: value or "" for name, value in match.groupdict().items()}
    side = values.get("side") or values.get("side_2") or hand
    if not side and "{side}" in clauses:
        return match.group(0)
    said = clauses.format(**(values | {"side": side, "other": OPPOSITE.get(side, "")}))
    return f" , {said} , " if "{side}" in clauses else said


def _with_sides(text: str, hand: str) -> str:
    """The limbs of a prompt with their sides, read from left to right."""
    bare = re.compile(f"{_BARE}|{_THAT}" % {"verbs": grammar()["following_words"].pattern})
    spoken, said, at = _Spoken(side=hand or "right"), "", 0
    single: dict[bool, str] = {}  # side of the limb called "one", by whether it is an arm
    subject_end = 0  # of the clause whose subject was found
    for match in sorted((*_LIMB.finditer(text), *bare.finditer(text)), key=lambda m: m.start()):
        if match.start() < at:
            continue
        said += text[at : match.start()]
        at = match.end()
        if match.re is bare:
            if match["that"]:
                named = [spoken.side] if spoken.named else re.findall(r"\b(?:left|right)\b", said)
                said += f"the {named[-1]} " if named else match.group(0)
                continue
            if match["bare"] and not _means_a_limb(match, spoken):
                said += match.group(0)
                continue
            if match["bare"] and not spoken.named and _OF_LEGS.match(text, at):
                spoken.noun = "leg"
            spoken.side = match["one"] or match["bare"] or OPPOSITE[spoken.side]
            said += f"{spoken.side} {spoken.noun}"
            continue
        noun, owners = match["limb"], match["owners"].split()
        is_arm = _OF_ARM.fullmatch(noun) is not None
        side = next((word for word in reversed(owners) if word in OPPOSITE), "")
        if not side and not match["plural"] and noun != "feet":
            side = _side_meant(text, match, owners, spoken, single.get(is_arm, ""), hand if is_arm else "")
        if "one" in owners:
            single[is_arm] = side or hand or "right"
        said += _with_side(match, side)
        # "right hand holding the left elbow": the elbow is no subject of its own
        if side and not (match["place"] and match.start() < subject_end):
            spoken = _Spoken(noun, side, named=True)
            end = re.compile(r"[,;.:!?]| and | while ").search(text, match.end())
            subject_end = end.start() if end else len(text)
        elif not match["place"] and not spoken.named:  # "both legs ..., the left one ..."
            spoken.noun = "foot" if noun == "feet" else noun
    return said + text[at:]


def _means_a_limb(match: re.Match[str], spoken: _Spoken) -> bool:
    """Whether a side without a noun is a limb: "her left hangs", and "left down" after "right hand up"."""
    owned = match["whose"] in ("his ", "her ", "their ")
    return owned or (spoken.named and spoken.side != match["bare"])


def _with_side(match: re.Match[str], side: str) -> str:
    """The words of one limb with its side, "" for none, in place of "one", "other", "same" and the like."""
    owners = match["owners"].split()
    kept = [word for word in owners if word not in (*_RELATIVE, *OPPOSITE)]
    single = not match["plural"] and not {"both", "two"} & set(owners)
    if side and single and set(owners) & set(_RELATIVE):
        kept = [word for word in kept if word not in ("the", "a", "an")]
    words = " ".join([*kept, side] if side else kept)
    return f"{match['place'] or ''}{words}{' ' if words else ''}{match['adjective'] or ''}{match['limb']}{match['plural'] or ''}"


def _side_meant(
    text: str, match: re.Match[str], owners: list[str], spoken: _Spoken, single: str, hand: str
) -> str:
    """The side of a single limb without one: by its relation to another, by its place, or "" where nothing tells it."""
    if {"other", "opposite"} & set(owners):
        return OPPOSITE[spoken.side]
    if "one" in owners and _EACH_OTHER.match(text, match.end()):
        return ""
    if "same" in owners:
        return spoken.side
    end = _CLAUSE_END.search(text, match.end())
    place = _side_of_place(text[match.end() : end.start() if end else len(text)])
    if match["place"] and "one" not in owners:
        return ""
    if place or "one" not in owners:
        return place or (hand if owners and owners[-1] in ("a", "his", "her", "their") else "")
    if single:
        return OPPOSITE[single]  # "one arm forward and one arm back"
    other = re.search(r"\bother\b", text[match.end() :])
    if other:  # "one arm behind the back, the other out to the right"
        rest = text[match.end() + other.end() :]
        end = _CLAUSE_END.search(rest)
        place = _side_of_place(rest[: end.start() if end else len(rest)])
        return OPPOSITE[place] if place else hand or "right"
    return hand


def _side_of_place(clause: str) -> str:
    """The side of the hand that is where a clause says: left "on the left hip", right "on the left shoulder"."""
    place = _PLACE.search(clause)
    if place is None:
        return ""
    return place["direction"] or hand_at(place["side"], place["same"] or place["across"])


def named_side(words: Sequence[Word]) -> str:
    """The one side of a body that a prompt names, "" for none and for both.

    It is named with a limb ("the left foot", "foot left") or as "on the left", "left side"; a direction is none.
    """
    named: set[str] = set()
    for i, word in enumerate(words):
        if word.text not in OPPOSITE:
            continue
        after = words[i + 1].stem if i + 1 < len(words) else ""
        before = words[i - 1] if i else None
        of_limb = after in _SIDED_NOUNS or (
            before is not None and before.stem in _SIDED_NOUNS | {"on"} and after not in PART_WORDS
        )
        # "a wooden left leg", "the paralysed left": between them an adjective at most
        if of_limb or (i + 2 < len(words) and words[i + 2].stem in _SIDED_NOUNS):
            named.add(word.text)
    return named.pop() if len(named) == 1 else ""


def entry_side(entry: LibraryEntry) -> str:
    """The side on which an entry does what makes it so, "" where both sides do the like.

    Its name says it ("limping on the left leg"), else the one leg that it defines, else the limb that is not idle.
    """
    spoken = {side for side in OPPOSITE if re.search(rf"\b{side}\b", entry.prompt)}
    if not spoken and not {"left_leg", "right_leg"} <= set(entry.defines):
        spoken = {side for side in OPPOSITE if f"{side}_leg" in entry.defines}
    if spoken:
        return spoken.pop() if len(spoken) == 1 else ""
    said = entry.descriptions.to_mapping()
    arms = [side for side in OPPOSITE if not _IDLE_ARM.search(said[f"{side}_arm"])]
    return lame_leg(said) or (arms[0] if len(arms) == 1 else "")


def lame_leg(said: Mapping[str, str]) -> str:
    """The side of the one leg that limps, drags, hops or is stiff by the descriptions of some parts, "" for none and for both."""
    lame = [side for side in OPPOSITE if _BUSY_LEG.search(said.get(f"{side}_leg", ""))]
    return lame[0] if len(lame) == 1 else ""


def lame_on(entry: LibraryEntry, side: str) -> LibraryEntry:
    """The entry, mirrored if it is lame on the other side: a pirate who drags the left leg has no wooden right one."""
    return on_side(entry, side) if lame_leg(entry.descriptions.to_mapping()) else entry


def on_side(entry: LibraryEntry, side: str) -> LibraryEntry:
    """The entry with its descriptions mirrored if it is one of the other side."""
    own = entry_side(entry)
    if not side or not own or own == side:
        return entry
    mirrored = {
        part: text.replace("left angle", "right angle")
        for part, text in entry.descriptions.mirrored().to_mapping().items()
    }
    return replace(entry, descriptions=PartDescriptions(**mirrored), defines=_mirrored(entry.defines))


def _mirrored(parts: tuple[str, ...]) -> tuple[str, ...]:
    swapped = {f"{OPPOSITE[p.split('_')[0]]}_{p.split('_')[1]}" if "_" in p else p for p in parts}
    return tuple(part for part in PART_NAMES if part in swapped)
