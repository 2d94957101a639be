"""Opening BVH files: a take on the ground that it was made on, a motion of another skeleton as reference."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from runtime.errors import FileError
from viewer.jobs import Jobs, Slot
from viewer.messages import Messages
from viewer.stage.state import StageState
from viewer.takes.state import ClipItem

if TYPE_CHECKING:
    from runtime.takes.clip import Clip
    from runtime.takes.own_skeleton import OwnSkeleton


@dataclass(frozen=True)
class Opened:
    """A clip from a file; `ground` is where it goes over, "" where the ground on the stage does."""

    clip: Clip
    ground: str
    problem: str = ""  # why its ground cannot be shown
    said: str = ""  # what else is to be known
    own: OwnSkeleton | None = None  # that moved in the file


def read_clip(path: Path) -> Opened:
    """A BVH of ours with its ground, or one of another skeleton as reference on flat ground; FileError."""
    from runtime.formats.ground import ground_spec, names_ground
    from runtime.formats.prepare import on_its_ground
    from runtime.formats.reference import open_take

    opened = open_take(path)
    clip = opened.clip
    if opened.reference is not None:
        return Opened(clip, "flat", said=opened.reference.describe(), own=opened.reference.own)
    if not names_ground(clip):
        return Opened(clip, "")
    try:
        return Opened(on_its_ground(clip), ground_spec(clip, path))
    except FileError as error:
        return Opened(clip, "", error.problem)


@dataclass
class Opening:
    """Opens files; `take` puts a clip into the list and plays it, `lay` puts it on a ground by name or file, and says so.

    `beside` puts a take into the list and shows it beside the one that plays.
    """

    messages: Messages
    jobs: Jobs
    stage: StageState
    take: Callable[[ClipItem], ClipItem]
    lay: Callable[[ClipItem, str, str], None]
    beside: Callable[[ClipItem], None]

    def open(self, path: Path, keep_ground: bool = False) -> None:
        """Add a BVH file to the list and play it, on its own ground unless `keep_ground`."""
        self.jobs.submit(
            Slot("clip", path),
            lambda: read_clip(path),
            lambda opened: self._opened(path, opened, keep_ground),
            reading=path.name,
        )

    def open_beside(self, path: Path) -> None:
        """Add a BVH file to the list and show it beside the take that plays; play it where none does."""

        def opened(found: Opened) -> None:
            self.beside(_item(path, found))
            self.messages.note(f"{path.name}: {len(found.clip)} frames{found.said}.")

        self.jobs.submit(Slot("clip", path), lambda: read_clip(path), opened, reading=path.name)

    def _opened(self, path: Path, opened: Opened, keep_ground: bool) -> None:
        clip, ground = opened.clip, opened.ground
        text = f"{path.name}: {len(clip)} frames at {clip.fps:g} fps{opened.said}"
        item = self.take(_item(path, opened))
        self.messages.note(f"{text}.")
        if opened.problem:
            self.messages.warn(
                f"{opened.problem} It plays on {self.stage.terrain.name}. Put that file beside it and open it again."
            )
        elif ground and not keep_ground:
            self.lay(item, ground, f"{text}, on the ground {Path(ground).name}.")


def _item(path: Path, opened: Opened) -> ClipItem:
    return ClipItem(opened.clip, path, own=opened.own)
