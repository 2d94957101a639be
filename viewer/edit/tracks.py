"""What lies on the tracks of a timeline, as plain data: prompts, the words of each part, gaits and grounds."""

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
from runtime.takes.input_edits import GaitSpan, PromptSpan, Span, gait_spans, prompt_spans
from runtime.takes.input_recording import GroundChange, InputRecording, StyleChange
from runtime.takes.metadata import PromptEvent, title
from runtime.takes.pins import Pin


@dataclass(frozen=True)
class LabelledSpan:
    """A labelled span; `hint` is what the mouse finds out about it."""

    span: Span
    text: str
    hint: str = ""


@dataclass(frozen=True)
class Tracks:
    """Everything on the timeline of one version of a take."""

    clip: Clip
    prompts: tuple[LabelledSpan, ...]
    parts: dict[str, tuple[LabelledSpan, ...]]
    gaits: tuple[LabelledSpan, ...]
    grounds: tuple[LabelledSpan, ...]

    def prompt_at(self, frame: int) -> int:
        """Which prompt holds in a frame; -1 for none."""
        return next((i for i, b in enumerate(self.prompts) if b.span.start <= frame < b.span.end), -1)


def tracks_of(clip: Clip, inputs: InputRecording | None) -> Tracks:
    """The tracks of a clip; without inputs, what its file says."""
    spans = _read_spans(clip) if inputs is None else prompt_spans(inputs)
    return Tracks(
        clip,
        tuple(LabelledSpan(s, title(s.event), _hint(s.event)) for s in spans),
        {part: _part(spans, part) for part in PART_NAMES},
        tuple(LabelledSpan(s, _gait(s)) for s in _gaits(clip)),
        _grounds(clip, inputs),
    )


def words_of(event: PromptEvent) -> PartDescriptions | None:
    """The six descriptions that a prompt meant; None for a blend, or where they are not known."""
    words = _words(event)
    return words if isinstance(words, PartDescriptions) else None


def _words(event: PromptEvent) -> Words | BlendedPrompt | None:
    try:
        return read_words(event.words) if event.words else None
    except SportError:  # of a file that somebody wrote by hand
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
    lines = [f"{name.replace('_', ' ')}: {said}" for name, said in words.to_mapping().items()]
    return "\n".join([title(event), *lines])


def _part(spans: list[PromptSpan], part: str) -> tuple[LabelledSpan, ...]:
    """Spans of one part's words; neighbours that say the same are one."""
    bars: list[LabelledSpan] = []
    for span in spans:
        words = _words(span.event)
        text = (
            str(getattr(words, part)) if isinstance(words, PartDescriptions) else "a blend" if words else ""
        )
        if bars and bars[-1].text == text:
            bars[-1] = LabelledSpan(Span(bars[-1].span.start, span.end), text, text)
        else:
            bars.append(LabelledSpan(Span(span.start, span.end), text, text))
    return tuple(bar for bar in bars if bar.text)


def _gaits(clip: Clip) -> list[GaitSpan]:
    return [] if clip.gaits is None else [s for s in gait_spans(clip.gaits) if s.gait >= 0]


def _gait(span: GaitSpan) -> str:
    return Gait(span.gait).label.capitalize()


def _grounds(clip: Clip, inputs: InputRecording | None) -> tuple[LabelledSpan, ...]:
    changes = [c for c in inputs.changes if isinstance(c, GroundChange)] if inputs is not None else []
    if not changes:
        return (LabelledSpan(Span(0, len(clip)), _short(clip.terrain), clip.terrain),)
    starts = [max(change.frame, 0) for change in changes]
    spans = zip(starts, [*starts[1:], len(clip)], changes, strict=True)
    return tuple(LabelledSpan(Span(a, b), _short(c.name), c.name) for a, b, c in spans if b > a)


def _short(spec: str) -> str:
    return Path(spec).name.replace("_", " ").capitalize() if "." not in spec else Path(spec).name


def lanes(pins: Sequence[Pin]) -> list[list[int]]:
    """Pins by their places, such that those of a lane do not overlap."""
    found: list[list[int]] = []
    for i in sorted(range(len(pins)), key=lambda i: pins[i].start):
        free = (lane for lane in found if pins[lane[-1]].end <= pins[i].start)
        lane = next(free, None)
        if lane is None:
            found.append([i])
        else:
            lane.append(i)
    return found
