"""What a sentence says of a body part, in measures: "elbow bent sharply" is an elbow bend of at least 65 degrees.

A rule is a pattern and a range of one measure, absolute or against the neutral walk. A fraction says how far a walk goes from
the neutral one into the range: 0 is as in neutral or away from it, 1 is there.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cache

from training.text.measure import BodyMeasures, measure_names

FAR = 1e9
MOST_STEPS = 3.0  # of one measure, in a sum of changes
# what counts as one step out of a range that the neutral walk is in; degrees, metres, fractions
_SIZE = {
    "hand_level": 0.4, "hand_out": 0.15, "hand_front": 0.2, "elbow_bend": 35.0, "swing": 0.2, "side_swing": 0.15,
    "hand_level_range": 0.4, "knee_bend": 15.0, "knee_bend_top": 15.0, "foot_lift": 0.08, "foot_pitch": 15.0, "width": 0.07, "toe_out": 15.0,
    "walk_ratio": 0.15, "step_length": 0.2, "cadence": 0.5, "landing": 0.3, "stance_lead": 0.4, "halting": 0.2,
    "pitch": 12.0, "roll": 8.0, "arch": 8.0, "roll_range": 8.0, "twist_range": 12.0, "bounce": 0.04, "sway": 0.06,
    "pelvis_yaw_range": 12.0, "shoulder_roll_range": 8.0, "shoulder_yaw_range": 10.0, "wander": 0.15, "turn": 20.0,
    "turn_range": 15.0, "pitch_range": 10.0, "forward": 0.04,
}  # fmt: skip


@dataclass(frozen=True)
class Rule:
    """`pattern` in a clause claims that `field` lies between `low` and `high`; `mode` says against what.

    "is": absolute. "plus": the neutral walk's value and so much. "times": so many times the neutral walk's value.
    """

    pattern: str
    field: str
    low: float = -FAR
    high: float = FAR
    mode: str = "is"

    def range(self, neutral: float) -> tuple[float, float]:
        """Lowest and highest value that keep the claim."""
        if self.mode == "plus":
            return neutral + self.low, neutral + self.high
        if self.mode == "times":
            return (neutral * self.low if self.low > -FAR else -FAR), (
                neutral * self.high if self.high < FAR else FAR
            )
        return self.low, self.high


def _by_degree(
    pattern: str, field: str, sizes: tuple[float, float, float], mode: str = "plus"
) -> tuple[Rule, ...]:
    """Rules of what is done slightly, plainly and far; negative sizes ask for less."""
    little, plain, far = sizes
    few = r"(?=.*\b(?:slightly|gently|a little|softly|lightly|weakly)\b)"
    much = r"(?=.*\b(?:far|deeply|widely|heavily|strongly|very|thrown|hanging down|low\b))"
    none = r"(?!.*\b(?:slightly|gently|a little|softly|lightly|weakly|far|deeply|widely|heavily|strongly|very|thrown)\b)"
    rules = []
    for degree, size in ((few, little), (none, plain), (much, far)):
        more = size > 0 if mode == "plus" else size > 1
        low, high = (size, FAR) if more else (-FAR, size)
        rules.append(Rule(rf"^{degree}.*{pattern}", field, low, high, mode))
    return tuple(rules)


_ARM = (
    Rule(r"overhead|above the head|over the head|to the sky", "hand_level", 1.2),
    Rule(r"on the head|behind the head|at the ear|to the ear|before the face|front of the face|forehead|diagonally up|raised up and out", "hand_level", 0.95),
    Rule(r"at shoulder height", "hand_level", 0.72, 1.25),
    Rule(r"chest height|front of the chest|to the chest|on the chest|at the chest|across the chest|over the chest", "hand_level", 0.42, 1.0),
    Rule(r"waist height|front of the (?:belly|waist|stomach)|(?:holding|on) the belly|at the waist", "hand_level", 0.08, 0.65),
    Rule(r"front of the (?:chest|belly|waist|stomach|face)|forearm level in front|held out in front", "hand_front", 0.1),
    Rule(r"stretched (?:straight )?out in front|reaching (?:out )?(?:far )?(?:forward|in front)|stretched (?:straight )?forward", "hand_front", 0.27),
    Rule(r"(?:out|stretched|spread|raised|held) (?:straight )?(?:out )?(?:to the side|sideways)|spread wide|like a wing$", "hand_out", 0.2),
    Rule(r"(?<!little )away from the side", "hand_out", 0.1),
    Rule(r"little away from the side", "hand_out", 0.05),
    Rule(r"close to the side", "hand_out", -FAR, 0.07),
    Rule(r"hanging", "hand_level", -FAR, 0.25),
    Rule(r"behind the back|far behind|behind the body", "hand_front", -FAR, -0.1),
    Rule(r"hand (?:resting )?on the hip|akimbo|fist on the waist", "elbow_bend", 50.0),
    Rule(r"in the pocket", "swing", -FAR, 0.14),
    Rule(r"elbow (?:slightly|a little) bent", "elbow_bend", 14.0, 55.0),
    Rule(r"elbow bent sharply|bent at a (?:right|left) angle", "elbow_bend", 62.0),
    Rule(r"elbow bent(?! sharply| at)|arm bent", "elbow_bend", 35.0),
    Rule(r"elbow (?:nearly )?straight|arm (?:stiff and )?straight|elbow not bending", "elbow_bend", -FAR, 22.0),
    Rule(r"not swinging|held still|arm still|^still$|hanging still|held tightly", "swing", -FAR, 0.12),
    Rule(r"hardly swinging|swinging (?:very )?little|moving little|nearly still", "swing", -FAR, 0.18),
    Rule(r"swinging (?:gently|softly|lightly|slightly)|swinging less", "swing", 0.05, 0.32),
    Rule(r"swinging (?:naturally|moderately|easily|evenly)", "swing", 0.12, 0.5),
    Rule(r"swinging (?:very )?(?:widely|broadly|strongly|high)|big (?:loose )?arcs|thrown far", "swing", 1.2, FAR, "times"),
    Rule(r"pumping|punching", "swing", 0.2),
    Rule(r"waving|from side to side", "side_swing", 0.1),
    Rule(r"flapping|up and down", "hand_level_range", 0.3),
)  # fmt: skip
_LEG = (
    Rule(r"knee (?:slightly|a little|kept a little) bent", "knee_bend", 12.0, 38.0),
    Rule(r"knee bent deeply|deep crouch|crouching low", "knee_bend", 16.0, FAR, "plus"),
    Rule(r"knee bent(?! deeply)|bent at the knee|walking crouched", "knee_bend", 7.0, FAR, "plus"),
    Rule(r"knee (?:nearly )?straight|stiff and straight|not bending|leg stiff|knee stiff|hardly bending", "knee_bend", -FAR, 20.0),
    Rule(r"(?<!nearly )knee straight(?! at| in)|stiff and straight|not bending|leg stiff|knee stiff", "knee_bend_top", -FAR, -15.0, "plus"),
    Rule(r"knee (?:lifting|lifted) (?:very )?high|stepping high", "foot_lift", 0.06, FAR, "plus"),
    Rule(r"lifted barely|close to the ground|shuffl|dragging|sliding|scuffing|hardly lifted", "foot_lift", -FAR, 0.8, "times"),
    Rule(r"tiptoe|on the toes|heel raised|toes landing first", "foot_pitch", 10.0, FAR, "plus"),
    Rule(r"wide apart|wide stance|spread|placed wide|stepping wide", "width", 0.04, FAR, "plus"),
    Rule(r"one line|narrow|close together|pressed together|knees together|crossing|foot in front of foot", "width", -FAR, -0.025, "plus"),
    Rule(r"(?:toes|foot|knee)(?: bent)?(?: deeply)?(?: and)? (?:slightly )?turned out|pointing outward", "toe_out", 8.0, FAR, "plus"),
    Rule(r"(?:toes|foot) (?:slightly )?turned in|pigeon|pointing inward", "toe_out", -FAR, -8.0, "plus"),
    Rule(r"very long|giant|long slow", "walk_ratio", 1.25, FAR, "times"),
    Rule(r"(?<!very )(?<!rather )long (?:\w+ )?(?:steps|strides)|striding", "walk_ratio", 1.1, FAR, "times"),
    Rule(r"rather short|slightly shorter", "walk_ratio", -FAR, 0.95, "times"),
    Rule(r"(?:tiny|very short|small)(?: and)?(?: \w+)? (?:and very quick )?steps", "walk_ratio", -FAR, 0.75, "times"),
    Rule(r"(?<!rather )(?<!very )short (?:\w+ )?steps|steps short", "walk_ratio", -FAR, 0.87, "times"),
    Rule(r"quick|hurried|hurrying|fast|brisk", "cadence", 1.08, FAR, "times"),
    Rule(r"(?<!long )slow(?!ly and heavily)", "cadence", -FAR, 0.94, "times"),
    Rule(r"stomp|stamp|slam|hitting the ground hard|landing heavily|full weight|heav", "landing", 1.35, FAR, "times"),
    Rule(r"softly|lightly|gently", "landing", -FAR, 0.95, "times"),
    Rule(r"limping", "stance_lead", -FAR, -0.12, "plus"),
    Rule(r"pausing|stopping|halting|hesitant|hesitating", "halting", 0.1, FAR, "plus"),
)  # fmt: skip
_TORSO = (
    *_by_degree(r"(?:lean|bent|bowed|tilted|pitch)\w*.*forward", "pitch", (3.0, 9.0, 20.0)),
    *_by_degree(r"(?:lean|bent|tilted)\w*.*\bback(?:ward)?\b", "pitch", (-3.0, -8.0, -16.0)),
    *_by_degree(r"lean\w*.*to the left", "roll", (2.0, 5.0, 12.0)),
    *_by_degree(r"lean\w*.*to the right", "roll", (-2.0, -5.0, -12.0)),
    Rule(r"torso upright|back straight", "pitch", -7.0, 7.0, "plus"),
    *_by_degree(r"rounded|hunched|slumped|chest sunken|rolled forward|stooped|shoulders drooping", "arch", (2.5, 6.0, 9.0)),
    *_by_degree(r"chest (?:pushed out|lifted|out|high)|back (?:arched|hollow)|shoulders (?:pulled|drawn) back", "arch", (-2.0, -4.0, -6.0)),
    *_by_degree(r"^(?!.*(?:hips|shoulders)).*(?:rocking|swaying|wobbling|tilting over|tilting far over|waddling)", "roll_range", (1.0, 4.0, 8.0)),
    *_by_degree(r"hips (?:\w+ )?(?:sway|pushed out|roll)", "sway", (1.15, 1.5, 2.0), "times"),
    *_by_degree(r"hips (?:\w+ )?(?:swing|twist|turn)", "pelvis_yaw_range", (1.15, 1.5, 2.0), "times"),
    *_by_degree(r"shoulders (?:\w+ )?(?:roll|rising)", "shoulder_roll_range", (1.5, 3.0, 6.0)),
    *_by_degree(r"shoulders (?:\w+ )?(?:swing|turn|twist)", "shoulder_yaw_range", (1.1, 1.3, 1.6), "times"),
    *_by_degree(r"^(?!.*(?:hips|shoulders)).*(?:twisting|turning)(?! as one)", "twist_range", (1.0, 4.0, 8.0)),
    Rule(r"held still|hardly turning|turning as one piece|nearly still|\bstiff\b", "twist_range", -FAR, 0.75, "times"),
    *_by_degree(r"bouncing|bobbing|rising and falling", "bounce", (1.1, 1.35, 1.7), "times"),
    Rule(r"held level|gliding|not rising", "bounce", -FAR, 0.8, "times"),
    Rule(r"stagger|reeling|off balance|drifting", "wander", 0.04, FAR, "plus"),
)  # fmt: skip
_HEAD = (
    Rule(r"chin on the chest|hanging", "pitch", 22.0, FAR, "plus"),
    *_by_degree(r"(?:lowered|head down|chin down|looking (?:down|at the (?:ground|feet|floor|hands))|bowed|drooping)", "pitch", (4.0, 9.0, 16.0)),
    *_by_degree(r"(?:head (?:slightly )?raised|chin (?:slightly )?(?:up|raised)|head up\b|held high|looking up|thrown back|tilted back)", "pitch", (-2.5, -6.0, -18.0)),
    Rule(r"head (?:upright|level)|straight ahead", "pitch", -9.0, 9.0, "plus"),
    *_by_degree(r"tilted(?: \w+)? to the left", "roll", (3.0, 6.0, 12.0)),
    *_by_degree(r"tilted(?: \w+)? to the right", "roll", (-3.0, -6.0, -12.0)),
    *_by_degree(r"(?:turned|looking)(?: \w+)? to the left", "turn", (7.0, 15.0, 30.0)),
    *_by_degree(r"(?:turned|looking)(?: \w+)? to the right", "turn", (-7.0, -15.0, -30.0)),
    Rule(r"turning|looking around|shaking", "turn_range", 7.0, FAR, "plus"),
    Rule(r"nodding|bobbing", "pitch_range", 3.0, FAR, "plus"),
    Rule(r"swaying|lolling|rolling|tilting", "roll_range", 3.0, FAR, "plus"),
    Rule(r"pushed forward|thrust forward|neck stretched", "forward", 0.02, FAR, "plus"),
    Rule(r"held still|steady|\bstill\b", "turn_range", -FAR, 9.0),
)  # fmt: skip
RULES: dict[str, tuple[Rule, ...]] = {
    "left_arm": _ARM,
    "right_arm": _ARM,
    "left_leg": _LEG,
    "right_leg": _LEG,
    "torso": _TORSO,
    "head": _HEAD,
}


def clause_fraction(
    part: str, clause: str, neutral: BodyMeasures, walked: BodyMeasures
) -> tuple[float, bool] | None:
    """The least fraction of what a clause claims of a part, and whether it claims something that neutral is not.

    None where no rule knows the clause. What the neutral walk does not show counts alone, where there is any.
    """
    found = [
        (_fraction(rule, _value(neutral, part, rule.field), _value(walked, part, rule.field)), rule)
        for rule in _rules(part, clause)
    ]
    changes = [fraction for fraction, rule in found if not _within(rule, _value(neutral, part, rule.field))]
    kept = [fraction for fraction, _ in found]
    return (min(changes or kept), bool(changes)) if kept else None


def clauses(sentence: str) -> list[str]:
    """The clauses of a sentence."""
    return [clause.strip() for clause in sentence.split(",") if clause.strip()]


def sentence_fraction(part: str, sentence: str, neutral: BodyMeasures, walked: BodyMeasures) -> float | None:
    """The least fraction of what the clauses claim that neutral is not; None where a sentence claims nothing of the kind."""
    found = [clause_fraction(part, clause, neutral, walked) for clause in clauses(sentence)]
    return min((fraction for fraction, changes in filter(None, found) if changes), default=None)


def claims(part: str, sentence: str) -> frozenset[tuple[str, str]]:
    """The measures that a sentence makes claims of, each with "more", "less" or "within"."""
    return frozenset(
        (rule.field, "more" if rule.high >= FAR else "less" if rule.low <= -FAR else "within")
        for rule in _rules(part, sentence)
    )


def unclaimed_change(part: str, sentence: str, neutral: BodyMeasures, walked: BodyMeasures) -> float:
    """What a walk does to a part that a sentence does not claim, in steps of each measure, and by how much it does too much."""
    rules = _rules(part, sentence)
    claimed = {rule.field for rule in rules}
    total = 0.0
    for field, size in _SIZE.items():
        if field in measure_names(part) and field not in claimed:
            before, now = _value(neutral, part, field), _value(walked, part, field)
            total += min(abs(now - before) / size, MOST_STEPS)
    return total + sum(
        _excess(rule, _value(neutral, part, rule.field), _value(walked, part, rule.field)) for rule in rules
    )


def _excess(rule: Rule, neutral: float, walked: float) -> float:
    """By how many steps a walk goes farther than a claim of more or less; 0 for a claim of a place between."""
    low, high = rule.range(neutral)
    if low > -FAR and high < FAR:
        return 0.0
    beyond = walked - low if high >= FAR else high - walked
    size = max(_SIZE[rule.field], _away(neutral, low, high))
    return min(max(beyond / size - 1.0, 0.0), MOST_STEPS)


def _rules(part: str, sentence: str) -> list[Rule]:
    return [
        rule for clause in clauses(sentence) for rule in RULES[part] if _compiled(rule.pattern).search(clause)
    ]


def _fraction(rule: Rule, neutral: float, walked: float) -> float:
    low, high = rule.range(neutral)
    start, now = _away(neutral, low, high), _away(walked, low, high)
    size = start if start > 0.0 else _SIZE[rule.field]
    return float(max(0.0, 1.0 - now / size))


def _within(rule: Rule, neutral: float) -> bool:
    return _away(neutral, *rule.range(neutral)) == 0.0


def _away(value: float, low: float, high: float) -> float:
    return max(low - value, value - high, 0.0)


def _value(body: BodyMeasures, part: str, field: str) -> float:
    owner = body.torso if field == "wander" else getattr(body, part)
    return float(getattr(owner, field))


@cache
def _compiled(pattern: str) -> re.Pattern[str]:
    return re.compile(pattern)
