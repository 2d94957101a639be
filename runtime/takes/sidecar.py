"""The JSON beside a BVH, as it follows from a clip."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from runtime.atomic import write_atomic
from runtime.takes.metadata import format_metadata, gait_changes, sidecar_path

if TYPE_CHECKING:
    from runtime.takes.clip import Clip


def write_sidecar(clip: Clip, path: Path, text: str) -> None:
    """Write what is known of the clip beside its BVH of this text; FileError when it cannot be written."""
    metadata = format_metadata(
        text,
        clip.name,
        clip.seconds,
        clip.terrain,
        clip.prompts,
        clip.origin,
        dict(clip.gait_seconds),
        gait_changes(clip.gaits, clip.fps),
        clip.placed,
    )
    write_atomic(sidecar_path(path), metadata)
