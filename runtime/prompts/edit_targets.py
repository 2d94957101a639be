"""Descriptions to edit targets (`runtime.edits.request`), by the phrases of assets/prompts/edits.toml.

The meaning of a phrase was measured on the captured clips whose captions use it (`runtime.prompts.captured`); only uncaptured
phrases are specified by hand. The caption of a captured style sets a target for a walk's lean only, because the network draws
lean towards the mean of all styles; the rest it has learnt.
"""

import tomllib
from collections.abc import Mapping, Sequence
from functools import cache, lru_cache
from math import inf
from typing import Any

import numpy as np

from runtime.arrays import Array
from runtime.assets import asset_path
from runtime.edits.request import (
    ARM,
    FOLD,
    FRAMES,
    GAITS,
    LEG,
    MAX_TARGET,
    PACE,
    PACED,
    PARTS,
    PLACE,
    ROW_TRUNK,
    SHAPE,
    TRUNK,
)
from runtime.errors import FileError
from runtime.measures.table import kind_of
from runtime.prompts.captured import Range, Ranges, captured
from runtime.prompts.parts import PartDescriptions
from runtime.skeleton import PART_NAMES

HAND = "hand"
ALONE, BESIDE = "alone", "beside"  # whole clauses that only the edit shows, and that it shows beside others
# position in a captured range at which a forward lean is visible, a jog leans, and feet are on their line
WELL_WITHIN_FRACTION = 0.25
# metres within which a hand counts as in place: tolerance for a held hand, and for one that the edit places
MAX_NEAR_M, PLACED_NEAR_M = 0.1, 0.03
PLAIN_ARM = "{side} arm hanging relaxed at the side, swinging naturally with the steps"
PLAIN_TORSO = "torso upright and relaxed, shoulders level"
PLAIN_LEG = "{side} leg stepping evenly, knee lifting moderately, foot rolling from heel to toe"
TARGETS = {"leg": (*LEG, PACE), "torso": TRUNK, "arm": (*ARM, HAND)}  # by the last word of a part's name
RELATIVE = "lean"  # a target whose hand-written values are relative to a gait's usual ones
IN_EVERY_GAIT = ("lean", "bounce")  # targets of every trunk in jogs, whatever its description
FOLD_DEGREES, MORE_FOLD_DEGREES = 20.0, 12.0  # limit of a trunk's forward lean, and beyond the described one
NEAR_M = 0.06  # default tolerance of a hand's place
_PLACE_KEYS = {"frame", "point", "pole", "near"}
Values = tuple[Any, ...]  # a range, or the seven numbers of a place; () requests nothing
# for each phrase, the first column it fills in a part's row, and its values
Phrases = dict[str, tuple[int, Values]]


@cache
def phrases() -> dict[str, dict[str, Phrases]]:
    """Return the phrases of every target, by kind of part; FileError if the file is invalid."""
    return _read()[0]


@cache
def _read() -> tuple[dict[str, dict[str, Phrases]], frozenset[str], frozenset[str]]:
    """Return the phrases, and the clauses of legs and trunks that edits show alone, and beside others."""
    path = asset_path("prompts/edits.toml")
    try:
        tree = tomllib.loads(path.read_text("utf-8"))
        alone, beside = (
            frozenset(
                c for part in ("leg", "torso") for kind in tree[part].values() for c in kind.get(key, ())
            )
            for key in (ALONE, BESIDE)
        )
        return read_phrases(tree), alone, beside
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise FileError(f"{path}: not readable as edits ({error}).", "Restore the file.") from error


def read_phrases(tree: Mapping[str, Mapping[str, Mapping[str, Any]]]) -> dict[str, dict[str, Phrases]]:
    """Read the phrases of a file's tables by part and target; ValueError names an unknown kind."""
    found: dict[str, dict[str, Phrases]] = {
        part: {name: {} for name in names} for part, names in TARGETS.items()
    }
    for part, kinds in tree.items():
        for name, kind in kinds.items():
            for target in (each for each in kind if each not in ("phrases", ALONE, BESIDE)):
                if part not in found or target not in found[part]:
                    raise ValueError(f"[{part}.{name}]: no target is called {target!r}")
                _add(
                    found[part][target],
                    kind["phrases"],
                    _columns(target, TARGETS[part], kind[target]),
                    f"{part}.{name}",
                )
    return found


def _add(table: Phrases, phrases: Sequence[str], columns: tuple[int, Values], kind: str) -> None:
    for phrase in phrases:
        if phrase in table:
            raise ValueError(f"[{kind}]: {phrase!r} is of another kind already")
        table[phrase] = columns


