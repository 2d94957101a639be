"""Takes of the list are moved to disk, so that a long list holds little memory."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

from runtime.errors import FileError
from runtime.takes.frame_store import FrameStore
from viewer.jobs import Jobs, Slot
from viewer.takes.state import ClipItem, TakesState, TakeVersion

if TYPE_CHECKING:
    from runtime.takes.clip import Clip

SLOT = Slot("takes to disk")
LOOKED_AT = 16  # takes in a frame: a project may bring hundreds at once
LET_GO_FRAMES = 60  # between two times at which what was read is given back


@dataclass
class Storing:
    """Looks after some takes of the list in each frame."""

    state: TakesState
    jobs: Jobs
    store: FrameStore
    _next: int = 0
    _frame: int = 0
    _full: bool = False  # the disk: what is in memory stays there

    def watch(self) -> None:
        """Move what is not on disk yet; call once a frame."""
        self._frame += 1
        if self._frame % LET_GO_FRAMES == 0:
            self.store.let_go()
        if self._full or not self.state.items or self.jobs.busy(SLOT):
            return
        clips = []
        for _ in range(min(LOOKED_AT, len(self.state.items))):
            self._next = (self._next + 1) % len(self.state.items)
            clips += [clip for clip in _clips(self.state.items[self._next]) if not self.store.holds(clip)]
        if clips:
            self.jobs.submit(SLOT, partial(self.store.move, clips), lambda _: None, self._stop)

    def keep(self, clips: Sequence[Clip]) -> None:
        """Move clips that are not in the list yet; on any thread. Where the disk has no room they stay in memory."""
        with contextlib.suppress(FileError):  # `watch` meets it again, and says so
            self.store.move(clips)

    def _stop(self, _error: Exception) -> None:
        self._full = True


def _clips(item: ClipItem) -> Iterator[Clip]:
    """Every version of a take."""
    versions: list[ClipItem | TakeVersion] = [item, *item.older, *item.newer]
    for version in versions:
        yield version.clip
        if version.base is not None:
            yield version.base
