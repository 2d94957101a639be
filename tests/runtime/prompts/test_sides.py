"""Sides and relations in English: a table of sentences written by their meaning, and what each part must then do."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from runtime.prompts.english.library import LibraryExpander
from runtime.prompts.text_encoder import TextEncoder

TABLE = Path(__file__).with_name("side_sentences.txt")
PARTS = {"la": "left_arm", "ra": "right_arm", "ll": "left_leg", "rl": "right_leg"}
# what a sentence of a part must contain to say so; in the words of the descriptions, not of the prompts
SAYS = {
    "HIP": r"\bhips?\b(?! height)|waist(?! height)|akimbo",
    "HANG": r"hang|at the side|straight down|limp|relaxed|loose",
    "SWING": r"swing",
    "STILL": r"not swinging|still|swinging very little|pressed|motionless",
    "DOWN": r"hang|at the side|straight down|down|beside the (?:hip|thigh)|hip height|low",
    "UP": r"raised|overhead|above|\bup\b|lifted|high|head height|shoulder height",
    "FORWARD": r"front(?! of the (?:chest|face))|forward|ahead",
    "SIDEWAYS": r"(?:out|up|stretched|spread|straight)\b[^,]*\bto the side|sideways",
    "BACK": r"behind (?:the )?(?:back|body)|back behind|stretched back|\bback\b",
    "BENT": r"bent|bend|curled|folded",
    "BODY": r"stomach|belly|chest|across|waist|ribs|hip|body",
    "CHEST": r"chest|across|heart|folded|crossed",
    "SHOULDER": r"shoulder(?! height)|folded across",
    "SHOULDERHIGH": r"shoulder height|raised|chest height",
    "TREMBLE": r"trembl|shak",
    "ELBOW": r"elbow",
    "FACE": r"face|eyes|mouth|forehead|head|\bear\b|brow",
    "THIGH": r"thigh|knee",
    "POCKET": r"pocket",
    "LIMP": r"limp|careful|stiff|drag|weak|hurt|short|barely|hardly|trail",
    "SHORT": r"short",
    "DRAG": r"drag|trail|scuff",
    "NODRAG": r"^(?!.*(?:drag|trail|scuff))",
    "STIFF": r"stiff|straight|not bending",
    "LIFT": r"lifted|raised|high|off the ground|up\b",
    "WEIGHT": r"weight|heav|firm|leaning on|stepping hard|bearing",
    "HOP": r"hop|spring",
    "BOUNCE": r"bounc",
    "TURNED_IN": r"inward|turned in",
    "TURNED_OUT": r"outward|turned out",
    "TURN_LEFT": r"(?:turn|look|twist|fac|rotat)\w*[^,]*\bleft",
    "TURN_RIGHT": r"(?:turn|look|twist|fac|rotat)\w*[^,]*\bright",
    "TILT_LEFT": r"(?:tilt|lean|bent|tip)\w*[^,]*\bleft",
    "TILT_RIGHT": r"(?:tilt|lean|bent|tip)\w*[^,]*\bright",
    "LEAN_LEFT": r"(?:lean|tilt|bent|bend|tip|drop|sag|lower)\w*[^,]*\bleft|left[^,]*(?:lower|drop|sag)",
    "LEAN_RIGHT": r"(?:lean|tilt|bent|bend|tip|drop|sag|lower)\w*[^,]*\bright(?! angle)|right[^,]*(?:lower|drop|sag)",
    "LEFT_UP": r"left shoulder[^,]*(?:rais|high|up)|right shoulder[^,]*(?:low|drop|down)|lean\w*[^,]*right",
    "RIGHT_DOWN": r"right shoulder[^,]*(?:low|drop|down|sag)|left shoulder[^,]*(?:rais|high)|lean\w*[^,]*right",
    "LEFT": r"\bleft\b",
    "RIGHT": r"\bright\b(?! angle)",
    "LOWERED": r"down|low|ground|feet|bowed|chest",
}
ROWS = [line for line in TABLE.read_text("utf-8").splitlines() if line and not line.startswith("#")]


@pytest.fixture(scope="module")
def library() -> LibraryExpander:
    return LibraryExpander(TextEncoder())


@pytest.mark.parametrize("row", ROWS, ids=[row.split(" | ")[0][:60] for row in ROWS])
def test_each_part_does_what_the_sentence_means(row: str, library: LibraryExpander) -> None:
    sentence, *expectations = row.split(" | ")
    words = library.expand(sentence).descriptions.to_mapping()
    failed = [e for e in expectations if not holds(e, words)]
    assert not failed, f"{sentence}: {failed} in {words}"


def holds(expectation: str, words: dict[str, str]) -> bool:
    """Whether the sentences `words` of the parts meet one expectation of the table."""
    part, _, what = expectation.partition(": ")
    if part in ("arms", "legs"):
        limb, (one, other) = part[:-1], what.split("/")
        left, right = words[f"left_{limb}"], words[f"right_{limb}"]
        return any(says(one, a) and says(other, b) for a, b in ((left, right), (right, left)))
    return says(what, words[PARTS.get(part, part)])


def says(what: str, sentence: str) -> bool:
    """Whether a sentence says WHAT, or does not for !WHAT."""
    denied = what.startswith("!")
    found = any(re.search(SAYS[name], sentence) for name in what.lstrip("!").split("|"))
    return found != denied
