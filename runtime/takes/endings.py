"""Endings of files and what is written into them: the one table that command and window go by."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from runtime.errors import UsageError


@dataclass(frozen=True)
class Ending:
    """An ending, the kind of writer behind it ("motion", "film" or "ground"), and what the file is."""

    suffix: str
    kind: str
    text: str


ENDINGS = (
    Ending(".bvh", "motion", "motion of the 31-joint skeleton"),
    Ending(".glb", "motion", "character with motion (glTF binary)"),
    Ending(".fbx", "motion", "character with motion, through Blender"),
    Ending(".mp4", "film", "film (H.264)"),
    Ending(".png", "film", "film as numbered frames, name_00000.png and on"),
    Ending(".webp", "film", "animated WebP"),
    Ending(".gif", "film", "animated GIF"),
    Ending(".obj", "ground", "ground under the take"),
)


def ending_of(path: Path) -> Ending:
    """The entry for a file's name; UsageError lists the endings that are written."""
    for ending in ENDINGS:
        if path.suffix.lower() == ending.suffix:
            return ending
    if path.is_dir():
        raise UsageError(f"{path}: this is a folder.", "Add the name of a file.")
    known = ", ".join(f"{e.suffix} ({e.text})" for e in ENDINGS)
    what = f"nothing writes files that end in {path.suffix}" if path.suffix else "a name without an ending"
    raise UsageError(f"{path}: {what}.", f"Choose {known}.")
