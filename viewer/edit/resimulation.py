"""Edits of a take's input (prompts, gaits, path), with resimulation by the recorded stick; also restyling with a prompt."""

import dataclasses
import threading
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from runtime.controls import Gait
from runtime.errors import SportError
from runtime.motion.control_scripts import Waypoint
from runtime.motion.controller import Controller
from runtime.motion.snapshot import Snapshot, take_snapshot
from runtime.motion.style import StyleMix
from runtime.pose import Pose
from runtime.prompts.answer import Request
from runtime.prompts.parts import PartDescriptions
from runtime.session import edits
from runtime.session.motion import Motion
from runtime.session.prompt_blend import Answer, PromptBlend
from runtime.session.session import LIVE, Ground, Reference, Session, Take
from runtime.takes import input_edits
from runtime.takes.clip import Clip
from runtime.takes.footplants import unfitted
from runtime.takes.input_edits import Edit
from runtime.takes.input_recording import InputRecording, Steppable, StyleChange, resimulate, resimulated_take
from runtime.takes.metadata import Origin, PromptEvent, origin_of, title
from runtime.takes.restyle import PathError, path_error, restyled
from viewer.edit.tracks import Tracks, mark_at, tracks_of, words_of
from viewer.editor import Change
from viewer.jobs import JobCancelled, Slot
from viewer.prompt.prompt_controller import PromptController
from viewer.session.playback import Playback
from viewer.session.takes import Takes

RESIMULATION = Slot("resimulation of a take")
MAX_LABEL_CHARACTERS = 32  # characters of a prompt in the label of an edit
# arguments: the clip, its input, a controller of its model and a progress callback; results: clip and input
Work = Callable[[Clip, InputRecording, Steppable, Callable[[float], None]], tuple[Clip, InputRecording]]


