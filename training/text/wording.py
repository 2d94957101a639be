"""Numbers to words: a body part's measures as a short description in the vocabulary of the prompts.

Every phrase has synonyms; `k` chooses among them, so that one motion gets several wordings of the same truth.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from runtime.prompts.parts import MAX_CHARACTERS, PartDescriptions
from training.text.measure import ArmMeasures, BodyMeasures, HeadMeasures, LegMeasures, TorsoMeasures

STRAIGHT = 0.3  # m of wandering under which a course is straight
STANDING = 0.3  # share of moving frames under which a motion is standing


def describe(body: BodyMeasures, k: int, pace: bool = False) -> PartDescriptions:
    """Six descriptions of a motion, wording number `k`.

    Without `pace` nothing is said of walking or running: a style is both, as the player's stick asks.
    """
    gap = body.left_leg.width + body.right_leg.width
    return PartDescriptions(
        left_arm=arm_words(body.left_arm, "left", k),
        right_arm=arm_words(body.right_arm, "right", k + 1),
        left_leg=leg_words(body.left_leg, gap, "left", k, pace),
        right_leg=leg_words(body.right_leg, gap, "right", k + 1, pace),
        torso=torso_words(body.torso, k),
        head=head_words(body.head, k),
    )


def arm_words(m: ArmMeasures, side: str, k: int) -> str:
    """What one arm does."""
    place, moves = _arm_place(m, k), _arm_movement(m, k)
    return _sentence([place.replace("{s}", side), moves])


def _arm_place(m: ArmMeasures, k: int) -> str:
    level = _level(m.hand_level)
    bend = _grade(
        m.elbow_bend,
        (15, 38, 70),
        ("elbow straight", "elbow slightly bent", "elbow bent", "elbow bent sharply"),
    )
    special = _special_arm(m, k)
    if special:
        return special
    if m.hand_front > 0.28:
        return _pick(
            k,
            f"{{s}} arm stretched out in front at {level} height, {bend}",
            f"{{s}} hand reaching forward in front of the {level}, {bend}",
        )
    if m.elbow_bend > 85:
        return _pick(
            k,
            f"{{s}} elbow bent sharply, hand in front of the {level}",
            f"{{s}} arm bent, hand held at {level} height",
        )
    if m.elbow_bend > 48:
        return _pick(
            k, f"{{s}} elbow bent, hand at {level} height", f"{{s}} arm bent, hand beside the {level}"
        )
    return _hanging_arm(m, bend, k)


def _special_arm(m: ArmMeasures, k: int) -> str:
    """Overhead, spread, and behind the body; "" for any other arm."""
    if m.hand_level_top > 1.4 and m.hand_level > 1.0:
        return _pick(k, "{s} arm raised overhead", "{s} hand raised above the head", "{s} arm raised high")
    if m.hand_level_top > 1.2 and m.hand_level_range > 1.5 and m.hand_out < 0.35 and m.swing < 0.3:
        return _pick(
            k, "{s} arm lifting up high overhead", "{s} hand rising above the head and lowering again"
        )
    if m.hand_out > 0.33 and m.elbow_bend < 40:
        tilt = ", tilting up and down" if m.hand_level_range > 1.0 else ""
        return (
            _pick(
                k,
                "{s} arm stretched straight out to the side at shoulder height",
                "{s} arm spread wide like a wing",
            )
            + tilt
        )
    if m.hand_front < -0.2 and m.hand_out < 0.0:
        return _pick(k, "{s} hand held behind the back, elbow bent", "{s} arm bent behind the back")
    if m.hand_front < -0.2 and m.elbow_bend > 45:
        return _pick(
            k,
            "{s} elbow bent and drawn back out to the side like a wing, hand behind the hip",
            "{s} arm bent like a wing, elbow out to the side and behind the body",
        )
    return ""


def _hanging_arm(m: ArmMeasures, bend: str, k: int) -> str:
    away = (
        " away from the side"
        if m.hand_out > 0.15
        else " close to the side"
        if m.hand_out < 0.03
        else " at the side"
    )
    return _pick(
        k,
        f"{{s}} arm hanging{away}, {bend}",
        f"{{s}} hand hanging beside the hip, {bend}",
        f"{{s}} arm{away}, {bend}",
    )


def _arm_movement(m: ArmMeasures, k: int) -> str:
    if m.hand_level > 1.0 and m.side_swing > 0.14 and m.frequency > 1.0:
        return _pick(k, "waving from side to side", "hand waving quickly")
    if m.hand_level > 1.0:
        return ""
    if m.frequency > 1.6 and m.swing < 0.12 and m.hand_level_range > 0.08:
        return _pick(k, "flapping quickly", "beating quickly up and down")
    if m.swing >= 0.36 and m.hand_level_range > 0.75:
        return _pick(k, "swinging widely, hand rising high in front", "swinging in big arcs")
    if m.hand_out > 0.33:
        return "" if m.hand_level_range > 1.0 else "held still"
    if m.hand_level_range > 0.5 and m.swing < 0.36 and m.elbow_bend > 60:
        return _pick(k, "hand moving up and down", "forearm rising and falling")
    words = (
        ("held still", "not swinging", "nearly still"),
        ("hardly swinging", "swinging very little", "moving little"),
        ("swinging gently", "swinging slightly forward and back", "swinging softly"),
        ("swinging naturally", "swinging moderately forward and back", "swinging easily with the steps"),
        ("swinging widely", "swinging strongly forward and back", "swinging broadly with the steps"),
    )
    movement = _pick(k, *_grade(m.swing, (0.06, 0.16, 0.29, 0.45), words))
    if m.side_swing > 0.17:
        movement += _pick(k, " and from side to side", ", drifting out to the side")
    return movement


def leg_words(m: LegMeasures, gap: float, side: str, k: int, pace: bool = False) -> str:
    """What one leg does; `gap` is the distance of both ankles, metres."""
    bend = _grade(
        m.knee_bend,
        (19, 32, 41),
        ("knee nearly straight", "knee slightly bent", "knee bent", "knee bent deeply"),
    )
    if m.moving < STANDING:
        return _pick(k, f"{side} leg standing still, {bend}", f"{side} foot planted on the ground, {bend}")
    speed, length = _pace(m), _step_length(m)
    steps = _pick(k, *length)
    words = [f"{side} leg {_pick(k, *speed)}", steps] if pace else [f"{side} leg taking {steps}"]
    words.append(bend)
    return _sentence(words + _step_words(m, gap, k))


def _pace(m: LegMeasures) -> tuple[str, ...]:
    return _grade(
        m.speed,
        (0.55, 0.85, 1.3, 1.75, 2.4),
        (
            ("stepping very slowly", "walking very slowly"),
            ("stepping slowly", "walking slowly"),
            ("stepping evenly", "walking at a normal pace"),
            ("stepping briskly", "walking fast"),
            ("jogging", "running slowly"),
            ("running", "running fast"),
        ),
    )


def _step_length(m: LegMeasures) -> tuple[str, ...]:
    return _grade(
        m.step_length,
        (0.38, 0.5, 0.7, 0.82),
        (
            ("short steps", "small steps"),
            ("rather short steps", "fairly short steps"),
            ("steps of normal length", "moderate steps"),
            ("long steps", "long strides"),
            ("very long strides", "very long steps"),
        ),
    )


def _step_words(m: LegMeasures, gap: float, k: int) -> list[str]:
    """What is unlike usual steps: their rate, their sides, the foot, the width."""
    words = []
    if m.cadence > 2.15:
        words.append(_pick(k, "quick steps", "many steps a minute"))
    elif 0.0 < m.cadence < 1.4:
        words.append(_pick(k, "slow steps", "few steps a minute"))
    if abs(m.stance_lead) > 0.2:
        words.append("standing longer than the other" if m.stance_lead > 0 else "limping a little")
    if m.landing > 0.75:
        words.append(_pick(k, "foot hitting the ground hard", "foot landing heavily"))
    elif 0.0 < m.landing < 0.15:
        words.append(_pick(k, "foot set down gently", "foot landing softly"))
    if m.thigh_lift > 40:
        words.append(_pick(k, "knee lifting high", "thigh lifting high"))
    elif m.foot_lift < 0.115:
        words.append(_pick(k, "foot lifted barely", "foot close to the ground"))
    if gap < -0.03:
        words.append(_pick(k, "crossing in front of the other on a narrow line", "feet on one line"))
    elif gap > 0.165:
        words.append(_pick(k, "feet wide apart", "wide stance"))
    return words


def torso_words(m: TorsoMeasures, k: int) -> str:
    """What the torso does."""
    lean = _grade(
        m.pitch,
        (-5, 3.5, 8, 20),
        (
            ("torso leaning back slightly", "torso upright, leaning back"),
            ("torso upright", "torso straight"),
            ("torso leaning slightly forward", "torso bent slightly forward"),
            ("torso leaning forward", "torso bent forward"),
            ("torso bent far forward", "torso leaning deeply forward from the hips"),
        ),
    )
    words = [_pick(k, *lean)]
    if m.arch > 3:
        words.append(_pick(k, "back rounded", "shoulders rolled forward"))
    if abs(m.roll) > 4:
        words.append(f"leaning to the {'left' if m.roll > 0 else 'right'}")
    if m.roll_range > 20:
        words.append(_pick(k, "tilting widely from side to side", "banking from side to side"))
    elif m.roll_range > 11 or m.pitch_range > 16:
        words.append(_pick(k, "swaying heavily", "swaying widely from side to side"))
    elif m.roll_range > 7.2:
        words.append(_pick(k, "swaying from side to side", "upper body swaying"))
    if m.twist_range > 27:
        words.append(_pick(k, "twisting widely with each step", "shoulders turning strongly with the arms"))
    elif m.twist_range > 17:
        words.append(_pick(k, "turning with each step", "twisting moderately with each step"))
    elif m.twist_range < 9 and m.roll_range < 8:
        words.append(_pick(k, "held still", "hardly turning"))
    if m.wander < STRAIGHT:  # on a bend hips and shoulders turn with the course
        words += _in_step(m, k)
    if m.bounce > 0.07:
        words.append(_pick(k, "bouncing up and down", "rising and falling with each step"))
    elif m.bounce > 0.045:
        words.append(_pick(k, "bouncing slightly", "rising and falling slightly"))
    return _sentence(words)


def _in_step(m: TorsoMeasures, k: int) -> list[str]:
    """What hips and shoulders do with the steps, if it is more than usual."""
    words = []
    if m.sway > 0.11 or m.pelvis_roll_range > 14:
        words.append(_pick(k, "hips swaying from side to side", "hips swaying with every step"))
    if m.pelvis_yaw_range > 22:
        words.append(_pick(k, "hips swinging round with every step", "hips turning clearly with the steps"))
    if m.shoulder_yaw_range > 23:
        words.append(_pick(k, "shoulders swinging round with every step", "shoulders turning with the steps"))
    if m.shoulder_roll_range > 11:
        words.append(_pick(k, "shoulders rolling with the steps", "shoulders rising and falling in turn"))
    return words


def head_words(m: HeadMeasures, k: int) -> str:
    """What the head does."""
    gaze = _grade(
        m.pitch,
        (-18, -5, 6, 14, 26),
        (
            ("head tilted back, chin raised", "head held high, looking up"),
            ("head raised", "chin up, head high"),
            ("head upright, looking straight ahead", "head level, facing forward"),
            ("head slightly lowered", "head lowered slightly, looking ahead at the ground"),
            ("head lowered, looking down", "head bowed, gaze on the ground"),
            ("head hanging down, looking at the ground", "head drooping, chin near the chest"),
        ),
    )
    words = [_pick(k, *gaze)]
    if m.forward > 0.05:
        words.append(_pick(k, "pushed forward", "neck stretched forward"))
    if abs(m.roll) > 11 and m.roll_range < 2 * abs(m.roll):
        words.append(f"tilted to the {'left' if m.roll > 0 else 'right'}")
    if m.turn_range > 25:
        words.append(_pick(k, "turning from side to side", "turning left and right"))
    if m.roll_range > 22:
        words.append(_pick(k, "rolling loosely from side to side", "lolling from side to side"))
    elif m.roll_range > 14:
        words.append(_pick(k, "swaying slightly", "tilting gently from side to side"))
    if m.bob > 0.045 or m.pitch_range > 25:
        words.append(_pick(k, "nodding", "bobbing"))
    if m.turn_range < 7 and m.roll_range < 7 and m.pitch_range < 7:
        words.append(_pick(k, "steady", "held still"))
    return _sentence(words)


def _level(hand_level: float) -> str:
    return _grade(hand_level, (0.05, 0.3, 0.75, 1.05), ("hip", "waist", "chest", "shoulder", "head"))


def _grade(value: float, limits: Sequence[float], words: Sequence[Any]) -> Any:
    """The word of the interval that `value` lies in; one more word than limits."""
    return words[sum(value >= limit for limit in limits)]


def _pick(k: int, *synonyms: str) -> str:
    # the second pair of wordings combines the synonyms differently: phrases shift by their own length
    return synonyms[(k + k // 2 * len(synonyms[0])) % len(synonyms)]


def _sentence(words: list[str]) -> str:
    return ", ".join(word for word in words if word)[:MAX_CHARACTERS]
