"""The mirror image of a take: left becomes right, in the motion and in its words."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np

from runtime import rotations
from runtime.skeleton import SPORT_SKELETON, mirror_motion
from runtime.takes.clip import Clip
from runtime.takes.metadata import PromptEvent

_SIDES = re.compile(r"(?<![a-zA-Z])(left|right)(?![a-zA-Z])", re.IGNORECASE)
_OTHER = {
    "left": "right",
    "right": "left",
    "Left": "Right",
    "Right": "Left",
    "LEFT": "RIGHT",
    "RIGHT": "LEFT",
}
UP = np.array([0.0, 1.0, 0.0])


def mirrored(clip: Clip) -> Clip:
    """The clip reflected through the vertical plane in which it begins to look, so that it begins at the same place.

    It no longer goes over the ground that it was made on, where that is not level.
    """
    yaw = _first_yaw(clip)
    turn = rotations.from_axis_angle(UP, np.array(yaw))
    back = rotations.from_axis_angle(UP, np.array(-yaw))
    start = clip.hips_positions[0] * np.array([1.0, 0.0, 1.0])
    local = np.array(clip.local_rotations, float)
    local[:, 0] = rotations.multiply(back, local[:, 0])
    hips, local = mirror_motion(rotations.rotate(back, clip.hips_positions - start), local)
    local[:, 0] = rotations.multiply(turn, local[:, 0])
    return replace(
        clip,
        name=f"{clip.name}, mirrored",
        hips_positions=(rotations.rotate(turn, hips) + start).astype(np.float32),
        local_rotations=local.astype(np.float32),
        contacts=clip.contacts[:, [2, 3, 0, 1]],
        prompts=tuple(_mirrored_event(event) for event in clip.prompts),
    )


def other_side(text: str) -> str:
    """Words with left and right exchanged."""
    return _SIDES.sub(lambda found: _OTHER.get(found[0], found[0]), text)


def _mirrored_event(event: PromptEvent) -> PromptEvent:
    return replace(
        event,
        prompt=other_side(event.prompt),
        words=other_side(event.words),
        typed=other_side(event.typed),
    )


def _first_yaw(clip: Clip) -> float:
    """Where the hips look in the first frame, radians about the vertical; 0 is +Z."""
    _, world = SPORT_SKELETON.forward_kinematics(clip.hips_positions[:1], clip.local_rotations[:1])
    forward = rotations.rotate(world[0, 0], np.array([0.0, 0.0, 1.0]))
    return float(np.arctan2(forward[0], forward[2]))
