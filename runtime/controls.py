"""What the person asks of the character in one frame, free of any device."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum


class Gait(IntEnum):
    """Gait labels in the order of the network's one-hot input g (Sec. III-A)."""

    STAND = 0
    WALK = 1
    JOG = 2
    CROUCH = 3
    JUMP = 4
    OTHER = 5


@dataclass(frozen=True)
class Controls:
    """World-space wishes: the viewer has already turned stick axes by the camera's heading.

    `move` is the wished direction in the XZ plane with a length of 0 (stand) to 1 (full stick);
    `facing` a unit XZ direction to look at while strafing, or None to face where the character goes.
    `gait` is the gait to move in: WALK, JOG, CROUCH or JUMP; standing follows from `move` alone.
    """

    move: tuple[float, float] = (0.0, 0.0)
    facing: tuple[float, float] | None = None
    gait: Gait = Gait.WALK
