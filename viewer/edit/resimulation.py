"""Edits of what drove a take: its prompts, gaits and path change, and the recorded stick resimulates it from there."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass, field, replace

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
from runtime.session.session import LIVE, Ground, Session, Take
from runtime.takes import input_edits
from runtime.takes.clip import Clip
from runtime.takes.footplants import unfitted
from runtime.takes.input_edits import Edit
from runtime.takes.input_recording import InputRecording, Steppable, StyleChange, resimulate, resimulated_take
from runtime.takes.metadata import Origin, PromptEvent, origin_of, title
from viewer.edit.tracks import Tracks, mark_at, tracks_of, words_of
from viewer.jobs import Slot
from viewer.prompt.prompt_controller import PromptController
from viewer.session.playback import Playback
from viewer.session.takes import Takes

SLOT = Slot("resimulation of a take")
MAX_LABEL = 32  # characters of a prompt in the name of an edit
# the driven clip, its input, a controller of its model and what hears the progress; another clip with its input
Work = Callable[[Clip, InputRecording, Steppable, Callable[[float], None]], tuple[Clip, InputRecording]]


@dataclass
class Resimulation:
    """Actions of the timeline that resimulate the take that plays; also what is typed for them."""

    takes: Takes
    prompting: PromptController
    progress: float = 0.0  # fraction of the frames that were resimulated; written by the worker
    part_tracks: bool = False
    new_prompt: str = ""
    focus_requested: bool = False  # of the take's prompt
    shown: object = None  # the prompt's span in the fields
    prompt: str = ""
    parts: dict[str, str] = field(default_factory=dict)
    _tracks: Tracks | None = None
    _model: tuple[Origin, Controller, bool] | None = None  # whether a controller made what has an origin
    _left_out: int = 0  # changed plants that the take has no steps for; written by the worker

    @property
    def playback(self) -> Playback | None:
        return self.takes.playback

    @property
    def take(self) -> Take | None:
        playback = self.takes.playback
        return None if playback is None else playback.take

    @property
    def busy(self) -> bool:
        return self.takes.jobs.busy(SLOT)

    @property
    def model(self) -> Controller | None:
        """The model that made the take that plays, when it is the one that is loaded."""
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
        """Why the take that plays cannot be resimulated; "" when it can."""
        playback = self.takes.playback
        if playback is None or playback.take.motion is None:
            return "No take plays."
        take = playback.take
        if not take.recorded:
            return "This motion comes from a file. It can be trimmed, pinned, posed and exported."
        if take.mirrored or not playback.take.motion.header.resimulable:
            return (
                "Only takes as recorded can be resimulated: this one was mirrored, cut or joined, goes on from another, or"
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
        """Other words for a prompt of the take, by its place; empty ones change nothing."""
        mark = self.tracks and self.tracks.prompts[index]
        if not mark or (isinstance(request, str) and not request.strip()):
            return
        known = _answer_of(mark.of.changes[-1])
        label = f"words of {_short(title(mark.of.event))}"

        def edit(inputs: InputRecording) -> Edit:
            style = self.style(mark.start, request, known)
            return input_edits.reworded(inputs, input_edits.prompt_spans(inputs)[index], style)

        self._again(label, edit)

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
        """Another prompt from the frame shown to the next prompt."""
        if self.playback is not None and text.strip():
            frame = self.playback.frame
            self._again(
                f"prompt {_short(text)}",
                lambda inputs: input_edits.with_prompt(inputs, self.style(frame, text, None)),
            )

    def style(self, frame: int, request: Request, known: Answer | None) -> StyleChange:
        """Return the style of a request from a frame on; waits for the answer, so call it on a worker."""
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
        """Another gait from the frame shown to the end of the gait there."""
        playback, tracks = self.playback, self.tracks
        if playback is None or tracks is None:
            return
        frame = playback.frame
        end = tracks.gaits[at].end if (at := mark_at(tracks.gaits, frame)) >= 0 else playback.frames
        self._again(f"gait {gait.label}", lambda inputs: input_edits.with_gait(inputs, frame, end - 1, gait))

    def move_prompt(self, index: int, start: int, end: int) -> None:
        """A prompt goes to other frames, at the cost of its neighbours."""
        self._again("move of a prompt", lambda inputs: input_edits.move_prompt(inputs, index, start, end))

    def move_gait(self, index: int, start: int, end: int) -> None:
        self._again("move of a gait", lambda inputs: input_edits.move_gait(inputs, index, start, end))

    # --- resimulating

    def _again(self, label: str, edit: Callable[[InputRecording], Edit]) -> None:
        """Resimulate the take that plays by the recorded stick after an edit of its input."""

        def work(
            driven: Clip, inputs: InputRecording, model: Steppable, progress: Callable[[float], None]
        ) -> tuple[Clip, InputRecording]:
            made = edit(inputs)
            return resimulated_take(driven, made.inputs, model, made.first, progress)

        self.run(label, work)

    def walk(self, points: tuple[Waypoint, ...]) -> None:
        """Resimulate the take that plays along another path."""

        def work(
            driven: Clip, inputs: InputRecording, model: Steppable, progress: Callable[[float], None]
        ) -> tuple[Clip, InputRecording]:
            from runtime.takes.take_path import resimulated_along

            return resimulated_along(driven, inputs, model, points, 0, progress)

        if points:
            self.run("path", work, points)

    def run(self, label: str, work: Work, path: tuple[Waypoint, ...] = ()) -> None:
        """Resimulate the take that plays by `work`, on a worker thread."""
        take, model = self.take, self.model
        if take is None or model is None or self.fixed:
            self.takes.messages.warn(self.fixed)
            return
        motion, self.progress = take.made, 0.0

        def made() -> Motion:
            inputs = motion.inputs
            assert inputs is not None
            clip, again = work(motion.clip, inputs, model.twin(), self.note_progress)
            self._left_out = unfitted(clip, take.poses.footplants)
            return Motion.of(clip, again)

        self.takes.jobs.submit(SLOT, made, lambda result: self._take(take, result, label, path))

    def note_progress(self, fraction: float) -> None:
        self.progress = fraction

    def _take(self, before: Take, motion: Motion, label: str, path: tuple[Waypoint, ...]) -> None:
        now = self.takes.session.take(before.number)
        if now is None or now.motion != before.motion:  # undone meanwhile
            return

        def change(session: Session) -> Session:
            made = edits.resimulated(session, before.number, motion)
            return made.with_take(before.number, path=path)

        self.takes.editor.do(f"{label} of {before.title}", change)
        text = f"{before.title}: {label}. Ctrl+Z undoes it."
        if self._left_out:
            count = "One changed footplant" if self._left_out == 1 else f"{self._left_out} changed footplants"
            self.takes.messages.warn(f"{count} of {before.title} dropped: the steps have changed. {text}")
        else:
            self.takes.messages.note(text)

    # --- going on

    def go_on(self) -> None:
        """Drive the live character from the frame shown, with the take's ground and prompt."""
        take, playback, model = self.take, self.playback, self.model
        if take is None or playback is None or model is None or self.fixed:
            self.takes.messages.warn(self.fixed)
            return
        motion, frame = take.made, playback.frame

        def work() -> tuple[Snapshot, Pose]:
            inputs, twin = motion.inputs, model.twin()
            assert inputs is not None
            poses, _ = resimulate(inputs, twin, frame, frame)
            return take_snapshot(twin), poses[-1]

        self.takes.jobs.submit(SLOT, work, lambda made: self._go_on(take, frame, *made))

    def _go_on(self, take: Take, frame: int, snapshot: Snapshot, pose: Pose) -> None:
        inputs = take.made.inputs
        if inputs is None:
            return
        style, ground = _style_at(inputs, frame), inputs.ground(frame)
        blend = None if style is None else style.note or PromptBlend((_answer_of(style), None))

        def change(session: Session) -> Session:
            if ground is not None:
                session = replace(session, ground=Ground.of(ground.name, ground.terrain.seen_by(1.0)))
            return session if blend is None else session.with_take(LIVE, prompt=blend)

        self.takes.close_playback()
        self.prompting.adopt(f"going on from frame {frame} of {take.title}", change)
        self.takes.scene.go_on_from(snapshot, pose)
        if style is not None:
            self.takes.mark_style_in_force(style)
        self.takes.messages.note(f"Live from frame {frame} of {take.title}.")


def _style_at(inputs: InputRecording, frame: int) -> StyleChange | None:
    spans = [s for s in input_edits.prompt_spans(inputs) if s.start <= frame]
    changes = [c for c in spans[-1].changes if c.frame <= frame] if spans else []
    return changes[-1] if changes else None


def _answer_of(style: StyleChange) -> Answer | None:
    """The answer that a style came from; from its six descriptions where nothing else was kept."""
    if isinstance(style.note, PromptBlend):
        return style.note.a if style.note.b is None else None
    words = words_of(style.event)
    codes = style.z.codes if isinstance(style.z, StyleMix) else (style.z,)
    if words is None or len(codes) > 1:
        return None
    return Answer(title(style.event), words, words, np.array(codes[0], np.float32))


def _short(text: str) -> str:
    return text if len(text) <= MAX_LABEL else text[: MAX_LABEL - 1] + "…"
