"""The ground that a take was made on: by the name in its metadata, or the file of that name near it."""

from __future__ import annotations

from pathlib import Path

from runtime.errors import FileError
from runtime.takes.clip import Clip
from runtime.takes.metadata import UNKNOWN
from runtime.terrain.height_map import Terrain
from runtime.terrain.library import TERRAIN_NAMES, load_terrain


def names_ground(clip: Clip) -> bool:
    """Whether a clip from a file says where it was made; one without metadata does not."""
    return clip.terrain != "flat" or bool(clip.prompts) or clip.origin != UNKNOWN


def ground_spec(clip: Clip, clip_path: Path | None = None, asked: str | None = None) -> str:
    """Name or file of the ground under `clip`: `asked`, or the one of its metadata.

    Metadata keep only the name of a ground from a file: it is looked for as it is, and beside the clip. FileError when
    it is in neither place, with the remedy to name it.
    """
    if asked is not None:
        return asked
    if clip.placed is None or clip.terrain in TERRAIN_NAMES:
        return clip.terrain if clip.placed is not None else "flat"
    places = [Path(clip.terrain)]
    if clip_path is not None:
        places.append(clip_path.parent / Path(clip.terrain).name)
    for place in places:
        if place.is_file():
            return str(place)
    raise FileError(
        f"{clip_path or clip.name}: made on the ground {Path(clip.terrain).name}, which is not beside it.",
        "Put that file beside the clip, or choose a ground (--terrain).",
    )


def ground_of(clip: Clip, clip_path: Path | None = None, asked: str | None = None) -> Terrain:
    """The terrain of `ground_spec`."""
    return load_terrain(ground_spec(clip, clip_path, asked))
