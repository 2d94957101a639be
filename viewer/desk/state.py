"""The desk's slice of the state: which of its windows are open."""

from __future__ import annotations

from dataclasses import dataclass, field

from viewer.exports.state import ExportState
from viewer.projects.state import ProjectsState


@dataclass
class DeskState:
    """What lies over the view."""

    projects: ProjectsState = field(default_factory=ProjectsState)
    settings_open: bool = False
    exports: ExportState = field(default_factory=ExportState)
