"""What lies on a track of the timeline or in the list of takes, as the selection knows it."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from runtime.session.session import Session
from runtime.takes.input_edits import Edit, Span
from runtime.takes.input_recording import InputRecording

Key = tuple[str, Hashable, int]
TAKES, PINS = "takes", "pins"


@dataclass(frozen=True)
class Item(Span):
    """Frames of a track, or a point where start and end are the same; `value` is what lies there, `lane` where it lies."""

    kind: str
    value: Any = field(compare=False)
    lane: Hashable = ""

    @property
    def key(self) -> Key:
        """What the item is known by: where it lies, and from which frame on; a take by its number, a pin by its place."""
        return self.kind, self.lane, 0 if self.kind in (TAKES, PINS) else self.start

    def at(self, start: int, end: int) -> Item:
        """Return the item at other frames."""
        return replace(self, start=start, end=end)


@dataclass(frozen=True)
class Mark(Span):
    """Frames, or a point where start and end are the same; `of` is what it stands for, `item` what can be selected of it."""

    text: str = ""
    hint: str = ""
    of: Any = None
    item: Item | None = None


Items = Sequence[Item]


@dataclass(frozen=True)
class ItemKind:
    """What the selection has to know of the items of a track.

    An edit takes items `gone` away and puts others; of items that are moved both have the same length. `change` makes it to
    a take, by its number, and gives what was put with it; `edit` makes it to what drove the take, which is resimulated.
    """

    name: str  # of one, in the user's words
    items: Callable[[], Items]
    change: Callable[[Session, int, Items, Items], tuple[Session, Items]] | None = None
    edit: Callable[[InputRecording, Items, Items], Edit] | None = None
    # each ends where the next one begins, and the first and the last one with the take
    adjacent: bool = False
    listed: bool = False  # lies in a list, by its place, not on a track by its frame
