"""Reading a BVH file: a take on the ground that it was made on, or a motion of another skeleton."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from runtime.errors import SportError
from runtime.session.motion import Motion
from runtime.session.session import Ground, Take
from runtime.terrain.height_map import Terrain
from viewer.jobs import Slot

SLOT = Slot("opening of a take")


def read_take(path: Path, load_ground: Callable[[str], Terrain] | None) -> tuple[Take, str, str]:
    """A take, a sentence about it, and why its ground cannot be shown; on any thread, FileError.

    One of another skeleton plays on flat ground, one of ours on its own, where `load_ground` finds that.
    """
    from runtime.formats.ground import ground_spec, names_ground
    from runtime.formats.prepare import on_its_ground, with_contacts
    from runtime.formats.reference import open_take

    opened = open_take(path)
    clip, said, spec, own, problem = opened.clip, "", "", None, ""
    if opened.reference is not None:
        said, spec, own = opened.reference.describe(), "flat", opened.reference.own
    text = f"{path.name}: {len(clip)} frames at {clip.fps:g} fps{said}"
    ground = None
    try:
        if own is None and names_ground(clip):
            clip, spec = on_its_ground(clip), ground_spec(clip, path)
        if spec and load_ground is not None:
            ground = Ground.of(spec, load_ground(spec))
            text += f", on the ground {Path(spec).name}"
    except SportError as error:
        clip, problem = opened.clip, error.problem
    clip = with_contacts(clip, None if ground is None else ground.terrain)
    take = Take(motion=Motion.of(clip), recorded=False, ground=ground, own=own)
    return take, f"{text}. {opened.note}".rstrip(), problem
