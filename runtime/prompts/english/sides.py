"""Resolves sides and relations in a prompt to explicit sides of limbs, before its clauses are parsed.

    "one hand on the left hip, the other arm hanging"   →  "left hand on the left hip, right arm hanging"
    "raises the right arm and limps on the opposite leg" →  "... right arm and limps on the left leg"
    "favouring the right leg"                            →  "limping on the right leg"

Phrases that imply an action (weight, injuries, loads) are rules of assets/prompts/clauses.toml.
"""

import re
from collections.abc import Callable, Iterable
from functools import partial

from runtime.prompts.english.grammar import Match, grammar, replaced

SIDE = re.compile(r"\b(?:left|right)\b")
OPPOSITE = {"left": "right", "right": "left"}
_RELATIVE = ("one", "other", "opposite", "same")  # words that refer to a side relative to another
Known = Callable[[str], bool]  # whether the library knows an action with a thing
_DEFINITE = ("the", "his", "her", "their", "its")
_OWNERS = ("a", "his", "her", "their")  # before the left hand of a left-handed person


def name_sides(prompt: str, known: Known) -> tuple[str, str]:
    """Return a lower-case prompt with a side before each limb, and the preferred or carrying side ("left-handed") or "".

    A single limb without any hint of its side is unchanged and later taken as the right one. Actions with a thing
    are replaced unless `known`.
    """
    rules = grammar()
    handed = rules["handed"].search(prompt)
    hand = (handed["side"] or "left") if handed else ""
    text = rules["handed"].sub("", prompt)
    sides: list[str] = []
    text = replaced(text, rules.before, partial(_relation, hand=hand, sides=sides))
    text = _Limbs(text, hand).named()
    for _ in range(2):  # a relation's words may contain another relation
        text = replaced(text, rules.after, partial(_relation, hand=hand, sides=[]))
    text = replaced(text, rules.things, partial(_relation, hand=hand, sides=[], known=known))
    return text, hand or "".join(sides[:1])


def _relation(
    match: Match, words: str, hand: str, sides: list[str], known: Known | None = None
) -> str | None:
    """Return the replacement of a relation, with its side, the other side, and the pattern's other groups filled in."""
    if known and (known(match.group()) or grammar()["of_arm"].search(match.string[: match.start()])):
        return None
    values = {name: value or "" for name, value in match.groupdict().items()}
    side = values.get("side") or values.get("side_2") or hand
    if "{side}" in words and not side:
        return None
    sides += [side] if values.get("side") in OPPOSITE else []
    named = {"side": side, "other": OPPOSITE.get(side, ""), "all": match.group()}
    leading = hand or "right"
    used = {"leading_hand": leading, "other_hand": OPPOSITE[leading], "gesture_hand": _hands(values)}
    said = words.format(**(values | named | used))
    return f" , {said} , " if "{side}" in words else said


def _hands(values: dict[str, str]) -> str:
    """Return the hand of a gesture: the named one, else the one for the target's side (the opposite one for an arm)."""
    named = values.get("side") in OPPOSITE  # "both eyes with the right hand"
    if values.get("side") == "both" or (values.get("both") and not named):
        return "both hands"
    place = values.get("target_side", "")
    side = values["side"] if named else place and _hand_at(place, values["target"])
    return f"{side or 'right'} hand"


def _hand_at(side: str, target: str) -> str:
    """Return the hand that lies on a target of one side: the same one on a hip, the other one on an arm."""
    return OPPOSITE[side] if grammar()["other_side"].fullmatch(target) else side


