"""What must be true of the records of a session besides the types of their fields."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

from runtime.character.character import NAMED_UNITS
from runtime.motion.control_scripts import MAX_POINTS
from runtime.safe_read import parse_json
from runtime.session.character_files import safe_name
from runtime.session.document import MAX_FRAMES
from runtime.session.motion import MotionHeader
from runtime.session.prompt_blend import Answer, PromptBlend
from runtime.session.session import LIVE, MAX_RATING, CharacterChoice, Session, Take
from runtime.skeleton import PART_NAMES
from runtime.takes.camera_keys import MAX_KEYS
from runtime.takes.clip import MAX_FPS, MAX_SIZE, MIN_SIZE
from runtime.takes.footplants import MAX_FRAME, FootplantEdit
from runtime.takes.metadata import PromptEvent
from runtime.takes.pins import MAX_PINS

MAX_VARIANTS, MAX_NEAREST = 9, 20
SOURCES = ("library", "gpt", "explicit")


def checked_record(record: Any) -> Any:
    """A record that was read, with what may be mended mended; ValueError, UsageError for what no session holds."""
    for what, holds in _RULES.get(type(record), ()):
        if not holds(record):
            raise ValueError(what)
    return _MENDED.get(type(record), lambda same: same)(record)


def _numbers(session: Session) -> list[int]:
    return [take.number for take in session.takes]


def _few_edits(take: Take) -> bool:
    edits = take.poses.pins, take.poses.footplants, take.poses.layer.keys
    return len(take.cameras) <= MAX_KEYS and len(take.path) <= MAX_POINTS and max(map(len, edits)) <= MAX_PINS


def _on_a_foot(edit: FootplantEdit) -> bool:
    spans = [span for span in (edit.old, edit.new) if span is not None]
    return edit.foot in (0, 1) and all(first < end < MAX_FRAME for first, end in spans)


def _mended_session(session: Session) -> Session:
    """The counter is that of the last take at least, and what is selected is there."""
    numbers = _numbers(session)
    selected = session.selected if session.selected in numbers else LIVE
    return replace(session, counter=max(session.counter, *numbers, 0), selected=selected)


_RULES: dict[Any, tuple[tuple[str, Callable[[Any], bool]], ...]] = {  # what is wrong where it does not hold
    Session: (
        ("takes without numbers of their own", lambda s: len({LIVE, *_numbers(s)}) == len(s.takes) + 1),
        ("variants without end", lambda s: len(s.variants) <= MAX_VARIANTS),
    ),
    Take: (
        ("a take without a motion", lambda t: t.number == LIVE or t.motion is not None),
        ("edits without end", _few_edits),
        ("a rating", lambda t: 0 <= t.rating <= MAX_RATING),
        ("a frame number", lambda t: 0 <= t.numbered_from <= MAX_FRAMES),
        ("a trim that keeps nothing", lambda t: t.trim is None or t.trim[0] < t.trim[1]),
    ),
    FootplantEdit: (("a footplant of no foot or frames", _on_a_foot),),
    PromptBlend: (
        ("weights of a blend that are none", lambda b: len(b.weights) == len(PART_NAMES) and all(0.0 <= w <= 1.0 for w in b.weights)),
    ),
    Answer: (("an answer of no known source", lambda a: a.source in SOURCES),),
    PromptEvent: (
        ("words that are none", lambda e: not e.words or isinstance(parse_json(e.words), dict)),
        ("a transition that ends before it begins", lambda e: e.transition_seconds >= 0.0),
    ),
    MotionHeader: (
        ("a motion that no clip is", lambda h: 0.0 < h.fps <= MAX_FPS and h.frames <= MAX_FRAMES and MIN_SIZE <= h.size <= MAX_SIZE),
        ("a place of other numbers", lambda h: h.placed is None or len(h.placed) == 4),
    ),
    CharacterChoice: (
        ("a shape of no body", lambda c: c.shape.check() is None),
        ("files of a character outside their folder", lambda c: not c.key or safe_name(c.key)),
        ("a character of an unknown unit", lambda c: c.unit in ("", *NAMED_UNITS)),
    ),
}  # fmt: skip
_MENDED: dict[Any, Callable[[Any], Any]] = {
    Session: _mended_session,
    PromptBlend: lambda blend: replace(blend, locked=blend.locked & set(PART_NAMES)),
    Answer: lambda answer: replace(answer, nearest=answer.nearest[:MAX_NEAREST]),
}
