"""The tracks of the take that plays: prompts, what each body part does, gaits, grounds, camera keys, pins and footplants."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from runtime.controls import Gait
from runtime.errors import SportError
from runtime.prompts.blend import BlendedPrompt, Words, read_words
from runtime.prompts.parts import PartDescriptions
from runtime.session.session import Take
from runtime.skeleton import PART_NAMES
from runtime.takes.clip import Clip
from runtime.takes.input_edits import PromptSpan, gait_spans, prompt_spans
from runtime.takes.input_recording import GroundChange, InputRecording, StyleChange
from runtime.takes.metadata import PromptEvent, title
from runtime.takes.pins import Pin
from viewer.edit.timeline import Mark, Track
from viewer.gl_bindings import imgui
from viewer.gui import theme
from viewer.session.playback import Playback

if TYPE_CHECKING:
    from viewer.edit.camera_keys import CameraKeys
    from viewer.edit.pins import Pins
    from viewer.edit.resimulation import Resimulation

PROMPTS, ROW, FEET = 21.0, 15.0, 8.0  # heights at scale 1, where there is no more room
PROMPT_TINTS = (theme.ACCENT_FILL, (0.36, 0.55, 0.78, 0.42))
GAIT_TINT, GROUND_TINT = (0.78, 0.62, 0.34, 0.42), (0.55, 0.58, 0.62, 0.35)
PART_TINT, PIN_TINT = (0.36, 0.55, 0.78, 0.28), (0.86, 0.48, 0.62, 0.45)
NEW_FOOTPLANT_FRAMES = 8
CAMERA_HINT = "Views of the camera, for a film by “keyed”.\nDrag a key; right-click removes it"
PIN_HINT = "A click shows the pin's fields; drag it or its ends"
FEET_HINT = (
    "When a foot bears: the left one above, the right one below.\n"
    "Drag a footplant or its ends; right-click adds or removes one"
)


@dataclass(frozen=True, eq=False)
class Tracks:
    """What lies on the tracks of one version of a take's motion; a prompt's mark is `of` its `PromptSpan`."""

    clip: Clip
    prompts: tuple[Mark, ...]
    parts: dict[str, tuple[Mark, ...]]
    gaits: tuple[Mark, ...]
    grounds: tuple[Mark, ...]


def tracks_of(clip: Clip, inputs: InputRecording | None) -> Tracks:
    """The tracks of a clip; without inputs, what its file says."""
    spans = _read_spans(clip) if inputs is None else prompt_spans(inputs)
    gaits = () if clip.gaits is None else [s for s in gait_spans(clip.gaits) if s.gait >= 0]
    return Tracks(
        clip,
        tuple(Mark(s.start, s.end, title(s.event), _hint(s.event), s) for s in spans),
        {part: _part(spans, part) for part in PART_NAMES},
        tuple(Mark(s.start, s.end, Gait(s.gait).label.capitalize()) for s in gaits),
        _grounds(clip, inputs),
    )


def mark_at(marks: Sequence[Mark], frame: int) -> int:
    """Which mark holds in a frame; -1 for none."""
    return next((i for i, mark in enumerate(marks) if mark.start <= frame < mark.end), -1)


def words_of(event: PromptEvent) -> PartDescriptions | None:
    """The six descriptions that a prompt meant; None for a blend, or where they are not known."""
    words = _words(event)
    return words if isinstance(words, PartDescriptions) else None


def _words(event: PromptEvent) -> Words | BlendedPrompt | None:
    try:
        return read_words(event.words) if event.words else None
    except SportError:  # of a file that was written by hand
        return None


def _read_spans(clip: Clip) -> list[PromptSpan]:
    starts = [max(round(event.seconds * clip.fps), 0) for event in clip.prompts]
    ends = [*starts, len(clip)][1:]
    return [
        PromptSpan(start, end, (StyleChange(start, np.zeros(0), event.transition_seconds, event),))
        for start, end, event in zip(starts, ends, clip.prompts, strict=True)
        if end > start
    ]


def _hint(event: PromptEvent) -> str:
    words = words_of(event)
    if words is None:
        return title(event)
    lines = [f"{name.replace('_', ' ')}: {text}" for name, text in words.to_mapping().items()]
    return "\n".join([title(event), *lines])


def _part(spans: list[PromptSpan], part: str) -> tuple[Mark, ...]:
    """Marks of one part's descriptions; neighbours with the same text are one."""
    marks: list[Mark] = []
    for span in spans:
        words = _words(span.event)
        blend = "a blend" if words else ""
        text = str(getattr(words, part)) if isinstance(words, PartDescriptions) else blend
        joins = bool(marks) and marks[-1].text == text
        start = marks.pop().start if joins else span.start
        marks.append(Mark(start, span.end, text))
    return tuple(mark for mark in marks if mark.text)


def _grounds(clip: Clip, inputs: InputRecording | None) -> tuple[Mark, ...]:
    changes = [c for c in inputs.changes if isinstance(c, GroundChange)] if inputs is not None else []
    names = [change.name for change in changes] or [clip.terrain]
    starts = [max(change.frame, 0) for change in changes] or [0]
    spans = zip(starts, [*starts[1:], len(clip)], names, strict=True)
    return tuple(Mark(a, b, _short(name), name) for a, b, name in spans if b > a)


