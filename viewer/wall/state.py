"""The wall's slice of the state: who walks on it."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field

from viewer.prompt.style_edit import Side, StyleEdit

FEWEST, MOST = 2, 9


@dataclass
class Candidate:
    """One character of the wall: what it moves by."""

    number: int  # the same as long as the wall is open
    edit: StyleEdit
    seed: int
    text: str = ""  # of its field
    asked: bool = False  # its prompt has no answer yet

    @property
    def name(self) -> str:
        """Its prompt, or both of a blend."""
        a, b = (self.edit.prompt(side) or "own words" for side in Side)
        return f"{self.edit.master_weight:.0%} {b}, else {a}" if self.edit.blended else a


@dataclass
class WallState:
    """The wall is open while there are candidates."""

    candidates: list[Candidate] = field(default_factory=list)
    hovered: int = -1  # index of the candidate under the mouse
    focus_requested: bool = False

    @property
    def open(self) -> bool:
        """Whether the wall is shown in place of the walker."""
        return bool(self.candidates)

    @property
    def titles(self) -> list[str]:
        """What stands over each: its prompt, with the seed where others have the same."""
        return [name + seed for name, seed in self.names]

    @property
    def names(self) -> list[tuple[str, str]]:
        """The titles in two: the prompt, which may be cut, and what tells it from others of the same prompt."""
        names = Counter(candidate.name for candidate in self.candidates)
        return [(c.name, f", seed {c.seed}" if names[c.name] > 1 else "") for c in self.candidates]
