"""The catalogue of torso, head and leg edits: parameters, sentences, and the measure that shows each."""

from __future__ import annotations

# --- Torso and head: turns in the facing frame -----------------------------------------------------------------------
TORSO: dict[str, tuple[str, dict[str, object], tuple[str, ...], str]] = {
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
HEAD: dict[str, tuple[dict[str, object], tuple[str, ...], str]] = {
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
    "turned_left_little": (
        {"yaw": 20.0},
        ("head turned slightly to the left", "looking a little to the left", "face turned a bit left"),
        "turn",
    ),
    "turned_right_little": (
        {"yaw": -20.0},
        ("head turned slightly to the right", "looking a little to the right", "face turned a bit right"),
        "turn",
    ),
    "tilted_left_little": (
        {"roll": 8.0},
        ("head tilted slightly to the left", "head leaning a little to the left shoulder"),
        "roll",
    ),
    "tilted_right_little": (
        {"roll": -8.0},
        ("head tilted slightly to the right", "head leaning a little to the right shoulder"),
        "roll",
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
        {"wave": (0.0, 30.0, 0.0, 1.0)},
        (
            "head turning left and right, looking around",
            "looking around from side to side",
            "head turning widely from one side to the other",
        ),
        "turn_range",
    ),
    "shaking": (
        {"wave": (0.0, 16.0, 0.0, 2.0)},
        ("head shaking quickly from side to side", "shaking the head"),
        "turn_range",
    ),
    "nodding": (
        {"wave": (13.0, 0.0, 0.0, 2.0)},
        ("head nodding up and down", "nodding with the head", "head bobbing down and up"),
        "pitch_range",
    ),
}

# --- Legs: one leg at a time, or both through the hips ----------------------------------------------------------------
LEG: dict[str, tuple[dict[str, object], tuple[str, ...], str]] = {
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
    "toes_out_little": (
        {"toe_out": 13.0},
        ("{s} toes turned slightly out", "{s} foot pointing a little outward"),
        "toe_out",
    ),
    "toes_in_little": (
        {"toe_out": -12.0},
        ("{s} toes turned slightly in", "{s} foot pointing a little inward"),
        "toe_out",
    ),
    "low": (
        {"drag": 0.45},
        ("{s} foot lifted less than usual", "{s} leg stepping flat, foot low over the ground"),
        "foot_lift",
    ),
}
LEGS: dict[str, tuple[dict[str, object], tuple[str, ...], str]] = {
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
        "foot_pitch",
    ),
    "very_wide": (
        {"outward": 0.2},
        ("{s} leg spread very wide apart", "{s} foot placed very far out to the side"),
        "width",
    ),
}
