"""Prompts in free words, none of which is a sentence of the catalogue, with the edits that they ask for."""

from __future__ import annotations

# prompt: edits of `sport.training.layering.catalog` whose measures tell whether it was followed
FREE_PROMPTS: dict[str, tuple[str, ...]] = {
    "left arm up in the air": ("left_arm.overhead",),
    "arms akimbo": ("left_arm.on_hip", "right_arm.on_hip"),
    "bent backwards a lot": ("torso.lean_back_far",),
    "gazing up at the stars": ("head.up_far",),
    "chin tucked to the chest": ("head.down_far",),
    "a man saying hello with his right hand": ("right_arm.waving",),
    "both arms spread wide like an eagle": ("left_arm.side", "right_arm.side"),
    "hands deep in the trouser pockets": ("left_arm.in_pocket", "right_arm.in_pocket"),
    "sneaking with very bent knees": ("legs.crouch_deep",),
    "walking on the balls of the feet, heels up": ("legs.tiptoe",),
    "dragging the right foot behind": ("right_leg.dragging",),
    "marching with the knees pulled up high": ("left_leg.high_knee", "right_leg.high_knee"),
    "a cowboy, legs far apart": ("legs.very_wide",),
    "right arm out to the side, level with the shoulder": ("right_arm.side",),
    "left palm resting on the tummy": ("left_arm.on_belly",),
    "head cocked to the left": ("head.tilted_left",),
    "slouching with rounded shoulders": ("torso.slump",),
    "peering over to the right": ("head.turned_right",),
    "nose in the air": ("head.up",),
    "sleepwalking with both arms out ahead": ("left_arm.forward", "right_arm.forward"),
}
