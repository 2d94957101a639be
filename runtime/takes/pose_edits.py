"""What is done to the poses of a take over the motion that was driven: plants of the feet, then pins. Nothing is baked in."""

from __future__ import annotations

from dataclasses import dataclass

from runtime.takes.clip import Clip
from runtime.takes.footplants import FootplantEdit, replanted
from runtime.takes.pinned import pinned
from runtime.takes.pins import Pin


@dataclass(frozen=True)
class PoseEdits:
    """Edits in the order in which they are made to the clip."""

    pins: tuple[Pin, ...] = ()
    footplants: tuple[FootplantEdit, ...] = ()

    def __bool__(self) -> bool:
        return bool(self.pins or self.footplants)

    def apply(self, clip: Clip) -> Clip:
        """The clip as it is shown; the same object without edits."""
        if self.footplants:
            clip = replanted(clip, self.footplants)
        return pinned(clip, self.pins) if self.pins else clip


NO_EDITS = PoseEdits()
