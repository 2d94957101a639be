"""Edits of a take's input: prompts and gaits as spans that are reworded, moved and inserted.

Each edit returns another `InputRecording` and the first frame that it changes; `inputs.resimulated_take` makes the frames.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import chain, pairwise
from math import hypot

import numpy as np
from numpy.typing import NDArray

from runtime.controls import Controls, Gait
from runtime.errors import UsageError
from runtime.takes.input_recording import InputFrame, InputFrames, InputRecording, StyleChange
from runtime.takes.metadata import PromptEvent, gait_of
from runtime.takes.recorder import follows_live

SETTLE_STEPS = 60  # before the clip, in which hands reach the place given by a new prompt
SLIVER_FRAMES = 6  # a shorter remainder of a covered span is invisible and is merged into its neighbour
JUMP_FRAMES = 3  # length of a key press; the controller then jumps by itself


@dataclass(frozen=True)
class Edit:
    """Edited inputs, and the first frame that may differ."""

    inputs: InputRecording
    first: int


@dataclass(frozen=True)
class Span:
    """A range of frames from `start` up to, but not including, `end`."""

    start: int
    end: int


@dataclass(frozen=True, eq=False)
class PromptSpan(Span):
    """A prompt with its duration; a slider's movement is one span of many changes."""

    changes: tuple[StyleChange, ...]

    @property
    def event(self) -> PromptEvent:
        """The prompt in force at the end of the span."""
        return self.changes[-1].event


@dataclass(frozen=True)
class GaitSpan(Span):
    """A requested gait with its duration; `Gait.STAND` if the stick is at rest."""

    gait: int  # a `Gait`; -1 if unknown


def prompt_spans(inputs: InputRecording) -> list[PromptSpan]:
    """Return the prompt spans of the clip, first to last."""
    groups: list[list[StyleChange]] = []
    for change in inputs.changes:
        if isinstance(change, StyleChange) and change.frame < len(inputs):
            begun = groups and (groups[-1][0].frame, groups[-1][-1].event)
            if begun and follows_live(begun, change.frame, change.seconds):
                groups[-1].append(change)
            else:
                groups.append([change])
    starts = [max(group[0].frame, 0) for group in groups]
    ends = [*starts[1:], len(inputs)]
    spans = zip(starts, ends, groups, strict=True)
    return [PromptSpan(start, end, tuple(group)) for start, end, group in spans if end > start]


def gait_spans(gaits: NDArray[np.integer]) -> list[GaitSpan]:
    """Return the spans of equal gait numbers in `(T,)`."""
    return [GaitSpan(block.start, block.end, block.of) for block in _blocks(gaits)]


def reworded(inputs: InputRecording, span: PromptSpan, style: StyleChange) -> Edit:
    """Replace the style of a prompt span from its first frame on.

    At the start of the clip the new style is in force at once: it blends in during hidden frames before.
    """
    if span.start > 0:
        return _with_styles(inputs, span.changes, [replace(style, frame=span.start)], span.start)
    # a keyframe's own frame is already simulated
    at = max(-SETTLE_STEPS, inputs.start + 1) if inputs.start < 0 else 0
    styles = [change for change in inputs.changes if isinstance(change, StyleChange)]
    old = [c for c in styles if at <= c.frame and (c.frame <= 0 or any(c is own for own in span.changes))]
    return _with_styles(inputs, old, [replace(style, frame=at, seconds=0.0)], 0)


def with_prompt(inputs: InputRecording, style: StyleChange) -> Edit:
    """Insert a style that lasts from its frame to the next prompt."""
    _check_frame(inputs, style.frame)
    for span in prompt_spans(inputs):
        if span.start == style.frame:
            return reworded(inputs, span, style)
    return _with_styles(inputs, (), [style], style.frame)


@dataclass(frozen=True)
class Block(Span):
    """A range of frames with the index `of` of the span that it belongs to, old spans first, then added ones."""

    of: int


def laid(spans: Sequence[Span], gone: Sequence[int], put: Sequence[Span]) -> list[Block]:
    """Return the blocks of a gapless track after removing spans `gone` (indices) and laying spans `put` over it.

    Frames of removed spans go to the span before, at the start to the one after. Added spans are numbered after those
    of the track. Remains too short to be useful are merged away.
    """
    frames = spans[-1].end
    owner = np.repeat(np.arange(len(spans)), [span.end - span.start for span in spans])
    kept = np.flatnonzero(~np.isin(owner, gone))
    if len(kept):
        owner = owner[kept[np.maximum(np.searchsorted(kept, np.arange(frames), side="right") - 1, 0)]]
    for number, span in enumerate(put, len(spans)):
        owner[max(span.start, 0) : max(span.end, 0)] = number
    blocks = _blocks(owner)
    for block in blocks:
        own = spans[block.of] if block.of < len(spans) else block
        if block.end - block.start < min(SLIVER_FRAMES, own.end - own.start) and len(blocks) > 1:
            owner[block.start : block.end] = owner[block.start - 1 if block.start else block.end]
    return _blocks(owner)


