"""Pose edits of a take, applied to its simulated motion without changing it: footplants, the pose layer, then pins."""

from dataclasses import dataclass

from runtime.arrays import Array
from runtime.errors import UsageError
from runtime.takes.clip import Clip
from runtime.takes.footplants import FootplantEdit, replanted
from runtime.takes.pinned import pinned
from runtime.takes.pins import MAX_PINS, Pin
from runtime.takes.pose_layer import NO_LAYER, PoseLayer, layered


@dataclass(frozen=True)
class PoseEdits:
    """The pose edits of a take, in the order in which they are applied: footplants, pose layer, pins. UsageError for too many."""

    pins: tuple[Pin, ...] = ()
    footplants: tuple[FootplantEdit, ...] = ()
    layer: PoseLayer = NO_LAYER

    def __post_init__(self) -> None:
        if max(map(len, (self.pins, self.footplants, self.layer.keys))) > MAX_PINS:
            problem = f"A take holds {MAX_PINS} pins, and as many footplants and pose keys."
            raise UsageError(problem, "Remove some first.")

    def __bool__(self) -> bool:
        return bool(self.pins or self.footplants or self.layer)

    def apply(self, clip: Clip) -> Clip:
        """Return the edited clip; the same object if there are no edits."""
        clip = self.below_layer(clip)
        if self.layer:
            clip = layered(clip, self.layer)
        return pinned(clip, self.pins) if self.pins else clip

    def frame(self, below: Clip, number: int) -> Clip:
        """Return one edited frame, from the motion below the pose layer."""

        def shown(frame: int) -> Clip:
            return layered(below.trim(frame, frame), self.layer, frame / below.fps)

        def pose_at(seconds: float) -> Array:
            return shown(min(round(seconds * below.fps), len(below) - 1)).local_rotations[0]

        return pinned(shown(number), self.pins, number / below.fps, pose_at)

    def below_layer(self, clip: Clip) -> Clip:
        """Return the motion below the pose layer: the clip with footplant edits."""
        return replanted(clip, self.footplants) if self.footplants else clip


NO_EDITS = PoseEdits()
