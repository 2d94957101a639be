"""The takes room's slice of the state: recording, the clip list and what is played back."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from sport.runtime.takes.clip import Clip
    from sport.runtime.takes.journal import FoundJournal, TakeJournal
    from sport.viewer.takes.playback import Playback


@dataclass
class ClipItem:
    """One clip in the list; `saved` is where it was last exported to."""

    clip: Clip
    saved: Path | None = None
    recorded: bool = False  # here, not opened from a file
    journal: TakeJournal | FoundJournal | None = None  # holds it until it is exported

    def drop_journal(self) -> None:
        """The take is exported, or not wanted: nothing is left to recover."""
        journal, self.journal = self.journal, None
        if journal is not None:
            journal.delete()

    @property
    def name(self) -> str:
        """The clip's name."""
        return self.clip.name


@dataclass
class TakesState:
    """What the clips panel and the transport show."""

    items: list[ClipItem] = field(default_factory=list)
    selected: int = -1
    recording: bool = False
    recorded_s: float = 0.0
    memory_s: float = 0.0  # how much the rolling memory holds
    playback: Playback | None = None
    export_path: str = ""
    counter: int = 0  # for clip names
    cut_off: list[FoundJournal] = field(default_factory=list)  # takes of runs that did not end well

    @property
    def current(self) -> ClipItem | None:
        """The selected clip."""
        return self.items[self.selected] if 0 <= self.selected < len(self.items) else None
