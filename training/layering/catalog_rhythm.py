"""The catalogue of rhythm and weight: how long and quick steps are, how the body moves within one, and how it lands.

Factors are times what the captured walk does. `{s}` is the side; an edit of several parts has sentences for each.
"""

from __future__ import annotations

Phrases = tuple[str, ...]

# --- Steps of both legs: kind, parameters, sentences of either leg, and of the torso where it takes part, measure -----
STEPS: dict[str, tuple[str, dict[str, object], Phrases, Phrases, tuple[str, str]]] = {
    "long_little": (
        "steps",
        {"length": 1.15},
        ("{s} leg taking rather long steps", "{s} leg taking slightly longer steps than usual"),
        (),
        ("left_leg", "walk_ratio"),
    ),
    "long": (
        "steps",
        {"length": 1.32},
        (
            "{s} leg taking long strides",
            "{s} leg stepping far forward at every step",
            "{s} leg striding out with long steps",
        ),
        (),
        ("left_leg", "walk_ratio"),
    ),
    "long_slow": (
        "steps",
        {"length": 1.15, "cadence": 0.8},
        (
            "{s} leg taking long slow strides",
            "{s} leg striding slowly, few long steps",
            "{s} leg swinging forward slowly in long steps",
        ),
        (),
        ("left_leg", "walk_ratio"),
    ),
    "giant": (
        "steps",
        {"length": 1.3, "cadence": 0.7},
        (
            "{s} leg taking very long slow strides",
            "{s} leg striding like a giant, slow and very long steps",
            "{s} leg taking giant slow steps",
        ),
        (),
        ("left_leg", "walk_ratio"),
    ),
    "short_little": (
        "steps",
        {"length": 0.85},
        ("{s} leg taking rather short steps", "{s} leg taking slightly shorter steps than usual"),
        (),
        ("left_leg", "walk_ratio"),
    ),
    "short": (
        "steps",
        {"length": 0.68},
        (
            "{s} leg taking short steps",
            "{s} leg taking small steps",
            "{s} leg stepping only a little forward",
        ),
        (),
        ("left_leg", "walk_ratio"),
    ),
    "quick_short": (
        "steps",
        {"length": 0.8, "cadence": 1.25},
        (
            "{s} leg taking short quick steps",
            "{s} leg stepping quickly in short steps",
            "{s} leg hurrying with many short steps",
        ),
        (),
        ("left_leg", "walk_ratio"),
    ),
    "hurried": (
        "steps",
        {"length": 0.6, "cadence": 1.5},
        (
            "{s} leg taking tiny hurried steps",
            "{s} leg tripping along in tiny quick steps",
            "{s} leg taking very short and very quick steps",
        ),
        (),
        ("left_leg", "walk_ratio"),
    ),
    "slow": (
        "steps",
        {"cadence": 0.75},
        ("{s} leg stepping slowly, steps of normal length", "{s} leg moving slowly from step to step"),
        (),
        ("left_leg", "cadence"),
    ),
    "quick": (
        "steps",
        {"cadence": 1.3},
        ("{s} leg stepping quickly, steps of normal length", "{s} leg moving briskly from step to step"),
        (),
        ("left_leg", "cadence"),
    ),
    "on_line": (
        "line",
        {"outward": 0.0},
        (
            "{s} foot placed exactly in front of the other, feet on one line",
            "{s} leg walking on a narrow line, foot in front of foot",
            "{s} foot set on the middle line like on a tightrope",
        ),
        (),
        ("left_leg", "width"),
    ),
    "crossing": (
        "line",
        {"outward": -0.055},
        (
            "{s} leg crossing in front of the other at every step",
            "{s} foot crossing over the middle line like a model",
            "{s} foot placed across the other on a catwalk",
        ),
        (),
        ("left_leg", "width"),
    ),
    "apart": (
        "line",
        {"outward": 0.14},
        ("{s} foot set down wide apart from the other", "{s} leg walking with a wide stance, feet apart"),
        (),
        ("left_leg", "width"),
    ),
    "far_apart": (
        "line",
        {"outward": 0.22},
        ("{s} foot set down very wide apart from the other", "{s} leg walking with a very wide stance"),
        (),
        ("left_leg", "width"),
    ),
    "pausing_little": (
        "hesitation",
        {"pause": 0.25},
        ("{s} leg stepping hesitantly", "{s} leg hesitating a little before every step"),
        (),
        ("left_leg", "halting"),
    ),
    "pausing": (
        "hesitation",
        {"pause": 0.55},
        (
            "{s} leg pausing after every step",
            "{s} leg stopping for a moment between the steps",
            "{s} leg stepping and halting, step by step",
        ),
        (),
        ("left_leg", "halting"),
    ),
    "stomping": (
        "landing",
        {"lift": 0.06, "drop": 0.03, "jolt": 3.0},
        (
            "{s} leg stepping heavily, foot hitting the ground hard",
            "{s} foot landing heavily at every step, knee giving",
            "{s} leg treading heavily",
        ),
        ("torso heavy, dropping with every step", "torso sinking heavily at every landing"),
        ("left_leg", "landing"),
    ),
    "stomping_hard": (
        "landing",
        {"lift": 0.13, "drop": 0.06, "jolt": 5.0},
        (
            "{s} leg stomping, foot slammed down hard at every step",
            "{s} foot stamping on the ground with full weight",
            "{s} leg stomping very heavily like a giant",
        ),
        ("torso very heavy, jolting down with every step", "torso shaken hard by every landing"),
        ("left_leg", "landing"),
    ),
    "soft": (
        "landing",
        {"soft": 0.6, "bob": 0.6},
        (
            "{s} leg stepping lightly and softly",
            "{s} foot set down gently without a sound",
            "{s} foot landing softly, light steps",
        ),
        ("torso light, gliding evenly over the steps", "torso carried lightly and evenly"),
        ("left_leg", "landing"),
    ),
    "unsteady": (
        "stagger",
        {"wander": 0.1, "roll": 5.0},
        ("{s} leg stepping a little unsteadily", "{s} foot placed now left, now right of the line"),
        ("torso swaying a little unsteadily", "torso slightly off balance, drifting to the sides"),
        ("torso", "wander"),
    ),
    "staggering": (
        "stagger",
        {"wander": 0.24, "roll": 11.0},
        (
            "{s} leg staggering, steps going astray to both sides",
            "{s} leg stumbling on a winding course",
            "{s} foot staggering now left, now right",
        ),
        (
            "torso staggering from one side to the other",
            "torso reeling off balance, drifting far to the sides",
        ),
        ("torso", "wander"),
    ),
}

