"""The options of `sport view`: one immutable set, checked before a window opens."""

import math
import os
from dataclasses import dataclass, fields
from pathlib import Path

from runtime.atomic import check_target
from runtime.errors import UsageError
from runtime.options import Spec, spec_of, specified
from runtime.prompts.blend import ALL_A, Weights
from runtime.safe_read import check_source, expanded
from runtime.terrain.library import load_terrain
from viewer.settings import CAMERAS, QUALITIES, VIEWS

SIDES = (64, 8192)  # pixels
MAX_SEED = (1 << 62) - 1  # that a session holds


@dataclass(frozen=True)
class ViewOptions:
    """Options of a viewer run; None means "as last time" or the built-in default.

    `controls` is a stick script (see `runtime.motion.control_scripts`), `keys` a script of keys for tests and films,
    e.g. "w 2; w+shift 1.5; idle 1" (see `viewer.input.devices`). `offscreen` needs no display: every frame is one
    simulation step of 1/60 s, and the run is deterministic; it ends after `frames` frames.
    """

    offscreen: bool = False
    frames: int | None = specified(None, 1, 1_000_000, flag="--frames")
    screenshot: Path | None = None  # PNG of the last frame
    frames_directory: Path | None = None  # offscreen: every frame as frame_00000.png
    width: int | None = specified(None, *SIDES, flag="--size", unit=" pixels")
    height: int | None = specified(None, *SIDES, flag="--size", unit=" pixels")
    ui_scale: float | None = specified(None, 0.5, 4.0, flag="--ui-scale")  # 1.0 is 96 dpi
    panels: bool = True
    terrain: str | None = None  # a name of the library or a file
    prompt: str | None = None
    blend: str | None = None  # a second prompt
    blend_weights: Weights = (0.5,) * len(ALL_A)  # its weight in each body part
    model: Path | None = None  # directory of an exported model
    character: Path | None = None  # GLB
    fit_to_motion: bool = False  # scale the character to the motion
    joint_map: Path | None = None  # JSON of its joints, instead of the one in its folder
    clip: Path | None = None  # BVH to open
    session: str | None = None  # file of a session, or "last"
    seed: int = specified(0, 0, MAX_SEED, flag="--seed")
    quality: str | None = specified(None, choices=QUALITIES, flag="--quality")
    camera: str | None = specified(None, choices=CAMERAS | VIEWS, flag="--camera")
    response: float | None = specified(None, 0.0, 1.0, flag="--response")
    controls: str | None = None
    keys: str = ""
    vmc: str | None = None  # the same by the VMC protocol
    live_link: str | None = None  # address for live poses, see `viewer.live.link`; None: off

    @property
    def saves_pictures(self) -> bool:
        """Whether frames are saved to files, without the status line."""
        return self.offscreen or self.screenshot is not None or self.frames_directory is not None

    def check(self) -> None:
        """Raise UsageError for an invalid option, and FileError if a file cannot be written."""
        for name in (entry.name for entry in fields(self)):
            value, spec = getattr(self, name), spec_of(self, name)
            if spec.flag and value is not None and not spec.allows(value):
                raise UsageError(f"{spec.flag} {value}: expected {_expected(spec)}.", "Choose another value.")
        self._check_sources()
        if self.frames_directory is not None:
            if not self.offscreen:
                raise UsageError("--save-frames: works with --offscreen only.", "Add --offscreen.")
            check_target(expanded(self.frames_directory) / "frame_00000.png")
        if self.screenshot is not None:
            check_target(expanded(self.screenshot))

    def _check_sources(self) -> None:
        """Raise FileError or TerrainError if a named file or ground does not exist."""
        session = Path(self.session) if self.session and self.session != "last" else None
        for path in filter(None, (session, self.clip, self.character, self.joint_map)):
            check_source(expanded(path))
        if self.terrain is not None and not os.path.exists(self.terrain):
            load_terrain(self.terrain)  # made quickly, or refused with the list of names


def _expected(spec: Spec) -> str:
    if spec.choices is not None:
        return " or ".join(filter(None, spec.choices))
    return f"{spec.low:g} " + ("or more" if spec.high == math.inf else f"to {spec.high:.7g}{spec.unit}")
