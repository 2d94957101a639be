"""The parametric part edits: what each does, in numbers, and the sentences that say so.

Distances are metres and angles degrees, given for the left side; the right side is the mirror image. Edits named in
`HELD_OUT` and pairs in `HELD_OUT_PAIRS` never enter training: the evaluation asks for them by their words.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

Vector = tuple[float, float, float]


@dataclass(frozen=True)
class PartEdit:
    """One edit. `phrases` `{part: sentences}` describe every part it changes; `parameters` are those of `kind`.

    `measure` (part, field of its measures in `training.text.measure`) is the quantity that shows the edit.
    """

    name: str
    slot: str  # of the parts that only one edit may change: left_arm, right_arm, torso, head, left_leg, right_leg, legs
    kind: str
    parameters: dict[str, object]
    phrases: dict[str, tuple[str, ...]]
    measure: tuple[str, str]


# --- Arms: where the wrist is held -----------------------------------------------------------------------------------
# frame: origin and axes of `point`; "shoulder" has the axes of the facing direction, the others those of their joint.
# pole: where the elbow points. wave: (x, y, z) amplitude and Hz of an oscillation of the hand.
_ARM: dict[str, tuple[dict[str, object], tuple[str, ...], str]] = {
    "hanging": (
        {"frame": "shoulder", "point": (0.05, -0.465, 0.02), "pole": (0.3, 0.0, -0.9)},
        (
            "{s} arm hanging straight down, not swinging",
            "{s} arm hanging limp at the side",
            "{s} hand hanging still beside the thigh",
            "no {s} arm swing, arm straight down",
        ),
        "swing",
    ),
    "forward_low": (
        {"frame": "shoulder", "point": (0.04, -0.33, 0.32), "pole": (0.4, -0.4, -0.7)},
        (
            "{s} arm lifted a little in front, hand at hip height",
            "{s} arm stretched forward and down",
            "{s} hand held out in front of the hips",
        ),
        "hand_front",
    ),
    "forward": (
        {"frame": "shoulder", "point": (0.03, 0.0, 0.465), "pole": (0.5, -0.8, 0.0)},
        (
            "{s} arm stretched straight out in front at shoulder height",
            "{s} arm reaching forward, elbow straight",
            "{s} hand reaching out far in front of the chest",
            "{s} arm held out in front like a zombie",
        ),
        "hand_front",
    ),
    "forward_high": (
        {"frame": "shoulder", "point": (0.03, 0.31, 0.34), "pole": (0.7, -0.5, -0.3)},
        (
            "{s} arm raised high in front, hand above the head",
            "{s} arm stretched up and forward",
            "{s} hand lifted high in front of the face, elbow straight",
        ),
        "hand_level",
    ),
    "side_low": (
        {"frame": "shoulder", "point": (0.3, -0.35, 0.02), "pole": (0.3, 0.2, -0.9)},
        (
            "{s} arm held away from the side, hand out at hip height",
            "{s} arm spread a little to the side",
            "{s} arm lifted slightly sideways",
        ),
        "hand_out",
    ),
    "side": (
        {"frame": "shoulder", "point": (0.465, 0.0, 0.03), "pole": (0.0, -0.7, -0.7)},
        (
            "{s} arm stretched straight out to the side at shoulder height",
            "{s} arm spread wide like a wing",
            "{s} arm held out sideways, elbow straight",
        ),
        "hand_out",
    ),
    "side_high": (
        {"frame": "shoulder", "point": (0.33, 0.33, 0.02), "pole": (0.6, -0.6, -0.4)},
        (
            "{s} arm raised up and out to the side",
            "{s} arm lifted sideways above the shoulder, hand at head height and far out",
            "{s} arm stretched diagonally up to the side",
        ),
        "hand_level",
    ),
    "overhead": (
        {"frame": "shoulder", "point": (0.04, 0.46, 0.06), "pole": (0.8, 0.0, -0.4)},
        (
            "{s} arm raised overhead",
            "{s} arm raised straight up above the head",
            "{s} hand held high overhead, elbow straight",
            "{s} arm stretched up to the sky",
        ),
        "hand_level",
    ),
    "backward": (
        {"frame": "shoulder", "point": (0.1, -0.34, -0.3), "pole": (0.5, 0.2, -0.7)},
        (
            "{s} arm stretched back behind the body",
            "{s} arm trailing far behind, elbow straight",
            "{s} hand pulled backward behind the hip",
        ),
        "hand_front",
    ),
    "on_hip": (
        {"frame": "hips", "point": (0.2, 0.05, 0.02), "pole": (0.85, 0.0, -0.5)},
        (
            "{s} hand on the hip, elbow out to the side",
            "{s} hand resting on the hip",
            "{s} arm akimbo, elbow pointing out",
            "{s} fist on the waist",
        ),
        "elbow_bend",
    ),
    "in_pocket": (
        {"frame": "hips", "point": (0.2, -0.09, 0.06), "pole": (0.6, 0.0, -0.8)},
        (
            "{s} hand in the pocket",
            "{s} hand tucked into the trouser pocket, elbow slightly bent",
            "{s} hand kept in the pocket, arm still",
        ),
        "swing",
    ),
    "behind_back": (
        {"frame": "hips", "point": (0.03, 0.1, -0.17), "pole": (0.75, 0.0, -0.6)},
        (
            "{s} hand held behind the back",
            "{s} arm bent behind the back, hand at the waist",
            "{s} hand clasped behind the back",
        ),
        "hand_front",
    ),
    "on_belly": (
        {"frame": "hips", "point": (0.04, 0.12, 0.17), "pole": (0.8, -0.3, -0.4)},
        (
            "{s} hand holding the belly",
            "{s} hand pressed on the stomach",
            "{s} forearm across the stomach",
        ),
        "elbow_bend",
    ),
    "on_chest": (
        {"frame": "chest", "point": (0.05, 0.0, 0.16), "pole": (0.8, -0.5, 0.0)},
        (
            "{s} hand on the chest",
            "{s} hand laid over the heart",
            "{s} hand pressed to the chest, elbow bent sharply",
        ),
        "hand_level",
    ),
    "folded": (
        {"frame": "chest", "point": (-0.1, -0.07, 0.19), "pole": (0.6, -0.7, 0.3)},
        (
            "{s} arm folded across the chest",
            "{s} arm crossed over the chest, hand at the other elbow",
            "{s} arm crossed in front of the chest",
        ),
        "hand_out",
    ),
    "on_head": (
        {"frame": "head", "point": (0.07, 0.16, 0.02), "pole": (0.95, 0.2, 0.0)},
        (
            "{s} hand on the head",
            "{s} hand resting on top of the head, elbow out",
            "{s} palm on the crown of the head",
        ),
        "hand_level",
    ),
    "behind_head": (
        {"frame": "head", "point": (0.06, 0.06, -0.12), "pole": (0.95, 0.1, -0.1)},
        (
            "{s} hand behind the head, elbow out",
            "{s} hand on the back of the neck",
            "{s} hand clasped behind the head",
        ),
        "hand_level",
    ),
    "at_ear": (
        {"frame": "head", "point": (0.12, 0.05, 0.03), "pole": (0.6, -0.75, 0.2)},
        (
            "{s} hand at the ear, holding a phone",
            "{s} hand held to the ear, elbow bent sharply",
            "{s} hand beside the head as if phoning",
        ),
        "hand_level",
    ),
    "before_face": (
        {"frame": "head", "point": (0.04, 0.05, 0.19), "pole": (0.5, -0.8, 0.1)},
        (
            "{s} hand in front of the face",
            "{s} hand covering the eyes",
            "{s} forearm raised to shield the face",
        ),
        "hand_level",
    ),
    "guard": (
        {"frame": "chest", "point": (0.09, 0.13, 0.24), "pole": (0.4, -0.9, 0.0)},
        (
            "{s} fist held up in front of the chin",
            "{s} arm in a boxing guard, elbow bent sharply",
            "{s} hand raised in front of the shoulder, elbow low",
        ),
        "hand_level",
    ),
    "carry": (
        {"frame": "hips", "point": (0.16, 0.16, 0.34), "pole": (0.2, -0.6, -0.8)},
        (
            "{s} elbow bent at a right angle, forearm level in front",
            "{s} forearm held out in front at waist height as if carrying something",
            "{s} hand held in front at waist height, elbow at the side",
        ),
        "hand_front",
    ),
    "waving": (
        {
            "frame": "shoulder",
            "point": (0.2, 0.33, 0.14),
            "pole": (0.8, -0.6, 0.0),
            "wave": (0.13, 0.0, 0.0, 1.7),
        },
        (
            "{s} hand raised high and waving from side to side",
            "{s} arm up, waving",
            "{s} hand waving above the head",
        ),
        "side_swing",
    ),
    "flapping": (
        {
            "frame": "shoulder",
            "point": (0.42, -0.08, 0.02),
            "pole": (0.1, -0.6, -0.7),
            "wave": (0.0, 0.16, 0.0, 2.0),
        },
        (
            "{s} arm out to the side, flapping up and down like a wing",
            "{s} arm spread and beating up and down",
            "{s} arm flapping sideways like a bird",
        ),
        "hand_level_range",
    ),
    "punching": (
        {
            "frame": "chest",
            "point": (0.07, 0.08, 0.3),
            "pole": (0.5, -0.8, -0.2),
            "wave": (0.0, 0.0, 0.12, 1.3),
        },
        (
            "{s} fist punching forward again and again",
            "{s} arm punching straight ahead",
            "{s} fist thrusting forward and pulling back",
        ),
        "swing",
    ),
}
_ARM_SWING: dict[str, tuple[float, tuple[str, ...]]] = {
    "swing_little": (
        0.3,
        (
            "{s} arm hanging at the side, hardly swinging",
            "{s} arm swinging very little",
            "{s} arm moving little",
        ),
    ),
    "swing_wide": (
        1.9,
        (
            "{s} arm swinging widely",
            "{s} arm swinging strongly forward and back",
            "{s} arm swinging in big arcs with the steps",
        ),
    ),
}

# --- Torso and head: turns in the facing frame -----------------------------------------------------------------------
_TORSO: dict[str, tuple[str, dict[str, object], tuple[str, ...], str]] = {
    "lean_forward_little": (
        "lean",
        {"pitch": 14.0},
        ("torso leaning slightly forward", "upper body tilted a little forward"),
        "pitch",
    ),
    "lean_forward": (
        "lean",
        {"pitch": 29.0},
        ("torso leaning forward", "upper body bent forward", "torso tilted clearly forward"),
        "pitch",
    ),
    "lean_forward_far": (
        "lean",
        {"pitch": 48.0},
        (
            "torso leaning far forward",
            "upper body bent deeply forward",
            "torso bowed far down from the hips",
        ),
        "pitch",
    ),
    "lean_back_little": (
        "lean",
        {"pitch": -11.0},
        ("torso leaning slightly back", "upper body tilted a little backward"),
        "pitch",
    ),
    "lean_back": (
        "lean",
        {"pitch": -21.0},
        ("torso leaning back", "upper body tilted backward", "torso leaning backward, belly forward"),
        "pitch",
    ),
    "lean_back_far": (
        "lean",
        {"pitch": -32.0},
        (
            "torso leaning far back",
            "upper body bent far backward",
            "torso tilted deeply backward",
        ),
        "pitch",
    ),
    "lean_left": (
        "lean",
        {"roll": 11.0},
        ("torso leaning to the left", "upper body tilted to the left side"),
        "roll",
    ),
    "lean_left_far": (
        "lean",
        {"roll": 23.0},
        ("torso leaning far to the left", "upper body bent deeply to the left side"),
        "roll",
    ),
    "lean_right": (
        "lean",
        {"roll": -11.0},
        ("torso leaning to the right", "upper body tilted to the right side"),
        "roll",
    ),
    "lean_right_far": (
        "lean",
        {"roll": -23.0},
        ("torso leaning far to the right", "upper body bent deeply to the right side"),
        "roll",
    ),
    "slump": (
        "slump",
        {"pitch": 26.0},
        (
            "back rounded, shoulders hunched forward",
            "torso slumped, chest sunken",
            "hunched over with a round back",
        ),
        "arch",
    ),
    "chest_out": (
        "slump",
        {"pitch": -15.0},
        ("chest pushed out, back arched", "torso upright with the chest lifted", "back hollow, chest high"),
        "arch",
    ),
    "sway": (
        "sway",
        {"roll": 10.0},
        (
            "torso swaying from side to side with the steps",
            "upper body rocking left and right",
            "torso rolling widely from side to side",
        ),
        "roll_range",
    ),
    "bounce": (
        "bounce",
        {"height": 0.07},
        (
            "torso bouncing up and down with every step",
            "body bobbing up and down",
            "bouncing strongly at each step",
        ),
        "bounce",
    ),
    "twist": (
        "twist",
        {"yaw": 16.0},
        (
            "shoulders twisting strongly with the steps",
            "torso twisting left and right with every step",
            "shoulders swinging from side to side",
        ),
        "twist_range",
    ),
}
_HEAD: dict[str, tuple[dict[str, object], tuple[str, ...], str]] = {
    "down_little": (
        {"pitch": 16.0},
        ("head slightly lowered", "looking a little downward"),
        "pitch",
    ),
    "down": (
        {"pitch": 32.0},
        ("head down, looking at the ground", "head lowered", "face turned down to the feet"),
        "pitch",
    ),
    "down_far": (
        {"pitch": 48.0},
        ("head hanging low, chin on the chest", "head hanging down, eyes on the ground"),
        "pitch",
    ),
    "up_little": ({"pitch": -13.0}, ("head slightly raised", "chin a little up"), "pitch"),
    "up": ({"pitch": -24.0}, ("head raised, chin up", "looking upward"), "pitch"),
    "up_far": (
        {"pitch": -38.0},
        ("head thrown back, looking at the sky", "looking far up, head tilted back"),
        "pitch",
    ),
    "turned_left": (
        {"yaw": 45.0},
        ("head turned to the left", "looking to the left side", "face turned left"),
        "turn",
    ),
    "turned_right": (
        {"yaw": -45.0},
        ("head turned to the right", "looking to the right side", "face turned right"),
        "turn",
    ),
    "tilted_left": (
        {"roll": 18.0},
        ("head tilted to the left shoulder", "head leaning to the left"),
        "roll",
    ),
    "tilted_right": (
        {"roll": -18.0},
        ("head tilted to the right shoulder", "head leaning to the right"),
        "roll",
    ),
    "looking_around": (
        {"wave": (0.0, 38.0, 0.0, 0.45)},
        (
            "head turning left and right, looking around",
            "looking around from side to side",
            "head turning widely from one side to the other",
        ),
        "turn_range",
    ),
    "shaking": (
        {"wave": (0.0, 16.0, 0.0, 1.7)},
        ("head shaking quickly from side to side", "shaking the head"),
        "turn_range",
    ),
    "nodding": (
        {"wave": (13.0, 0.0, 0.0, 1.5)},
        ("head nodding up and down", "nodding with the head", "head bobbing down and up"),
        "pitch_range",
    ),
}

# --- Legs: one leg at a time, or both through the hips ----------------------------------------------------------------
_LEG: dict[str, tuple[dict[str, object], tuple[str, ...], str]] = {
    "high_knee": (
        {"lift": 0.24},
        (
            "{s} knee lifted high at every step",
            "{s} leg stepping high, knee raised to the hip",
            "{s} foot raised far off the ground",
        ),
        "foot_lift",
    ),
    "lifted": (
        {"lift": 0.1},
        ("{s} foot lifted clearly at every step", "{s} leg stepping a little higher than usual"),
        "foot_lift",
    ),
    "dragging": (
        {"drag": 0.9},
        (
            "{s} foot dragging over the ground",
            "{s} leg shuffling, foot hardly lifted",
            "{s} foot sliding along the ground",
        ),
        "foot_lift",
    ),
    "wide": (
        {"outward": 0.1},
        (
            "{s} foot placed wide to the side",
            "{s} leg spread apart, wide stance",
            "{s} leg stepping wide",
        ),
        "width",
    ),
    "narrow": (
        {"outward": -0.07},
        (
            "{s} foot placed on one line, narrow stance",
            "{s} foot stepping close to the middle line",
            "{s} leg crossing towards the middle",
        ),
        "width",
    ),
    "toes_out": (
        {"toe_out": 28.0},
        ("{s} toes turned out", "{s} foot pointing outward like a duck", "{s} foot turned outward"),
        "toe_out",
    ),
    "toes_in": (
        {"toe_out": -26.0},
        (
            "{s} toes turned in",
            "{s} foot pointing inward, pigeon-toed",
            "{s} foot turned inward",
        ),
        "toe_out",
    ),
    "limping": (
        {"limp": 0.055},
        (
            "limping on the {s} leg, hip dropping at its step",
            "{s} leg limping, body sinking on it",
            "{s} leg hurt and hobbling",
        ),
        "knee_bend",
    ),
}
_LEGS: dict[str, tuple[dict[str, object], tuple[str, ...], str]] = {
    "crouch_little": (
        {"lower": 0.04},
        ("{s} knee slightly bent", "{s} knee kept a little bent, hips low"),
        "knee_bend",
    ),
    "crouch": (
        {"lower": 0.1},
        ("{s} knee bent, walking crouched", "{s} leg bent at the knee, hips lowered"),
        "knee_bend",
    ),
    "crouch_deep": (
        {"lower": 0.2},
        ("{s} knee bent deeply, crouching low", "{s} leg in a deep crouch, hips near the ground"),
        "knee_bend",
    ),
    "tiptoe": (
        {"tiptoe": 32.0},
        ("{s} foot on tiptoe, heel raised", "{s} heel high off the ground, walking on the toes"),
        "knee_bend",
    ),
    "very_wide": (
        {"outward": 0.2},
        ("{s} leg spread very wide apart", "{s} foot placed very far out to the side"),
        "width",
    ),
}


def _sided(phrases: Sequence[str], side: str) -> tuple[str, ...]:
    return tuple(p.replace("{s}", side) for p in phrases)


def _build() -> dict[str, PartEdit]:
    edits = []
    for side in ("left", "right"):
        arm, leg = f"{side}_arm", f"{side}_leg"
        for name, (parameters, phrases, field) in _ARM.items():
            texts = {arm: _sided(phrases, side)}
            edits.append(PartEdit(f"{arm}.{name}", arm, "hand", parameters, texts, (arm, field)))
        for name, (scale, phrases) in _ARM_SWING.items():
            texts = {arm: _sided(phrases, side)}
            edits.append(PartEdit(f"{arm}.{name}", arm, "swing", {"scale": scale}, texts, (arm, "swing")))
        for name, (parameters, phrases, field) in _LEG.items():
            texts = {leg: _sided(phrases, side)}
            edits.append(PartEdit(f"{leg}.{name}", leg, "leg", parameters, texts, (leg, field)))
    for name, (kind, parameters, phrases, field) in _TORSO.items():
        edits.append(
            PartEdit(f"torso.{name}", "torso", kind, parameters, {"torso": phrases}, ("torso", field))
        )
    for name, (parameters, phrases, field) in _HEAD.items():
        edits.append(PartEdit(f"head.{name}", "head", "head", parameters, {"head": phrases}, ("head", field)))
    for name, (parameters, phrases, field) in _LEGS.items():
        texts = {f"{side}_leg": _sided(phrases, side) for side in ("left", "right")}
        edits.append(PartEdit(f"legs.{name}", "legs", "legs", parameters, texts, ("left_leg", field)))
    return {edit.name: edit for edit in edits}


EDITS = _build()

# One side is trained and the other never shown, or a strength is left out between or beyond trained ones.
HELD_OUT = frozenset(
    {
        "left_arm.overhead",
        "right_arm.on_head",
        "left_arm.behind_back",
        "right_arm.at_ear",
        "left_arm.on_chest",
        "right_arm.backward",
        "left_arm.forward_low",
        "right_arm.side_low",
        "right_arm.punching",
        "torso.lean_back_far",
        "torso.lean_forward",
        "torso.lean_right_far",
        "head.down_far",
        "head.up",
        "head.turned_right",
        "head.tilted_left",
        "left_leg.high_knee",
        "right_leg.dragging",
        "left_leg.toes_out",
        "legs.crouch",
        "legs.very_wide",
    }
)
# Each alone is trained, never both at once.
HELD_OUT_PAIRS: dict[str, tuple[str, str]] = {
    "hands on hips": ("left_arm.on_hip", "right_arm.on_hip"),
    "both arms stretched out in front": ("left_arm.forward", "right_arm.forward"),
    "arms crossed": ("left_arm.folded", "right_arm.folded"),
    "hands in pockets": ("left_arm.in_pocket", "right_arm.in_pocket"),
    "both hands behind the head": ("left_arm.behind_head", "right_arm.behind_head"),
    "hunched over, looking at the ground": ("torso.slump", "head.down"),
}
