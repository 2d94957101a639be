"""Saving and opening projects, autosave, and sessions that other runs left behind."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

from runtime.errors import SportError
from runtime.projects.archive import Packed
from runtime.projects.character_files import Files, read_character_files
from runtime.projects.project import SUFFIX, Project, load_project, save_project
from runtime.takes.clip import Clip
from viewer.gui.dialogs import DialogKind, Dialogs
from viewer.jobs import Jobs, Slot
from viewer.messages import Messages
from viewer.projects import autosave
from viewer.projects.autosave import AutosaveFile, LeftBehind
from viewer.projects.contents import Contents
from viewer.projects.notes import StyleNotes
from viewer.projects.state import ProjectsState
from viewer.settings import Settings
from viewer.takes.recovery_panel import CutOffSession
from viewer.takes.reference import Look
from viewer.takes.state import ClipItem

FILTERS = ("SPORT projects", f"*{SUFFIX}")
MAX_RECENT = 8
LOOKS_S = (
    2.0,
    5.0,
    10.0,
    20.0,
    40.0,
)  # after the start: what was killed right before it may still hold its files
SESSION_S = 0.5  # that the session may take longer at the end than what else is written
SETTLE_FRAMES = 5  # after loading, until what was opened counts as unchanged


@dataclass
class Projects:
    """Actions of the project menu."""

    state: ProjectsState
    settings: Settings
    messages: Messages
    jobs: Jobs
    contents: Contents
    dialogs: Dialogs
    folder: Path  # of autosaved sessions
    autosaving: bool = True
    clock: Callable[[], float] = time.monotonic
    kept: bool = False  # at the end: every take is in the project or in the session of a project
    in_session: bool = False  # at the end: every take is in a session that the next start offers
    _file: AutosaveFile = field(init=False)
    _clean: object = None  # fingerprint of what the project's file holds
    _autosaved: object = None  # fingerprint of what the session's file holds
    _held_clips: list[tuple[ClipItem, Clip]] = field(default_factory=list)  # what it holds of the takes
    _begun_s: float = -1e9
    _settling: int = 0
    _held: set[Path] = field(default_factory=set)  # sessions of processes that lived at the last look
    _looks: list[float] = field(default_factory=list)  # when to look again
    _adopted: Path | None = None  # a session that was reopened, until this one is on disk
    _packed: Packed = field(init=False)
    _files: dict[Path, Files] = field(default_factory=dict)  # of characters

    def __post_init__(self) -> None:
        self._file = AutosaveFile(self.folder)
        self._packed = Packed(self.folder)

    @property
    def files(self) -> dict[str, Callable[[Path], None]]:
        """What opens a file, by its suffix."""
        return {SUFFIX: self.open}

    @property
    def recent(self) -> list[Path]:
        """Projects that were open last, newest first."""
        return [Path(text) for text in self.settings.recent_projects[:MAX_RECENT]]

    # --- actions

    def new(self) -> None:
        """An empty desk; what was not saved can be reopened as the last session."""
        aside = self._put_aside()
        self.contents.clear(kept=aside is not None)
        self.state.path, self._clean = None, None
        self._begin_settling()
        self.messages.note(f"A new project.{aside or ''}")

    def ask_open(self) -> None:
        """Choose a project to open."""
        self.dialogs.ask(DialogKind.OPEN, "Open a project", self._home(), self.open, FILTERS)

    def open(self, path: Path) -> None:
        """Open a project; what is on the desk stays until it is read."""
        self.jobs.submit(
            Slot("open project"),
            partial(self._load, path),
            lambda project: self._opened(path, project),
            reading=path.name,
        )

    def open_last(self) -> None:
        """Open the project that was open last."""
        if self.recent:
            self.open(self.recent[0])
        else:
            self.messages.warn("No project was saved or opened before.")

    def save(self) -> None:
        """Write the project to its file, or ask for one."""
        if self.state.path is None:
            self.ask_save()
        else:
            self.save_as(self.state.path)

    def ask_save(self) -> None:
        """Choose where to save."""
        start = self.state.path or self._home() / f"project{SUFFIX}"
        self.dialogs.ask(DialogKind.SAVE, "Save the project", start, self.save_as, FILTERS)

    def save_as(self, path: Path) -> None:
        """Write the project to a file, which is the project's from now on."""
        path = path.expanduser()
        path = path if path.suffix.lower() == SUFFIX else path.with_name(path.name + SUFFIX)
        project, print_now, items = self.contents.gather(), self.contents.fingerprint(), self._items()
        self.jobs.submit(
            Slot("project"),
            partial(self._write, project, path),
            lambda _: self._saved(path, print_now, items),
            writing=f"the project {path.name}",
        )

    def reopen(self, left: LeftBehind) -> None:
        """Open a session that another run left behind."""
        self.jobs.submit(
            Slot("open project"),
            partial(self._load, left.path),
            lambda project: self._reopened(left, project),
            reading=f"the session of {left.describe()}",
        )

    def discard(self, left: LeftBehind) -> None:
        """Remove a session that another run left behind, with the takes that it had not written yet."""
        autosave.remove(left.path)
        self.state.left.remove(left)
        journals = self.contents.takes.journals
        for found in [] if left.ended else list(journals.state.cut_off):
            journals.discard(found)
        self.messages.note("The autosaved session was discarded.")

    @property
    def offer(self) -> CutOffSession | None:
        """What is offered of a session that was killed: all of it at once."""
        left = self.state.cut_off
        if left is None:
            return None
        takes = left.takes + len(self.contents.takes.state.cut_off)
        return CutOffSession(
            f"Cut off: {replace(left, takes=takes).describe()}",
            self.jobs.busy(Slot("open project")),
            lambda: self.reopen(left),
            lambda: self.discard(left),
        )

    def _load(self, path: Path) -> Project:
        """Read a project, its frames to disk; on any thread."""
        return load_project(path, StyleNotes(), self.contents.takes.storing.keep)

    # --- what comes back

    def _opened(self, path: Path, project: Project) -> None:
        aside = self._put_aside()
        self.contents.restore(project, kept=aside is not None)
        self.state.path = path
        self._remember(path)
        self._begin_settling()
        self.messages.note(f"{path.name}: {_takes(len(project.takes))}.{aside or ''}")

    def _reopened(self, left: LeftBehind, project: Project) -> None:
        aside = self._put_aside()
        self.contents.restore(project, kept=aside is not None)
        origin = Path(left.origin) if left.origin else None
        self.state.path = origin if origin is not None and origin.is_file() else None
        self._clean, self._adopted = None, left.path
        if left in self.state.left:
            self.state.left.remove(left)
        journals = self.contents.takes.journals
        if not left.ended:  # what was recorded when it was cut off belongs to it
            for found in list(journals.state.cut_off):
                journals.recover(found)
        self.messages.note(f"Reopened: {left.describe()}. Save writes it to a file of your own.")

    def _saved(self, path: Path, fingerprint: object, items: list[ClipItem]) -> None:
        self.state.path, self._clean = path, fingerprint
        self._settling = 0
        self._remember(path)
        self._safe(items)
        self.messages.note(f"Saved {path}, {_takes(len(items))}.")

    def _remember(self, path: Path) -> None:
        text = str(path.absolute())
        rest = [known for known in self.settings.recent_projects if known != text]
        self.settings.recent_projects = [text, *rest][:MAX_RECENT]

    def _home(self) -> Path:
        return self.recent[0].parent if self.recent else Path(self.settings.export_folder).expanduser()

    def _items(self) -> list[ClipItem]:
        return list(self.contents.takes.state.items)

    def _safe(self, items: list[ClipItem]) -> None:
        """These takes are in a file: nothing else needs to keep them."""
        for item in items:
            item.drop_journal()
        adopted, self._adopted = self._adopted, None
        if adopted is not None:
            autosave.remove(adopted)

    # --- writing

    def _write(self, project: Project, path: Path) -> None:
        """Write a project with the files of its character; on any thread."""
        contents = self.contents
        reference, stored = contents.takes.reference, project.reference
        project.character = self._character_files(contents.stage.character_path)
        if stored is not None and stored.look == Look.CHARACTER:
            files = self._character_files(reference.character_path)
            project.reference = replace(stored, character=files)
        save_project(project, path, StyleNotes(), self._packed)

    def _character_files(self, path: Path | None) -> Files:
        if path is None:
            return {}
        if path not in self._files:
            self._files = {path: read_character_files(path), **self._files}
            self._files = dict(list(self._files.items())[:2])  # one of the stage, one of a reference
        return self._files[path]

    def _session(self, ended: bool) -> Project:
        project = self.contents.gather()
        marks = {"origin": "" if self.state.path is None else str(self.state.path.absolute()), "ended": ended}
        return replace(project, view={**project.view, **marks})

    # --- autosave

    def poll(self) -> None:
        """Note changes and autosave them; call once a frame."""
        self.dialogs.poll()
        self._look_again()
        self.contents.match_models()
        now = self.contents.fingerprint()
        self._settle(now)
        worth = bool(self.contents.takes.state.items) or self.state.path is not None
        self.state.changed = worth and now != self._clean
        due = self.clock() - self._begun_s >= autosave.INTERVAL_S and not self.jobs.busy(Slot("autosave"))
        if self.autosaving and self.state.changed and due and now != self._autosaved:
            self._begun_s = self.clock()
            self._autosave(now)

    def _autosave(self, fingerprint: object) -> None:
        session, path, items = self._session(ended=False), self._file.path, self._items()
        clips = [(item, item.clip) for item in items]

        def work() -> None:
            self._hold()
            self._write(session, path)

        def done(_: None) -> None:
            self._autosaved = fingerprint
            if self._file.path == path:
                self._file.written, self._held_clips = True, clips
                self._safe(items)

        self.jobs.submit(Slot("autosave"), work, done, writing="the autosave")

    def _hold(self) -> None:
        """Lock the session's file; SportError."""
        try:
            self._file.hold()
        except OSError as error:
            path = self._file.path
            raise SportError(f"{path}: {error.strerror or error}.", "Make the folder writable.") from error

    def _begin_settling(self) -> None:
        self._settling = SETTLE_FRAMES

    def _settle(self, now: object) -> None:
        """What loading changes is no change of the project."""
        if not self._settling:
            return
        self._clean = now if self.state.path is not None else None
        loading = any(self.jobs.busy(Slot(kind)) for kind in ("character", "model", "terrain"))
        if not loading and not self.contents.prompting.state.asked:
            self._settling -= 1

    def _put_aside(self) -> str | None:
        """Keep what is on the desk and not saved as the last session; a sentence about it, None where that failed."""
        if not self.state.changed or not self.autosaving:
            self._file.leave(keep=False)
            return ""
        written = self._keep_session()
        self.look()
        return " What was not saved is under Project: Reopen the last session." if written else None

    def _keep_session(self) -> bool:
        """Write the session as one that ended as planned; whether it is on disk."""
        self.jobs.finish("autosave")
        try:
            self._file.hold()
            self._write(self._session(ended=True), self._file.path)
        except (SportError, OSError) as error:
            self.messages.error(error)
            self._file.leave(keep=self._file.written)
            return False
        self._safe(self._items())
        self._file.leave(keep=True)
        autosave.drop_old_sessions(self.folder)
        return True

    def look(self, tell: bool = False) -> None:
        """Find the sessions of runs that are over; `tell` of one that was cut off, also where it is over a little later."""
        self.state.left = autosave.find_sessions(self.folder)
        if tell:
            self._held = autosave.held_sessions(self.folder)
            self._looks = [self.clock() + after for after in LOOKS_S]
            self._tell()

    def _look_again(self) -> None:
        """Find what held its files at the start."""
        if not self._looks or self.clock() < self._looks[0]:
            return
        del self._looks[0]
        journals = self.contents.takes.journals
        more = [left for left in autosave.find_sessions(self.folder) if left.path in self._held]
        self._held = autosave.held_sessions(self.folder) if self._held else set()
        recordings = journals.look(again=True)
        self.state.left = sorted([*more, *self.state.left], key=lambda left: left.path, reverse=True)
        if more and (recordings or self.state.cut_off in more):
            self._tell()

    def _tell(self) -> None:
        offer = self.offer
        if offer is not None:
            self.messages.warn(f"{offer.text}. Clips: Reopen or Discard.")

    def finish(self, until: float | None = None) -> None:
        """The program ends: keep what is not saved as the last session; `kept` says whether every take is in a file.

        What is not written at the time `until` (of `time.monotonic`) is given up: a project, as the session holds it, and
        the session `SESSION_S` later, as journals hold the takes, or the last autosave.
        """
        self.jobs.finish("project", until if self.autosaving else None)
        if not self.autosaving:
            return
        if self.contents.takes.recorder.recording:
            self.contents.takes.toggle_recording()
        now = self.contents.fingerprint()
        named, any_takes = self.state.path is not None, bool(self._items())
        if now == self._clean or not (named or any_takes):
            self.kept = named
            self._file.leave(keep=False)
            return
        if not self.jobs.finish("autosave", until) or self.jobs.abandoned:
            self._packed = Packed(self.folder)  # the other one is in use
        self.in_session = self._end_session(None if until is None else until + SESSION_S)
        self.kept = self.in_session and named

    def offers(self, item: ClipItem) -> bool:
        """At the end: whether the next start offers the take as it is, in the session or in the last autosave."""
        return self.in_session or any(item is one and item.clip is clip for one, clip in self._held_clips)

    def _end_session(self, until: float | None) -> bool:
        """Write the session as one that ended as planned, by the time `until`; whether it is on disk."""
        session, items, path = self._session(ended=True), self._items(), self._file.path
        written = threading.Event()

        def work() -> None:
            self._hold()
            self._write(session, path)
            written.set()

        self.jobs.submit(Slot("session"), work, lambda _: self._safe(items), writing="the session")
        self.jobs.finish("session", until)
        on_disk = written.is_set()
        if not self._file.written:
            self._held_clips.clear()
        self._file.leave(keep=on_disk or self._file.written)
        if on_disk:
            autosave.drop_old_sessions(self.folder)
        return on_disk


def _takes(count: int) -> str:
    return f"{count} take{'s' * (count != 1)}"
