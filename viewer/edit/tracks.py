"""Items on the tracks of a take and in the list of takes, and marks of prompts, body parts, gaits and grounds."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from runtime.controls import Gait
from runtime.errors import SportError
from runtime.prompts.blend import BlendedPrompt, Words, read_words
from runtime.prompts.parts import PartDescriptions
from runtime.session.session import Session
from runtime.skeleton import PART_NAMES
from runtime.takes.clip import Clip
from runtime.takes.input_edits import Edit, PromptSpan, Span, gait_spans, prompt_spans
from runtime.takes.input_recording import GroundChange, InputRecording, StyleChange
from runtime.takes.metadata import PromptEvent, title
from runtime.takes.pins import Pin

Key = tuple[str, Hashable, int]
TAKES, PINS = "takes", "pins"


@dataclass(frozen=True)
class Item(Span):
    """An item on a track: a frame range, or a point if start equals end; `value` is its content, `lane` its row."""

    kind: str
    value: Any = field(compare=False)
    lane: Hashable = ""

    @property
    def key(self) -> Key:
        """The identity of an item: its kind, lane and start frame; takes and pins by their lane alone."""
        return self.kind, self.lane, 0 if self.kind in (TAKES, PINS) else self.start

    def at(self, start: int, end: int) -> Item:
        """Return the item at other frames."""
        return replace(self, start=start, end=end)


@dataclass(frozen=True)
class Mark(Span):
    """A drawn range or point on a track; `of` is what it represents, `item` the selectable item if any."""

    text: str = ""
    hint: str = ""
    of: Any = None
    item: Item | None = None


Items = Sequence[Item]


@dataclass(frozen=True)
class ItemKind:
    """How the selection edits one kind of items.

    An edit removes items (`gone`) and adds others (`put`); moved items have the same order in both. `change` applies it to a
    take of the session, by number, and returns what was added; `edit` applies it to the take's input, then resimulated.
    """

    name: str  # of a single item, for the user
    items: Callable[[], Items]
    change: Callable[[Session, int, Items, Items], tuple[Session, Items]] | None = None
    edit: Callable[[InputRecording, Items, Items], Edit] | None = None
    # adjacent: each ends where the next one begins, and the first and last with the take
    adjacent: bool = False
    listed: bool = False  # in a list, by position, instead of on a track by frame


@dataclass(frozen=True, eq=False)
class Tracks:
    """The tracks of a version of a take's motion; a prompt's mark is `of` its `PromptSpan`."""

    clip: Clip
    prompts: tuple[Mark, ...]
    parts: dict[str, tuple[Mark, ...]]
    gaits: tuple[Mark, ...]
    grounds: tuple[Mark, ...]


def tracks_of(clip: Clip, inputs: InputRecording | None) -> Tracks:
    """Return the tracks of a clip; without inputs, from its file's metadata."""
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
    """Return the index of the mark at a frame, or -1."""
    return next((i for i, mark in enumerate(marks) if mark.start <= frame < mark.end), -1)


def words_of(event: PromptEvent) -> PartDescriptions | None:
    """Return the six descriptions of a prompt event; None for a blend or if they are unknown."""
    words = _words(event)
    return words if isinstance(words, PartDescriptions) else None


def _words(event: PromptEvent) -> Words | BlendedPrompt | None:
    try:
        return read_words(event.words) if event.words else None
    except SportError:  # in a hand-written file
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
    """Return the indices of the pins by lane; pins in a lane do not overlap."""
    found: list[list[int]] = []
    for i in sorted(range(len(pins)), key=lambda i: pins[i].start):
        lane = next((lane for lane in found if pins[lane[-1]].end <= pins[i].start), None)
        if lane is None:
            found.append([i])
        else:
            lane.append(i)
    return found
