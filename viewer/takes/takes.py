"""Recording, the clip list, playback and export. A clip leaves the list only when the user removes it."""

from __future__ import annotations

import os
import re
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from runtime.controls import Controls
from runtime.errors import SportError, UsageError
from runtime.pose import Pose
from runtime.safe_read import printable
from runtime.takes.frame_store import FrameStore
from runtime.takes.metadata import Origin, gait_of, origin_of
from runtime.takes.pins import Pin
from runtime.takes.pose_edits import PoseEdits
from viewer.input.bindings import Action
from viewer.jobs import Jobs, Slot
from viewer.messages import Messages
from viewer.prompt.style_edit import StyleEdit
from viewer.settings import Settings
from viewer.stage.state import StageState
from viewer.takes.journals import Journals
from viewer.takes.opening import Opening
from viewer.takes.playback import Playback
from viewer.takes.reference import Reference
from viewer.takes.rescue import Rescue
from viewer.takes.state import ClipItem, Removed, TakesState
from viewer.takes.storing import Storing
from viewer.takes.video import SUFFIXES as VIDEOS

if TYPE_CHECKING:
    from runtime.takes.clip import Clip
    from runtime.takes.drive import DriveRecorder, StyleChange
    from runtime.takes.recorder import ClipRecorder
    from runtime.terrain.height_map import Terrain

MAX_NAME = 60
EXPORT_ALL = Slot("export", "all takes")
MAX_REMOVED = 20  # clips that can be brought back


