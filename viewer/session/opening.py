"""Opens a motion file as a take, on its original ground, or retargeted from another skeleton."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from runtime.errors import SportError
from runtime.session import edits
from runtime.session.motion import Motion
from runtime.session.session import Ground, Reference, Session, Take
from runtime.terrain.height_map import Terrain
from viewer.jobs import Slot
from viewer.session.takes import Takes

SLOT = Slot("opening of a take")


@dataclass(frozen=True)
class Opened:
    """A take opened from a file, a sentence about it, and why its ground cannot be shown."""

    take: Take
    text: str
    problem: str
    animations: tuple[str, ...]  # of the file


def read_take(path: Path, load_ground: Callable[[str], Terrain] | None, animation: str = "") -> Opened:
    """Read the take of a file, choosing an animation by name; thread-safe. Raises FileError.

    It gets the ground named in its file if `load_ground` finds it; a retargeted motion without one gets flat ground.
    """
    from runtime.formats.ground import ground_spec, names_ground
    from runtime.formats.prepare import on_its_ground, placement_of, with_contacts
    from runtime.formats.reference import open_take

    opened = open_take(path, animation)
    clip, own, ground, problem = opened.clip, None, None, ""
    text = f"{path.name}: {len(clip)} frames at {clip.fps:g} fps"
    if opened.reference is not None:
        own, text = opened.reference.own, text + opened.reference.describe()
    named = names_ground(clip)
    try:
        spec = ground_spec(clip, path) if named else "" if own is None else "flat"
        if spec and load_ground is not None:
            ground = Ground.of(spec, load_ground(spec))
            text += f", on the ground {Path(spec).name}"
    except SportError as error:
        named, problem = False, error.problem
    if named:
        back, clip = placement_of(clip).inverse(), on_its_ground(clip)
        own = None if own is None else replace(own, points=back.points(own.points).astype(np.float32))
    clip = with_contacts(clip, None if ground is None else ground.terrain)
    take = Take(motion=Motion.of(clip), recorded=False, ground=ground, own=own)
    return Opened(take, f"{text}. {opened.note}".rstrip(), problem, opened.animations)


def open_file(takes: Takes, path: Path, keep_ground: bool = False, animation: str = "") -> None:
    """Add the motion of a file to the list and play it, on its own ground unless `keep_ground`."""
    _open(takes, path, keep_ground, animation, takes.play)


def open_reference(takes: Takes, path: Path, animation: str = "") -> None:
    """Add the motion of a file to the list as reference of the playing take, or play it if none plays."""

    def show(number: int) -> None:
        if takes.playback is None:
            takes.play(number)
        else:
            made = Reference(take=number)
            takes.editor.do(f"reference {path.name}", lambda session: replace(session, reference=made))

    _open(takes, path, False, animation, show, selects=False)


def _open(
    takes: Takes,
    path: Path,
    keep_ground: bool,
    animation: str,
    show: Callable[[int], None],
    selects: bool = True,
) -> None:
    load, number = None if keep_ground else takes.scene.read_ground, takes.session.counter + 1

    def add(found: Opened, session: Session) -> Session:
        made = edits.with_new_take(session, found.take, number)
        return made if selects else replace(made, selected=session.selected)

    def opened(found: Opened) -> None:
        takes.animations[number] = path, found.animations
        show(number)
        takes.messages.note(found.text)
        if found.problem:
            shown = takes.scene.terrain.name
            takes.messages.warn(
                f"{found.problem} It plays on {shown}. Put that file into the same folder and open it again."
            )

    work, slot = partial(read_take, path, load, animation), replace(SLOT, of=(path, animation))
    takes.editor.run(
        takes.jobs, f"opening of {path.name}", slot, work, add, edits.with_number, opened, reading=path.name
    )