@dataclass
class Resimulation:
    """Edits of the playing take that need resimulation, and the text typed for them."""

    takes: Takes
    prompting: PromptController
    part_tracks: bool = False
    new_prompt: str = ""
    focus_requested: bool = False  # for the take's prompt
    shown: object = None  # the prompt span in the fields
    prompt: str = ""
    parts: dict[str, str] = field(default_factory=dict)
    _tracks: Tracks | None = None
    _model: tuple[Origin, Controller, bool] | None = None  # origin and controller, and whether they match
    # resimulated fraction of each take's frames, by number; written by workers
    _done: dict[int, float] = field(default_factory=dict)

    @property
    def playback(self) -> Playback | None:
        return self.takes.playback

    @property
    def take(self) -> Take | None:
        playback = self.takes.playback
        return None if playback is None else playback.take

    @property
    def busy(self) -> bool:
        """Whether the playing take is being resimulated."""
        return self.take is not None and self.takes.jobs.busy(replace(RESIMULATION, of=self.take.number))

    @property
    def progress(self) -> float:
        """Progress of the playing take's resimulation, 0 to 1."""
        return 0.0 if self.take is None else self._done.get(self.take.number, 0.0)

    @property
    def model(self) -> Controller | None:
        """A controller with the playing take's model, or None if that model is not loaded."""
        playback, controller = self.takes.playback, self.takes.scene.simulation.controller
        if playback is None or controller is None or playback.take.motion is None:
            return None
        made, known = playback.take.motion.header.origin, self._model
        if known is None or known[0] is not made or known[1] is not controller:
            same = origin_of(controller, "").model_sha256 == made.model_sha256
            known = self._model = made, controller, same
        return controller if known[2] else None

    @property
    def fixed(self) -> str:
        """The reason why the playing take cannot be resimulated, or ""."""
        playback = self.takes.playback
        if playback is None or playback.take.motion is None:
            return "No take plays."
        take = playback.take
        if not take.recorded:
            return "This motion comes from a file. It can be trimmed, pinned, posed and exported."
        if take.mirrored or not playback.take.motion.header.resimulable:
            return (
                "Only takes as recorded can be resimulated: this one was mirrored, cut, joined or continued from another, or"
                " its model changed. It can be trimmed, pinned, posed and exported."
            )
        if self.model is None:
            return "Another model made this take. It can be trimmed, pinned, posed and exported."
        return "It is being resimulated…" if self.busy else ""

    @property
    def tracks(self) -> Tracks | None:
        playback = self.takes.playback
        if playback is None:
            return None
        clip = playback.clip
        if self._tracks is None or self._tracks.clip is not clip:
            self._tracks = tracks_of(clip, playback.inputs)
        return self._tracks

    # --- prompts

    def reword(self, index: int, request: Request) -> None:
        """Change the words of prompt number `index` of the take; empty text changes nothing."""
        mark = self.tracks and self.tracks.prompts[index]
        if not mark or (isinstance(request, str) and not request.strip()):
            return
        known = _answer_of(mark.of.changes[-1])
        label = f"words of {_short(title(mark.of.event))}"

        def edit(inputs: InputRecording) -> Edit:
            style = self.style(mark.start, request, known)
            return input_edits.reworded(inputs, input_edits.prompt_spans(inputs)[index], style)

        self.again(label, edit)

    def reword_part(self, index: int, part: str, text: str) -> None:
        mark = self.tracks and self.tracks.prompts[index]
        words = mark and words_of(mark.of.event)
        if not words:
            return
        try:
            changed = PartDescriptions.from_mapping({**words.to_mapping(), part: text})
        except SportError as error:
            self.takes.messages.error(error)
            return
        if changed != words:
            self.reword(index, changed)

    def insert_prompt(self, text: str) -> None:
        """Insert a prompt from the frame shown to the next prompt."""
        if self.playback is not None and text.strip():
            frame = self.playback.frame
            self.again(
                f"prompt {_short(text)}",
                lambda inputs: input_edits.with_prompt(inputs, self.style(frame, text, None)),
            )

    def style(self, frame: int, request: Request, known: Answer | None) -> StyleChange:
        """Return the style change for a request at a frame; blocks for the answer, so call it on a worker."""
        answer, seconds = self.prompting.answer(request), self.takes.settings.blend_seconds
        if isinstance(request, PartDescriptions):
            base = known or dataclasses.replace(answer, prompt="")
            answer = dataclasses.replace(base, words=answer.words, z=answer.z)
        style = PromptBlend((answer, None))
        event = PromptEvent(0.0, style.prompt_text, seconds, style.spelled_out(), style.typed())
        mix = style.style(self.takes.settings.exact_legs)
        assert mix is not None
        return StyleChange(frame, mix, seconds, event, style)

    # --- spans

    def insert_gait(self, gait: Gait) -> None:
        """Insert a gait from the frame shown to the end of the gait there."""
        playback, tracks = self.playback, self.tracks
        if playback is None or tracks is None:
            return
        frame = playback.frame
        end = tracks.gaits[at].end if (at := mark_at(tracks.gaits, frame)) >= 0 else playback.frames
        self.again(f"gait {gait.label}", lambda inputs: input_edits.with_gait(inputs, frame, end - 1, gait))

    # --- resimulation

    def again(
        self, label: str, edit: Callable[[InputRecording], Edit], also: Change = lambda session: session
    ) -> None:
        """Resimulate the playing take with its recorded stick, after an edit of its input."""

        def work(
            driven: Clip, inputs: InputRecording, model: Steppable, progress: Callable[[float], None]
        ) -> tuple[Clip, InputRecording]:
            made = edit(inputs)
            return resimulated_take(driven, made.inputs, model, made.first, progress)

        self.run(label, work, also=also)

    def walk(self, points: tuple[Waypoint, ...]) -> None:
        """Resimulate the playing take along another path."""

        if points:
            from runtime.takes.take_path import resimulated_along

            self.run(
                "path",
                lambda clip, inputs, model, progress: resimulated_along(
                    clip, inputs, model, points, 0, progress
                ),
                points,
            )

    def run(
        self, label: str, work: Work, path: tuple[Waypoint, ...] = (), also: Change = lambda session: session
    ) -> None:
        """Resimulate the playing take with `work` on a worker thread; the change `also` applies at once."""
        take, model = self.take, self.model
        if take is None or model is None or self.fixed:
            self.takes.messages.warn(self.fixed)
            return
        motion, number = take.made, take.number

        def made(progress: Callable[[float], None]) -> tuple[Motion, int]:
            inputs = motion.inputs
            assert inputs is not None
            clip, again = work(motion.clip, inputs, model.twin(), progress)
            return Motion.of(clip, again), unfitted(clip, take.poses.footplants)

        def change(result: tuple[Motion, int], session: Session) -> Session:
            now = session.take(number)
            if now is None or now.motion != motion:
                return session
            return edits.resimulated(session, number, result[0]).with_take(number, path=path)

        def done(result: tuple[Motion, int]) -> None:
            text, dropped = f"{take.title}: {label}. Ctrl+Z undoes it.", result[1]
            if dropped:
                count = "One changed footplant" if dropped == 1 else f"{dropped} changed footplants"
                self.takes.messages.warn(f"{count} of {take.title} dropped: the steps have changed. {text}")
            else:
                self.takes.messages.note(text)

        self.submit(f"{label} of {take.title}", take, made, change, done, also)

    def submit(
        self,
        label: str,
        take: Take,
        work: Callable[[Callable[[float], None]], Any],
        change: Callable[[Any, Session], Session],
        done: Callable[[Any], None],
        also: Change = lambda session: session,
    ) -> None:
        """Run `work` on a worker, as a step of undo whose result arrives later."""
        slot, ended, jobs = replace(RESIMULATION, of=take.number), threading.Event(), self.takes.jobs
        self._done[take.number] = 0.0

        def progress(fraction: float) -> None:
            if ended.is_set():
                raise JobCancelled("Resimulation: cancelled.")
            self._done[take.number] = fraction
            jobs.progress[slot] = f"{fraction:.0%}"

        self.takes.editor.run(
            jobs, label, slot, lambda: work(progress), change, also, done,
            doing=f"Resimulating {take.title}", cancel=ended.set,
        )  # fmt: skip

    # --- continuing live

    def go_on(self) -> None:
        """Continue with the live character from the frame shown, on the take's terrain and with its prompt."""
        take, playback, model = self.take, self.playback, self.model
        if take is None or playback is None or model is None or self.fixed:
            self.takes.messages.warn(self.fixed)
            return
        frame, before, inputs = playback.frame, self.takes.session, take.made.inputs
        if inputs is None:
            return
        style, ground = _style_at(inputs, frame), inputs.ground(frame)
        blend = None if style is None else style.note or PromptBlend((_answer_of(style), None))

        def work(progress: Callable[[float], None]) -> tuple[Snapshot, Pose]:
            twin = model.twin()
            poses, _ = resimulate(inputs, twin, frame, frame, progress)
            return take_snapshot(twin), poses[-1]

        def change(_: object, session: Session) -> Session:
            if ground is not None and session.ground == before.ground:
                session = replace(session, ground=Ground.of(ground.name, ground.terrain.seen_by(1.0)))
            if blend is not None and session.live.prompt == before.live.prompt:
                session = session.with_take(LIVE, prompt=blend)
            return session

        def done(made: tuple[Snapshot, Pose]) -> None:
            self.takes.close_playback()
            self.takes.scene.go_on_from(*made)
            if style is not None and blend is not None:
                self.takes.mark_style_in_force(style)
                self.prompting.moves_by(blend)
            self.takes.messages.note(f"Live from frame {frame} of {take.title}.")

        self.submit(f"going on from frame {frame} of {take.title}", take, work, change, done)