# --- One leg: stance time ---------------------------------------------------------------------------------------------
# sentences of the leg, sentences of the other
STANCE: dict[str, tuple[dict[str, object], Phrases, Phrases]] = {
    "limping_little": (
        {"uneven": 0.7, "drop": 0.012},
        ("limping slightly on the {s} leg", "{s} leg limping a little, step a bit short"),
        ("{s} leg carrying slightly longer than the other", "{s} leg standing a little longer"),
    ),
    "limping": (
        {"uneven": 0.45, "drop": 0.025},
        (
            "limping on the {s} leg, hip dropping at its step",
            "{s} leg limping, body sinking on it",
            "{s} leg hurt and hobbling",
        ),
        ("{s} leg taking the weight, stepping quickly and heavily", "{s} leg carrying longer than the other"),
    ),
    "limping_far": (
        {"uneven": 0.28, "drop": 0.04},
        (
            "limping heavily on the {s} leg, hardly standing on it",
            "{s} leg limping badly, leaving the ground at once",
            "{s} leg hardly carrying any weight",
        ),
        ("{s} leg carrying nearly all the time", "{s} leg taking nearly all the weight, standing long"),
    ),
    "lingering": (
        {"uneven": 2.0},
        ("{s} leg lingering on the ground at every step", "{s} foot standing longer than the other"),
        ("{s} leg standing only briefly", "{s} foot lifted again quickly after every step"),
    ),
}

