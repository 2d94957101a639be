"""The list of takes: recording into it, and playback."""

import re
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

from runtime.controls import Controls
from runtime.errors import SportError
from runtime.pose import Pose
from runtime.safe_read import printable
from runtime.session import edits
from runtime.session.motion import Motion, MotionHeader
from runtime.session.prompt_blend import PromptBlend
from runtime.session.recording import Recording
from runtime.session.session import LIVE, MIN_FRAMES, Ground, Reference, Session, Take
from runtime.takes.clip import Clip
from runtime.takes.input_recording import InputRecorder, InputRecording, StyleChange
from runtime.takes.metadata import Origin, PromptEvent, gait_of, origin_of
from runtime.takes.pins import pins_of_take
from runtime.takes.pose_edits import NO_EDITS, PoseEdits
from runtime.takes.recorder import ClipRecorder
from runtime.terrain.height_map import Terrain
from viewer.editor import Editor
from viewer.input.bindings import Action
from viewer.jobs import Jobs, Slot
from viewer.messages import Messages
from viewer.scene.scene import Scene
from viewer.session.playback import Playback
from viewer.settings import Settings

MAX_NOTE_CHARACTERS = 500  # characters
MIN_SEARCHED_TAKES = 8  # number of takes from which the list has a search field
SHOWING, PLAYING = Slot("frames of the take"), Slot("take")
LONG_FRAMES = 20_000  # of a take whose pins and footplants take noticeably long
RECORDED_NAME = re.compile(r"(?:Take|Last seconds) (\d{1,9})")
LoadedFrames = tuple[Clip, InputRecording | None, SportError | None]  # see `_loaded`
RECORDED_FRAMES = 10  # written at once: six times a second


