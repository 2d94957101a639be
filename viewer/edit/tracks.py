"""What lies on the tracks of a take: prompts, what each body part does, gaits and grounds, and lanes of its pins."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from runtime.controls import Gait
from runtime.errors import SportError
from runtime.prompts.blend import BlendedPrompt, Words, read_words
from runtime.prompts.parts import PartDescriptions
from runtime.skeleton import PART_NAMES
from runtime.takes.clip import Clip
from runtime.takes.input_edits import PromptSpan, gait_spans, prompt_spans
from runtime.takes.input_recording import GroundChange, InputRecording, StyleChange
from runtime.takes.metadata import PromptEvent, title
from runtime.takes.pins import Pin
from viewer.edit.items import Item, Mark


@dataclass(frozen=True, eq=False)
class Tracks:
    """What lies on the tracks of one version of a take's motion; a prompt's mark is `of` its `PromptSpan`."""

    clip: Clip
    prompts: tuple[Mark, ...]
    parts: dict[str, tuple[Mark, ...]]
    gaits: tuple[Mark, ...]
    grounds: tuple[Mark, ...]


def tracks_of(clip: Clip, inputs: InputRecording | None) -> Tracks:
    """Return the tracks of a clip; without inputs, what its file says."""
    spans = _read_spans(clip) if inputs is None else prompt_spans(inputs)
    gaits = () if clip.gaits is None else [s for s in gait_spans(clip.gaits) if s.gait >= 0]
    return Tracks(
        clip,
        tuple(
            Mark(s.start, s.end, title(s.event), of=s, item=Item(s.start, s.end, "prompts", s)) for s in spans
        ),
        {part: _part(spans, part) for part in PART_NAMES},
        tuple(
            Mark(s.start, s.end, Gait(s.gait).label.capitalize(), item=Item(s.start, s.end, "gaits", s))
            for s in gaits
        ),
        _grounds(clip, inputs),
    )


def mark_at(marks: Sequence[Mark], frame: int) -> int:
    """Return which mark holds in a frame; -1 for none."""
    return next((i for i, mark in enumerate(marks) if mark.start <= frame < mark.end), -1)


def words_of(event: PromptEvent) -> PartDescriptions | None:
    """Return the six descriptions that a prompt meant; None for a blend, or where they are not known."""
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


def _part(spans: list[PromptSpan], part: str) -> tuple[Mark, ...]:
    """Return the marks of one part's descriptions; neighbours with the same text are one."""
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
    """Return the pins by their places, such that those of a lane do not overlap."""
    found: list[list[int]] = []
    for i in sorted(range(len(pins)), key=lambda i: pins[i].start):
        lane = next((lane for lane in found if pins[lane[-1]].end <= pins[i].start), None)
        if lane is None:
            found.append([i])
        else:
            lane.append(i)
    return found
