"""Rollouts in which one body part has the words of another clip: the others must go on as their own words say.

In capture the parts of a style always move together, so a network may read the right arm off the left arm's code, or
off the left arm itself. A lane with a swap keeps the other clip's code for one part until it ends. That part runs
free, unsupervised, from frame to frame; everything that it does not carry is still held to the captured clip. So the
rest of the body learns not to follow it, at the frame itself and through the fed-back pose.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from runtime.motion.features import OUTPUT, OUTPUT_SIZE
from runtime.skeleton import PART_JOINTS, PART_NAMES, J

SHARE = 0.5  # of the lanes
# Arms most often: they have the most to say, and each follows the other in most of the capture.
_CHANCE = {
    "left_arm": 0.3,
    "right_arm": 0.3,
    "left_leg": 0.08,
    "right_leg": 0.08,
    "torso": 0.1,
    "head": 0.14,
}
NOTHING = len(PART_NAMES)  # index of "no part is swapped"

_UPPER = ("left_arm", "right_arm", "torso", "head")
# Whose joint positions, and whose rotations, against the root a part moves with itself: a leg bends the height of all.
_MOVES: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "left_arm": (("left_arm",), ("left_arm",)),
    "right_arm": (("right_arm",), ("right_arm",)),
    "left_leg": (PART_NAMES, ("left_leg", "right_leg")),
    "right_leg": (PART_NAMES, ("left_leg", "right_leg")),
    "torso": (_UPPER, _UPPER),
    "head": (("head",), ("head",)),
}


@dataclass
class Swaps:
    """Of every lane: the part `(lanes,)` that is swapped, or NOTHING, and the clip `(lanes,)` whose words it has."""

    part: Tensor
    clip: Tensor

    @staticmethod
    def none(lanes: int, device: torch.device) -> Swaps:
        """No part of any lane."""
        zero = torch.zeros(lanes, dtype=torch.long, device=device)
        return Swaps(zero + NOTHING, zero)

    def draw(self, lanes: Tensor, clips: Tensor) -> None:
        """New swaps for the lanes with indices `lanes` `(n,)`, with the words of `clips` `(n,)`."""
        chance = torch.tensor([SHARE * _CHANCE[p] for p in PART_NAMES] + [1.0 - SHARE], device=clips.device)
        self.part[lanes] = torch.multinomial(chance, len(lanes), replacement=True)
        self.clip[lanes] = clips

    def mixed(self, z: Tensor, other: Tensor) -> Tensor:
        """Z^t `(lanes, n)` with the swapped part's code taken from `other`, alike."""
        part = torch.arange(len(PART_NAMES), device=z.device)
        swapped = (part == self.part[:, None]).repeat_interleave(z.shape[1] // len(PART_NAMES), dim=1)
        return torch.where(swapped, other, z)

    def supervised(self) -> Tensor:
        """One where an entry of y `(lanes, OUTPUT_SIZE)` is held to the clip, zero where the swapped part moves it."""
        return _kept().to(self.part.device)[self.part]


def _kept() -> Tensor:
    """`(parts + 1, OUTPUT_SIZE)`, a row per part and one for NOTHING."""
    kept = torch.ones(len(PART_NAMES) + 1, OUTPUT_SIZE)
    for row, part in zip(kept, PART_NAMES, strict=False):
        positions, rotations = _MOVES[part]
        for names, fields in (
            (positions, ("joint_positions", "joint_velocities")),
            (rotations, ("joint_rotations",)),
        ):
            joints = [j for name in names for j in PART_JOINTS[name]]
            for field in fields:
                row[OUTPUT[field]].view(J, -1)[joints] = 0.0
    return kept
