"""Other words for the edits of head, torso and legs, which the catalogue says in two or three sentences each.

A network that has read three sentences of a movement knows these three, and words between two strengths fall anywhere.
None of these is a sentence that the evaluation asks for.
"""

from __future__ import annotations

from training.layering.catalog import HELD_OUT

# Of one part each. `{s}` is the side.
HEAD_AND_TORSO: dict[str, tuple[str, ...]] = {
    "head.down_little": (
        "head tipped forward a little",
        "chin slightly down",
        "head bowed a little",
        "eyes a few steps ahead, head slightly bent down",
        "head inclined slightly forward",
        "face turned a little towards the ground",
        "head slightly bowed",
    ),
    "head.down": (
        "head bowed",
        "head bent down",
        "looking down",
        "chin lowered",
        "head tipped clearly forward",
        "looking at the feet",
        "eyes on the floor, head bent",
        "watching the ground in front of the feet",
    ),
    "head.up_little": (
        "head tipped back a little",
        "looking slightly upward",
        "chin raised slightly",
        "face turned a little up",
        "head held a bit higher than usual",
        "looking a little above the horizon",
        "head inclined slightly back",
    ),
    "head.up_far": (
        "looking straight up into the sky",
        "head bent all the way back",
        "head tipped far back, face to the clouds",
        "face turned straight up",
        "chin pointing at the sky",
        "head thrown far back",
        "staring up at the ceiling, neck bent back strongly",
    ),
    "head.looking_around": (
        "looking left and right all the time",
        "head searching from side to side",
        "head turning slowly to the left and to the right",
        "looking about in all directions",
    ),
    "head.shaking": (
        "head shaking",
        "head going quickly left and right as if saying no",
        "head wagging from side to side",
    ),
    "head.nodding": (
        "head nodding",
        "head nodding with every step as if saying yes",
        "head going up and down",
        "nodding again and again",
    ),
    "torso.lean_forward_little": (
        "torso bent slightly forward",
        "torso inclined a little forward",
        "leaning forward a little",
        "upper body slightly in front of the hips",
        "torso tipped forward a bit",
        "trunk leaning somewhat forward",
    ),
    "torso.lean_forward_far": (
        "torso bent far forward",
        "torso almost level with the ground",
        "bent over double from the hips",
        "upper body leaning very far forward",
        "trunk tipped deeply forward",
        "torso bent strongly forward, nearly horizontal",
    ),
    "torso.lean_back_little": (
        "torso bent slightly back",
        "leaning back a little",
        "torso inclined a little backward",
        "upper body slightly behind the hips",
        "torso tipped back a bit",
        "trunk leaning somewhat back",
    ),
    "torso.lean_back": (
        "torso bent back",
        "leaning back",
        "trunk leaning clearly backward",
        "upper body behind the hips, leaning back",
        "torso tipped backward",
    ),
    "torso.slump": (
        "back bent, shoulders forward",
        "hunched over",
        "slouching, back round",
        "chest fallen in, shoulders drooping",
        "torso collapsed, back curved",
    ),
    "torso.chest_out": (
        "chest out",
        "chest thrust forward proudly",
        "back arched, breast lifted",
        "torso arched backward, chest up",
    ),
    "torso.bounce": (
        "torso bouncing",
        "springing up and down with the steps",
        "bouncing high with every step",
        "body hopping lightly up at each step",
    ),
    "torso.twist": (
        "torso twisting strongly",
        "upper body turning left and right against the hips",
        "shoulders turning far left and far right",
    ),
    "torso.level": (
        "torso floating at one height",
        "body not bobbing at all",
        "hips carried level, without rising or falling",
    ),
    "torso.bob": (
        "torso going strongly up and down with the steps",
        "body rising and sinking clearly at every step",
        "hips rising and falling a lot",
    ),
    "torso.hips_still": (
        "hips quiet",
        "hips stiff, not turning",
        "pelvis held still",
        "hips locked, neither swinging nor swaying",
    ),
    "torso.hips_sway_little": (
        "hips moving slightly to the side at every step",
        "hips swinging sideways a little",
        "pelvis swaying a little from left to right",
    ),
    "torso.hips_sway_far": (
        "hips thrown far to the side at every step",
        "hips swaying very strongly left and right",
        "pelvis pushed far out to the side of the standing leg",
        "hips wiggling widely to the sides",
    ),
    "torso.hips_swing_far": (
        "hips turning very far with every step",
        "pelvis swinging far forward on each side in turn",
        "hips twisting far round at every step",
        "hips rotating strongly left and right",
    ),
    "torso.shoulders_still": (
        "shoulders quiet, not turning",
        "shoulders held still",
        "shoulders stiff and level",
        "chest always facing forward, shoulders still",
    ),
    "torso.shoulders_turn_little": (
        "shoulders swinging slightly with the steps",
        "chest turning a little with every step",
        "shoulders turning slightly left and right",
    ),
    "torso.shoulders_roll_far": (
        "shoulders swaggering widely",
        "one shoulder dropping far and then the other",
        "shoulders heaving far up and down with the steps",
    ),
    "torso.rock": (
        "torso rocking over to each side in turn",
        "upper body tipping left and right with the steps",
        "trunk waddling over the feet",
    ),
    "torso.rock_far": (
        "torso rocking very far to both sides",
        "upper body tipping far over at every step",
        "trunk waddling heavily over the feet",
    ),
}
LEGS: dict[str, tuple[str, ...]] = {
    "high_knee": (
        "{s} knee pulled up high",
        "{s} thigh raised level at every step",
        "{s} leg marching, knee very high",
    ),
    "dragging": (
        "{s} foot dragged along",
        "{s} leg pulled behind, foot scraping the ground",
        "{s} foot never leaving the ground",
    ),
    "wide": (
        "{s} foot set out to the side",
        "{s} leg placed apart, out to the side",
        "{s} foot stepping outward",
    ),
    "narrow": (
        "{s} foot set close to the other",
        "{s} foot placed inward, near the middle",
        "{s} leg stepping narrow",
    ),
    "toes_in": ("{s} toes pointing inward", "{s} foot turned strongly in"),
    "toes_out_little": ("{s} foot turned out a little", "{s} toes pointing slightly outward"),
    "toes_in_little": ("{s} foot turned in a little", "{s} toes pointing slightly inward"),
    "low": ("{s} foot close to the ground", "{s} foot lifted only a little", "{s} leg shuffling a bit"),
    "crouch_little": (
        "{s} leg slightly bent at the knee",
        "{s} knee never quite straight",
        "{s} knee soft, a bit bent",
        "{s} leg bent a little, hips slightly lowered",
    ),
    "crouch_deep": (
        "{s} leg bent very deeply",
        "{s} knee bent as far as it goes, squatting",
        "{s} knee strongly bent, hips very low",
        "{s} leg squatting low, thigh level",
    ),
    "tiptoe": ("{s} foot on the toes", "{s} heel up, on the ball of the foot", "{s} foot tiptoeing"),
    "long": (
        "{s} leg striding far",
        "{s} leg taking big steps",
        "{s} leg reaching far forward at every step",
    ),
    "giant": ("{s} leg taking huge slow steps", "{s} leg striding enormously far and very slowly"),
    "short_little": ("{s} leg taking somewhat shorter steps", "{s} leg stepping slightly short"),
    "short": ("{s} leg stepping short", "{s} leg taking little steps", "{s} foot set just before the other"),
    "hurried": (
        "{s} leg scurrying",
        "{s} leg pattering along with tiny rapid steps",
        "{s} leg taking minute fast steps",
    ),
    "slow": (
        "{s} leg stepping slowly",
        "{s} leg walking slowly, unhurried",
        "{s} leg taking its time at every step",
    ),
    "quick": ("{s} leg stepping quickly", "{s} leg walking briskly", "{s} leg moving fast from step to step"),
    "crossing": ("{s} foot set across the line to the other side", "{s} leg crossing over at every step"),
    "far_apart": ("{s} leg straddling, feet very far apart", "{s} foot set very far out, legs straddled"),
    "pausing": (
        "{s} leg stopping after every step",
        "{s} leg waiting long between the steps",
        "{s} leg halting at each step",
    ),
    "stomping_hard": (
        "{s} foot stamping very hard",
        "{s} leg pounding the ground",
        "{s} foot crashing down with all the weight",
    ),
    "soft": ("{s} foot landing without a sound", "{s} leg treading softly", "{s} foot put down very gently"),
    "staggering": ("{s} leg reeling from side to side", "{s} foot stepping far astray, left and right"),
    "limping": ("{s} leg limping", "{s} leg lame", "limping on the {s} side"),
}
_SLOT = {
    "limping": "{s}_leg",
    "high_knee": "{s}_leg",
    "dragging": "{s}_leg",
    "wide": "{s}_leg",
    "narrow": "{s}_leg",
}
_SLOT |= dict.fromkeys(("toes_in", "toes_out_little", "toes_in_little", "low"), "{s}_leg")


def more_words() -> dict[tuple[str, str], tuple[str, ...]]:
    """Sentences of every edit (its name) for a part of it."""
    found = {(name, name.split(".")[0]): words for name, words in HEAD_AND_TORSO.items()}
    for side in ("left", "right"):
        for name, words in LEGS.items():
            slot = _SLOT.get(name, "legs").replace("{s}", side)
            found[f"{slot}.{name}", f"{side}_leg"] = tuple(w.replace("{s}", side) for w in words)
    return {key: words for key, words in found.items() if key[0] not in HELD_OUT}
