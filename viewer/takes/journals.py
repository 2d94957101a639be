"""Takes on disk while they are not exported yet, and the offer to take up those that another run left behind."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from runtime.takes.journal import FoundJournal, Header, TakeJournal, find_journals
from runtime.takes.metadata import Origin
from viewer.gui.widgets import clock
from viewer.jobs import Jobs, Slot
from viewer.messages import Messages
from viewer.takes.state import ClipItem, TakesState

if TYPE_CHECKING:
    from runtime.takes.clip import Clip
    from runtime.takes.recorder import ClipRecorder


@dataclass
class Journals:
    """One journal for each take of this run that is not exported, and those found at the start."""

    state: TakesState
    messages: Messages
    jobs: Jobs
    folder: Path
    add: Callable[[ClipItem], None]  # puts a recovered take into the list
    _running: TakeJournal | None = None  # of the take that is being recorded
    _watched: int = 0  # the item that was looked after last
    _lost: list[TakeJournal | FoundJournal] = field(default_factory=list)  # that it was said of

    def begin(
        self, recorder: ClipRecorder, name: str, terrain: str, origin: Origin, size: float = 1.0
    ) -> None:
        """Write down the take that begins now, of a body of a size."""
        self._running = journal = TakeJournal(
            self.folder, Header(name, recorder.fps, terrain, origin, time.time(), size)
        )
        in_force = recorder.prompt_in_force
        if in_force is not None:
            journal.mark_prompt(in_force)
        recorder.journal = journal

    def watch(self) -> None:
        """Say once when a take cannot be written down; call once a frame.

        Of the takes that have ended one is looked after in each frame: whether its journal is still there.
        """
        if self._running is not None and self._running.problem:
            self._warn("The take", self._running)
        if not self.state.items:
            return
        self._watched = (self._watched + 1) % len(self.state.items)
        item = self.state.items[self._watched]
        if item.journal is not None and item.journal not in self._lost:
            item.journal.watch()
            if item.journal.problem:
                self._warn(item.name, item.journal)

    def _warn(self, name: str, journal: TakeJournal | FoundJournal) -> None:
        if journal not in self._lost:
            self._lost.append(journal)
            self.messages.warn(f"{name} is in memory only until you export it: {journal.problem}")

    def end(self, recorder: ClipRecorder) -> TakeJournal | None:
        """The journal of the take that has just ended; whoever keeps the take deletes it when it is exported."""
        journal, self._running, recorder.journal = self._running, None, None
        if journal is not None:
            journal.finish()
        return journal

    def keep(self, clip: Clip) -> TakeJournal:
        """Write down a take that was cut from the memory."""
        journal = TakeJournal(
            self.folder, Header(clip.name, clip.fps, clip.terrain, clip.origin, time.time(), clip.size)
        )
        count = len(clip)
        gaits = np.full(count, -1, np.float32) if clip.gaits is None else clip.gaits.astype(np.float32)
        rotations = clip.local_rotations.reshape(count, -1)
        rows = np.column_stack([clip.hips_positions, rotations, clip.contacts, gaits]).astype(np.float32)
        events = list(clip.prompts)
        for i, row in enumerate(rows):
            while events and events[0].seconds * clip.fps <= i + 0.5:
                journal.mark_prompt(events.pop(0))
            journal.add_row(row)
        journal.finish()
        return journal

    # --- of runs that were cut off

    def look(self, again: bool = False) -> bool:
        """Find the takes of runs that were cut off; the panel offers them. Whether there are more than were known."""
        found, complaints = find_journals(self.folder)
        self.state.cut_off += found
        for complaint in [] if again else complaints:
            self.messages.warn(complaint)
        if found:
            first, more = self.state.cut_off[0], len(self.state.cut_off) - 1
            others = f" and {more} more" if more else ""
            self.messages.warn(
                f"Cut off before it was exported: {first.header.name} ({describe(first)}){others}."
                " Clips: Recover or Discard."
            )
        return bool(found)

    def recover(self, found: FoundJournal) -> None:
        """Read a take that was cut off and put it into the list; its journal stays until it is exported."""
        self.jobs.submit(Slot("recovery", found.path), found.read, lambda clip: self._recovered(found, clip))

    def _recovered(self, found: FoundJournal, clip: Clip) -> None:
        if found in self.state.cut_off:  # not discarded meanwhile
            self.state.cut_off.remove(found)
            self.add(ClipItem(clip, recorded=True, journal=found))
            self.messages.note(f"{clip.name}: {clip.seconds:.1f} s recovered. Export writes it as BVH.")

    def discard(self, found: FoundJournal) -> None:
        """Remove a take that was cut off."""
        self.state.cut_off.remove(found)
        found.delete()
        self.messages.note(f"{found.header.name}: discarded.")

    def close(self, discard: bool = False) -> None:
        """Let go of every journal, so that the next start offers what was not exported; or delete this run's."""
        kept = [item.journal for item in self.state.items if item.journal is not None]
        for journal in [*kept, *filter(None, [self._running])]:
            journal.delete() if discard else journal.release()
        for found in self.state.cut_off:
            found.release()
        self._running = None


def describe(found: FoundJournal) -> str:
    """Length and time of a take that was cut off."""
    try:
        begun = time.strftime("%d %b %H:%M", time.localtime(found.header.begun)) if found.header.begun else ""
    except (OverflowError, ValueError, OSError):  # of a clock that was far off
        begun = ""
    return ", ".join(filter(None, (clock(found.seconds), begun)))
