"""Everything the application knows about itself, as plain data: panels read it, actions change it."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from runtime.skeleton import PART_NAMES
from viewer.messages import Messages
from viewer.settings import Settings
from viewer.simulation import Simulation

if TYPE_CHECKING:
    from runtime.clip import Clip
    from runtime.terrain import Terrain
    from viewer.playback import Playback

FPS_HALF_LIFE_S = 0.5


@dataclass
class PromptState:
    """The prompt panel: what was typed, and what came back."""

    text: str = ""
    parts: dict[str, str] = field(default_factory=lambda: dict.fromkeys(PART_NAMES, ""))
    applied: dict[str, str] = field(default_factory=dict)  # the six descriptions the character moves by
    shown_prompt: str = ""  # what the character is blending to
    answered_by: str = ""  # "" before the first answer
    nearest: tuple[tuple[str, float], ...] = ()
    note: str = ""
    milliseconds: float = 0.0
    busy: bool = False
    available: bool = True  # False when the model could not be loaded
    search: str = ""
    ready: tuple[str, ...] = ()  # prompts to choose from
    focus_requested: bool = False


@dataclass
class SceneState:
    """The scene panel."""

    terrain_names: tuple[str, ...] = ()
    terrain_spec: str = ""  # name or path of the shown terrain
    file_path: str = ""  # the path field
    loading: str = ""  # what is being loaded, for the panel
    quality_names: tuple[str, ...] = ()
    quality: str = ""
    character: str = ""


@dataclass
class ClipItem:
    """One clip in the list; `saved` is where it was last exported to."""

    clip: Clip
    saved: Path | None = None
    recorded: bool = False  # here, not opened from a file

    @property
    def name(self) -> str:
        """The clip's name."""
        return self.clip.name


@dataclass
class ClipsState:
    """Recording, the clip list and what is played back."""

    items: list[ClipItem] = field(default_factory=list)
    selected: int = -1
    recording: bool = False
    recorded_s: float = 0.0
    memory_s: float = 0.0  # how much the rolling memory holds
    playback: Playback | None = None
    export_path: str = ""
    counter: int = 0  # for clip names

    @property
    def current(self) -> ClipItem | None:
        """The selected clip."""
        return self.items[self.selected] if 0 <= self.selected < len(self.items) else None


@dataclass
class Stats:
    """Smoothed times of a frame."""

    frame_ms: float = 0.0  # work of one frame, without waiting
    fps: float = 0.0

    def add(self, work_s: float, interval_s: float) -> None:
        """Take one frame's work and the time since the frame before, both in seconds."""
        if interval_s <= 0.0:
            return
        share = 1.0 if self.fps == 0.0 else 1.0 - 0.5 ** (interval_s / FPS_HALF_LIFE_S)
        self.frame_ms += (work_s * 1e3 - self.frame_ms) * share
        self.fps += (1.0 / interval_s - self.fps) * share


@dataclass
class AppState:
    """The one state of the application."""

    settings: Settings
    terrain: Terrain
    simulation: Simulation
    messages: Messages = field(default_factory=Messages)
    prompt: PromptState = field(default_factory=PromptState)
    scene: SceneState = field(default_factory=SceneState)
    clips: ClipsState = field(default_factory=ClipsState)
    stats: Stats = field(default_factory=Stats)
    model_name: str = ""  # "" while loading
    provider: str = ""
    device: str = "keyboard"  # name of the gamepad, or "keyboard"
    crouching: bool = False  # the toggle is on
    help_open: bool = False
    panels_open: bool = True