class _Limbs:
    """The limbs of a prompt, read from left to right; "the other" refers to the last one."""

    def __init__(self, text: str, hand: str) -> None:
        self._text, self._hand = text, hand
        self._noun, self._side = "arm", hand or "right"  # of the last limb mentioned
        self._spoken = False  # whether any was mentioned
        self._single: dict[bool, str] = {}  # side of the limb called "one", by whether it is an arm
        self._subject_end = 0  # end of the clause whose subject was found

    def named(self) -> str:
        """Return the text with the side before each noun."""
        return grammar()["limb"].sub(self._replacement, self._text)

    def _replacement(self, match: Match) -> str:
        if match["that"]:
            sides = [self._side] if self._spoken else SIDE.findall(self._text, 0, match.start())
            return f"the {sides[-1]} " if sides else match.group()
        if match["it"]:
            return f"{self._side} {self._noun}" if self._spoken else "it"
        return self._limb(match) if match["noun"] else self._bare(match)

    def _bare(self, match: Match) -> str:
        """Return the limb of a side without a noun, the last one mentioned: "her left hangs", "right hand up, left down"."""
        bare = match["bare"]
        if bare:
            if match["whose"] in (None, "the ") and not (self._spoken and self._side != bare):
                return match.group()
            if not self._spoken and grammar()["of_legs"].match(self._text, match.end()):
                self._noun = "leg"
        self._side = match["one"] or bare or OPPOSITE[self._side]
        return f"{self._side} {self._noun}"

    def _limb(self, match: Match) -> str:
        noun, owners = match["noun"], match["owners"].split()
        is_arm = grammar()["arm_noun"].fullmatch(noun) is not None
        side = next((word for word in reversed(owners) if word in OPPOSITE), "")
        if not side and not match["plural"] and noun != "feet":
            side = self._side_meant(match, owners, is_arm)
        if "one" in owners:
            self._single[is_arm] = side or self._hand or "right"
        self._speak_of(match, noun, side)
        return _with_side(match, owners, side)

    def _speak_of(self, match: Match, noun: str, side: str) -> None:
        # "right hand holding the left elbow": the elbow is not a subject
        if side and not (match["at"] and match.start() < self._subject_end):
            self._noun, self._side, self._spoken = noun, side, True
            self._subject_end = self._end_of(r"[,;.:!?]| and | while ", match.end())
        elif not match["at"] and not self._spoken:  # "both legs ..., the left one ..."
            self._noun = "foot" if noun == "feet" else noun

    def _side_meant(self, match: Match, owners: list[str], is_arm: bool) -> str:
        """Return the side of a limb without one: by its relation to another, by its place, or "" if nothing tells it."""
        if {"other", "opposite"} & set(owners):
            return OPPOSITE[self._side]
        if "same" in owners:
            return self._side
        if "one" in owners:
            return self._side_of_one(match, is_arm)
        if match["at"]:
            return ""
        return self._side_of_owner(match, "".join(owners[-1:]), is_arm)

    def _side_of_owner(self, match: Match, owner: str, is_arm: bool) -> str:
        joint = grammar()["joint"].fullmatch(f"{self._noun} {match['noun']}")
        if self._spoken and (joint or (match["noun"] == self._noun and owner in _DEFINITE)):
            return self._side  # "pain in the left knee, so the knee stays straight"
        hand = self._hand if is_arm and owner in _OWNERS else ""
        return self._side_of_place(match.end()) or hand or self._left_over(match.end(), is_arm)

    def _left_over(self, start: int, is_arm: bool) -> str:
        """Return the side that a later clause's limb leaves: "broken arm in a sling, right arm swinging"."""
        later = grammar()["later_arm" if is_arm else "later_leg"].findall(self._text, start)
        return "" if self._spoken else OPPOSITE.get(only_side(later), "")

    def _side_of_one(self, match: Match, is_arm: bool) -> str:
        """Return the side of "one arm": that of its place, else the side left by the prompt's other arm."""
        after = match.end()
        if grammar()["each_other"].match(self._text, after):
            return ""
        place = self._side_of_place(after)
        if place or is_arm in self._single:
            return place or OPPOSITE[self._single[is_arm]]  # "one arm forward and one arm back"
        hand = self._hand if is_arm else ""
        other = re.compile(r"\bother\b").search(self._text, after)
        if not other:
            return hand or self._left_over(after, is_arm)
        place = self._side_of_place(other.end())  # "one arm behind the back, the other out to the right"
        return OPPOSITE[place] if place else hand or "right"

    def _side_of_place(self, start: int) -> str:
        """Return the side of the hand by the place named up to the clause's end: left for "on the left hip"."""
        end = self._end_of(grammar()["clause_end"].pattern, start)
        place = grammar()["place"].search(self._text[start:end])
        if place is None:
            return ""
        return place["direction"] or _hand_at(place["side"], place["same"] or place["across"])

    def _end_of(self, pattern: str, start: int) -> int:
        end = re.compile(pattern).search(self._text, start)
        return end.start() if end else len(self._text)


def _with_side(match: Match, owners: list[str], side: str) -> str:
    """Return the words of one limb with its side, "" for none, in place of "one", "other", "same" and the like."""
    said, dropped = match.groupdict(""), {*_RELATIVE, *OPPOSITE}
    if side and not said["plural"] and {*owners} & {*_RELATIVE} and not {"both", "two"} & {*owners}:
        dropped |= {"the", "a", "an"}
    words = [word for word in owners if word not in dropped] + [side] * bool(side)
    before = "".join(f"{word} " for word in words)
    return f"{said['at']}{before}{said['adjective']}{said['noun']}{said['plural']}"


def named_side(text: str) -> str:
    """Return the only body side that a text without articles names; "" for none or both.

    It may be named with a limb ("left foot", "foot left") or as "on left", "left side"; directions do not count.
    """
    return only_side(one or other for one, other in grammar()["named_side"].findall(text))


def only_side(sides: Iterable[str]) -> str:
    """Return the side if all are the same, "" if there are none or both."""
    named = set(sides)
    return named.pop() if len(named) == 1 else ""
