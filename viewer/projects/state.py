"""The projects room's slice of the state: which project is open, and what other sessions left."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from viewer.projects.autosave import LeftBehind


@dataclass
class ProjectsState:
    """What the project menu shows."""

    path: Path | None = None  # of the project that is open
    changed: bool = False  # since it was saved or opened
    left: list[LeftBehind] = field(default_factory=list)  # sessions that ended without saving, newest first

    @property
    def name(self) -> str:
        """What the menu calls the project."""
        return "Untitled" if self.path is None else self.path.stem

    @property
    def cut_off(self) -> LeftBehind | None:
        """The newest session that was killed; None without one."""
        return next((left for left in self.left if not left.ended), None)
