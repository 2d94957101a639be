"""What `sport view` is asked for: one immutable set of options, checked before a window opens."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from sport.runtime.atomic import check_target
from sport.runtime.errors import UsageError
from sport.runtime.prompts.blend import ALL_A, Weights

MIN_SIDE, MAX_SIDE = 64, 8192  # pixels
MAX_FRAMES = 1_000_000


@dataclass(frozen=True)
class ViewOptions:
    """Options of one run of the viewer; None means "as last time" or the built-in default.

    `controls` is a script of keys for tests and film making, e.g. "w 2; w+shift 1.5; idle 1" (see
    `sport.viewer.input.script`). With `offscreen` no display is needed, every frame is one simulation step of 1/60 s
    and the run is deterministic; it ends after `frames` frames.
    """

    offscreen: bool = False
    frames: int | None = None
    screenshot: Path | None = None  # PNG of the last frame
    frames_directory: Path | None = None  # offscreen: every frame as frame_00000.png
    width: int | None = None  # pixels
    height: int | None = None
    ui_scale: float | None = None  # 1.0 is 96 dpi
    panels: bool = True
    terrain: str | None = None  # a name of the library or a file
    prompt: str | None = None
    blend: str | None = None  # a second prompt
    blend_weights: Weights = (0.5,) * len(ALL_A)  # its share in each body part
    model: Path | None = None  # directory of an exported model
    character: Path | None = None  # GLB
    clip: Path | None = None  # BVH to open
    seed: int = 0
    quality: str | None = None
    camera: str | None = None  # "follow" or "orbit"
    controls: str = ""

    def check(self) -> None:
        """UsageError naming the option when a value cannot be used, FileError when a picture cannot be written."""
        for name, value in (("--width", self.width), ("--height", self.height)):
            if value is not None and not MIN_SIDE <= value <= MAX_SIDE:
                raise UsageError(
                    f"{name} {value}: expected {MIN_SIDE} to {MAX_SIDE} pixels.", "Choose another size."
                )
        if self.frames is not None and not 1 <= self.frames <= MAX_FRAMES:
            raise UsageError(f"--frames {self.frames}: expected 1 to {MAX_FRAMES}.", "Choose another number.")
        if self.seed < 0:
            raise UsageError(f"--seed {self.seed}: expected 0 or more.", "Choose another seed.")
        if self.ui_scale is not None and not 0.5 <= self.ui_scale <= 4.0:
            raise UsageError(f"--ui-scale {self.ui_scale}: expected 0.5 to 4.", "Choose another scale.")
        if self.camera not in (None, "follow", "orbit"):
            raise UsageError(f"--camera {self.camera}: expected follow or orbit.", "Choose one of the two.")
        if self.frames_directory is not None and not self.offscreen:
            raise UsageError("--save-frames: works with --offscreen only.", "Add --offscreen.")
        if self.screenshot is not None:
            check_target(self.screenshot.expanduser())
        if self.frames_directory is not None:
            check_target(self.frames_directory.expanduser() / "frame_00000.png")
