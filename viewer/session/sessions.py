"""The session's file: new, open, save as, copy, revert; and the sessions of earlier runs."""

import os
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial, reduce
from pathlib import Path
from typing import Any

from runtime.assets import model_folder, model_hashes, shipped_models
from runtime.errors import SportError
from runtime.safe_read import expanded
from runtime.session import edits, library
from runtime.session.document_reader import MAX_TAKES
from runtime.session.history import History
from runtime.session.library import SessionSummary
from runtime.session.lost import LostTake
from runtime.session.session import ModelName, Take
from runtime.session.session_file import SessionFile
from runtime.session.sqlite_file import SUFFIX, FileInUse
from runtime.takes.metadata import origin_of
from runtime.takes.pose_edits import NO_EDITS
from viewer.editor import Editor
from viewer.gui.dialogs import DialogKind, Dialogs
from viewer.jobs import Jobs, Slot
from viewer.messages import Messages
from viewer.prompt.prompt_controller import PromptController
from viewer.scene.scene import Scene
from viewer.session.summaries import count_takes, describe
from viewer.session.takes import Takes
from viewer.settings import CAMERAS, Settings, checked, remembered

FILTERS = ("SPORT sessions", f"*{SUFFIX}")
MAX_RECENT_SESSIONS = 8
KEPT_SESSIONS = 10  # untitled ones kept for reopening
VIEW_INTERVAL_S = 10.0  # between two times at which the view is stored
OPENING, CLOSING, COPYING = Slot("session"), Slot("closing of a session"), Slot("copy of the session")
LOST, RECOVERY = Slot("lost takes"), Slot("recovery of takes")
PROBLEM = Slot("file of the session")  # a topic of messages
UNFINISHED = "unfinished"  # key in the file for work that the program's end interrupted
CLOSE_LIMIT_S = 1.0  # limit when the program ends
MENTION_AFTER_S = 0.2  # closing takes longer than this only with a message
KEPT_SETTINGS = (
    "temperature", "response", "strength", "blend_seconds", "show_grid", "show_trajectory", "show_skeleton",
    "show_contacts",
)  # fmt: skip
# ranges of the stored view: metres and radians, of the character and of the camera
PLACES = {
    "x": (-1e5, 1e5), "z": (-1e5, 1e5), "facing": (-1e5, 1e5),
    "yaw": (-1e3, 1e3), "pitch": (-1.5, 1.5), "distance": (0.5, 60.0),
}  # fmt: skip


