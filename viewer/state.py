"""The application's state as plain data: one slice for each room, which draws and changes it."""

from __future__ import annotations

from dataclasses import dataclass, field

from viewer.desk.state import DeskState
from viewer.messages import Messages
from viewer.prompt.state import PromptState
from viewer.settings import Settings
from viewer.shell import ShellState
from viewer.stage.state import StageState
from viewer.takes.state import TakesState
from viewer.wall.state import WallState


@dataclass
class AppState:
    """A record of the slices."""

    settings: Settings
    stage: StageState
    messages: Messages = field(default_factory=Messages)
    prompt: PromptState = field(default_factory=PromptState)
    takes: TakesState = field(default_factory=TakesState)
    wall: WallState = field(default_factory=WallState)
    shell: ShellState = field(default_factory=ShellState)
    desk: DeskState = field(default_factory=DeskState)
