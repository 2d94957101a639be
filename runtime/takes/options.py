"""What a take is exported with: one immutable set of options for every format."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from runtime.errors import UsageError
from runtime.takes.clip import MAX_FPS, UNITS_PER_METRE


@dataclass(frozen=True)
class ExportOptions:
    """Options of an export; `unit` concerns BVH and the ground beside it, GLB and FBX are in metres."""

    fps: float = 60.0
    unit: str = "cm"
    in_place: bool = False  # the root's path over the ground is taken out, its heading stays
    ground_root: bool = False  # a joint of its own above the hips, on the ground
    at_origin: bool = False  # begin at x = z = 0 on height 0, facing +Z
    rest_frame: bool = False  # the rest pose as first frame
    loop: bool = False  # only the best cycle of a steady walk
    start_s: float = 0.0
    end_s: float | None = None  # None: to the last frame
    with_ground: bool = False  # the ground as a second node (GLB, FBX)
    character: Path | None = None  # of GLB, FBX and film; None: the mannequin
    joint_map: Path | None = None  # names of its joints, see `runtime.character.joint_map.read_joint_map`

    def check(self) -> None:
        """UsageError names the option that cannot be used."""
        if not 1.0 <= self.fps <= MAX_FPS:
            raise UsageError(
                f" {self.fps:g}: expected 1 to {MAX_FPS:.0f} frames per second.", "Try 60 or 30.", "fps"
            )
        if self.unit not in UNITS_PER_METRE:
            raise UsageError(f" {self.unit}: expected cm or m.", "Choose one of the two.", "unit")
        if not self.start_s >= 0.0 or (self.end_s is not None and not self.end_s > self.start_s):
            end = "" if self.end_s is None else f"{self.end_s:g}"
            raise UsageError(
                f" {self.start_s:g}:{end}: expected 0 or more, and an end after the start.",
                "Write seconds, such as 2:6.5.",
                "start_s",
            )
        if self.in_place and self.with_ground:
            raise UsageError(
                " with a ground: the character would not move over it.",
                "Leave one of the two out.",
                "in_place",
            )
