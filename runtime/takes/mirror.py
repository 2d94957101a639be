"""The mirror image of a take: left becomes right, in the motion and in its prompts."""

import re
from dataclasses import replace

from runtime import rotations
from runtime.skeleton import mirror_motion
from runtime.takes.clip import Clip
from runtime.takes.root import Placement

_SIDES = re.compile(r"(?<![a-zA-Z])(left|right)(?![a-zA-Z])", re.IGNORECASE)


def mirrored(clip: Clip) -> Clip:
    """Return the clip mirrored at the vertical plane of its first facing direction, so that it starts at the same place.

    It no longer fits uneven ground.
    """
    x, _, z = (float(v) for v in clip.hips_positions[0])
    place = Placement(float(rotations.yaw_of(clip.local_rotations[0, 0])), (x, 0.0, z))
    there = place.inverse().clip(clip)
    hips, local = mirror_motion(there.hips_positions, there.local_rotations)
    return replace(
        place.clip(there.posed(hips, local)),
        name=f"{clip.name}, mirrored",
        contacts=clip.contacts[:, [2, 3, 0, 1]],
        prompts=tuple(event.rewritten(other_side) for event in clip.prompts),
    )


def other_side(text: str) -> str:
    """Return the text with left and right swapped."""

    def other(found: re.Match[str]) -> str:
        word = "right" if found[0].lower() == "left" else "left"
        return word.upper() if found[0].isupper() else word.capitalize() if found[0][0].isupper() else word

    return _SIDES.sub(other, text)
