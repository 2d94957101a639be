"""Numbers to sentences: a body part's measures as a short description in the vocabulary of the prompts.

Every phrase has synonyms, "one | another"; `k` chooses among them, so that one motion gets several descriptions of the same truth.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from runtime.prompts.parts import MAX_CHARACTERS, PartDescriptions
from training.text.measure import ArmMeasures, BodyMeasures, HeadMeasures, LegMeasures, TorsoMeasures

STRAIGHT = 0.3  # m of wandering under which a course is straight
STANDING = 0.3  # of the frames that move, under which a motion is standing
_SPREAD = "{s} arm stretched straight out to the side at shoulder height | {s} arm spread wide like a wing"
_BENDS = ("knee nearly straight", "knee slightly bent", "knee bent", "knee bent deeply")
_SWINGS = (
    "held still | not swinging | nearly still",
    "hardly swinging | swinging very little | moving little",
    "swinging gently | swinging slightly forward and back | swinging softly",
    "swinging naturally | swinging moderately forward and back | swinging easily with the steps",
    "swinging widely | swinging strongly forward and back | swinging broadly with the steps",
)
_STEPS = (
    "short steps | small steps",
    "rather short steps | fairly short steps",
    "steps of normal length | moderate steps",
    "long steps | long strides",
    "very long strides | very long steps",
)
_PACES = (
    "stepping very slowly | walking very slowly",
    "stepping slowly | walking slowly",
    "stepping evenly | walking at a normal pace",
    "stepping briskly | walking fast",
    "jogging | running slowly",
    "running | running fast",
)
_LEANS = (
    "torso leaning back slightly | torso upright, leaning back",
    "torso upright | torso straight",
    "torso leaning slightly forward | torso bent slightly forward",
    "torso leaning forward | torso bent forward",
    "torso bent far forward | torso leaning deeply forward from the hips",
)
_GAZES = (
    "head tilted back, chin raised | head held high, looking up",
    "head raised | chin up, head high",
    "head upright, looking straight ahead | head level, facing forward",
    "head slightly lowered | head lowered slightly, looking ahead at the ground",
    "head lowered, looking down | head bowed, gaze on the ground",
    "head hanging down, looking at the ground | head drooping, chin near the chest",
)


def describe(body: BodyMeasures, k: int) -> PartDescriptions:
    """Six descriptions of a motion, by its synonyms number `k`."""
    gap = body.left_leg.width + body.right_leg.width
    return PartDescriptions(
        left_arm=describe_arm(body.left_arm, "left", k),
        right_arm=describe_arm(body.right_arm, "right", k + 1),
        left_leg=describe_leg(body.left_leg, gap, "left", k),
        right_leg=describe_leg(body.right_leg, gap, "right", k + 1),
        torso=describe_torso(body.torso, k),
        head=describe_head(body.head, k),
    )


def describe_arm(m: ArmMeasures, side: str, k: int) -> str:
    """What one arm does."""
    return _sentence([_arm_place(m, k).replace("{s}", side), _arm_movement(m, k)])


def _arm_place(m: ArmMeasures, k: int) -> str:
    level = _grade(m.hand_level, (0.05, 0.3, 0.75, 1.05), ("hip", "waist", "chest", "shoulder", "head"))
    bends = ("elbow straight", "elbow slightly bent", "elbow bent", "elbow bent sharply")
    bend = _grade(m.elbow_bend, (15, 38, 70), bends)
    away = _grade(m.hand_out, (0.03, 0.15), (" close to the side", " at the side", " away from the side"))
    lifts = m.hand_level_top > 1.2 and m.hand_level_range > 1.5 and m.hand_out < 0.35 and m.swing < 0.3
    place = _first(
        k,
        (
            m.hand_level_top > 1.4 and m.hand_level > 1.0,
            "{s} arm raised overhead | {s} hand raised above the head | {s} arm raised high",
        ),
        (lifts, "{s} arm lifting up high overhead | {s} hand rising above the head and lowering again"),
        (m.hand_out > 0.33 and m.elbow_bend < 40, _SPREAD),
        (
            m.hand_front < -0.2 and m.hand_out < 0.0,
            "{s} hand held behind the back, elbow bent | {s} arm bent behind the back",
        ),
        (
            m.hand_front < -0.2 and m.elbow_bend > 45,
            "{s} elbow bent and drawn back out to the side like a wing, hand behind the hip"
            " | {s} arm bent like a wing, elbow out to the side and behind the body",
        ),
        (
            m.hand_front > 0.28,
            f"{{s}} arm stretched out in front at {level} height, {bend}"
            f" | {{s}} hand reaching forward in front of the {level}, {bend}",
        ),
        (
            m.elbow_bend > 85,
            f"{{s}} elbow bent sharply, hand in front of the {level} | {{s}} arm bent, hand held at {level} height",
        ),
        (
            m.elbow_bend > 48,
            f"{{s}} elbow bent, hand at {level} height | {{s}} arm bent, hand beside the {level}",
        ),
        (
            True,
            f"{{s}} arm hanging{away}, {bend} | {{s}} hand hanging beside the hip, {bend} | {{s}} arm{away}, {bend}",
        ),
    )
    return place + ", tilting up and down" if place in _SPREAD and m.hand_level_range > 1.0 else place


def _arm_movement(m: ArmMeasures, k: int) -> str:
    swing = _pick(k, _grade(m.swing, (0.06, 0.16, 0.29, 0.45), _SWINGS))
    sideways = _pick(k, " and from side to side | , drifting out to the side") if m.side_swing > 0.17 else ""
    return _first(
        k,
        (
            m.hand_level > 1.0 and m.side_swing > 0.14 and m.frequency > 1.0,
            "waving from side to side | hand waving quickly",
        ),
        (m.hand_level > 1.0, ""),
        (
            m.frequency > 1.6 and m.swing < 0.12 and m.hand_level_range > 0.08,
            "flapping quickly | beating quickly up and down",
        ),
        (
            m.swing >= 0.36 and m.hand_level_range > 0.75,
            "swinging widely, hand rising high in front | swinging in big arcs",
        ),
        (m.hand_out > 0.33, "" if m.hand_level_range > 1.0 else "held still"),
        (
            m.hand_level_range > 0.5 and m.swing < 0.36 and m.elbow_bend > 60,
            "hand moving up and down | forearm rising and falling",
        ),
        (True, swing + sideways),
    )


def describe_leg(m: LegMeasures, gap: float, side: str, k: int) -> str:
    """What one leg does; `gap` is the distance of both ankles, metres."""
    bend = _grade(m.knee_bend, (19, 32, 41), _BENDS)
    if m.moving < STANDING:
        return _pick(k, f"{side} leg standing still, {bend} | {side} foot planted on the ground, {bend}")
    pace = _pick(k, _grade(m.speed, (0.55, 0.85, 1.3, 1.75, 2.4), _PACES))
    steps = _pick(k, _grade(m.step_length, (0.38, 0.5, 0.7, 0.82), _STEPS))
    return _sentence([f"{side} leg {pace}", steps, bend, *_unusual_steps(m, gap, k)])


def _unusual_steps(m: LegMeasures, gap: float, k: int) -> list[str]:
    """What is unlike usual steps: their rate, their sides, the foot, the width."""
    return [
        _first(
            k,
            (m.cadence > 2.15, "quick steps | many steps a minute"),
            (0.0 < m.cadence < 1.4, "slow steps | few steps a minute"),
        ),
        _first(
            k,
            (m.stance_lead > 0.2, "standing longer than the other"),
            (m.stance_lead < -0.2, "limping a little"),
        ),
        _first(
            k,
            (m.landing > 0.75, "foot hitting the ground hard | foot landing heavily"),
            (0.0 < m.landing < 0.15, "foot set down gently | foot landing softly"),
        ),
        _first(
            k,
            (m.thigh_lift > 40, "knee lifting high | thigh lifting high"),
            (m.foot_lift < 0.115, "foot lifted barely | foot close to the ground"),
        ),
        _first(
            k,
            (gap < -0.03, "crossing in front of the other on a narrow line | feet on one line"),
            (gap > 0.165, "feet wide apart | wide stance"),
        ),
    ]


def describe_torso(m: TorsoMeasures, k: int) -> str:
    """What the torso does."""
    straight = m.wander < STRAIGHT  # on a bend hips and shoulders turn with the course
    return _sentence(
        [
            _pick(k, _grade(m.pitch, (-5, 3.5, 8, 20), _LEANS)),
            _first(k, (m.arch > 3, "back rounded | shoulders rolled forward")),
            _first(k, (m.roll > 4, "leaning to the left"), (m.roll < -4, "leaning to the right")),
            _first(
                k,
                (m.roll_range > 20, "tilting widely from side to side | banking from side to side"),
                (
                    m.roll_range > 11 or m.pitch_range > 16,
                    "swaying heavily | swaying widely from side to side",
                ),
                (m.roll_range > 7.2, "swaying from side to side | upper body swaying"),
            ),
            _first(
                k,
                (
                    m.twist_range > 27,
                    "twisting widely with each step | shoulders turning strongly with the arms",
                ),
                (m.twist_range > 17, "turning with each step | twisting moderately with each step"),
                (m.twist_range < 9 and m.roll_range < 8, "held still | hardly turning"),
            ),
            *(_in_step(m, k) if straight else ()),
            _first(
                k,
                (m.bounce > 0.07, "bouncing up and down | rising and falling with each step"),
                (m.bounce > 0.045, "bouncing slightly | rising and falling slightly"),
            ),
        ]
    )


def _in_step(m: TorsoMeasures, k: int) -> list[str]:
    """What hips and shoulders do with the steps, if it is more than usual."""
    sways = m.sway > 0.11 or m.pelvis_roll_range > 14
    swings, turns, rolls = m.pelvis_yaw_range > 22, m.shoulder_yaw_range > 23, m.shoulder_roll_range > 11
    cases = (
        (sways, "hips swaying from side to side | hips swaying with every step"),
        (swings, "hips swinging round with every step | hips turning clearly with the steps"),
        (turns, "shoulders swinging round with every step | shoulders turning with the steps"),
        (rolls, "shoulders rolling with the steps | shoulders rising and falling in turn"),
    )
    return [_first(k, case) for case in cases]


def describe_head(m: HeadMeasures, k: int) -> str:
    """What the head does."""
    tilted = abs(m.roll) > 11 and m.roll_range < 2 * abs(m.roll)
    still = m.turn_range < 7 and m.roll_range < 7 and m.pitch_range < 7
    return _sentence(
        [
            _pick(k, _grade(m.pitch, (-18, -5, 6, 14, 26), _GAZES)),
            _first(k, (m.forward > 0.05, "pushed forward | neck stretched forward")),
            _first(k, (tilted, f"tilted to the {'left' if m.roll > 0 else 'right'}")),
            _first(k, (m.turn_range > 25, "turning from side to side | turning left and right")),
            _first(
                k,
                (m.roll_range > 22, "rolling loosely from side to side | lolling from side to side"),
                (m.roll_range > 14, "swaying slightly | tilting gently from side to side"),
            ),
            _first(k, (m.bob > 0.045 or m.pitch_range > 25, "nodding | bobbing")),
            _first(k, (still, "steady | held still")),
        ]
    )


def _grade(value: float, limits: Sequence[float], words: Sequence[str]) -> str:
    """The word of the interval that `value` lies in; one more word than limits."""
    return words[sum(value >= limit for limit in limits)]


def _first(k: int, *cases: tuple[bool, str]) -> str:
    """A synonym of the first case that holds, "" where none does."""
    return next((_pick(k, synonyms) for holds, synonyms in cases if holds), "")


def _pick(k: int, phrase: str) -> str:
    synonyms = phrase.split(" | ")
    # the second pair of descriptions combines the synonyms differently: phrases shift by their own length
    return synonyms[(k + k // 2 * len(synonyms[0])) % len(synonyms)]


def _sentence(words: Iterable[str]) -> str:
    return ", ".join(word for word in words if word)[:MAX_CHARACTERS]
