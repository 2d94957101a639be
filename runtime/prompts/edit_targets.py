"""What a description asks of legs and trunk in numbers: the line of the feet, hips, heels, toes and knees; lean, twist and sway.

The sentences are those that the library, its rules and the catalogue of edits use. Of the phrases below that a clause
has, the longest counts, so that a phrase with "slightly" or "not" is an entry of its own.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from runtime.arrays import Array
from runtime.feet import trunk_edit
from runtime.feet.leg_edit import SHOWN, TARGETS
from runtime.feet.trunk_edit import TRUNK
from runtime.prompts.parts import PartDescriptions
from runtime.skeleton import PART_NAMES

EDITED = ("left_leg", "right_leg", "torso")  # the rows of what is asked for
# metres outward of the middle line
LINE, CLOSE, CROSSED, WIDE, VERY_WIDE = 0.005, 0.02, -0.035, 0.11, 0.19
PHRASES: dict[str, dict[str, float | None]] = {
    "outward": {
        "one line": LINE, "narrow line": LINE, "middle line": LINE, "tightrope": LINE, "foot in front of foot": LINE,
        "exactly in front of the other": LINE, "in front of the other on": LINE, "catwalk": LINE, "like a model": LINE,
        "narrow stance": CLOSE, "close together": CLOSE, "pressed together": CLOSE, "feet together": CLOSE,
        "close to the middle line": CLOSE, "crossing towards the middle": CLOSE,
        "crossing in front of the other": CROSSED, "crossing far over": CROSSED, "now and then": None,
        "feet apart": WIDE, "wide apart": WIDE, "wide stance": WIDE, "spread apart": WIDE, "placed wide": WIDE,
        "stepping wide": WIDE, "walking wide": WIDE, "spread very wide": VERY_WIDE, "very wide stance": VERY_WIDE,
        "very wide apart": VERY_WIDE, "very far out to the side": VERY_WIDE, "standing": None,
    },
    "lower": {
        "knee slightly bent": 0.025, "kept a little bent": 0.025, "knee bent": 0.06, "bent at the knee": 0.08,
        "hips low": 0.08, "hips lowered": 0.1, "walking crouched": 0.1, "knee bent deeply": 0.16, "deep crouch": 0.2,
        "crouching low": 0.2, "hips near the ground": 0.22, "sinking lower": 0.1, "with the knee bent deeply": 0.16,
        "held bent": None, "knee bent and lifting": None, "springing": None, "landing": None,
    },
    "heel": {
        "tiptoe": 28.0, "heel raised": 28.0, "heel high": 28.0, "on the toes": 24.0, "weight on the toes": 24.0,
        "landing on the toes": None, "springing off the toes": None, "rising on the toes now and then": None,
        "twisting on the toes": None,
    },
    "toe_out": {
        "turned out": 24.0, "turned outward": 24.0, "pointing outward": 24.0, "turned slightly out": 12.0,
        "pointing a little outward": 12.0, "turned outward slightly": 12.0, "turned in": -20.0, "turned inward": -20.0,
        "pointing inward": -20.0, "pigeon-toed": -20.0, "turned slightly in": -11.0, "pointing a little inward": -11.0,
        "turned inward and outward": None, "knee turned outward": None, "bent and turned outward": None,
    },
    "knee": {
        "stiff and straight": 25.0, "leg stiff": 25.0, "knee stiff": 25.0, "not bending": 25.0, "hardly bending": 32.0,
        "with a straight knee": 25.0, "knee straight": 25.0, "knee straight at landing": None, "knee straightening": None, "leg stiff and heavy": 30.0,
        "standing still": None,
    },
}  # fmt: skip
TRUNK_PHRASES: dict[str, dict[str, float | None]] = {
    "lean": {
        "leaning slightly forward": 6.0, "leaning forward": 13.0, "bent forward": 20.0, "leaning far forward": 26.0,
        "leaning slightly back": -4.0, "leaning back": -8.0, "leaning backward": -8.0, "leaning far back": -14.0,
        "upright": -1.0, "back straight": -1.0, "back arched": -2.0, "chest pushed out": -2.0, "upright and relaxed": None,
        "upright, leaning": None,
    },
    "aside": {
        "leaning to the left": 9.0, "leaning far to the left": 15.0, "leaning slightly to the left": 5.0,
        "leaning to the right": -9.0, "leaning far to the right": -15.0, "leaning slightly to the right": -5.0,
    },
    "twist": {
        "turned to the left": 24.0, "turned slightly to the left": 12.0, "turned to the right": -24.0,
        "turned slightly to the right": -12.0,
    },
    "sway": {
        "swaying": 0.09, "swaying widely": 0.11, "swaying strongly": 0.11, "swaying heavily": 0.13, "rolling strongly": 0.1,
        "staggering": 0.13, "pitching": 0.1, "swaying slightly": None, "swaying gently": None, "swaying rhythmically": None,
        "swaying slowly": 0.09, "neither swaying": None,
    },
    "rock": {
        "rocking slightly": 8.0, "rocking from side to side": 11.0, "rocking heavily": 14.0, "rocking widely": 14.0,
        "waddling": 13.0, "tilting far over": 13.0, "swaying heavily": 10.0, "staggering": 12.0, "rocking unevenly": 8.0,
    },
}  # fmt: skip


@lru_cache(256)
def targets_of(sentence: str) -> tuple[float | None, ...]:
    """The value of each of `TARGETS` that a leg's description asks for; None for what it says nothing about."""
    return tuple(_value(sentence.lower(), PHRASES[name]) for name in TARGETS)


@lru_cache(256)
def trunk_targets(sentence: str) -> tuple[float | None, ...]:
    """The same of a trunk's description, of each of `trunk_edit.TARGETS`."""
    return tuple(_value(sentence.lower(), TRUNK_PHRASES[name]) for name in trunk_edit.TARGETS)


def _value(sentence: str, phrases: dict[str, float | None]) -> float | None:
    """The value of the longest phrase of the first clause that has one."""
    for clause in sentence.split(","):
        found = [phrase for phrase in phrases if phrase in clause]
        if found:
            return phrases[max(found, key=len)]
    return None


def edit_targets(descriptions: PartDescriptions) -> Array:
    """What both legs and the trunk are asked to show, `(3, 5, 2)`: weights and weighted values (`runtime.feet.leg_edit`)."""
    result = np.zeros(SHOWN)
    for leg, sentence in enumerate((descriptions.left_leg, descriptions.right_leg)):
        for k, value in enumerate(targets_of(sentence)):
            if value is not None:
                result[leg, k] = 1.0, value
    for k, value in enumerate(trunk_targets(descriptions.torso)):
        if value is not None:
            result[TRUNK, k] = 1.0, value
    return result


def blended_targets(a: PartDescriptions, b: PartDescriptions, weights: Sequence[float]) -> Array:
    """Those of two prompts, each part by its own weight of B."""
    of_b = np.array([weights[PART_NAMES.index(part)] for part in EDITED])[:, None, None]
    return np.asarray((1.0 - of_b) * edit_targets(a) + of_b * edit_targets(b))


def edited_parts(descriptions: PartDescriptions | None) -> frozenset[str]:
    """The parts, by name, of whose description an edit shows what the network does not."""
    if descriptions is None:
        return frozenset()
    asked = edit_targets(descriptions)[..., 0]
    return frozenset(part for part, weights in zip(EDITED, asked, strict=True) if weights.any())
