"""Captions from measures: short descriptions of body parts in the vocabulary of the prompts.

words.toml maps measures to words. Every phrase has synonyms, selected by `k`, so that one motion has several equivalent
descriptions.
"""

import tomllib
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

from runtime.measures.table import BodyMeasures, PartMeasures
from runtime.prompts.parts import MAX_CHARACTERS, PartDescriptions

STANDING_FRACTION = 0.3  # of frames that move, below which a motion counts as standing


@cache
def _words() -> dict[str, Any]:
    words: dict[str, Any] = tomllib.loads(Path(__file__).with_name("words.toml").read_text("utf-8"))
    return words["captions"]


def describe(body: BodyMeasures, k: int) -> PartDescriptions:
    """Return the six descriptions of a motion with synonyms number `k`."""
    gap = {"gap": body.left_leg.width + body.right_leg.width}
    tilted = body.head.roll_range < 2 * abs(body.head.roll)
    # synonyms are chosen by their length, for legs including the name of the side
    return PartDescriptions(
        left_arm=_sentence("arm", vars(body.left_arm), k).replace("{s}", "left"),
        right_arm=_sentence("arm", vars(body.right_arm), k + 1).replace("{s}", "right"),
        left_leg=_sentence(_leg(body.left_leg), vars(body.left_leg) | gap, k, "left"),
        right_leg=_sentence(_leg(body.right_leg), vars(body.right_leg) | gap, k + 1, "right"),
        torso=_sentence("torso", vars(body.torso), k),
        head=_sentence("head", vars(body.head) | {"tilt": body.head.roll if tilted else 0.0}, k),
    )


def _leg(measures: PartMeasures) -> str:
    return "standing_leg" if measures.moving < STANDING_FRACTION else "leg"


def _sentence(kind: str, measures: Mapping[str, float], k: int, side: str = "{s}") -> str:
    """Describe measures with the items of a kind, with the name of the side if known."""
    sizes = {
        name: _pick(k, size["says"][sum(measures[size["of"]] >= limit for limit in size["limits"])])
        for name, size in _words()["sizes"][kind.removeprefix("standing_")].items()
    }
    said = (_first(item, measures, k, sizes | {"s": side}) for item in _words()["items"][kind])
    return ", ".join(text for text in said if text)[:MAX_CHARACTERS]


def _first(item: list[dict[str, Any]], measures: Mapping[str, float], k: int, names: dict[str, str]) -> str:
    """Return a synonym of the first matching case, or ""."""
    for case in item:
        ranges = {name: ends for name, ends in case.items() if name != "says"}
        if all(low < measures[name] < high for name, (low, high) in ranges.items()):
            return _pick(k, case["says"].format_map(names))
    return ""


def _pick(k: int, phrase: str) -> str:
    synonyms = phrase.split(" | ")
    # the second pair of descriptions combines the synonyms differently: phrases shift by their own length
    return synonyms[(k + k // 2 * len(synonyms[0])) % len(synonyms)]
