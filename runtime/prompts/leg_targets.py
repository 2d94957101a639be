"""What a description asks of a leg in numbers: the line of the feet, the height of the hips, heels, toes and knees.

The sentences are those that the library, its rules and the catalogue of edits use. Of the phrases below that a clause
has, the longest counts, so that a phrase with "slightly" or "not" is an entry of its own.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from runtime.arrays import Array
from runtime.feet.leg_edit import BOTH, TARGETS
from runtime.prompts.parts import PartDescriptions
from runtime.skeleton import PART_NAMES

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


@lru_cache(256)
def targets_of(sentence: str) -> tuple[float | None, ...]:
    """The value of each of `TARGETS` that a leg's description asks for; None for what it says nothing about."""
    return tuple(_value(sentence.lower(), PHRASES[name]) for name in TARGETS)


def _value(sentence: str, phrases: dict[str, float | None]) -> float | None:
    """The value of the longest phrase of the first clause that has one."""
    for clause in sentence.split(","):
        found = [phrase for phrase in phrases if phrase in clause]
        if found:
            return phrases[max(found, key=len)]
    return None


def leg_targets(descriptions: PartDescriptions) -> Array:
    """What both legs are asked to show, `(2, 5, 2)`: weights and weighted values (`runtime.feet.leg_edit`)."""
    result = np.zeros(BOTH)
    for leg, sentence in enumerate((descriptions.left_leg, descriptions.right_leg)):
        for k, value in enumerate(targets_of(sentence)):
            if value is not None:
                result[leg, k] = 1.0, value
    return result


def blended_legs(a: PartDescriptions, b: PartDescriptions, weights: Sequence[float]) -> Array:
    """Those of two prompts, each leg by its own weight of B."""
    of_b = np.array([weights[PART_NAMES.index(leg)] for leg in ("left_leg", "right_leg")])[:, None, None]
    return np.asarray((1.0 - of_b) * leg_targets(a) + of_b * leg_targets(b))


def edited_legs(descriptions: PartDescriptions | None) -> frozenset[str]:
    """The legs, by their part's name, of whose description an edit shows what the network does not."""
    if descriptions is None:
        return frozenset()
    legs = ("left_leg", "right_leg")
    return frozenset(
        leg for leg in legs if any(v is not None for v in targets_of(getattr(descriptions, leg)))
    )