def _short(spec: str) -> str:
    return Path(spec).name.replace("_", " ").capitalize() if "." not in spec else Path(spec).name


def lanes(pins: Sequence[Pin]) -> list[list[int]]:
    """Pins by their places, such that those of a lane do not overlap."""
    found: list[list[int]] = []
    for i in sorted(range(len(pins)), key=lambda i: pins[i].start):
        lane = next((lane for lane in found if pins[lane[-1]].end <= pins[i].start), None)
        if lane is None:
            found.append([i])
        else:
            lane.append(i)
    return found


def extra_rows(take: Take | None, parts: bool) -> int:
    """How many tracks a take has besides those that every one has."""
    own = 0 if take is None else len(lanes(take.poses.pins)) + bool(take.cameras)
    return own + (len(PART_NAMES) if parts else 0)


class TakeTracks:
    """Gathers the tracks of all tools; the same ones again until something changes."""

    def __init__(self, editing: Resimulation, pins: Pins, cameras: CameraKeys) -> None:
        self.editing, self.pins, self.cameras = editing, pins, cameras
        self._state: tuple[Any, ...] = ()
        self._rows: list[Track] = []

    def rows(self, tracks: Tracks, playback: Playback) -> list[Track]:
        """The tracks from top to bottom."""
        editing, pins, frame = self.editing, self.pins, playback.frame
        fixed, lit = bool(editing.fixed), (mark_at(tracks.prompts, frame), mark_at(tracks.gaits, frame))
        state = tracks, playback.take, playback.shown, pins.selected, editing.part_tracks, fixed, lit
        if len(state) != len(self._state) or any(
            a is not b and a != b for a, b in zip(state, self._state, strict=True)
        ):
            self._state, self._rows = state, [*self._of_motion(tracks, lit, fixed), *self._of_edits(playback)]
        return self._rows

    def _of_motion(self, tracks: Tracks, lit: tuple[int, int], fixed: bool) -> list[Track]:
        editing = self.editing
        parts = [
            Track(f"track {part}", part.replace("_", " ").capitalize(), ROW, tracks.parts[part], (PART_TINT,))
            for part in (PART_NAMES if editing.part_tracks else ())
        ]
        return [
            Track(
                "prompts", "Prompts", PROMPTS, tracks.prompts, PROMPT_TINTS, lit=lit[0], adjacent=True,
                fixed=fixed, drop=editing.move_prompt,
            ),
            *parts,
            Track(
                "gaits", "Gait", ROW, tracks.gaits, (GAIT_TINT,), lit=lit[1], adjacent=True, fixed=fixed,
                drop=editing.move_gait,
            ),
            # one ground all the way says the least
            Track(
                "grounds", "Ground", ROW, tracks.grounds, (GROUND_TINT,), fixed=True,
                optional=len(tracks.grounds) == 1,
            ),
        ]  # fmt: skip

    def _of_edits(self, playback: Playback) -> list[Track]:
        take, fps, pins, cameras = playback.take, playback.clip.fps, self.pins, self.cameras
        keys = [Mark(at, at, of=key) for key in take.cameras for at in (round(key.seconds * fps),)]
        rows = []
        if keys:
            rows.append(
                Track(
                    "camera", "Camera", ROW, keys, (theme.ACCENT,), CAMERA_HINT,
                    press=lambda mark: playback.seek(mark.start), remove=lambda mark: cameras.remove(mark.of),
                    move=lambda mark, start, _: cameras.move(mark.of, start),
                )
            )  # fmt: skip
        for number, lane in enumerate(lanes(take.poses.pins)):
            marks = [_pin(i, take.poses.pins[i], playback) for i in lane]
            lit = lane.index(pins.selected) if pins.selected in lane else -1
            rows.append(
                Track(
                    f"pins {number}", "" if number else "Pins", ROW, marks, (PIN_TINT,), PIN_HINT, lit,
                    press=lambda mark: pins.select(mark.of[0]), move=pins.move,
                )
            )  # fmt: skip
        return [*rows, self._feet(0), self._feet(1)]

    def _feet(self, foot: int) -> Track:
        pins = self.pins
        marks = [Mark(first, end, of=(first, end)) for first, end in pins.footplants(foot)]

        def menu(mark: Mark | None, frame: int) -> None:
            half = NEW_FOOTPLANT_FRAMES // 2
            if mark is not None and imgui.menu_item("Lift the foot here", "", False)[0]:
                pins.set_footplant(foot, mark.of, None)
            if mark is None and imgui.menu_item("Plant the foot here", "", False)[0]:
                pins.set_footplant(foot, None, (frame - half, frame + half))

        def move(mark: Mark, start: int, end: int) -> None:
            pins.set_footplant(foot, mark.of, (start, end))

        name, fixed = "" if foot else "Feet", bool(pins.fixed)
        return Track(
            f"foot {foot}", name, FEET, marks, (theme.ACCENT,), FEET_HINT, fixed=fixed, move=move, menu=menu
        )


def _pin(index: int, pin: Pin, playback: Playback) -> Mark:
    """The mark of a pin, `of` its place and itself; its last frame is in it."""
    fps = playback.clip.fps
    text = f"{pin.what}" + (" on a rail" if pin.rail else " along" if pin.along else "")
    start, last = round(pin.start * fps), round(pin.end_in(playback.clip.seconds) * fps)
    return Mark(start, max(last, start) + 1, text.capitalize(), of=(index, pin))
