"""The parametric part edits: what each does, in numbers, and the sentences that say so.

Distances are metres and angles degrees, given for the left side; the right side is the mirror image. Edits named in
`HELD_OUT` and pairs in `HELD_OUT_PAIRS` never enter training: the evaluation asks for them by their words.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from training.layering.catalog_arms import ARM, ARM_SWING
from training.layering.catalog_body import HEAD, LEG, LEGS, TORSO
from training.layering.catalog_rhythm import ARM_SWINGS, STANCE, STEPS, TORSO_RHYTHM


@dataclass(frozen=True)
class PartEdit:
    """One edit. `phrases` `{part: sentences}` describe every part it changes; `parameters` are those of `kind`.

    Two edits of one clip never describe the same part.

    `measure` (part, field of its measures in `training.text.measure`) is the quantity that shows the edit.
    """

    name: str
    slot: str  # left_arm, right_arm, torso, head, left_leg, right_leg or legs
    kind: str
    parameters: dict[str, object]
    phrases: dict[str, tuple[str, ...]]
    measure: tuple[str, str]

    @property
    def moves_feet(self) -> bool:
        """Whether it puts feet elsewhere on the ground, or changes the length of the clip: rhythm."""
        return self.kind in ("steps", "line", "stance", "hesitation", "stagger")

    @property
    def of_steps(self) -> bool:
        """Whether it is of rhythm and weight, which show in walking only."""
        return self.moves_feet or self.kind in ("landing", "bob", "hips", "shoulders", "rock")

    @property
    def rhythm(self) -> bool:
        """Whether the evaluation counts it as rhythm and weight, and not as posture."""
        return self.of_steps or self.kind == "swing"

    @property
    def scales(self) -> bool:
        """Whether it scales what the captured motion does, so that a body which does not do it shows nothing."""
        return self.kind in ("swing", "bob", "hips", "shoulders")


def _sided(phrases: Sequence[str], side: str) -> tuple[str, ...]:
    return tuple(p.replace("{s}", side) for p in phrases)


def _build() -> dict[str, PartEdit]:
    edits = []
    for side in ("left", "right"):
        arm, leg = f"{side}_arm", f"{side}_leg"
        for name, (parameters, phrases, field) in ARM.items():
            texts = {arm: _sided(phrases, side)}
            edits.append(PartEdit(f"{arm}.{name}", arm, "hand", parameters, texts, (arm, field)))
        for name, (scale, phrases) in (ARM_SWING | ARM_SWINGS).items():
            texts = {arm: _sided(phrases, side)}
            edits.append(PartEdit(f"{arm}.{name}", arm, "swing", {"scale": scale}, texts, (arm, "swing")))
        for name, (parameters, phrases, field) in LEG.items():
            texts = {leg: _sided(phrases, side)}
            edits.append(PartEdit(f"{leg}.{name}", leg, "leg", parameters, texts, (leg, field)))
        other = "right" if side == "left" else "left"
        for name, (parameters, phrases, others) in STANCE.items():
            texts = {leg: _sided(phrases, side), f"{other}_leg": _sided(others, other)}
            edits.append(PartEdit(f"{leg}.{name}", leg, "stance", parameters, texts, (leg, "stance_lead")))
    for name, (kind, parameters, phrases, field) in (TORSO | TORSO_RHYTHM).items():
        edits.append(
            PartEdit(f"torso.{name}", "torso", kind, parameters, {"torso": phrases}, ("torso", field))
        )
    for name, (parameters, phrases, field) in HEAD.items():
        edits.append(PartEdit(f"head.{name}", "head", "head", parameters, {"head": phrases}, ("head", field)))
    for name, (parameters, phrases, field) in LEGS.items():
        texts = {f"{side}_leg": _sided(phrases, side) for side in ("left", "right")}
        edits.append(PartEdit(f"legs.{name}", "legs", "legs", parameters, texts, ("left_leg", field)))
    for name, (kind, parameters, phrases, torso, measure) in STEPS.items():
        texts = {f"{side}_leg": _sided(phrases, side) for side in ("left", "right")}
        texts |= {"torso": torso} if torso else {}
        edits.append(PartEdit(f"legs.{name}", "legs", kind, parameters, texts, measure))
    return {edit.name: edit for edit in edits}


EDITS = _build()

# One side is trained and the other never shown, or a strength is left out between or beyond trained ones.
HELD_OUT = frozenset(
    {
        "left_arm.overhead",
        "right_arm.on_head",
        "left_arm.behind_back",
        "right_arm.at_ear",
        "left_arm.on_chest",
        "right_arm.backward",
        "left_arm.forward_low",
        "right_arm.side_low",
        "right_arm.punching",
        "torso.lean_back_far",
        "torso.lean_forward",
        "torso.lean_right_far",
        "head.down_far",
        "head.up",
        "head.turned_right",
        "head.tilted_left",
        "left_leg.lifted",
        "right_leg.dragging",
        "left_leg.toes_out",
        "legs.crouch",
        "legs.very_wide",
        "legs.long_little",
        "legs.long_slow",
        "legs.quick_short",
        "legs.on_line",
        "legs.apart",
        "legs.pausing_little",
        "legs.stomping",
        "legs.unsteady",
        "right_leg.limping_little",
        "left_leg.limping_far",
        "left_leg.lingering",
        "torso.bob_little",
        "torso.hips_sway",
        "torso.hips_swing",
        "torso.shoulders_turn",
        "torso.shoulders_roll",
        "torso.rock_little",
        "left_arm.swing_far",
        "right_arm.swing_more",
        "right_arm.swing_half",
    }
)
# Each alone is trained, never both at once.
HELD_OUT_PAIRS: dict[str, tuple[str, str]] = {
    "hands on hips": ("left_arm.on_hip", "right_arm.on_hip"),
    "both arms stretched out in front": ("left_arm.forward", "right_arm.forward"),
    "arms crossed": ("left_arm.folded", "right_arm.folded"),
    "hands in pockets": ("left_arm.in_pocket", "right_arm.in_pocket"),
    "both hands behind the head": ("left_arm.behind_head", "right_arm.behind_head"),
    "hunched over, looking at the ground": ("torso.slump", "head.down"),
}
