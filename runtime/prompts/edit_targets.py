"""What descriptions ask of a body in numbers (`runtime.edits.request`), by the phrases of assets/prompts/edits.toml."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from functools import cache, lru_cache
from typing import Any

import numpy as np

from runtime.arrays import Array
from runtime.assets import asset_path
from runtime.edits.request import (
    ARM,
    FAST,
    FOLD,
    FRAMES,
    LEG,
    PACE,
    PARTS,
    PLACE,
    ROW_TRUNK,
    SHAPE,
    SLOW,
    TRUNK,
)
from runtime.errors import FileError
from runtime.prompts.parts import PartDescriptions
from runtime.skeleton import PART_NAMES

HAND = "hand"
ALONE, BESIDE = "alone", "beside"  # whole clauses of a kind that the edit shows alone, and beside others
PLAIN_LEG = "{side} leg stepping evenly, knee lifting moderately, foot rolling from heel to toe"
TARGETS = {"leg": (*LEG, *PACE), "torso": TRUNK, "arm": (*ARM, HAND)}  # by the last word of a part's name
FOLDS, FOLDS_MORE = 20.0, 15.0  # degrees from upright that any trunk may lean forward, and over what is said
NEAR = 0.06  # metres within which a hand is at its place, where the file does not say it
_PLACE_KEYS = {"frame", "point", "pole", "near"}
Values = tuple[tuple[int, float], ...]  # columns of a part's row, and the value of each
Phrases = dict[str, Values]  # what each phrase asks for; () for one that asks for nothing


@cache
def phrases() -> dict[str, dict[str, Phrases]]:
    """The phrases of every target by the kind of part; FileError where the file is none."""
    return _read()[0]


@cache
def _read() -> tuple[dict[str, dict[str, Phrases]], frozenset[str], frozenset[str]]:
    """The phrases, and the clauses of legs that edits show alone, and beside others."""
    path = asset_path("prompts/edits.toml")
    try:
        tree = tomllib.loads(path.read_text("utf-8"))
        alone, beside = (
            frozenset(c for kind in tree["leg"].values() for c in kind.get(key, ()))
            for key in (ALONE, BESIDE)
        )
        return read_phrases(tree), alone, beside
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise FileError(f"{path}: not readable as edits ({error}).", "Restore the file.") from error


def read_phrases(tree: Mapping[str, Mapping[str, Mapping[str, Any]]]) -> dict[str, dict[str, Phrases]]:
    """The same of the file's tables; ValueError names the kind that is none."""
    found: dict[str, dict[str, Phrases]] = {
        part: {name: {} for name in names} for part, names in TARGETS.items()
    }
    for part, kinds in tree.items():
        for name, kind in kinds.items():
            for target, value in kind.items():
                if target in ("phrases", ALONE, BESIDE):
                    continue
                if part not in found or target not in found[part]:
                    raise ValueError(f"[{part}.{name}]: no target is called {target!r}")
                for phrase in kind["phrases"]:
                    if phrase in found[part][target]:
                        raise ValueError(f"[{part}.{name}]: {phrase!r} is of another kind already")
                    found[part][target][phrase] = _columns(target, TARGETS[part], value)
    return found


def _columns(target: str, names: Sequence[str], value: Any) -> Values:
    if value is False:
        return ()
    if target != HAND:
        return ((names.index(target), float(value)),)
    if not set(value) <= _PLACE_KEYS:
        raise ValueError(f"a place has {', '.join(sorted(_PLACE_KEYS))}, not {', '.join(value)}")
    x, y, z = value["point"]
    px, py, pz = value["pole"]
    first = len(ARM) + FRAMES.index(value["frame"]) * len(PLACE)
    return tuple(enumerate((x, y, z, px, py, pz, value.get("near", NEAR)), first))


def targets_of(part: str, sentence: str) -> dict[str, tuple[float, ...]]:
    """What the description of a part ("left_leg") asks for: the values of a target by its name, of those that it speaks of."""
    return {
        name: tuple(value for _, value in values) for name, values in _asked(part, sentence).items() if values
    }


@lru_cache(512)
def _asked(part: str, sentence: str) -> dict[str, Values]:
    clauses = sentence.lower().split(",")
    return {name: _longest(clauses, table) for name, table in phrases()[part.split("_")[-1]].items()}


def _longest(clauses: Sequence[str], table: Phrases) -> Values:
    """What the longest phrase of the first clause that has one asks for."""
    for clause in clauses:
        found = [phrase for phrase in table if phrase in clause]
        if found:
            return table[max(found, key=len)]
    return ()


def edit_targets(descriptions: PartDescriptions) -> Array:
    """What the parts are asked to show, `(5, 34, 2)`: weights and weighted values."""
    result = np.zeros(SHAPE)
    for row, part in enumerate(PARTS):
        for values in _asked(part, getattr(descriptions, part)).values():
            for column, value in values:
                result[row, column] = 1.0, value
    weight, lean = result[ROW_TRUNK, TRUNK.index("lean")]
    result[FOLD] = 1.0, max(FOLDS, lean + FOLDS_MORE) if weight else FOLDS
    return result


def blended_targets(a: PartDescriptions, b: PartDescriptions, weights: Sequence[float]) -> Array:
    """Those of two prompts, each part by its own weight of B."""
    of_b = np.array([weights[PART_NAMES.index(part)] for part in PARTS])[:, None, None]
    return np.asarray((1.0 - of_b) * edit_targets(a) + of_b * edit_targets(b))


def left_to_network(descriptions: PartDescriptions) -> PartDescriptions:
    """The descriptions that the network reads under the edits: without the clauses of legs that these show alone.

    Legs that cross by the network as well let it fall out of step with most other words.
    """
    _, alone, beside = _read()
    for part in ("left_leg", "right_leg"):
        side = part.split("_")[0]
        said = getattr(descriptions, part).split(", ")
        kept = [clause for clause in said if clause.removeprefix(f"{side} ") not in alone]
        rest = [clause for clause in kept if clause.removeprefix(f"{side} ") not in beside]
        kept = rest if rest and rest[0].startswith(side) else kept
        if not kept or (len(kept) < len(said) and kept[0].startswith(side)):  # what is left is a sentence
            descriptions = descriptions.replace(part, ", ".join(kept) or PLAIN_LEG.format(side=side))
    return descriptions


def edited_parts(descriptions: PartDescriptions | None) -> frozenset[str]:
    """The parts, by name, of whose description an edit shows what the network does not."""
    if descriptions is None:
        return frozenset()
    asked = edit_targets(descriptions)[..., 0]
    asked[FOLD] = 0.0  # of every trunk, whatever is said
    # of the stick, not of the pose: how a leg steps is the network's
    asked[:ROW_TRUNK, SLOW : FAST + 1] = 0.0
    return frozenset(part for part, weights in zip(PARTS, asked, strict=True) if weights.any())
