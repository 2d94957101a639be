"""What a take is compared with, as a project keeps it, and put beside the take again."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

from runtime.projects.character_files import write_character_files
from runtime.projects.project import StoredReference
from viewer.takes.reference import LIMITS, Look, Reference
from viewer.takes.state import ClipItem


def fingerprint_of(reference: Reference) -> tuple[Any, ...]:
    """Changes whenever something changes that is kept."""
    numbers = tuple(getattr(reference, name) for name in LIMITS)
    shown = (reference.item, reference.video, reference.character_path)
    return (*(id(thing) for thing in shown), reference.look, reference.over, numbers)


def stored_reference(items: list[ClipItem], reference: Reference) -> StoredReference | None:
    """The reference as it is kept, but for the files of its character; None where there is none.

    A film is kept by its path, a take by its number.
    """
    if reference.item is None and reference.video is None:
        return None
    number = next((i for i, item in enumerate(items) if item is reference.item), -1)
    return StoredReference(
        take=number,
        video="" if reference.video is None else str(reference.video.path.absolute()),
        look=str(reference.look),
        numbers={name: float(getattr(reference, name)) for name in LIMITS} | {"over": float(reference.over)},
    )


def restore_reference(
    stored: StoredReference, items: list[ClipItem], reference: Reference, cache: Path
) -> None:
    """Show the reference of a project again; `cache` takes the files of its character."""
    reference.close()
    if 0 <= stored.take < len(items):
        reference.show(items[stored.take])
    for name, (low, high, first) in LIMITS.items():
        value = stored.numbers.get(name, first)
        setattr(reference, name, min(max(value, low), high) if math.isfinite(value) else first)
    reference.over = bool(stored.numbers.get("over", 0.0))
    if stored.look in (Look.TAKE, Look.SKELETON):
        look = Look(stored.look)
        reference.look = look if look in reference.looks else Look.TAKE
    if stored.character:
        reference.open_character(write_character_files(stored.character, cache))
    if stored.video:
        reference.open_video(Path(stored.video), keep_numbers=True)