# --- Torso: what it does in a cycle -----------------------------------------------------------------------------------
TORSO_RHYTHM: dict[str, tuple[str, dict[str, object], Phrases, str]] = {
    "level": (
        "bob",
        {"scale": 0.3},
        ("torso gliding level, not rising or falling", "torso carried at one height, no bounce"),
        "bounce",
    ),
    "bob_little": (
        "bob",
        {"scale": 1.6},
        ("torso bobbing a little with the steps", "torso rising and falling slightly with the steps"),
        "bounce",
    ),
    "bob": (
        "bob",
        {"scale": 2.4},
        (
            "torso bobbing clearly at every step",
            "torso rising and falling strongly with the steps",
            "torso bobbing deeply up and down",
        ),
        "bounce",
    ),
    "hips_still": (
        "hips",
        {"sideways": 0.3, "roll": 0.3, "yaw": 0.3},
        ("torso with still hips, hips neither swaying nor turning", "hips held still and level"),
        "pelvis_yaw_range",
    ),
    "hips_sway_little": (
        "hips",
        {"sideways": 1.6, "roll": 1.6},
        ("hips swaying slightly from side to side", "torso with hips swaying a little"),
        "sway",
    ),
    "hips_sway": (
        "hips",
        {"sideways": 2.3, "roll": 2.4},
        (
            "hips swaying from side to side with every step",
            "torso with hips swaying clearly",
            "hips rolling to the side of the standing leg",
        ),
        "sway",
    ),
    "hips_sway_far": (
        "hips",
        {"sideways": 3.2, "roll": 3.2},
        (
            "hips swaying widely from side to side",
            "torso with hips swinging far out to the sides",
            "hips swaying strongly, hip pushed out at every step",
        ),
        "sway",
    ),
    "hips_swing": (
        "hips",
        {"yaw": 2.0},
        (
            "hips swinging round with every step",
            "torso with hips turning clearly with the steps",
            "hips twisting forward at every step",
        ),
        "pelvis_yaw_range",
    ),
    "hips_swing_far": (
        "hips",
        {"yaw": 3.0},
        ("hips swinging far round with every step", "torso with hips twisting strongly with the steps"),
        "pelvis_yaw_range",
    ),
    "shoulders_still": (
        "shoulders",
        {"yaw": 0.25},
        ("torso with still shoulders, hardly turning", "shoulders held square to the front"),
        "shoulder_yaw_range",
    ),
    "shoulders_turn_little": (
        "shoulders",
        {"yaw": 1.6},
        ("shoulders turning a little with the steps", "torso turning slightly left and right with the steps"),
        "shoulder_yaw_range",
    ),
    "shoulders_turn": (
        "shoulders",
        {"yaw": 2.3},
        (
            "shoulders swinging round with every step",
            "torso turning clearly left and right with the steps",
        ),
        "shoulder_yaw_range",
    ),
    "shoulders_roll": (
        "shoulders",
        {"roll": 6.0},
        (
            "shoulders rolling with the steps",
            "torso with shoulders rising and falling in turn",
        ),
        "shoulder_roll_range",
    ),
    "shoulders_roll_far": (
        "shoulders",
        {"roll": 12.0, "yaw": 1.4},
        (
            "shoulders rolling widely with a swagger",
            "torso swaggering, shoulders rolling strongly",
            "shoulders rolling far up and down in turn",
        ),
        "shoulder_roll_range",
    ),
    "rock_little": (
        "rock",
        {"roll": 7.5, "sideways": 0.02},
        ("torso rocking slightly from side to side", "torso tilting a little over each foot"),
        "roll_range",
    ),
    "rock": (
        "rock",
        {"roll": 12.0, "sideways": 0.035},
        (
            "torso rocking from side to side with every step",
            "torso tilting over each foot in turn",
            "torso waddling from side to side",
        ),
        "roll_range",
    ),
    "rock_far": (
        "rock",
        {"roll": 19.0, "sideways": 0.06},
        (
            "torso rocking heavily from side to side",
            "torso tilting far over each foot in turn",
            "torso waddling widely like a duck",
        ),
        "roll_range",
    ),
}

# --- Arms: how far they swing, times the capture's; beside those of catalog_arms --------------------------------------
ARM_SWINGS: dict[str, tuple[float, Phrases]] = {
    "swing_half": (0.6, ("{s} arm swinging less than usual", "{s} arm swinging softly")),
    "swing_more": (1.4, ("{s} arm swinging a little more than usual", "{s} arm swinging slightly wider")),
    "swing_far": (
        2.6,
        (
            "{s} arm swinging very widely, far forward and far back",
            "{s} arm thrown far forward and back with every step",
        ),
    ),
}
