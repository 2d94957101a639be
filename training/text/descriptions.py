"""Numbers to sentences: a body part's measures as a short description in the vocabulary of the prompts.

Which measures have which words is in words.toml. Every phrase has synonyms; `k` chooses among them, so that one motion gets
several descriptions of the same truth.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

from runtime.measures.table import BodyMeasures, PartMeasures
from runtime.prompts.parts import MAX_CHARACTERS, PartDescriptions

STANDING_FRACTION = 0.3  # of the frames that move, under which a motion is standing


@cache
def _words() -> dict[str, Any]:
    words: dict[str, Any] = tomllib.loads(Path(__file__).with_name("words.toml").read_text("utf-8"))
    return words["captions"]


def describe(body: BodyMeasures, k: int) -> PartDescriptions:
    """Six descriptions of a motion, by its synonyms number `k`."""
    gap = {"gap": body.left_leg.width + body.right_leg.width}
    tilted = body.head.roll_range < 2 * abs(body.head.roll)
    # a synonym is chosen by its length, that of legs with the side's name
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
    """What the items of a kind say of measures; the side's name where it is known."""
    sizes = {
        name: _pick(k, size["says"][sum(measures[size["of"]] >= limit for limit in size["limits"])])
        for name, size in _words()["sizes"][kind.removeprefix("standing_")].items()
    }
    said = (_first(item, measures, k, sizes | {"s": side}) for item in _words()["items"][kind])
    return ", ".join(text for text in said if text)[:MAX_CHARACTERS]


def _first(item: list[dict[str, Any]], measures: Mapping[str, float], k: int, names: dict[str, str]) -> str:
    """A synonym of the first case that holds, "" where none does."""
    for case in item:
        ranges = {name: ends for name, ends in case.items() if name != "says"}
        if all(low < measures[name] < high for name, (low, high) in ranges.items()):
            return _pick(k, case["says"].format_map(names))
    return ""


def _pick(k: int, phrase: str) -> str:
    synonyms = phrase.split(" | ")
    # the second pair of descriptions combines the synonyms differently: phrases shift by their own length
    return synonyms[(k + k // 2 * len(synonyms[0])) % len(synonyms)]