def _blocks(owner: NDArray[np.integer]) -> list[Block]:
    cuts = [0, *(np.flatnonzero(np.diff(owner)) + 1).tolist(), len(owner)]
    return [Block(a, b, int(owner[a])) for a, b in pairwise(cuts) if b > a]


def prompts_laid(inputs: InputRecording, gone: Sequence[int], put: Sequence[PromptSpan]) -> Edit:
    """Remove prompts and lay others over the rest; see `laid`."""
    spans = prompt_spans(inputs)
    known, blocks = [*spans, *put], laid(spans, gone, put)
    new = _changes_of(blocks, known)
    old = [change for span in spans for change in span.changes]
    first = known[blocks[0].of]
    if first is not spans[0]:  # it takes effect before the clip, in place of the first one
        new = [*spans[0].changes, *(change for change in new if change.frame > 0)]
    changed = [c.frame for c in (*old, *new) if (c in old) is not (c in new)]
    edit = _with_styles(inputs, old, new, min(changed, default=len(inputs)))
    return edit if first is spans[0] else reworded(edit.inputs, spans[0], first.changes[-1])


def _changes_of(blocks: Sequence[Block], known: Sequence[PromptSpan]) -> list[StyleChange]:
    """Return the style changes of blocks, moved to their starts; a part behind another prompt keeps the span's last change."""
    seen, new = set[int](), list[StyleChange]()
    for block in blocks:
        changes = known[block.of].changes[-1:] if block.of in seen else known[block.of].changes
        seen.add(block.of)
        by = block.start - max(changes[0].frame, 0)
        moved = (replace(c, frame=c.frame + by) if by else c for c in changes)
        new += [c for c in moved if c.frame < block.end]
    return new


def with_gait(inputs: InputRecording, first: int, last: int, gait: Gait) -> Edit:
    """Request another gait in frames `first` to `last`; a jump is pressed for `JUMP_FRAMES`.

    Where the stick is at rest, a moving gait pushes it fully in its last direction; standing releases it.
    """
    _check_frame(inputs, first)
    last = min(last, len(inputs) - 1)
    if gait is Gait.JUMP:
        last = min(last, first + JUMP_FRAMES - 1)
    if last < first:
        raise UsageError(f"gait from frame {first} to {last}: no frame.", "Choose a later end.")
    start, end = first - inputs.start, last + 1 - inputs.start
    before, changed = inputs.frames[:start], list[InputFrame]()
    for frame in inputs.frames[start:end]:
        changed.append(_requested(frame, gait, chain(reversed(changed), reversed(before))))
    frames = before + InputFrames.of(changed) + inputs.frames[end:]
    return Edit(replace(inputs, frames=frames), first)


def gaits_laid(inputs: InputRecording, gone: Sequence[int], put: Sequence[GaitSpan]) -> Edit:
    """Remove gaits and lay others over the rest; see `laid`."""
    now = inputs.gaits()
    spans = gait_spans(now)
    known, wanted = [*spans, *put], now.copy()
    for block in laid(spans, gone, put):
        wanted[block.start : block.end] = known[block.of].gait
    edit = Edit(inputs, len(inputs))
    for span in gait_spans(np.where(wanted == now, -1, wanted)):
        if span.gait >= 0:
            changed = with_gait(edit.inputs, span.start, span.end - 1, Gait(span.gait))
            edit = Edit(changed.inputs, min(edit.first, span.start))
    return edit


def _requested(frame: InputFrame, gait: Gait, before: Iterable[InputFrame]) -> InputFrame:
    """Return a frame with another gait; `before` are the frames before it, the last one first."""
    old = frame.controls
    if gait is Gait.STAND:
        requested = Controls((0.0, 0.0), old.facing, Gait.WALK)
    elif any(old.move) or gait is Gait.JUMP:
        requested = replace(old, gait=gait)
    else:
        requested = Controls(_pointed(before), old.facing, gait)
    return replace(frame, controls=requested)


def _pointed(before: Iterable[InputFrame]) -> tuple[float, float]:
    """Return the last direction of the stick, at full length; +Z if it was never moved."""
    for frame in before:
        x, z = frame.controls.move
        length = hypot(x, z)
        if length > 0.0 and gait_of(frame.controls) != Gait.STAND:
            return x / length, z / length
    return 0.0, 1.0


def _with_styles(
    inputs: InputRecording, old: Sequence[StyleChange], new: Sequence[StyleChange], first: int
) -> Edit:
    kept = [change for change in inputs.changes if all(change is not gone for gone in old)]
    # stable: the others keep their order
    changes = tuple(sorted([*kept, *new], key=lambda change: change.frame))
    return Edit(replace(inputs, changes=changes), max(first, 0))


def _check_frame(inputs: InputRecording, frame: int) -> None:
    if not 0 <= frame < len(inputs):
        raise UsageError(f"frame {frame}: the take has frames 0 to {len(inputs) - 1}.", "Choose one of them.")
