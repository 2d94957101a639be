"""Random choice of the edits of a clip, without held-out edits and pairs."""

import numpy as np

from runtime.arrays import Array
from training.augmentation.catalogue import PartEdit, catalogue, part_edits

# legs first: some of their edits also describe the torso
_SLOT_PROBABILITY = {"legs": 0.74, "torso": 0.5, "left_arm": 0.42, "right_arm": 0.42, "head": 0.38}
BOTH_ARMS_PROBABILITY, BOTH_LEGS_PROBABILITY = 0.2, 0.35  # that the other limb gets the same edit
BOTH_SWING_PROBABILITY = 0.5  # the same for edits of arm swing
BOTH_POSTURE_FRACTION, BOTH_RHYTHM_FRACTION = 0.3, 0.72  # of edits of legs that concern both
LEGS_RHYTHM_FRACTION = 0.55  # of edits of legs that are of rhythm and weight
TOGETHER_PROBABILITY, WAIST_PROBABILITY = (
    0.5,
    0.3,
)  # that a base clip has two edits of legs; that its hips or waist are edited too
_DRAWS = 6
_OF_WAIST = ("hips", "twist", "bob", "rock")
_AGAINST = (  # kinds and measures that counteract each other
    {"landing", "foot_lift"}, {"stiff", "knee_bend"}, {"stiff", "foot_lift"}, {"stiff", "width"}, {"foot_pitch", "foot_lift"},
)  # fmt: skip
# Edits of a movement, unlike those of posture, are visible only during part of each step: they are drawn more often.
_OF_MOVEMENT = ("swing", "foot_lift", "knee_bend", "foot_pitch", "turn_range", "pitch_range")  # measures
_MOVEMENT_WEIGHT = 3.0
_ORDER = (
    "left_leg",
    "right_leg",
    "legs",
    "torso",
    "head",
    "left_arm",
    "right_arm",
)  # of slots, see `_in_order`


def draw(random: np.random.Generator, standing: bool) -> tuple[str, ...]:
    """Draw one to four edits of different parts; returns their names in the order of application."""
    while True:
        chosen: list[PartEdit] = []
        for slot, chance in _SLOT_PROBABILITY.items():
            if random.random() < chance:
                chosen += _drawn(slot, chosen, random, standing)
        names = _in_order(chosen)
        if names and allowed(names):
            return names


def draw_base(random: np.random.Generator, standing: bool) -> tuple[str, ...]:
    """Draw one or two edits of legs, sometimes with hips or waist, for a base clip that gets arms, torso and head of others.

    Two edits are a posture and a rhythm, or two postures, with different measures.
    """
    while True:
        chosen = _drawn("legs", [], random, standing)
        if random.random() < TOGETHER_PROBABILITY:
            chosen += _beside(chosen, random, standing)
        if not standing and random.random() < WAIST_PROBABILITY:
            edit = _one_of([e for e in _edits_of("torso") if e.kind in _OF_WAIST], random)
            chosen += [] if _taken(chosen, edit) else [edit]
        names = _in_order(chosen)
        if names and allowed(names):
            return names


def allowed(names: tuple[str, ...]) -> bool:
    """Return whether a combination is allowed in training."""
    pairs = (set(pair) <= set(names) for pair in catalogue().held_out_pairs.values())
    return not set(names) & catalogue().held_out and not any(pairs)


def _beside(chosen: list[PartEdit], random: np.random.Generator, standing: bool) -> list[PartEdit]:
    """Draw another edit of legs that is compatible with `chosen`; empty after a few unsuccessful draws."""
    for _ in range(_DRAWS):
        found = _drawn("legs", [], random, standing)
        if all(_go_together(a, b) for a in chosen for b in found):
            return found
    return []


def _go_together(one: PartEdit, other: PartEdit) -> bool:
    """Return whether two edits of legs are compatible: not both rhythms, and with independent measures."""
    kinds, fields = {one.kind, other.kind}, {one.measure[1], other.measure[1]}
    if len(fields) == 1 or (one.does.of_steps and other.does.of_steps):
        return False
    shared = "torso" in one.phrases.keys() & other.phrases.keys()
    return not shared and not any(pair <= kinds | fields for pair in _AGAINST)


def _drawn(slot: str, chosen: list[PartEdit], random: np.random.Generator, standing: bool) -> list[PartEdit]:
    """Draw an edit of a slot, sometimes with that of the other side, for parts that `chosen` do not describe."""
    edits = _edits_of_legs(random, standing) if slot == "legs" else _edits_of(slot)
    if standing:
        edits = [e for e in edits if _shows_standing(e)]
    if not edits:
        return []
    edit = _one_of(edits, random, _weights(edits))
    if _taken(chosen, edit):
        return []
    twin = _twin(edit)
    if twin is None or _taken([*chosen, edit], twin):
        return [edit]
    return [edit, twin] if random.random() < _both_chance(edit) else [edit]


def _weights(edits: list[PartEdit]) -> Array:
    weights = np.array([_MOVEMENT_WEIGHT if e.measure[1] in _OF_MOVEMENT else 1.0 for e in edits])
    return weights / weights.sum()


def _both_chance(edit: PartEdit) -> float:
    if edit.kind == "swing":
        return BOTH_SWING_PROBABILITY
    return BOTH_ARMS_PROBABILITY if "arm" in edit.name else BOTH_LEGS_PROBABILITY


def _one_of(edits: list[PartEdit], random: np.random.Generator, chances: Array | None = None) -> PartEdit:
    return edits[int(random.choice(len(edits), p=chances))]


def _edits_of_legs(random: np.random.Generator, standing: bool) -> list[PartEdit]:
    """Draw edits of rhythm or posture, of one or both legs; for a standing body postures of both."""
    rhythm = not standing and random.random() < LEGS_RHYTHM_FRACTION
    both = BOTH_RHYTHM_FRACTION if rhythm else BOTH_POSTURE_FRACTION
    one = not standing and random.random() >= both
    slots = ("left_leg", "right_leg") if one else ("legs",)
    return [e for e in _edits_of(*slots) if e.does.of_steps == rhythm]


def _edits_of(*slots: str) -> list[PartEdit]:
    return [e for e in catalogue().trained if e.slot in slots]


def _shows_standing(edit: PartEdit) -> bool:
    return edit.kind != "leg" and not edit.does.of_steps and edit.name != "torso.bounce"


def _twin(edit: PartEdit) -> PartEdit | None:
    """Return the same edit of the other side, if both can be combined: both legs cannot limp."""
    side, _, rest = edit.name.partition("_")
    name = {"left": "right_", "right": "left_"}.get(side, "") + rest
    return None if edit.kind == "stance" or name in catalogue().held_out else part_edits().get(name)


def _taken(chosen: list[PartEdit], edit: PartEdit) -> bool:
    """Return whether a chosen edit already describes a part of `edit`."""
    return any(edit.phrases.keys() & other.phrases.keys() for other in chosen)


def _in_order(edits: list[PartEdit]) -> tuple[str, ...]:
    """Sort edits: rhythm before posture, legs and torso before hands, which are placed on the body, the head last."""
    order = sorted(edits, key=lambda e: -1 if e.does.moves_feet else _ORDER.index(e.slot))
    return tuple(e.name for e in order)