@dataclass
class Takes:
    """Actions of the clips panel."""

    state: TakesState
    settings: Settings
    messages: Messages
    stage: StageState  # what is recorded, and where it is shown again
    jobs: Jobs
    recorder: ClipRecorder
    drives: DriveRecorder
    folder: Path  # the state folder: journals, and takes that cannot be written elsewhere
    load_ground: Callable[[str], Terrain]  # by name or file
    load_character: Callable[[Path], Any]
    is_safe: Callable[[ClipItem], bool]  # it is in a project's file
    is_offered: Callable[[ClipItem], bool]  # it is in a session that the next start offers
    live_pins: Callable[[int, int], tuple[Pin, ...]] = (
        lambda _first, _frames: ()
    )  # that the character held from a frame on
    incomplete: bool = False  # a take was lost, or is elsewhere than asked
    _writers: dict[Path, ClipItem] = field(default_factory=dict)  # whose clip a file of this session holds
    _proposed: str | None = None  # what was put into the export field, until something else is typed
    _target: Path | None = None  # the file that it means: a name may hold what no field can show

    _seen: tuple[Terrain, Terrain] | None = field(
        default=None, init=False
    )  # a ground, as a take of another size sees it

    def __post_init__(self) -> None:
        self.reference = Reference(self.state, self.messages, self.jobs, self.load_character)
        self.journals = Journals(self.state, self.messages, self.jobs, self.folder / "journals", self._add)
        self.storing = Storing(self.state, self.jobs, FrameStore(self.folder / "frames"))
        self.opening = Opening(
            self.messages, self.jobs, self.stage, self._take_opened, self.lay, self._show_opened
        )

    @property
    def actions(self) -> dict[Action, Callable[[], None]]:
        """What keys and buttons do here."""
        return {
            Action.RECORD: self.toggle_recording,
            Action.SAVE_LAST: self.save_last,
            Action.PLAY: self.play_or_pause,
            Action.FRAME_BACK: lambda: self.step(-1),
            Action.FRAME_ON: lambda: self.step(1),
            Action.FIRST_FRAME: lambda: self.seek_end(first=True),
            Action.LAST_FRAME: lambda: self.seek_end(first=False),
        }

    @property
    def files(self) -> dict[str, Callable[[Path], None]]:
        """What opens a file, by its suffix."""
        return {".bvh": self.opening.open, **dict.fromkeys(VIDEOS, self.reference.open_video)}

    def watch(self) -> None:
        """Look after what is on disk of the takes; call once a frame."""
        self.journals.watch()
        self.storing.watch()

    def before_steps(self) -> None:
        """Keep the controller's state when it is time; call once a frame before it is simulated."""
        if self.stage.controller is not None:
            self.drives.before_steps(self.stage.controller)

    def mark_style(self, edit: StyleEdit, seconds: float) -> None:
        """A style came into force for the next frame."""
        z, prompt, words, typed = edit.style(), edit.prompt_text, edit.spelled_out(), edit.typed()
        self.recorder.mark_prompt(prompt, seconds, words, typed)
        if z is not None:
            self.drives.mark_style(z, seconds, prompt, words, edit, typed=typed)

    def mark_style_in_force(self, style: StyleChange) -> None:
        """A style of a take holds in the live controller already."""
        event = style.event
        self.recorder.mark_prompt(event.prompt, 0.0, event.words, event.typed)
        self.drives.mark_style(
            style.z, style.seconds, event.prompt, event.words, style.note, holds=True, typed=event.typed
        )

    def add_poses(self, poses: list[Pose], controls: Controls) -> None:
        """Remember simulated poses, as they are shown, and what was asked for; call once a frame."""
        for pose in poses:
            self.recorder.add(pose, gait_of(controls))
            if self.stage.controller is not None:
                self.drives.add(controls, self.stage.controller)
        self.drives.drop_before(self.recorder.first_frame)
        clips = self.state
        clips.memory_s = self.recorder.seconds
        clips.recorded_s = self.recorder.take_seconds

    def toggle_recording(self) -> None:
        """Start a take, or stop it and put it into the list."""
        if not self.recorder.recording:
            self.close_playback()
            self.recorder.start()
            ground = self.stage.terrain_spec
            origin = origin_of(self.stage.controller, ground)
            name, size = f"Take {self.state.counter + 1}", self.stage.terrain.unit_m
            self.journals.begin(self.recorder, name, ground, origin, size)
            self.messages.note(f"Take {self.state.counter + 1} is being recorded. R ends it.")
        else:
            journal = self.journals.end(self.recorder)
            item = self._keep("Take", self.recorder.stop)
            if item is not None:
                item.journal = journal
            elif journal is not None:
                journal.delete()
        self.state.recording = self.recorder.recording

    def save_last(self) -> None:
        """Put the last seconds into the list, recording or not."""
        seconds = self.settings.keep_seconds
        item = self._keep("Last seconds", lambda *about: self.recorder.last(seconds, *about))
        if item is not None:
            item.journal = self.journals.keep(item.clip)

    def _keep(self, kind: str, cut: Callable[[str, str, Origin], Clip]) -> ClipItem | None:
        """Add what `cut(name, terrain, origin)` makes of the memory to the list; None without any frame."""
        clips, ground = self.state, self.stage.terrain_spec
        origin = origin_of(self.stage.controller, ground)
        try:
            clip = replace(cut(f"{kind} {clips.counter + 1}", ground, origin), size=self.stage.terrain.unit_m)
        except SportError as error:
            self.messages.warn(str(error))
            return None
        clips.counter += 1
        first = self.recorder.next_frame - len(clip)
        drive, edits = self.drives.cut(first), PoseEdits(self.live_pins(first, len(clip)))
        item = ClipItem(
            edits.apply(clip), None, True, drive=drive, maker=self.stage.controller, ground=self.stage.terrain,
            base=clip if edits else None, edits=edits,
        )  # fmt: skip
        self._add(item)
        self.messages.note(f"{clip.name}: {clip.seconds:.1f} s in the clip list. Export writes it as BVH.")
        return item

    def _add(self, item: ClipItem) -> None:
        self.state.items.append(item)
        self.select(len(self.state.items) - 1)

    def _take_opened(self, item: ClipItem) -> ClipItem:
        self.state.items.append(item)
        self.play(len(self.state.items) - 1)
        return item

    def _show_opened(self, item: ClipItem) -> None:
        if self.state.playback is None:
            self._take_opened(item)
        else:
            self.state.items.append(item)
            self.reference.show(item)

    def select(self, index: int) -> None:
        """Make a clip the current one and propose where to export it."""
        clips = self.state
        if not 0 <= index < len(clips.items):
            return
        clips.selected = index
        if clips.playback is not None and clips.playback.index != index:
            self.play(index)
        self._propose(clips.items[index])

    def _propose(self, item: ClipItem) -> None:
        """Fill the export field with the file that holds the clip since this session, or with a name that is free."""
        if item.saved is not None and self._writers.get(item.saved) is item:
            proposal = item.saved
        else:
            folder = Path(self.settings.export_folder)
            proposal = folder / free_path(folder.expanduser() / f"{file_stem(item.name)}.bvh").name
        self._target = proposal.expanduser()
        self.state.export_path = self._proposed = printable(proposal)

    def remove(self, index: int) -> None:
        """Take a clip out of the list; files stay."""
        clips = self.state
        if not 0 <= index < len(clips.items):
            return
        self.close_playback()
        item = clips.items.pop(index)
        self.reference.forget(item)
        item.drop_journal()
        self._writers = {path: writer for path, writer in self._writers.items() if writer is not item}
        clips.removed = [*clips.removed, Removed(item, index)][-MAX_REMOVED:]
        clips.renaming = -1
        clips.selected = min(index, len(clips.items) - 1)
        self.select(clips.selected)
        self.messages.note(f"{item.name} removed from the list. Ctrl+Z brings it back.")

    def restore(self) -> None:
        """Bring the clip back that was removed last."""
        clips = self.state
        if not clips.removed:
            return
        gone = clips.removed.pop()
        index = min(gone.index, len(clips.items))
        clips.items.insert(index, gone.item)
        if not gone.item.safe:
            gone.item.journal = self.journals.keep(gone.item.clip)
        if clips.playback is not None and clips.playback.index >= index:
            clips.playback.index += 1
        self.select(index)
        self.messages.note(f"{gone.item.name} is back.")

    def rename(self, index: int, name: str) -> None:
        """Give a clip another name; files that hold it keep theirs. An empty name brings the first one back."""
        name = printable(" ".join(name.split()))[:MAX_NAME]
        item = self.state.items[index]
        if name != item.name:
            item.given = "" if name == item.clip.name else name
            self.messages.note(f"Renamed: {item.name}.")
            if index == self.state.selected:
                self._propose(item)

    def mirror(self, index: int) -> None:
        """Put the mirror image of a clip into the list, and play it."""
        from runtime.takes.mirror import mirrored

        item = self.state.items[index]
        made = ClipItem(mirrored(item.named_clip), recorded=True)
        made.journal = self.journals.keep(made.clip)
        self._add(made)
        self.play(len(self.state.items) - 1)
        over = (
            "" if np.ptp(self.stage.terrain.heights) < 0.01 else " Its feet fit level ground, not this one."
        )
        self.messages.note(f"{made.name} is in the list.{over}")

    def begin_rename(self, index: int) -> None:
        """Let the name of a clip be typed in its row."""
        clips = self.state
        clips.renaming, clips.new_name, clips.naming_begins = index, clips.items[index].name, True

    def clear(self, kept: bool = True) -> None:
        """Take every clip out of the list, for another project; journals stay where nothing else has `kept` the clips."""
        self.close_playback()
        for item in self.state.items:
            if kept or item.safe or item.journal is None:
                item.drop_journal()
            else:
                item.journal.release()
        self._writers.clear()
        clips = self.state
        clips.items.clear()
        clips.removed.clear()
        self.reference.close()
        clips.selected = clips.renaming = -1
        clips.export_path = ""

    # --- playback

    def play(self, index: int) -> None:
        """Show a clip instead of the live character."""
        clips = self.state
        if 0 <= index < len(clips.items):
            item, live = clips.items[index], self.stage.terrain
            clips.playback = Playback(item.clip, item.ground or live, live, index)
            driven = item.drive is not None and item.drive.ground(0) is not None
            if item.recorded and item.ground is None and not driven:
                self.lay(item, item.clip.terrain)
            clips.timeline.shown = clips.timeline.drag = None
            self.select(index)

    def lay(self, item: ClipItem, spec: str, said: str = "") -> None:
        """Put the ground of a name or file under a take; `said` of it then. The live ground stays."""
        if spec == self.stage.terrain_spec:
            self._shown(item, self.stage.terrain, said)
        else:
            load = partial(self.load_ground, spec)
            self.jobs.submit(
                Slot("ground of a take", item),
                load,
                lambda t: self._shown(item, t, said),
                reading=Path(spec).name,
            )

    def _shown(self, item: ClipItem, ground: Terrain, said: str) -> None:
        item.ground = ground
        playback = self.state.playback
        if playback is not None and self.state.played is item:
            playback.terrain = ground
        if said:
            self.messages.note(said)

    def ground_to_show(self) -> Terrain:
        """The ground to draw: that of the take that plays, in the frame that is shown, or the live one."""
        playback, item = self.state.playback, self.state.played
        if playback is None:
            return self.stage.terrain
        if (
            playback.live is not self.stage.terrain
        ):  # another one was chosen meanwhile: the take is shown on that
            playback.terrain = self.stage.terrain
        elif item is not None and item.drive is not None:
            change = item.drive.ground(playback.frame)
            playback.terrain = playback.terrain if change is None else change.terrain
        size = playback.clip.size
        if playback.terrain.unit_m == size:
            return playback.terrain
        if self._seen is None or self._seen[0] is not playback.terrain or self._seen[1].unit_m != size:
            self._seen = playback.terrain, playback.terrain.seen_by(size)
        return self._seen[1]

    def play_row(self, index: int) -> None:
        """Play a clip of the list, or pause it when it is the one that plays."""
        playback = self.state.playback
        if playback is not None and playback.index == index:
            playback.toggle()
        else:
            self.play(index)

    def play_or_pause(self) -> None:
        """Toggle the clip that is shown, or begin with the current one."""
        clips = self.state
        if clips.playback is not None:
            clips.playback.toggle()
        elif clips.current is not None:
            self.play(clips.selected)

    def step(self, frames: int) -> None:
        """Go so many frames on in the clip that plays, or back."""
        if self.state.playback is not None:
            self.state.playback.step(frames)

    def seek_end(self, first: bool) -> None:
        """Go to the first or the last frame that is kept of the clip that plays."""
        playback = self.state.playback
        if playback is not None:
            playback.seek(playback.first if first else playback.last)

    def close_playback(self) -> None:
        """Back to the live character."""
        self.state.playback = None

    # --- export

    def export(self) -> None:
        """Write the current clip, trimmed as marked, as BVH to the path in the field.

        A path that was typed may be one that exists; what was proposed is free or holds this clip already.
        """
        clips, settings = self.state, self.settings
        item = clips.current
        if item is None:
            return
        new = False  # whether the name must be a free one
        try:
            if clips.export_path == self._proposed and self._target is not None:
                self._propose(item)  # another program may have taken the name since
                path = self._target
                new = self._writers.get(path) is not item
            else:
                self._proposed = None  # typed: whatever is typed from now on is meant
                path = export_target(clips.export_path)
        except SportError as error:
            self.messages.error(error)
            return
        from runtime.formats.bvh_clip import save_bvh

        fps, clip, cut = settings.export_fps, item.clip, self._trimmed(item)
        whole = len(cut) == len(clip) and fps >= clip.fps
        self.jobs.submit(
            Slot("export", item),
            partial(save_bvh, cut, path, fps, settings.export_unit, new=new),
            lambda done: self._exported(item, clip, done, whole),
            writing=f"the export of {item.name}",
        )

    def _trimmed(self, item: ClipItem) -> Clip:
        playback = self.state.playback
        if playback is None or playback.clip is not item.clip or not playback.trimmed:
            return item.named_clip
        return item.named_clip.trim(playback.first, playback.last)

    def _exported(self, item: ClipItem, clip: Clip, path: Path, whole: bool) -> None:
        self.note_file(item, clip, path, whole)
        self.settings.export_folder = str(path.parent)
        self.messages.note(f"Saved {path}")

    def note_file(self, item: ClipItem, clip: Clip, path: Path, whole: bool) -> None:
        """A file was written from the version `clip` of a take: `whole` when it is a BVH of all its frames.

        A version is saved by such a file only, and no longer once the file is written over.
        """
        for other in [*self.state.items, *(gone.item for gone in self.state.removed)]:
            if other.overwritten(path) and other.journal is None and other in self.state.items:
                other.journal = self.journals.keep(other.clip)
        self._writers[path], item.exported = item, path
        if whole:
            item.written(clip, path)

    def export_all(self) -> None:
        """Write every clip as BVH under its own name into the export folder; no file is replaced."""
        items = [(item, item.clip, item.named_clip) for item in self.state.items]
        folder = Path(self.settings.export_folder).expanduser()
        fps, unit = self.settings.export_fps, self.settings.export_unit

        def work() -> list[Path]:
            from runtime.formats.bvh_clip import save_bvh

            return [
                save_bvh(named, folder / f"{file_stem(named.name)}.bvh", fps, unit, new=True)
                for _, _, named in items
            ]

        def done(paths: list[Path]) -> None:
            for (item, clip, _), path in zip(items, paths, strict=True):
                self.note_file(item, clip, path, fps >= clip.fps)
            self.messages.note(f"Saved {len(paths)} takes in {folder}")

        self.jobs.submit(EXPORT_ALL, work, done, writing="the export of all takes")

    @property
    def unsaved(self) -> list[ClipItem]:
        """Clips of which no file holds every frame."""
        return [item for item in self.state.items if not item.safe and not self.is_safe(item)]

    def rescue(self, until: float | None = None) -> list[Path]:
        """Write every unsaved clip into the export folder, or where there is room: what is recorded outlives the program.

        After the time `until` (of `time.monotonic`) those stay where they are that the next start offers anyway.

        `incomplete` says afterwards whether anything was lost or went elsewhere than asked.
        """
        if self.recorder.recording:
            self.toggle_recording()
        rescue = Rescue(
            self.messages, lambda: Path(self.settings.export_folder).expanduser(), self.folder, self._save
        )
        for item in self.unsaved:
            late = until is not None and time.monotonic() > until
            if late and (self.is_offered(item) or (item.journal is not None and not item.older)):
                self.messages.note(f"{item.name} is not exported: the next start offers it.")
            else:
                rescue.keep(item)
        self.incomplete = self.incomplete or rescue.incomplete
        return rescue.written

    def _save(self, item: ClipItem, folder: Path) -> Path:
        from runtime.formats.bvh_clip import save_bvh

        path, fps = folder / f"{file_stem(item.name)}.bvh", max(self.settings.export_fps, item.clip.fps)
        path = save_bvh(item.named_clip, path, fps, self.settings.export_unit, new=True)
        item.written(item.clip, path)
        return path


def export_target(text: str) -> Path:
    """The path in the export field; UsageError when it names no BVH file."""
    text = text.strip().strip('"')
    if not text or "\0" in text:
        raise UsageError("Export: the path is empty.", "Write a path such as ~/sport-clips/walk.bvh.")
    path = Path(text).expanduser()
    if path.is_dir():
        raise UsageError(f"Export: {path} is a folder.", "Add a file name, for example walk.bvh.")
    return path if path.suffix.lower() == ".bvh" else path.with_name(path.name + ".bvh")


def file_stem(name: str) -> str:
    """A file name for a clip's name: lower case, words joined by dashes."""
    return re.sub(r"[^a-z0-9]+", "-", name.lower()).strip("-")[:MAX_NAME] or "clip"


def free_path(path: Path) -> Path:
    """`path`, or the first of path-2, path-3, … that does not exist."""
    candidate, number = path, 2
    while os.path.lexists(candidate):  # unlike Path.exists, no error where the folder cannot be read
        candidate = path.with_stem(f"{path.stem}-{number}")
        number += 1
    return candidate
