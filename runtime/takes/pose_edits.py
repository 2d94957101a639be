"""What is done to the poses of a take over the motion that was driven: plants of the feet, then pins. Nothing is baked in."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from runtime.takes.clip import Clip
from runtime.takes.footplants import FootplantEdit, read_footplant, replanted
from runtime.takes.pinned import pinned
from runtime.takes.pins import MAX_PINS, Pin, read_pin


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

    def to_json(self) -> dict[str, Any]:
        """Plain values, see `read_edits`."""
        return {
            "pins": [pin.to_json() for pin in self.pins],
            "footplants": [p.to_json() for p in self.footplants],
        }


NO_EDITS = PoseEdits()


def read_edits(value: Mapping[str, Any]) -> PoseEdits:
    """Edits of `PoseEdits.to_json`; KeyError, TypeError, ValueError or UsageError for what is none."""
    if len(value["pins"]) > MAX_PINS or len(value["footplants"]) > MAX_PINS:
        raise ValueError(f"{len(value['pins'])} pins")
    return PoseEdits(
        tuple(read_pin(pin) for pin in value["pins"]),
        tuple(read_footplant(plant) for plant in value["footplants"]),
    )
