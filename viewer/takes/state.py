"""The takes room's slice of the state: recording, the clip list, what is played back, and how its timeline looks."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

from runtime.takes.pose_edits import NO_EDITS, PoseEdits

if TYPE_CHECKING:
    from runtime.takes.camera_keys import CameraKey
    from runtime.takes.clip import Clip
    from runtime.takes.drive import Drive
    from runtime.takes.journal import FoundJournal, TakeJournal
    from runtime.takes.own_skeleton import OwnSkeleton
    from runtime.terrain.height_map import Terrain
    from viewer.services import ControllerLike
    from viewer.takes.playback import Playback
    from viewer.takes.tracks import Tracks


MAX_OLDER_BYTES = (
    128 << 20
)  # of rotations in the versions of a take that undo goes back to: ten of two minutes are 36 MB


@dataclass(frozen=True)
class TakeVersion:
    """A take as it was before an edit or after it; `label` says which edit made it."""

    clip: Clip
    drive: Drive | None
    saved: Path | None
    label: str
    base: Clip | None = None
    edits: PoseEdits = NO_EDITS


@dataclass(eq=False)  # an item is itself: its arrays cannot be compared as a whole
class ClipItem:
    """One clip in the list; `saved` is the BVH that holds every frame of the version that is shown."""

    clip: Clip
    saved: Path | None = None
    recorded: bool = False  # here, not opened from a file
    journal: TakeJournal | FoundJournal | None = None  # holds it until it is exported
    drive: Drive | None = None  # None: it cannot be driven again
    maker: ControllerLike | None = None  # what moved it
    label: str = ""  # the edit that made this version
    older: list[TakeVersion] = field(default_factory=list)
    newer: list[TakeVersion] = field(default_factory=list)
    given: str = ""  # the name that the user gave it
    ground: Terrain | None = None  # that it was made on, where that is known
    exported: Path | None = None  # the last file that was made of it, whole or not
    base: Clip | None = None  # as it was driven, where `edits` bend the poses of `clip`
    edits: PoseEdits = NO_EDITS
    camera: tuple[CameraKey, ...] = ()
    own: OwnSkeleton | None = None  # of the file, where another skeleton moved in it

    def drop_journal(self) -> None:
        """The take is exported, or not wanted: nothing is left to recover."""
        journal, self.journal = self.journal, None
        if journal is not None:
            journal.delete()

    def written(self, clip: Clip, path: Path) -> None:
        """A file holds every frame of the version `clip`; when that is the one shown, its journal is not needed."""
        self.older = [replace(v, saved=path) if v.clip is clip else v for v in self.older]
        self.newer = [replace(v, saved=path) if v.clip is clip else v for v in self.newer]
        if self.clip is clip:
            self.saved = path
            self.drop_journal()

    def overwritten(self, path: Path) -> bool:
        """A file holds something else from now on; whether it was the one of the version that is shown."""
        self.older = [replace(v, saved=None) if v.saved == path else v for v in self.older]
        self.newer = [replace(v, saved=None) if v.saved == path else v for v in self.newer]
        shown = self.saved == path
        self.saved = None if shown else self.saved
        return shown

    @property
    def safe(self) -> bool:
        """Whether the file that holds the shown version is still there."""
        try:
            return self.saved is not None and self.saved.is_file()
        except OSError:
            return False

    @property
    def name(self) -> str:
        """The name it was given, or the clip's."""
        return self.given or self.clip.name

    @property
    def named_clip(self) -> Clip:
        """The clip under this name, for a file."""
        return self.clip if not self.given else replace(self.clip, name=self.given)

    @property
    def undo_label(self) -> str:
        """The edit that undo would take back; "" when there is none."""
        return self.label if self.older else ""

    @property
    def redo_label(self) -> str:
        """The edit that redo would do again; "" when there is none."""
        return self.newer[-1].label if self.newer else ""

    @property
    def driven(self) -> Clip:
        """The clip without the edits of its poses."""
        return self.clip if self.base is None else self.base

    def edit(
        self,
        clip: Clip,
        drive: Drive | None,
        label: str,
        base: Clip | None = None,
        edits: PoseEdits = NO_EDITS,
    ) -> None:
        """Show a new version, whose poses `edits` bend from those of `base`; the one before is kept."""
        self.older.append(self._version())
        self.newer.clear()
        while (
            len(self.older) > 1 and sum(v.clip.local_rotations.nbytes for v in self.older) > MAX_OLDER_BYTES
        ):
            del self.older[0]
        self._show(TakeVersion(clip, drive, None, label, base, edits))

    def undo(self) -> None:
        """Show the version before the last edit."""
        if self.older:
            self.newer.append(self._version())
            self._show(self.older.pop())

    def redo(self) -> None:
        """Show the version that was undone last."""
        if self.newer:
            self.older.append(self._version())
            self._show(self.newer.pop())

    def _version(self) -> TakeVersion:
        return TakeVersion(self.clip, self.drive, self.saved, self.label, self.base, self.edits)

    def _show(self, version: TakeVersion) -> None:
        self.clip, self.drive, self.saved = version.clip, version.drive, version.saved
        self.label, self.base, self.edits = version.label, version.base, version.edits


@dataclass(frozen=True)
class Drag:
    """What the mouse holds on a track: a span's `part` ("body", "start" or "end") since the frame `grabbed`."""

    track: str
    index: int
    part: str
    grabbed: int
    start: int  # where the span would go
    end: int
    moved: bool = False
    dropped: bool = False  # let go of: it stays there until the take was driven again


@dataclass
class TimelineState:
    """How the timeline of the take that plays is shown, and what is typed into it."""

    part_tracks: bool = False
    drag: Drag | None = None
    new_prompt: str = ""
    focus_requested: bool = False  # of the take's prompt
    shown: object = None  # the prompt's span in the fields
    prompt: str = ""
    parts: dict[str, str] = field(default_factory=dict)
    tracks: Tracks | None = None  # of the clip that plays


@dataclass(frozen=True)
class Removed:
    """A clip that was taken out of the list, and its place there."""

    item: ClipItem
    index: int


@dataclass
class TakesState:
    """What the clips panel and the timeline show."""

    items: list[ClipItem] = field(default_factory=list)
    selected: int = -1
    recording: bool = False
    recorded_s: float = 0.0
    memory_s: float = 0.0  # how much the rolling memory holds
    playback: Playback | None = None
    export_path: str = ""
    counter: int = 0  # for clip names
    cut_off: list[FoundJournal] = field(default_factory=list)  # takes of runs that did not end well
    timeline: TimelineState = field(default_factory=TimelineState)
    removed: list[Removed] = field(default_factory=list)  # the last ones, newest last
    renaming: int = -1  # row whose name is being typed
    new_name: str = ""
    naming_begins: bool = False

    @property
    def current(self) -> ClipItem | None:
        """The selected clip."""
        return self.items[self.selected] if 0 <= self.selected < len(self.items) else None

    @property
    def played(self) -> ClipItem | None:
        """The clip that plays."""
        playback = self.playback
        known = playback is not None and 0 <= playback.index < len(self.items)
        return self.items[playback.index] if playback is not None and known else None
