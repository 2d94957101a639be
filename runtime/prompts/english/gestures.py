"""Gestures of a hand at another part of the body: "wiping the forehead with the left hand", "clutching his ribs"."""

from __future__ import annotations

import re

from runtime.prompts.english.clause_rules import grammar
from runtime.prompts.english.sides import OPPOSITE, hand_at
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
        for side in _sides(match):
            parts.setdefault(f"{side}_arm", template.replace("{s}", side))
        return " , "

    rest = rules["gesture"].sub(take, text)
    return {part: parts[part] for part in PART_NAMES if part in parts}, rest


def _sides(match: re.Match[str]) -> tuple[str, ...]:
    if match["side"] == "both":
        return tuple(OPPOSITE)
    if match["side"] in OPPOSITE:
        return (match["side"],)
    return (hand_at(match["target_side"], match["target"]) if match["target_side"] else "right",)