@dataclass
class Takes:
    editor: Editor
    settings: Settings
    messages: Messages
    scene: Scene
    jobs: Jobs
    inputs: InputRecorder
    recorder: ClipRecorder = field(default_factory=ClipRecorder)
    playback: Playback | None = None
    search: str = ""  # text of the list's search field
    renaming: int = LIVE  # the take whose name is being typed
    noting: bool = False  # the note is typed instead of the name
    new_name: str = ""
    naming_begins: bool = False
    # for takes opened in this run: the file and its animations, by number
    animations: dict[int, tuple[Path, tuple[str, ...]]] = field(default_factory=dict)
    _recording: Recording | None = None
    _written: int = 0  # number of the first frame not yet written
    _known: object = None  # the last keyframe and change written
    _seen: tuple[Terrain, Terrain] | None = None  # a ground, and the same at the scale of a take

    def __post_init__(self) -> None:
        self.editor.followers.append(self.follow)

    @property
    def actions(self) -> dict[Action, Callable[[], None]]:
        return {
            Action.RECORD: self.toggle_recording,
            Action.SAVE_LAST: self.save_last,
            Action.PLAY: self.play_or_pause,
            Action.FIRST_FRAME: partial(self._played, lambda playback: playback.seek(playback.first)),
            Action.LAST_FRAME: partial(self._played, lambda playback: playback.seek(playback.last)),
            Action.PLAY_BACKWARDS: partial(self._played, lambda playback: playback.shuttle(-1)),
            Action.STOP_PLAYING: partial(self._played, lambda playback: playback.shuttle(0)),
            Action.PLAY_FORWARDS: partial(self._played, lambda playback: playback.shuttle(1)),
            Action.TRIM_IN: partial(self._played, lambda playback: self.trim(first=playback.frame)),
            Action.TRIM_OUT: partial(self._played, lambda playback: self.trim(last=playback.frame)),
        }

    @property
    def session(self) -> Session:
        return self.editor.session

    @property
    def played(self) -> Take | None:
        return None if self.playback is None else self.playback.take

    def follow(self, before: Session, now: Session) -> None:
        """Update the playing take after an edit; stop playback if the take is gone or the ground was changed."""
        if before.ground is not None and now.ground != before.ground:
            self.close_playback()  # it would float above the new ground
        if self.playback is not None:
            self._follow_played(self.playback, now)
        if self.renaming != LIVE and now.take(self.renaming) is None:
            self.renaming = LIVE
        changed = now.selected != before.selected or now.current != before.current
        if changed and self.playback is not None and now.selected not in (LIVE, self.playback.number):
            self.play(now.selected)

    def _follow_played(self, playback: Playback, now: Session) -> None:
        take = now.take(playback.number)
        if take is None or take.number == LIVE:
            self.close_playback()
        elif take != playback.take or take != playback.shown:
            self._refresh(playback, take)

    def _refresh(self, playback: Playback, take: Take) -> None:
        playback.use(take)
        shown = playback.shown
        if (take.motion, take.mirrored, take.poses) == (shown.motion, shown.mirrored, shown.poses):
            playback.shown = take
        elif not self.editor.dragging:
            self.jobs.submit(SHOWING, partial(_loaded, take), partial(self._show, playback, take))

    def _show(self, playback: Playback, take: Take, loaded: LoadedFrames) -> None:
        clip, inputs, problem = loaded
        if problem is not None:
            self.messages.error(problem)
        if self.playback is playback and playback.take == take:
            playback.show(take, clip, inputs)

    # --- recording

    def before_steps(self) -> None:
        """Store the controller's state if a keyframe is due; call once per frame before simulating."""
        if self.scene.controller is not None:
            self.inputs.before_steps(self.scene.controller)

    def mark_style(self, blend: PromptBlend, seconds: float, holds: bool = False) -> None:
        """Record that a prompt is in force from the next frame on; `holds`: the controller has the style already."""
        z = blend.style(self.settings.exact_legs)
        event = PromptEvent(0.0, blend.prompt_text, seconds, blend.spelled_out(), blend.typed())
        self.recorder.mark_prompt(event.prompt, seconds, event.words, event.typed)
        if z is not None:
            self.inputs.mark_style(StyleChange(0, z, seconds, event, blend), holds)

    def mark_style_in_force(self, style: StyleChange) -> None:
        """Record the style of a take that the live controller already has."""
        event = style.event
        self.recorder.mark_prompt(event.prompt, 0.0, event.words, event.typed)
        self.inputs.mark_style(style, holds=True)

    def add_poses(self, poses: list[Pose], controls: Controls) -> None:
        """Record simulated poses, before pins, and their input; call once per frame."""
        for pose in poses:
            self.recorder.add(pose, gait_of(controls))
            if self.scene.controller is not None:
                self.inputs.add(controls, self.scene.controller)
        self.inputs.drop_before(self.recorder.first_frame)
        if self._recording is not None and self.recorder.next_frame - self._written >= RECORDED_FRAMES:
            self._write_down(self._recording)

    def _write_down(self, recording: Recording) -> None:
        """Write the newly recorded frames to the file."""
        first, begin = self._written, self.recorder.take_first
        rows = self.recorder.rows(first)
        if begin is None or not len(rows):
            return
        sticks, known = self.inputs.sticks(first), self.inputs.known
        if known == self._known:
            recording.add(rows, sticks)
        else:
            recording.add(rows, sticks, self.recorder.events(begin), self.inputs.cut(begin))
        self._known = known
        self._written = self.recorder.next_frame

    def memory(self, seconds: float) -> Playback | None:
        """Return the last seconds of the live character as a take paused at its end; None if there are none."""
        if not self.recorder.seconds:
            return None
        clip = self.recorder.last(seconds)
        begin = (self.recorder.next_frame - len(clip)) / clip.fps
        pins = pins_of_take(self.session.live.poses.pins, begin, len(clip) / clip.fps)
        take = Take(motion=Motion.of(clip), poses=PoseEdits(pins))
        ground = self.scene.terrain
        return Playback(take, take.clip, ground, ground, time_s=clip.seconds, playing=False)

    @property
    def recording(self) -> bool:
        return self.recorder.recording

    def toggle_recording(self) -> None:
        """Start recording, or stop it and add the take to the list."""
        if not self.recorder.recording:
            self.close_playback()
            self.recorder.start()
            name = self._free_name("Take")
            self._written, self._known = self.recorder.next_frame, None
            header = MotionHeader(
                name, self.recorder.fps, 0, self.scene.terrain_spec, origin=self._origin,
                size=self.scene.terrain.unit_m, has_gaits=True, resimulable=self.scene.controller is not None,
            )  # fmt: skip
            self._recording = self.editor.file.begin_recording(header)
            self.messages.note(f"{name} is being recorded. R ends it.")
            return
        recording, self._recording = self._recording, None
        if recording is not None:
            self._write_down(recording)
        self._keep("Take", self.recorder.stop, recording)

    def _free_name(self, kind: str) -> str:
        """Return a name with the next number of the recorded takes, counting removed ones, but not opened files."""
        history = self.editor.history
        names = {
            take.made.header.name
            for step in history.steps[: history.at + 1]
            for take in step.session.takes
            if take.recorded
        }
        numbers = [int(found[1]) for name in names if (found := RECORDED_NAME.fullmatch(name))]
        return f"{kind} {max(numbers, default=0) + 1}"

    def end_recording(self) -> None:
        if self.recorder.recording:
            self.toggle_recording()

    def save_last(self) -> None:
        """Add the last seconds to the list as a take, also while recording."""
        seconds = self.settings.keep_seconds
        self._keep("Last seconds", lambda *about: self.recorder.last(seconds, *about), None)

    @property
    def _origin(self) -> Origin:
        return origin_of(self.scene.controller, self.scene.terrain_spec)

    def _keep(self, kind: str, cut: Callable[[str, str, Origin], Clip], recording: Recording | None) -> None:
        """End a piece of the live take: add the clip made by `cut(name, terrain, origin)` to the list."""
        name = self._free_name(kind)
        try:
            clip = cut(name, self.scene.terrain_spec, self._origin)
        except SportError as error:
            self.messages.warn(str(error))
            if recording is not None:
                recording.give_up()
            return
        clip = replace(clip, size=self.scene.terrain.unit_m)
        first = self.recorder.next_frame - len(clip)
        inputs = self.inputs.cut(first)
        motion = Motion.of(clip, inputs) if recording is None else recording.finish(clip, inputs)
        begin = first / clip.fps
        pins = pins_of_take(self.session.live.poses.pins, begin, len(clip) / clip.fps)
        cameras = tuple(
            replace(key, seconds=key.seconds - begin)
            for key in self.session.live.cameras
            if 0.0 <= key.seconds - begin <= clip.seconds
        )
        take = Take(motion=motion, poses=PoseEdits(pins), cameras=cameras, ground=self.scene.ground)
        self.editor.do(f"recording of {name}", lambda session: edits.with_new_take(session, take))
        self.messages.note(f"{name}: {clip.seconds:.1f} s in the list of takes.")

    # --- the list

    def select(self, number: int) -> None:
        """Select a take; if another one is playing, play this one."""
        self.editor.amend(lambda session: edits.selected(session, number))

    def remove(self, number: int) -> None:
        """Remove a take from the list; exported files stay."""
        take = self.session.take(number)
        if take is not None and number != LIVE:
            self.editor.do(f"removal of {take.title}", lambda session: edits.without_take(session, number))
            self.messages.note(f"{take.title} removed from the list. Ctrl+Z brings it back.")

    def begin_rename(self, number: int, noting: bool = False) -> None:
        """Start editing the name or note of a take in its row."""
        take = self.session.take(number)
        if take is not None:
            self.renaming, self.noting, self.naming_begins = number, noting, True
            self.new_name = take.note if noting else take.title

    def rename(self, number: int, name: str) -> None:
        """Rename a take; exported files keep their names. An empty name restores the original."""
        take = self.session.take(number)
        if take is None:
            return
        name = printable(name)
        if self.editor.do(f"name of {take.title}", lambda session: edits.renamed(session, number, name)):
            renamed = self.session.take(number)
            self.messages.note(f"Renamed: {'' if renamed is None else renamed.title}.")

    def mirror(self, number: int) -> None:
        """Add the mirror image of a take to the list and play it."""
        take = self.session.take(number)
        if take is None:
            return
        if self.editor.do(f"mirror image of {take.title}", lambda s: edits.mirrored_copy(s, number)):
            self.play(self.session.selected)
            uneven = take.ground is not None and float(take.ground.terrain.heights.std()) > 0.005
            over = " Its feet fit level ground, not this one." if uneven else ""
            self.messages.note(f"The mirror image of {take.title} is in the list.{over}")

    def trim(self, first: int | None = None, last: int | None = None, held: bool = False) -> None:
        """Trim the playing take to start or end at a frame; `held` during a drag."""
        take = self.played
        if take is None:
            return
        now = take.range
        if first is not None:
            wanted = min(first, now[1] - MIN_FRAMES + 1), now[1]
        else:
            wanted = now[0], max(now[1] if last is None else last, now[0] + MIN_FRAMES - 1)
        change = self.editor.drag if held else self.editor.do
        change(f"trim of {take.title}", lambda session: edits.trimmed(session, take.number, *wanted))

    @property
    def searchable(self) -> bool:
        return len(self.session.takes) >= MIN_SEARCHED_TAKES

    @property
    def found(self) -> list[Take]:
        """The takes that match every word of the search, in the chosen order; "***" finds three or more stars."""
        words, order = self.search.lower().split() if self.searchable else [], self.settings.takes_order
        found = [take for take in self.session.takes if all(word in _words(take) for word in words)]
        if self.searchable and order:
            found.sort(key=_ORDERS[order])
        return found

    def versions(self, number: int) -> list[tuple[str, Take]]:
        """Return earlier versions of a take from the history, oldest first, each with the label of its edit."""
        found: list[tuple[str, Take]] = []
        for step in self.editor.history.steps:
            take = step.session.take(number)
            if take is not None and (not found or found[-1][1].motion != take.motion):
                found.append((step.label, take))
        return found

    def go_back_to(self, version: Take) -> None:
        """Restore the motion and path of a take's earlier version."""
        change = partial(edits.resimulated, number=version.number, motion=version.made)
        self.editor.do(
            f"version of {version.title}",
            lambda session: change(session).with_take(version.number, path=version.path),
        )

    def compare_with(self, version: Take) -> None:
        """Play a take with an earlier version as reference, which is added to the list."""
        name, number = f"{version.title}, before"[: edits.MAX_NAME_CHARACTERS], version.number
        copy = replace(edits.copied(version), name=name)

        def change(session: Session) -> Session:
            made = edits.with_new_take(session, copy)
            return replace(made, reference=Reference(take=made.counter), selected=number)

        self.editor.do(f"comparison of {version.title}", change)
        self.play(number)

    def rate(self, number: int, stars: int) -> None:
        self.editor.do("rating of a take", lambda session: session.with_take(number, rating=stars))

    def set_note(self, number: int, text: str) -> None:
        text = " ".join(printable(text).split())[:MAX_NOTE_CHARACTERS]
        self.editor.do("note of a take", lambda session: session.with_take(number, note=text))

    def set_color(self, number: int, color: int) -> None:
        self.editor.do("color of a take", lambda session: session.with_take(number, color=color))

    # --- playback

    def play(self, number: int) -> None:
        take = self.session.take(number)
        if take is None or take.motion is None:
            return

        # a long take is shown at once, without its pins and footplants until they are applied
        long = take.frames > LONG_FRAMES
        shown = replace(take, poses=NO_EDITS) if take.poses and long else take

        def begin(loaded: LoadedFrames) -> None:
            now, (clip, inputs, problem) = self.session.take(number), loaded
            if problem is not None:
                self.messages.error(problem)
            if now is None:
                return
            self.end_recording()
            live = self.scene.terrain
            ground = live if now.ground is None else now.ground.terrain
            self.playback = Playback(now, clip, ground, live, inputs)
            self.select(number)
            if now != shown:
                self.playback.shown = shown
                self._refresh(self.playback, now)

        self.jobs.submit(PLAYING, partial(_loaded, shown), begin, reading=take.title if long else "")

    def ground_to_show(self) -> Ground:
        """Return the ground to draw: that of the playing take at the shown frame, or the live one."""
        playback = self.playback
        if playback is None:
            return self.scene.ground
        take, inputs = playback.take, playback.inputs
        spec = self.scene.terrain_spec if take.ground is None else take.ground.spec
        if playback.live is not self.scene.terrain:  # the live ground was changed meanwhile: it is shown
            playback.terrain, spec = self.scene.terrain, self.scene.terrain_spec
        elif inputs is not None:
            change = inputs.ground(playback.frame)
            if change is not None:
                playback.terrain, spec = change.terrain, change.name
        terrain, size = playback.terrain, playback.clip.size
        if terrain.unit_m != size:
            if self._seen is None or self._seen[0] is not terrain or self._seen[1].unit_m != size:
                self._seen = terrain, terrain.seen_by(size)
            terrain = self._seen[1]
        return Ground(spec, terrain, "")

    def play_or_pause(self, number: int = LIVE) -> None:
        """Play or pause a take; LIVE stands for the shown or selected one."""
        self.end_recording()  # selects what was recorded
        if self.playback is not None and number in (LIVE, self.playback.number):
            self.playback.toggle()
        else:
            self.play(number or self.session.selected)

    def _played(self, act: Callable[[Playback], None]) -> None:
        if self.playback is not None:
            act(self.playback)

    def close_playback(self) -> None:
        self.jobs.end_slot(PLAYING)
        self.playback = None


_ORDERS: dict[str, Callable[[Take], Any]] = {
    "name": lambda take: take.title.lower(),
    "length": lambda take: take.range[0] - take.range[1],  # longest first
    "rating": lambda take: -take.rating,
}


def _words(take: Take) -> str:
    return f"{take.title} {take.note} {'*' * take.rating} {_about(take.made.header)}".lower()


@lru_cache(256)
def _about(header: MotionHeader) -> str:
    return header.describe()


def _loaded(take: Take) -> LoadedFrames:
    """Return the shown frames of a take, its input, and why that cannot be read; thread-safe, FileError."""
    clip = take.clip
    try:
        return clip, None if take.mirrored else take.made.inputs, None
    except SportError as error:
        return clip, None, error