def _columns(target: str, names: Sequence[str], value: Any) -> tuple[int, Values]:
    if value is False:
        return 0, ()
    if target != HAND:
        low, high = map(float, value)
        if not low <= high:
            raise ValueError(f"{target} of {value}: expected a lowest and a highest value")
        return names.index(target), (low, high)
    if not set(value) <= _PLACE_KEYS:
        raise ValueError(f"a place has {', '.join(sorted(_PLACE_KEYS))}, not {', '.join(value)}")
    x, y, z = value["point"]
    px, py, pz = value["pole"]
    first = len(ARM) + FRAMES.index(value["frame"]) * len(PLACE)
    return first, (x, y, z, px, py, pz, value.get("near", NEAR_M))


def targets_of(part: str, sentence: str) -> dict[str, Values]:
    """Return the hand-written range or place of every target that a description of a part ("left_leg") mentions."""
    found = spoken(part, sentence)
    return {name: values for name, (_, _, (_, values)) in found.items() if values}


@lru_cache(512)
def spoken(part: str, sentence: str) -> dict[str, tuple[str, str, tuple[int, Values]]]:
    """Return, by target, the first clause that mentions it, its longest phrase, and that phrase's hand-written values."""
    clauses, found = sentence.lower().split(","), {}
    for name, table in phrases()[kind_of(part)].items():
        for clause in clauses:
            said = [phrase for phrase in table if phrase in clause]
            if said:
                phrase = max(said, key=len)
                found[name] = clause.strip(), phrase, table[phrase]
                break
    return found


@lru_cache(512)
def _asked(part: str, sentence: str, styles: frozenset[str]) -> tuple[tuple[int, Ranges], ...]:
    """Return columns of a part's row with their ranges in every gait; `styles` have all six descriptions as captions."""
    measured, kind = captured(), kind_of(part)
    if measured.is_caption(part, sentence):
        own = measured.caption(part, sentence, styles)
        one = len(styles) == 1
        return tuple((TARGETS[kind].index(n), _of_caption(n, ranges, one)) for n, ranges in own.items())
    found: list[tuple[int, Ranges]] = []
    for name, (clause, phrase, (column, values)) in spoken(part, sentence).items():
        if values and name != HAND:
            shown = measured.clause(part, clause, name) or measured.phrase(kind, phrase, name)
            found.append((column, _ranges(name, values, shown)))
        elif values and not measured.moves(part, clause):
            near = min(values[-1], PLACED_NEAR_M) if is_placed(part, clause, values) else values[-1]
            found += [
                (at, ((value, value),) * len(GAITS)) for at, value in enumerate((*values[:-1], near), column)
            ]
    return tuple(found)


def _ranges(name: str, values: Values, shown: Ranges | None) -> Ranges:
    """Return a phrase's range in every gait: as captured, or else as written by hand."""
    by_hand = [_by_hand(name, values, captured().usual(gait)) for gait in GAITS]
    own = [ends and _well_within(name, ends) for ends in shown or (None,) * len(GAITS)]
    return tuple(measured or other for measured, other in zip(own, by_hand, strict=True))


def _well_within(name: str, ends: Range) -> Range:
    """Return the part of a captured range used as target: where a lean is visible, and feet are on their line."""
    low, high = ends
    within = low + WELL_WITHIN_FRACTION * (high - low)
    if name == RELATIVE and low > 0.0:
        return within, high
    return (low, within) if name == "outward" and low < 0.0 else ends


def _of_caption(name: str, ranges: Ranges, of_one_style: bool) -> Ranges:
    """Return a caption's target ranges: the captured lean, for one style its typical value; in a walk nothing else."""
    if name != "lean":
        return (None, *ranges[1:])
    if not of_one_style:
        return ranges
    low_in_range = (0.5, WELL_WITHIN_FRACTION, 0.5)  # takes of a jog are not always at full speed
    leans = (e and e[0] + f * (e[1] - e[0]) for e, f in zip(ranges, low_in_range, strict=True))
    return tuple(None if lean is None else (lean, lean) for lean in leans)


def _by_hand(name: str, values: Values, usual: Mapping[str, Range]) -> Range:
    low, high = values
    middle = 0.5 * sum(usual["lean"]) if name == RELATIVE and "lean" in usual else 0.0
    return low + middle, high + middle


