"""The table of data sets: what is in a folder of archives, whom to credit, what may be done with the weights."""

from __future__ import annotations

from pathlib import Path

from runtime.errors import FileError
from runtime.formats.bvh import BvhMotion
from training.data import source_skeletons
from training.data.record import ClipSource, Refusal
from training.data.sets import DATA_SETS
from training.data.source_skeletons import SourceSkeleton

BY_NAME = {record.name: record for record in DATA_SETS}
NON_COMMERCIAL = "non-commercial: trained also on CC BY-NC and academic data"
FREE = "CC BY 4.0: may be published and used commercially with the credits"


def list_clips(data: Path, free_only: bool = False) -> tuple[list[ClipSource], list[Refusal]]:
    """All clips below `data` (one folder per archive) and the files that are left out, in a stable order.

    `free_only` leaves out the archives that may not go into weights which anybody may publish.
    """
    clips: list[ClipSource] = []
    refused: list[Refusal] = []
    for record in DATA_SETS:
        source = record.name
        if free_only and not record.free:
            refused.append(Refusal(source, source, "licence is non-commercial"))
            continue
        folder = source_folder(data, source)
        if folder is None:
            refused.append(Refusal(source, source, "archive not present"))
            continue
        found, left_out = record.clips(folder)
        clips += found
        refused += left_out
    if not clips:
        raise FileError(
            f"{data}: none of {', '.join(BY_NAME)} found.", "Give the folder of the archives with --data."
        )
    return clips, refused


def source_folder(data: Path, source: str) -> Path | None:
    """Folder with the unpacked files of `source`: DATA/NAME/NAME or DATA/NAME."""
    for folder in (data / source / source, data / source):
        if folder.is_dir():
            return folder
    return None


def recognise(motion: BvhMotion, file_name: str) -> SourceSkeleton:
    """The known skeleton of a motion; FileError names the file when there is none."""
    return source_skeletons.recognise(motion, file_name, (s for r in DATA_SETS for s in r.skeletons))


def skeleton_of(clip: ClipSource, motion: BvhMotion) -> SourceSkeleton:
    """The skeleton of a clip with the constants of its capture."""
    found = recognise(motion, clip.path.name)
    owner = next(
        (r for r in DATA_SETS if clip.capture in {*r.head_lift_degrees, *r.references}), BY_NAME[clip.source]
    )
    return owner.of_capture(found, clip.capture)


def credits_of(sources: set[str]) -> list[str]:
    """A line for each archive, in a stable order, none twice; KeyError for one that is unknown."""
    return list(dict.fromkeys(BY_NAME[name].credit for name in sorted(sources)))


def licence_of(sources: set[str]) -> str:
    """What may be done with weights that were trained on these archives."""
    return FREE if all(BY_NAME[name].free for name in sources) else NON_COMMERCIAL
