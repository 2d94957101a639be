"""The catalogue of arm edits: parameters, sentences with {s} for the side, and the measure that shows each."""

from __future__ import annotations

# --- Arms: where the wrist is held -----------------------------------------------------------------------------------
# frame: origin and axes of `point`; "shoulder" has the axes of the facing direction, the others those of their joint.
# pole: where the elbow points. wave: (x, y, z) amplitude of an oscillation of the hand, and its cycles per stride:
# in step, because the phase is all that tells the network the time.
ARM: dict[str, tuple[dict[str, object], tuple[str, ...], str]] = {
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
            "wave": (0.13, 0.0, 0.0, 2.0),
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
            "wave": (0.0, 0.0, 0.12, 1.0),
        },
        (
            "{s} fist punching forward again and again",
            "{s} arm punching straight ahead",
            "{s} fist thrusting forward and pulling back",
        ),
        "hand_front",
    ),
}
ARM_SWING: dict[str, tuple[float, tuple[str, ...]]] = {
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
