"""Edits of the take that plays: its prompts and gaits change, and the recorded stick drives it again from there."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from runtime.controls import Gait
from runtime.errors import SportError
from runtime.motion.snapshot import Snapshot, take_snapshot
from runtime.motion.style_mix import StyleMix
from runtime.pose import Pose
from runtime.prompts.parts import PartDescriptions
from runtime.takes.metadata import PromptEvent, title
from runtime.takes.plants import unfitted
from viewer.jobs import Slot
from viewer.messages import Messages
from viewer.prompt.prompting import Prompting
from viewer.prompt.state import Request
from viewer.prompt.style_edit import Answer, StyleEdit
from viewer.stage.stage import Stage
from viewer.takes.state import ClipItem, TakesState
from viewer.takes.takes import Takes
from viewer.takes.tracks import Tracks, tracks_of, words_of

if TYPE_CHECKING:
    from runtime.takes.clip import Clip
    from runtime.takes.drive import Drivable, Drive, StyleChange
    from runtime.takes.drive_edits import Edit, PromptSpan

SLOT = Slot("driving a take")
MAX_LABEL = 32  # characters of a prompt in the name of an edit
# the driven clip, its drive, a controller of its model and what hears the progress; another clip with its drive
Work = Callable[["Clip", "Drive", "Drivable", Callable[[float], None]], tuple["Clip", "Drive"]]
Edited = tuple["Clip", "Drive", "Clip"]  # as it is shown, what drove it, and without the edits of its poses


@dataclass
class TakeEditing:
    """Actions of the timeline."""

    takes: Takes
    stage: Stage
    prompting: Prompting
    progress: float = 0.0  # share of the frames that were driven again; written by the worker
    left_out: int = 0  # changed plants that the driven take has no steps for; written by the worker

    @property
    def state(self) -> TakesState:
        """The room's slice of the state."""
        return self.takes.state

    @property
    def messages(self) -> Messages:
        """The status line."""
        return self.takes.messages

    @property
    def busy(self) -> bool:
        """Whether a take is being driven again."""
        return self.takes.jobs.busy(SLOT)

    @property
    def fixed(self) -> str:
        """Why the take that plays cannot be edited; "" when it can."""
        item = self.state.played
        if item is None:
            return "No take plays."
        if item.drive is None or item.maker is None:
            return (
                "This motion comes from a file: it can be trimmed, pinned and exported."
                if not item.recorded
                else "A mirror image cannot be driven again, nor a take in which a model was loaded or another take was gone on from."
                " It can be trimmed, pinned and exported."
            )
        return "It is being driven again…" if self.busy else ""

    @property
    def tracks(self) -> Tracks | None:
        """What lies on the tracks of the take that plays."""
        item, timeline = self.state.played, self.state.timeline
        if item is None:
            return None
        if timeline.tracks is None or timeline.tracks.clip is not item.clip:
            timeline.tracks = tracks_of(item.clip, item.drive)
        return timeline.tracks

    # --- prompts

    def reword(self, index: int, request: Request) -> None:
        """Other words for a prompt of the take, by its place; empty ones change nothing."""
        bar = self.tracks and self.tracks.prompts[index]
        if not bar or (isinstance(request, str) and not request.strip()):
            return
        known = _answer_of(bar.span.changes[-1])  # type: ignore[attr-defined]
        label = f"words of {_short(title(bar.span.event))}"  # type: ignore[attr-defined]

        def edit(drive: Drive) -> Edit:
            from runtime.takes import drive_edits

            style = self._style(bar.span.start, request, known)
            return drive_edits.reworded(drive, drive_edits.prompt_spans(drive)[index], style)

        self._again(label, edit)

    def reword_part(self, index: int, part: str, text: str) -> None:
        """Other words for one part of a prompt of the take."""
        bar = self.tracks and self.tracks.prompts[index]
        words = bar and words_of(bar.span.event)  # type: ignore[attr-defined]
        if not words:
            return
        try:
            changed = PartDescriptions.from_mapping({**words.to_mapping(), part: text})
        except SportError as error:
            self.messages.error(error)
            return
        if changed != words:
            self.reword(index, changed)

    def insert_prompt(self, text: str) -> None:
        """Another prompt from the frame shown to the next prompt."""
        playback = self.state.playback
        if playback is None or not text.strip():
            return
        frame = playback.frame

        def edit(drive: Drive) -> Edit:
            from runtime.takes import drive_edits

            return drive_edits.with_prompt(drive, self._style(frame, text, None))

        self._again(f"prompt {_short(text)}", edit)

    def _style(self, frame: int, request: Request, known: Answer | None) -> StyleChange:
        """The style of a request from a frame on; waits for the answer."""
        from runtime.takes.drive import StyleChange

        answer, seconds = self.prompting.answer(request), self.takes.settings.blend_seconds
        if isinstance(request, PartDescriptions):
            base = known or dataclasses.replace(answer, prompt="")
            answer = dataclasses.replace(base, words=answer.words, z=answer.z)
        style = StyleEdit((answer, None))
        event = PromptEvent(0.0, style.prompt_text, seconds, style.spelled_out(), style.typed())
        return StyleChange(frame, np.array(answer.z, np.float32), seconds, event, style)

    # --- spans

    def insert_gait(self, gait: Gait) -> None:
        """Another gait from the frame shown to the end of the gait there."""
        playback, tracks = self.state.playback, self.tracks
        if playback is None or tracks is None:
            return
        frame = playback.frame
        end = next((b.span.end for b in tracks.gaits if b.span.start <= frame < b.span.end), playback.frames)

        def edit(drive: Drive) -> Edit:
            from runtime.takes import drive_edits

            return drive_edits.with_gait(drive, frame, end - 1, gait)

        self._again(f"gait {gait.label}", edit)

    def move(self, track: str, index: int, start: int, end: int) -> None:
        """A span of the track "prompts" or "gaits" goes to other frames, at the cost of its neighbours."""

        def edit(drive: Drive) -> Edit:
            from runtime.takes import drive_edits

            change = drive_edits.move_prompt if track == "prompts" else drive_edits.move_gait
            return change(drive, index, start, end)

        self._again("move of a prompt" if track == "prompts" else "move of a gait", edit)

    # --- driving again

    def _again(self, label: str, edit: Callable[[Drive], Edit]) -> None:
        """Drive the take that plays again by the recorded stick after an edit of its drive."""

        def work(
            driven: Clip, drive: Drive, maker: Drivable, progress: Callable[[float], None]
        ) -> tuple[Clip, Drive]:
            from runtime.takes.drive import played_again

            made = edit(drive)
            return played_again(driven, made.drive, maker, made.first, progress)

        self.run(label, work)

    def run(self, label: str, work: Work) -> None:
        """Drive the take that plays again by `work`, on a worker thread."""
        item = self.state.played
        if item is None or item.drive is None or item.maker is None or self.busy:
            self.messages.warn(self.fixed)
            return
        clip, driven, drive, maker = item.clip, item.driven, item.drive, item.maker
        edits, self.progress = item.edits, 0.0

        def made() -> Edited:
            base, again = work(driven, drive, maker.twin(), self._note_progress)
            self.left_out = unfitted(base, edits.plants)
            return edits.apply(base), again, base

        self.takes.jobs.submit(SLOT, made, lambda result: self._take(item, clip, result, label))

    def _note_progress(self, share: float) -> None:
        self.progress = share

    def _take(self, item: ClipItem, before: Clip, made: Edited, label: str) -> None:
        if item.clip is before:  # not undone meanwhile
            clip, drive, base = made
            item.edit(clip, drive, label, base if item.edits else None, item.edits)
            self.show(item)
            text = f"{item.name}: {label}. Ctrl+Z brings the version before back."
            if self.left_out:
                count = "One changed plant" if self.left_out == 1 else f"{self.left_out} changed plants"
                self.messages.warn(f"{count} of {item.name} left out: the steps are others now. {text}")
            else:
                self.messages.note(text)

    def keep_trim(self) -> None:
        """Make what the trim marks became a step of undo."""
        item, playback = self.state.played, self.state.playback
        if item is not None and playback is not None and playback.keep_trim(len(item.older)):
            self.messages.note(
                f"{item.name}: frames {playback.first} to {playback.last} play and are exported. Ctrl+Z undoes it."
            )

    @property
    def undo_labels(self) -> tuple[str, str]:
        """What undo would take back and redo do again; "" for nothing."""
        item, playback = self.state.played, self.state.playback
        if item is None or playback is None:
            return "", ""
        count = len(item.older)
        trims, undone = (
            steps and steps[-1].versions == count for steps in (playback.trims, playback.undone_trims)
        )
        return "trim" if trims else item.undo_label, "trim" if undone else item.redo_label

    def undo(self) -> None:
        """Back to the trim or version before the last edit of the take that plays."""
        item, playback = self.state.played, self.state.playback
        if item is not None and playback is not None and playback.undo_trim(len(item.older)):
            self.messages.note(f"{item.name}: undone: trim.")
        elif item is not None and item.undo_label:
            label = item.undo_label
            item.undo()
            self.show(item)
            self.messages.note(f"{item.name}: undone: {label}.")

    def redo(self) -> None:
        """On to the trim or version that was undone last."""
        item, playback = self.state.played, self.state.playback
        if item is not None and playback is not None and playback.redo_trim(len(item.older)):
            self.messages.note(f"{item.name}: done again: trim.")
        elif item is not None and item.redo_label:
            item.redo()
            self.show(item)
            self.messages.note(f"{item.name}: done again: {item.label}.")

    def show(self, item: ClipItem) -> None:
        """Another version of a take is there; where it plays, that is shown."""
        playback = self.state.playback
        if playback is not None and self.state.played is item:
            playback.show(item.clip)

    # --- going on

    def go_on(self) -> None:
        """Drive the live character from the frame shown, with the take's ground and prompt."""
        item, playback = self.state.played, self.state.playback
        if item is None or playback is None or self.fixed:
            self.messages.warn(self.fixed)
            return
        if item.maker is not self.stage.state.controller:
            self.messages.warn(f"{item.name} was made with another model than the one that is loaded.")
            return
        drive, maker, frame = item.drive, item.maker, playback.frame

        def work() -> tuple[Snapshot, Pose]:
            from runtime.takes.drive import redrive

            assert drive is not None
            assert maker is not None
            twin = maker.twin()
            poses, _ = redrive(drive, twin, frame, frame)
            return take_snapshot(twin), poses[-1]  # type: ignore[arg-type]

        self.takes.jobs.submit(SLOT, work, lambda made: self._go_on(item, frame, *made))

    def _go_on(self, item: ClipItem, frame: int, snapshot: Snapshot, pose: Pose) -> None:
        if item.drive is None:
            return
        self.stage.go_on_from(snapshot, pose, item.drive.ground(frame))
        style = _style_at(item.drive, frame)
        if style is not None:
            self.prompting.adopt(style.note or StyleEdit((_answer_of(style), None)), f"take {item.name}")
            self.takes.mark_style_in_force(style)
        self.state.playback = None
        self.messages.note(f"Live from frame {frame} of {item.name}.")


def _style_at(drive: Drive, frame: int) -> StyleChange | None:
    from runtime.takes.drive_edits import prompt_spans

    spans: list[PromptSpan] = [s for s in prompt_spans(drive) if s.start <= frame]
    changes = [c for c in spans[-1].changes if c.frame <= frame] if spans else []
    return changes[-1] if changes else None


def _answer_of(style: StyleChange) -> Answer | None:
    """The answer that a style came from; from its six descriptions where nothing else was kept."""
    if isinstance(style.note, StyleEdit):
        return style.note.a if style.note.b is None else None
    words = words_of(style.event)
    if words is None or isinstance(style.z, StyleMix):
        return None
    return Answer(title(style.event), words, words, np.array(style.z, np.float32))


def _short(text: str) -> str:
    return text if len(text) <= MAX_LABEL else text[: MAX_LABEL - 1] + "…"