def edit_targets(descriptions: PartDescriptions) -> Array:
    """Return the edit targets of six descriptions, shape `request.SHAPE`: weights and weighted bounds."""
    result, styles = np.zeros(SHAPE), captured().styles_of(descriptions)
    for row, part in enumerate(PARTS):
        for column, ranges in _asked(part, getattr(descriptions, part), styles):
            for gait, ends in enumerate(ranges):
                if ends is not None:
                    result[gait, row, column] = 1.0, *np.clip(ends, -MAX_TARGET, MAX_TARGET)
    _ask_of_every_trunk(result)
    return result


def _ask_of_every_trunk(result: Array) -> None:
    """Write the fold limit of every trunk; in jogs also the captured usual ranges, unless the description says otherwise."""
    jog = GAITS.index("jog")
    for name in IN_EVERY_GAIT:
        low, high = captured().usual("jog").get(name, (-inf, inf))
        target = result[jog, ROW_TRUNK, TRUNK.index(name)]
        if not target[0]:
            target[:] = (1.0, low, MAX_TARGET) if name == "lean" else (1.0, -MAX_TARGET, high)
    for gait in result:
        weight, low, _ = gait[ROW_TRUNK, TRUNK.index("lean")]
        fold = max(FOLD_DEGREES, low + MORE_FOLD_DEGREES) if weight else FOLD_DEGREES
        gait[FOLD] = 1.0, -MAX_TARGET, fold


def blended_targets(a: PartDescriptions, b: PartDescriptions, weights: Sequence[float]) -> Array:
    """Return the edit targets of prompts A and B blended, with the weight of B in each part."""
    of_b = np.array([weights[PART_NAMES.index(part)] for part in PARTS])[:, None, None]
    return np.asarray((1.0 - of_b) * edit_targets(a) + of_b * edit_targets(b))


def left_to_network(descriptions: PartDescriptions) -> PartDescriptions:
    """Return the descriptions for the network, without the clauses that only edits show.

    If the network shows crossing legs as well, it conflicts with most other words; swaying hips then go twice
    as far as in any capture; arms held at a place unbalance the whole body.
    """
    unedited = {"leg": _unedited_leg, "torso": _unedited_torso, "arm": _unedited_arm}
    for part in PARTS:
        said = getattr(descriptions, part)
        if not captured().is_caption(part, said):
            descriptions = descriptions.replace(part, unedited[kind_of(part)](part, said))
    return descriptions


def is_placed(part: str, clause: str, place: Values) -> bool:
    """Return whether a clause holds a hand at a fixed place, so that only the edit shows it; a waving hand is not held."""
    return bool(place) and place[-1] <= MAX_NEAR_M and not captured().moves(part, clause)


def _unedited_arm(part: str, said: str) -> str:
    """Return the description of an arm, or a plain walk's description if its hand is placed."""
    clause, _, (_, place) = spoken(part, said).get(HAND, ("", "", (0, ())))
    return PLAIN_ARM.format(side=part.split("_")[0]) if is_placed(part, clause, place) else said


def _unedited_torso(_part: str, said: str) -> str:
    """Return the description of the trunk without the clauses that only edits show."""
    _, alone, _ = _read()
    kept = [c.strip() for c in said.split(",") if c.strip().lower().removeprefix("torso ") not in alone]
    return ", ".join(kept) or PLAIN_TORSO


def _unedited_leg(part: str, said: str) -> str:
    """Return the description of a leg without the clauses that only edits show; unchanged if the rest does not name the leg."""
    _, alone, beside = _read()
    side = part.split("_")[0]
    clauses = said.split(", ")
    kept = [clause for clause in clauses if clause.removeprefix(f"{side} ") not in alone]
    rest = [clause for clause in kept if clause.removeprefix(f"{side} ") not in beside]
    if rest and rest[0].startswith(side):
        kept = rest
    if not kept:
        return PLAIN_LEG.format(side=side)
    return ", ".join(kept) if kept[0].startswith(side) else said


def edited_parts(descriptions: PartDescriptions | None) -> frozenset[str]:
    """Return the names of parts whose description is shown by an edit rather than by the network."""
    if descriptions is None:
        return frozenset()
    asked = edit_targets(descriptions)[GAITS.index("walk"), ..., 0]
    asked[FOLD] = 0.0  # every trunk has it, whatever its description
    # set by the stick, not by a pose: how a leg steps is the network's
    asked[:ROW_TRUNK, PACED] = 0.0
    edited = [part for part, weights in zip(PARTS, asked, strict=True) if weights.any()]
    return frozenset(p for p in edited if not captured().is_caption(p, getattr(descriptions, p)))