def _style_at(inputs: InputRecording, frame: int) -> StyleChange | None:
    spans = [s for s in input_edits.prompt_spans(inputs) if s.start <= frame]
    changes = [c for c in spans[-1].changes if c.frame <= frame] if spans else []
    return changes[-1] if changes else None


def _answer_of(style: StyleChange) -> Answer | None:
    """Return the answer that a style came from, or one made from its six descriptions."""
    if isinstance(style.note, PromptBlend):
        return style.note.a if style.note.b is None else None
    words = words_of(style.event)
    codes = style.z.codes if isinstance(style.z, StyleMix) else (style.z,)
    if words is None or len(codes) > 1:
        return None
    return Answer(title(style.event), words, words, np.array(codes[0], np.float32))


def _short(text: str) -> str:
    return text if len(text) <= MAX_LABEL_CHARACTERS else text[: MAX_LABEL_CHARACTERS - 1] + "…"


LATE_S = 0.15  # unreported difference of the new take's timing from the clip's


def restyle(editing: Resimulation, prompt: str) -> None:
    """Walk the playing take's path with another prompt, on the current terrain; adds a take with the original as reference."""
    takes, playback = editing.takes, editing.playback
    controller = takes.scene.simulation.controller
    if playback is None or controller is None or editing.busy or not prompt.strip():
        return
    take, ground, terrain = playback.take, takes.scene.ground, takes.scene.terrain
    clip, number = playback.clip.trim(playback.first, playback.last), takes.session.counter + 1

    def work(progress: Callable[[float], None]) -> tuple[Motion, PathError]:
        walker = controller.twin()
        walker.set_terrain(terrain)
        made, inputs = restyled(clip, walker, editing.style(0, prompt, None), progress)
        made = replace(made, name=f"{take.title}, restyled", size=terrain.unit_m)
        return Motion.of(made, inputs), path_error(made, clip)

    def change(found: tuple[Motion, PathError], session: Session) -> Session:
        led = session.take(take.number)
        if led is None or led.motion != take.motion:
            return session
        made = edits.with_new_take(session, Take(motion=found[0], ground=ground), number)
        return replace(made, reference=Reference(take=take.number))

    def done(found: tuple[Motion, PathError]) -> None:
        error = found[1]
        takes.play(number)
        if error.time_s > LATE_S:
            text = f"{take.title} goes faster than this style can: the new take is {error.time_s:.1f} s off its time."
            takes.messages.warn(text)
        else:
            takes.messages.note(
                f"{take.title} restyled: {100.0 * error.path_m:.0f} cm off its path, {error.time_s:.2f} s off its time."
            )

    editing.submit(f"restyling of {take.title}", take, work, change, done, edits.with_number)
