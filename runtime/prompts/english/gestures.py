"""Gestures of a hand at another part of the body: "wiping the forehead with the left hand", "clutching his ribs"."""

from __future__ import annotations

import re
from functools import cache

from sport.runtime.skeleton import PART_NAMES

_THE = r"(?:the |his |her |their |my )?"
# Where the hand goes, in the words that the networks were trained on; searched in order, `{s}` is the hand's side.
_TARGETS: tuple[tuple[str, str], ...] = (
    (rf"(?:back of {_THE})?(?:neck|nape)|back of {_THE}head", "{s} hand behind the head, elbow out"),
    (
        r"(?:fore)?head|temples?|(?:eye)?brows?|face|eyes?|nose|mouth|lips|glasses",
        "{s} hand in front of the face",
    ),
    (r"hair|scalp|skull|hat|cap", "{s} hand on the head"),
    (r"ears?|cheeks?|earrings?", "{s} hand held to the ear, elbow bent sharply"),
    (r"chin|beard|jaw|moustache|throat|collar|tie", "{s} elbow bent sharply, hand held at the chin"),
    (r"chest|heart|breast", "{s} hand on the chest"),
    (r"stomach|belly|tummy|abdomen|ribs?|ribcage|side|gut|wound", "{s} hand pressed on the stomach"),
    (r"hips?|waist|lower back|back|kidneys?", "{s} hand on the hip, elbow out to the side"),
    (r"shoulders?|upper arm|arm|elbow|wrist|forearm|sleeve", "{s} arm folded across the chest"),
    (r"knees?|thighs?|legs?", "{s} arm straight down in front, hand pressing on the thigh"),
)
_OF_AN_ARM = _TARGETS[8][0]  # reached by the other hand only
_VERB = (
    r"(?:rubb?|massag|scratch|wip|touch|tapp?|patt?|shield|strok|slapp?|clutch|grabb?|grasp|gripp?|squeez|pinch|cradl|"
    r"cupp?|press|adjust|dust|brush|mopp?|dabb?)(?:e?s|e|ed|ing)?|nursing"
)
_OBJECT = r"(?:(?:the |his |her |my )?(?:sweat|tears?|blood|dust|dirt|hair|hands?|palms?|rain|snow|crumbs) )?"
_BETWEEN = r"(?:(?:off|from|on|over|to|against|at|out of|away from) )?"
_OWNER = r"(?:(?:the|his|her|their|its|my|your|both|an|a) )*(?:(?P<target_side>left|right) )?"
_HAND = (
    r"(?:\s+(?:with|using|by) (?:(?:the|his|her|their|my|a) )?(?P<side>left|right|both|one)? ?"
    r"(?:hands?|arms?|palms?|fists?|fingers?|sleeve))?"
)
# "straightening the back still", "pressing the arms down" say what a part does, not where a hand is
_NOT_BEFORE = r"(?!\s+(?:held|high|up|down|low|back|still|straight|tilted|turned|lowered|raised|out|together|apart|against|into|in front|and (?:arms|hands)))"
_HAND_SPOKEN_OF = r"\b(?:arms?|hands?|fists?|fingers?|palms?|elbows?)\b[^,;.:!?]*$"
_DENIED = r"\b(?:not|never|without|no|don't|stop)\s*$"


def take_gestures(text: str) -> tuple[dict[str, str], str]:
    """The arms that gestures in a lower-case prompt move, and the prompt without those gestures.

    The hand is the one that is named, else that of the target's side (across from it on an arm), else the right one.
    """
    parts: dict[str, str] = {}

    def take(match: re.Match[str]) -> str:
        before = re.split(r"[,;.:!?]", text[: match.start()])[-1]
        if re.search(_HAND_SPOKEN_OF, before) or re.search(_DENIED, before):
            return match.group(0)  # a clause about that hand, or a denial
        # a head is scratched on its top and wiped at its front
        target = (
            "hair" if match["target"] == "head" and match["verb"].startswith("scratch") else match["target"]
        )
        template = next(said for names, said in _TARGETS if re.fullmatch(names, target))
        for side in _sides(match):
            parts.setdefault(f"{side}_arm", template.replace("{s}", side))
        return " , "

    rest = _gesture().sub(take, text)
    return {part: parts[part] for part in PART_NAMES if part in parts}, rest


def _sides(match: re.Match[str]) -> tuple[str, ...]:
    if match["side"] in ("left", "right"):
        return (match["side"],)
    if match["side"] == "both":
        return ("left", "right")
    side = match["target_side"] or "right"
    across = bool(match["target_side"] and re.fullmatch(_OF_AN_ARM, match["target"]))
    return ({"left": "right", "right": "left"}[side] if across else side,)


@cache
def _gesture() -> re.Pattern[str]:
    targets = "|".join(names for names, _ in _TARGETS)
    return re.compile(
        rf"\b(?P<verb>(?:{_VERB})) {_OBJECT}{_BETWEEN}{_OWNER}(?P<target>{targets})\b{_NOT_BEFORE}{_HAND}"
    )