@dataclass
class Sessions:
    editor: Editor
    settings: Settings
    messages: Messages
    jobs: Jobs
    dialogs: Dialogs
    scene: Scene
    prompting: PromptController
    takes: Takes
    load_model: Callable[[Path | None, int], None]
    picture: Callable[[], bytes]  # a small PNG of the view
    folder: Path  # the state folder
    earlier: list[SessionSummary] = field(default_factory=list)  # of other runs, newest first
    lost: list[LostTake] = field(default_factory=list)  # lost takes, newest first, see `find_lost`
    incomplete: bool = False  # something could not be written to its place
    _viewed: dict[str, Any] = field(default_factory=dict)
    _viewed_s: float = -1e9
    _said: str = ""

    @property
    def untitled_folder(self) -> Path:
        return self.folder / "sessions"

    @property
    def path(self) -> Path | None:
        """The file named by the user, or None for an untitled session."""
        path = self.editor.file.path
        return None if self._is_untitled(path) else path

    def _is_untitled(self, path: Path) -> bool:
        home = path.parent
        return home == self.untitled_folder or (
            home.name.startswith("sport-") and home.parent == Path(tempfile.gettempdir())
        )

    @property
    def name(self) -> str:
        return "Untitled" if self.path is None else self.path.stem

    @property
    def recent(self) -> list[Path]:
        """Recently opened named sessions, newest first."""
        return [Path(text) for text in self.settings.recent_sessions[:MAX_RECENT_SESSIONS]]

    @property
    def cut_off(self) -> SessionSummary | None:
        """The newest untitled session with takes or recordings if it was cut off, else None."""
        newest = next((summary for summary in self.earlier if summary.has_motions), None)
        return None if newest is None or newest.ended else newest

    def find_cut_off(self) -> SessionSummary | None:
        """Return the last open session, untitled or named, if it was cut off."""
        named = library.look_at(self.recent[0]) if self.recent else None
        # the state in the file is stored with the view, and may be older
        named = named and replace(named, name=named.path.stem)
        found = [left for left in (self.cut_off, named) if left is not None and not left.ended]
        return max(found, key=lambda left: left.saved_s, default=None)

    # --- actions

    def new(self) -> None:
        """Start an empty session with the same ground and character; the old one stays in its file."""
        before = self.editor.session
        try:
            file, problem = library.first_file(self.untitled_folder, self.folder / "characters")
        except SportError as error:
            self.messages.error(error)
            return
        history = History()
        live = replace(before.live, path=(), cameras=(), poses=NO_EDITS)
        history.replace(
            replace(before, takes=(), live=live, counter=0, selected=0, reference=None, variants=())
        )
        self._use(file, history)
        file.write(history)
        self.messages.note(f"A new session. {problem}".strip())

    def ask_open(self) -> None:
        self.dialogs.ask(DialogKind.OPEN, "Open a session", self._home(), self.open, FILTERS)

    def open(self, path: Path) -> None:
        """Open a session; the current one stays until it is loaded."""
        path = expanded(path)
        if os.path.realpath(path) == str(self.editor.file.path):
            self.messages.note(f"{path.name} is open already.")
            return
        self.jobs.submit(
            OPENING, partial(self._read, path), lambda found: self._opened(path, *found), reading=path.name,
            unwanted=lambda found: found[0].close(CLOSE_LIMIT_S),  # else it stays locked, and opens as a copy
        )  # fmt: skip

    def _read(self, path: Path) -> tuple[SessionFile, History, str]:
        try:
            return *SessionFile.open(path, self.folder / "characters"), ""
        except FileInUse:
            copy = library.new_path(self.untitled_folder)
            SessionFile.copy(path, copy)
            said = f"{path.name} is open in another window: this is an untitled copy of it."
            return *SessionFile.open(copy, self.folder / "characters"), said

    def _opened(self, path: Path, file: SessionFile, history: History, said: str) -> None:
        self.jobs.cancel_reading()  # what the session before was to have
        self._use(file, history)
        self._restore(file.view)
        if not said and not self._is_untitled(path):
            self._remember(path)
        self.earlier = [summary for summary in self.earlier if summary.path != path]
        more = f", and {file.unrecovered} under Lost takes" if file.unrecovered else ""
        recovered = f"Recovered: {count_takes(file.recovered)}{more}." if file.recovered else ""
        wrong = list(filter(None, (said, recovered, file.repaired, self._unfinished(file))))
        text = said or f"{self.name}: {count_takes(len(history.present.session.takes))}."
        (self.messages.warn if wrong else self.messages.note)(" ".join(dict.fromkeys([text, *wrong])))

    def open_last(self) -> None:
        """Open the most recent session, named or not."""
        times = {path: path.stat().st_mtime if os.path.exists(path) else 0.0 for path in self.recent[:1]}
        times |= {summary.path: summary.saved_s for summary in self.earlier[:1]}
        if times:
            self.open(max(times, key=times.__getitem__))
        else:
            self.messages.warn("No session was saved or opened before.")

    def save(self) -> None:
        """Save the session: ask for a name if it is untitled; a named one is saved continuously."""
        if self.path is None:
            self.ask_save()
        elif self.editor.file.flush(1.0):
            self.messages.note(f"{self.path.name} is saved, as is every edit.")
        else:
            text = self.editor.file.problem or f"{self.path.name} is still being written."
            self.messages.error(text, PROBLEM)

    def ask_save(self) -> None:
        start = self.path or self._home() / f"session{SUFFIX}"
        self.dialogs.ask(DialogKind.SAVE, "Save the session as", start, self.save_as, FILTERS)

    def ask_copy(self) -> None:
        start = self._home() / f"{self.name} copy{SUFFIX}"
        self.dialogs.ask(DialogKind.SAVE, "Save a copy", start, self.save_copy, FILTERS)

    def save_as(self, path: Path) -> None:
        """Continue in a file of this name."""
        path, untitled = _with_suffix(path), self.path is None
        file, before = self.editor.file, self.editor.file.path
        self._write_view()

        def done(_: None) -> None:
            if untitled:
                library.remove(before)
            self._remember(path)
            self.messages.note(f"Saved {path}.", path)

        self.jobs.submit(OPENING, lambda: file.save_as(path), done, writing=f"the session {path.name}")

    def save_copy(self, path: Path) -> None:
        """Write a copy, and continue in the current file."""
        path, file = _with_suffix(path), self.editor.file
        self._write_view()
        self.jobs.submit(
            COPYING, lambda: file.save_copy(path), writing=f"the copy {path.name}",
            done=lambda _: self.messages.note(f"Saved a copy as {path}.", path),
        )  # fmt: skip

    def revert(self) -> None:
        """Restore the session as it was when opened, as a step of undo."""
        self.editor.end_running()
        opened = self.editor.opened
        if not self.editor.do("revert to when it was opened", lambda _: opened):
            self.messages.note("Nothing was changed since it was opened.")

    def find_lost(self) -> None:
        """Search the file for motions that no step of the history uses."""
        file = self.editor.file
        self.jobs.submit(LOST, lambda: file.lost_takes, lambda found: setattr(self, "lost", found))

    def recover(self, *lost: LostTake) -> None:
        """Put lost takes with their edits into the list again, as many as it has room for."""
        file, room = self.editor.file, MAX_TAKES - len(self.editor.session.takes)
        if room < 1 or self.jobs.busy(RECOVERY):
            full = "The list of takes is full. Remove some first."
            self.messages.warn(full if room < 1 else "Other takes are being recovered: wait for them.")
            return
        lost = lost[-room:]
        what = lost[0].name if len(lost) == 1 else count_takes(len(lost))

        def found(takes: list[Take]) -> None:
            self.editor.do(f"recovery of {what}", lambda session: reduce(edits.with_new_take, takes, session))
            keys = {take.key for take in lost}
            self.lost = [take for take in self.lost if take.key not in keys]
            self.messages.note(f"Recovered: {what}.")

        self.jobs.submit(RECOVERY, lambda: file.found_takes(lost), found, reading=what)

    def discard(self, summary: SessionSummary) -> None:
        """Delete an untitled session of another run for good."""
        library.remove(summary.path)
        self.earlier = [one for one in self.earlier if one is not summary]
        self.messages.note(f"Discarded: {describe(summary)}.")

    # --- switching sessions

    def _use(self, file: SessionFile, history: History) -> None:
        self.note_unfinished()
        self.editor.end_running()
        self.editor.finish_drag()
        self.takes.end_recording()
        self.takes.close_playback()
        self.takes.animations.clear()
        for slot in (LOST, RECOVERY):
            self.jobs.end_slot(slot)
        self.lost = []
        self._leave()
        self.editor.use(file, history)
        self._viewed_s = time.monotonic()

    def _leave(self) -> None:
        """Close the open file; an empty untitled one is removed."""
        file, empty = self.editor.file, self._is_empty
        if not empty:
            self._write_view(ended=True)

        def close() -> bool:
            whole = file.close(CLOSE_LIMIT_S)
            if empty:
                library.remove(file.path)
            return whole

        slot = Slot(CLOSING.what, file.path)
        self.jobs.submit(slot, close, lambda _: self.look(), writing=f"the session {file.path.stem}")

    @property
    def _is_empty(self) -> bool:
        """Whether the session is untitled and never contained work; prompts have their own history."""
        return self.path is None and not self.editor.file.has_work

    def _remember(self, path: Path) -> None:
        known, text = self.settings.recent_sessions, str(path.absolute())
        self.settings.recent_sessions = remembered(text, known, MAX_RECENT_SESSIONS)

    def _home(self) -> Path:
        return self.recent[0].parent if self.recent else expanded(self.settings.export_folder)

    # --- the view

    def _view(self) -> dict[str, Any]:
        """Return how the session is viewed: stored, but not undoable."""
        camera, pose = self.scene.camera, self.scene.simulation.current
        now, (x, _, z) = camera.current, pose.root_position
        numbers = (x, z, pose.root_yaw, now.yaw, now.pitch, now.distance)  # in the order of `PLACES`
        view = {name: getattr(self.settings, name) for name in KEPT_SETTINGS}
        view |= {name: round(float(value), 3) for name, value in zip(PLACES, numbers, strict=True)}
        return view | {"camera": camera.mode, "name": self.name}

    def _write_view(self, ended: bool = False) -> None:
        self._viewed, self._viewed_s = self._view(), time.monotonic()
        self.editor.file.write_view(self._viewed, ended, self.picture() if ended else b"")

    def _restore(self, view: dict[str, Any]) -> None:
        """Restore the stored view and the character's place."""
        camera = self.scene.camera
        for name in KEPT_SETTINGS:
            value = checked(name, view.get(name), getattr(Settings(), name))
            if value is not None:
                setattr(self.settings, name, value)
        if view.get("camera") in CAMERAS:
            camera.use(str(view["camera"]))
        known = {
            name: min(max(float(view[name]), low), high)
            for name, (low, high) in PLACES.items()
            if isinstance(view.get(name), int | float)
        }
        if "x" in known and "z" in known:
            self.scene.put_character(known.pop("x"), known.pop("z"), known.pop("facing", 0.0))
        for name in known.keys() & {"yaw", "pitch", "distance"}:
            setattr(camera.current, name, known[name])
        if not self._has_model(self.editor.session.model):
            self.prompting.ask_again()

    def _has_model(self, wanted: ModelName) -> bool:
        """Load the session's model if another one is loaded; return whether none is needed."""
        if not wanted.sha256 or self.scene.controller is None:
            return True
        if origin_of(self.scene.controller, "").model_sha256 == wanted.sha256:
            return True
        folder = self._known_model(wanted)
        if folder is None:
            self.messages.warn(
                f"The session's model {wanted.name or wanted.folder!r} is not known here: takes play and"
                " export, but cannot be resimulated until you choose it in the settings."
            )
        elif folder != model_folder(self.scene.model_folder):
            self.load_model(folder, wanted.seed)
        return False

    def _known_model(self, wanted: ModelName) -> Path | None:
        """Return the folder of a shipped or previously chosen model with the wanted network."""
        chosen = str(self.scene.model_folder or ""), self.settings.model_folder, *self.settings.known_models
        folders = [*shipped_models().values(), *(Path(text) for text in chosen if os.path.isabs(text))]
        return next((folder for folder in folders if wanted.sha256 in model_hashes(folder)), None)

    # --- while it is open

    def begin(self, session: str | None, looking: bool) -> None:
        """List the sessions of other runs and open the one of the command line; "last" is the most recent."""
        if looking:
            self.look()
            if self.cut_off is not None:
                self.messages.warn(f"Cut off: {describe(self.cut_off)}. Takes: Reopen or Discard.")
        if session == "last":
            self.open_last()
        elif session is not None:
            self.open(Path(session))

    def look(self) -> None:
        """List the untitled sessions of other runs that contain work; beyond a limit, the least valuable are deleted."""
        self.earlier = library.keep_newest(self.untitled_folder, KEPT_SESSIONS)

    def poll(self) -> None:
        """Store the view from time to time, and report write problems; call once per frame."""
        self.dialogs.poll()
        problem = self.editor.file.problem
        if problem and (problem != self._said or self.messages.current is None):
            self.messages.error(f"{problem} Until then it is in memory only.", PROBLEM)
        elif self._said and not problem:
            self.messages.settle(PROBLEM)
        self._said = problem
        if time.monotonic() - self._viewed_s > VIEW_INTERVAL_S and not self._is_empty:
            if self._view() != self._viewed:
                self._write_view()
            self._viewed_s = time.monotonic()

    def keep(self) -> None:
        """Write all changes now."""
        self.editor.finish_drag()
        self.editor.file.flush(MENTION_AFTER_S)

    def finish(self, keep: bool, until: float, ended: bool = True) -> None:
        """Write what is left, until a time of `time.monotonic`; the rest is kept for the next start.

        If not `ended` normally, the next start offers the session.
        """
        self.editor.end_running()
        self.editor.finish_drag()
        self.takes.end_recording()
        file, empty = self.editor.file, self._is_empty or (not keep and self.path is None)
        if not empty:
            self._write_view(ended)
            if not file.flush(MENTION_AFTER_S):
                self.messages.note(f"Waiting for the session {self.name} to be written.")
        whole = file.close(max(until - time.monotonic(), 0.0))
        if empty:
            library.remove(file.path)
        elif not whole:
            self._not_whole(file)
        elif self.path is None and file.path.parent != self.untitled_folder:
            self.incomplete = True
            self.messages.error(f"The session is in {file.path}.")

    def note_unfinished(self) -> None:
        """Report steps whose jobs are ended with the session, now and when it is opened again."""
        labels = ", ".join(step.label for step in self.editor.history.steps if step.awaited)
        if labels:
            text = f"{labels[:1].upper()}{labels[1:]} was not finished: do that again."
            self.editor.file.set_meta(UNFINISHED, text)
            self.messages.warn(text)

    def _unfinished(self, file: SessionFile) -> str:
        """Return the work that the last end of the program interrupted; reported once."""
        text = file.database.meta(UNFINISHED)
        if text:
            file.set_meta(UNFINISHED, "")
        return text

    def _not_whole(self, file: SessionFile) -> None:
        self.incomplete = True
        problem, kept = file.problem or f"{file.path}: its disk is too slow.", file.database.handed_over
        left = "Its last changes are lost." if kept is None else f"The next start adds what is in {kept}."
        self.messages.error(f"{problem} {left}")


def _with_suffix(path: Path) -> Path:
    path = expanded(path)
    return path if path.suffix.lower() == SUFFIX else path.with_name(path.name + SUFFIX)
