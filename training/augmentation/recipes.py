"""Which parts of a clip are edited: drawn at random, never what is held out."""

from __future__ import annotations

import numpy as np

from training.augmentation.catalogue import PartEdit, catalogue, part_edits

# legs first: some of their edits take the torso along
_CHANCE = {"legs": 0.74, "torso": 0.5, "left_arm": 0.42, "right_arm": 0.42, "head": 0.38}
BOTH_ARMS = 0.2  # chance that an edited arm is joined by the same edit of the other
BOTH_LEGS = 0.35
BOTH = 0.3  # fraction of the posture edits of legs that are of both at once
BOTH_RHYTHM = 0.72  # of those of rhythm
BOTH_SWING = 0.5  # arms that swing more or less mostly do so together
LEGS_RHYTHM = 0.55  # fraction of the legs' edits that are of rhythm and weight
TOGETHER = 0.5  # chance that a base has two edits of legs
WAIST = 0.3  # that its hips or waist are edited too
_DRAWS = 6
_OF_WAIST = ("hips", "twist", "bob", "rock")
_AGAINST = (  # kinds and measures of which one undoes the other
    {"landing", "foot_lift"}, {"stiff", "knee_bend"}, {"stiff", "foot_lift"}, {"stiff", "width"}, {"foot_pitch", "foot_lift"},
)  # fmt: skip
# Edits that change a movement, not a posture, show in a part of every step only: they are drawn more often.
_OF_MOVEMENT = ("swing", "foot_lift", "knee_bend", "foot_pitch", "turn_range", "pitch_range")  # measures
_MOVEMENT_WEIGHT = 3.0


def draw(random: np.random.Generator, standing: bool) -> tuple[str, ...]:
    """Names of one to four edits that do not touch the same part twice, in the order in which they are applied."""
    while True:
        chosen: list[str] = []
        for slot, chance in _CHANCE.items():
            if random.random() < chance:
                chosen += _drawn(slot, chosen, random, standing)
        if chosen and allowed(tuple(chosen)):
            return tuple(sorted(chosen, key=_order))


def draw_base(random: np.random.Generator, standing: bool) -> tuple[str, ...]:
    """Names of edits of legs, one or two at once, at times with hips or waist: a body for arms, trunk and head of others.

    Two are a posture and a rhythm, or two postures, that move different measures.
    """
    while True:
        chosen = _drawn("legs", [], random, standing)
        if random.random() < TOGETHER:
            chosen += _beside(chosen, random, standing)
        if not standing and random.random() < WAIST:
            edit = str(random.choice([e.name for e in _edits_of(("torso",)) if e.kind in _OF_WAIST]))
            chosen += [] if _taken(chosen, edit) else [edit]
        if chosen and allowed(tuple(chosen)):
            return tuple(sorted(chosen, key=_order))


def _beside(chosen: list[str], random: np.random.Generator, standing: bool) -> list[str]:
    """Another edit of legs that goes with those `chosen`; none where few draws find one."""
    for _ in range(_DRAWS):
        found = _drawn("legs", [], random, standing)
        if all(_go_together(part_edits()[a], part_edits()[b]) for a in chosen for b in found):
            return found
    return []


def _go_together(one: PartEdit, other: PartEdit) -> bool:
    """Whether two edits of legs show both: they are no two rhythms, and neither changes the other's measure."""
    kinds, fields = {one.kind, other.kind}, {one.measure[1], other.measure[1]}
    if (
        (one.does.of_steps and other.does.of_steps)
        or len(fields) == 1
        or "torso" in one.phrases.keys() & other.phrases.keys()
    ):
        return False
    return not any(pair <= kinds | fields for pair in _AGAINST)


def allowed(names: tuple[str, ...]) -> bool:
    """Whether a combination may enter training."""
    pairs = (set(pair) <= set(names) for pair in catalogue().held_out_pairs.values())
    return not set(names) & catalogue().held_out and not any(pairs)


def _drawn(slot: str, chosen: list[str], random: np.random.Generator, standing: bool) -> list[str]:
    """An edit of a slot, at times with the same of the other side; none that describes a part of those `chosen`."""
    edit = _choose(slot, random, standing)
    if edit is None or _taken(chosen, edit):
        return []
    twin = _twin(edit)
    if twin is None or _taken([*chosen, edit], twin):
        return [edit]
    both = BOTH_ARMS if "arm" in edit else BOTH_LEGS
    both = BOTH_SWING if part_edits()[edit].kind == "swing" else both
    return [edit, twin] if random.random() < both else [edit]


def _choose(slot: str, random: np.random.Generator, standing: bool) -> str | None:
    edits = _edits_of_legs(random, standing) if slot == "legs" else _edits_of((slot,))
    if standing:
        edits = [e for e in edits if _shows_standing(e)]
    if not edits:
        return None
    weight = np.array([_MOVEMENT_WEIGHT if e.measure[1] in _OF_MOVEMENT else 1.0 for e in edits])
    return str(random.choice([e.name for e in edits], p=weight / weight.sum()))


def _edits_of_legs(random: np.random.Generator, standing: bool) -> list[PartEdit]:
    """Those of rhythm or of posture, of one leg or of both; of who stands the posture of both."""
    rhythm = not standing and random.random() < LEGS_RHYTHM
    one = not standing and random.random() >= (BOTH_RHYTHM if rhythm else BOTH)
    slots = ("left_leg", "right_leg") if one else ("legs",)
    return [e for e in _edits_of(slots) if e.does.of_steps == rhythm]


def _edits_of(slots: tuple[str, ...]) -> list[PartEdit]:
    return [e for e in catalogue().trained if e.slot in slots]


def _shows_standing(edit: PartEdit) -> bool:
    return edit.kind != "leg" and not edit.does.of_steps and edit.name != "torso.bounce"


def _twin(name: str) -> str | None:
    """The same edit of the other side, where both can be done at once."""
    if part_edits()[name].kind == "stance":
        return None  # both legs cannot limp at once
    for one, other in (("left_", "right_"), ("right_", "left_")):
        if name.startswith(one):
            twin = other + name.removeprefix(one)
            return twin if twin in part_edits() and twin not in catalogue().held_out else None
    return None


def _taken(chosen: list[str], name: str) -> bool:
    """Whether an edit describes a part that another one describes already."""
    return any(part_edits()[name].phrases.keys() & part_edits()[other].phrases.keys() for other in chosen)


def _order(name: str) -> int:
    """Legs and torso first, rhythm before posture: hands are then placed on the body as it is, the head looks last."""
    slot = ("left_leg", "right_leg", "legs", "torso", "head", "left_arm", "right_arm").index(
        part_edits()[name].slot
    )
    return 0 if part_edits()[name].does.moves_feet else 1 + slot
