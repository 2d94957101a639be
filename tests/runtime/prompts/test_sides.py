"""Sides and relations in English: a table of sentences written by their meaning, and what each part must then do."""

import re
from pathlib import Path

import pytest

from runtime.prompts.english.library import LibraryExpander
from tests.helpers.shipped import shipped_library

FOLDER = Path(__file__).parent
PARTS = {"la": "left_arm", "ra": "right_arm", "ll": "left_leg", "rl": "right_leg"}
# what a sentence of a part must contain to say so; in the words of the descriptions, not of the prompts
SAYS = {
    "HIP": r"(?<!behind the )\bhips?\b(?! height)|waist(?! height)|akimbo",
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
    "BOUNCE": r"bounc|bob|spring",
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
    "HUNCH": r"hunch|round|slump|bowed|stoop",
    "UPRIGHT": r"upright|straight|arched|chest",
    "CHEST_OUT": r"chest|arched|proud",
    "SHRUG": r"shoulders (?:raised|lifted)|raised shoulders",
    "LEAN_FORWARD": r"forward|bowed|bent|hunch",
    "LEAN_BACK": r"lean\w*[^,]*back|belly forward|hips forward",
    "SWAY": r"sway|rock|roll|swing|stagger|tilt\w* from side",
    "STAGGER": r"stagger|stumbl|unstead|astray|reel|weav|wobbl",
    "LEVEL": r"glid|level|smooth",
    "AHEAD": r"ahead|straight|upright|still|level",
    "AROUND": r"around|left and right|side to side",
    "NOD": r"nod|bob|peck",
    "LOLL": r"loll|roll|side to side|wobbl",
    "HIGH": r"high|lifted|straight",
    "HEEL": r"heel",
    "TIPTOE": r"tiptoe|toes|heels? raised",
    "NARROW": r"narrow|one line|together|close|cross",
    "KNEES": r"knees",
    "WIDE": r"wide|apart|around",
    "LONG": r"long|large|big|strid",
    "QUICK": r"quick|fast|hurr|brisk",
    "SLOW": r"slow|careful",
    "HESITATE": r"hesit|paus|careful|cautious|tentative|feeling",
    "HEAVY": r"heav|stomp|slam|stamp|hard|tread|trudg|flat",
    "LIGHT": r"light|soft|gentl|barely",
    "CROUCH": r"bent|bend|crouch|low",
    "CROSS": r"cross",
    "KICK": r"kick|low kick",
    "CARRY": r"in front|waist|right angle|forearm",
    "WAVE": r"wav",
    "FLAP": r"flap|wing",
    "ARCS": r"arcs|circl|wild|widely|high|flail",
    "SWING_WIDE": r"swing\w* (?:\w+ )*(?:wide|widely|far|big|high|strongly|vigorously|stiffly)|pump|arcs",
    "SIDE_LOW": r"to the side|away from",
    "FIST": r"fist",
    "GUARD": r"guard|in front of the (?:chest|face|chin)|elbow bent sharply",
    "CHIN": r"chin|face|guard|throat|neck",
    "NECK": r"neck|behind the head|back of the head",
    "PUNCH": r"punch|fist|stretched",
    "PRAY": r"palm|clasp|pressed against the other|together",
    "OVERHEAD": r"overhead|above",
}


def rows(name: str) -> list[str]:
    """The lines of a table: a sentence and what each part must do."""
    lines = (FOLDER / f"{name}.txt").read_text("utf-8").splitlines()
    return [line for line in lines if line and not line.startswith("#")]


@pytest.fixture(scope="module")
def library() -> LibraryExpander:
    return shipped_library()


@pytest.mark.parametrize(
    "row", rows("side_sentences"), ids=[row.split(" | ")[0][:60] for row in rows("side_sentences")]
)
def test_each_part_does_what_the_sentence_means(row: str, library: LibraryExpander) -> None:
    sentence, *expectations = row.split(" | ")
    words = library.expand(sentence).descriptions.to_mapping()
    failed = [e for e in expectations if not holds(e, words)]
    assert not failed, f"{sentence}: {failed} in {words}"


@pytest.mark.parametrize(("name", "least"), [("seen_prompts", 94), ("unseen_prompts", 78)])
def test_prompts_of_animators_are_read(name: str, least: int, library: LibraryExpander) -> None:
    whole, held, of = 0, 0, 0
    for row in rows(name):
        sentence, *expectations = row.split(" | ")
        words = library.expand(sentence).descriptions.to_mapping()
        failed = [e for e in expectations if not holds(e, words)]
        whole, held, of = whole + (not failed), held + len(expectations) - len(failed), of + len(expectations)
        if failed and not name.startswith("unseen"):
            print(sentence, failed)  # those that are only counted are not looked at
    print(f"{name}: {whole} of {len(rows(name))} prompts whole, {held} of {of} expectations hold")
    assert whole >= least


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
